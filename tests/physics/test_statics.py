"""Tensions against virtual work and segments of rope; courses give back the rope that Eq. (1) says."""

import numpy as np
import pytest
from support.oracles import TABLE_1, coupling_by_columns, path_length, random_routing, rope_used

from tendonrepro.physics.drive import coupling_inverse, coupling_matrix
from tendonrepro.physics.statics import (
    TENSIONER_SIDES,
    Spring,
    force_window,
    joint_positions,
    path_points,
    sign_of_side,
    slack_time,
    spring_force,
    tendon_path,
    tendon_tension,
    tension_with_losses,
    tensioner_side,
    tensioner_stretch,
    tensioner_torque,
)

SIDE = np.array([[1.0, -1.0, 1.0, -1.0], [0.0, 1.0, -1.0, -1.0], [0.0, 0.0, 1.0, -1.0]])
DIAMETER = np.array([[77.0, 35.0, 35.0, 35.0], [0.0, 77.0, 35.0, 35.0], [0.0, 0.0, 37.0, 37.0]]) / 1000.0
D = np.full(3, 0.037)
S = coupling_matrix(coupling_inverse(D, DIAMETER[:, :3], sign_of_side(SIDE[:, :3])))


def test_sides_of_section_2_2_give_the_signs_of_section_3_3():
    assert (sign_of_side(SIDE[:, :3]) == np.triu(TABLE_1.sign)).all()
    assert (sign_of_side(sign_of_side(SIDE[:, :3])) == SIDE[:, :3]).all()
    rope = (SIDE * DIAMETER).T[:3] / 2.0
    assert rope == pytest.approx(coupling_by_columns(TABLE_1) * 0.0185)


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_tension_does_the_work_of_the_joint_torque(n):
    """Rope drawn in by the winches, counted along each tendon, times tension is torque times angle."""
    rng = np.random.default_rng(n)
    routing = random_routing(n, rng)
    coupling = coupling_matrix(coupling_inverse(*routing))
    tau, angles = rng.normal(size=(n, 7)), rng.normal(size=n)
    tension = tendon_tension(tau, coupling, routing.winch)
    assert rope_used(angles, routing) @ tension == pytest.approx(angles @ tau, rel=1e-9)


def test_a_tendon_is_slack_from_a_sample_without_tension_to_the_next():
    time = np.array([0.0, 1.0, 3.0, 6.0])
    tension = np.array([[0.0, 5.0, -1.0, 0.0], [5.0, 1e-3, 5.0, -5.0]])
    assert (slack_time(time, tension) == [4.0, 0.0]).all()


class TestTensioner:
    def test_it_turns_the_last_joint_down_and_the_others_by_its_course(self):
        sides = {"negative": [-1, -1, -1], "distal_only": [0, 0, -1], "alternating": [-1, 1, -1]}
        assert sides.keys() == TENSIONER_SIDES.keys()
        for course, of_three in sides.items():
            for joints in (1, 2, 3):
                assert tensioner_side(course, joints).tolist() == of_three[-joints:]

    def test_force_is_that_of_its_work(self):
        rng = np.random.default_rng(3)
        turn = rng.normal(size=3)
        work = tensioner_torque(20.0, SIDE[:, 3], DIAMETER[:, 3]) @ turn
        assert work == pytest.approx(-20.0 * tensioner_stretch(turn, SIDE[:, 3], DIAMETER[:, 3]))
        assert (tensioner_torque(20.0, SIDE[:, 3], DIAMETER[:, 3]) < 0.0).all(), "it turns joints down"

    def test_a_spring_follows_its_length_and_never_pushes(self):
        stretch = np.array([-0.2, -0.1, 0.0, 0.1])
        assert spring_force(stretch, Spring(10.0, 80.0)) == pytest.approx([0.0, 2.0, 10.0, 18.0])
        assert spring_force(stretch, Spring(10.0, 0.0)) == pytest.approx(10.0)

    def test_window_is_where_every_tendon_pulls(self):
        """Also of a tendon to which the tensioner does nothing."""
        rng = np.random.default_rng(5)
        without, per_newton = rng.normal(size=(4, 200)), np.array([0.4, 0.0, -0.3, 1.0])
        without[1, 0] = 0.1
        least, largest = force_window(without, per_newton, 0.1)
        for force in np.linspace(0.0, 5.0, 23):
            tense = (without + per_newton[:, np.newaxis] * force >= 0.1).all(axis=0)
            assert (tense == ((least <= force) & (force <= largest))).all()
        unbounded = force_window(np.full((2, 3), 0.5), np.zeros(2))
        assert np.array_equal(unbounded, [np.zeros(3), np.full(3, np.inf)])


class TestLosses:
    def test_without_friction_it_is_virtual_work(self):
        tau = np.random.default_rng(1).normal(size=(3, 4, 5))
        net = tau - tensioner_torque(np.full((4, 5), 17.0), SIDE[:, 3], DIAMETER[:, 3])
        found = tension_with_losses(tau, 17.0 * np.ones((4, 5)), SIDE, DIAMETER, np.ones(4))
        assert found == pytest.approx(tendon_tension(net, S, D), rel=1e-12)

    def test_torques_of_every_segment_of_rope_balance(self):
        """Each joint holds its torque by the segments that pass it, weaker after every pulley."""
        tau, force, share = np.array([4.0, 2.0, 1.0]), 17.0, np.array([0.97, 1.03, 0.97, 0.97])
        tension = [*tension_with_losses(tau, force, SIDE, DIAMETER, share), force]
        for joint in range(3):
            held = 0.0
            for tendon in range(4):
                segment = tension[tendon] * share[tendon] ** joint
                held += SIDE[joint, tendon] * DIAMETER[joint, tendon] / 2.0 * segment
            assert held == pytest.approx(tau[joint], rel=1e-12)


WINCH = np.array([0.3, -0.4])


def path_of(tendon, q, routing, length, posture=0.8):
    """One tendon of an arm in the postures q (T, n)."""
    angle = posture + np.cumsum(q, axis=1)
    joints = joint_positions(length, angle)[:, : tendon + 1]
    centre = np.concatenate([np.broadcast_to(WINCH, (len(q), 1, 2)), joints], axis=1)
    side = sign_of_side(routing.sign)[: tendon + 1, tendon]
    radius = np.append(routing.winch[tendon], side * routing.pulley[: tendon + 1, tendon]) / 2.0
    # The tendon ends on its link, whose direction from hanging this is.
    return tendon_path(centre, radius, -np.pi / 2.0 - angle[:, tendon])


def sweep(n, seed):
    """A random arm in postures that follow each other, far beyond what any run bends."""
    rng = np.random.default_rng(seed)
    q = np.linspace(0.0, 1.0, 60)[:, np.newaxis] * rng.uniform(-4.0, 4.0, n)
    return q, random_routing(n, rng), rng.uniform(1.0, 2.0, n)


@pytest.mark.parametrize("seed", range(6))
def test_path_and_winch_share_one_length_of_rope(seed):
    """Eq. (1): with the motor where Eq. (1) has it, path and wound rope keep their sum."""
    q, routing, length = sweep(4, seed)
    for tendon in range(4):
        path = path_length(path_of(tendon, q, routing, length))
        assert path[0] - path == pytest.approx(rope_used(q.T, routing)[tendon], abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_tangents_touch_at_right_angles_on_their_side(seed):
    q, routing, length = sweep(4, seed)
    path = path_of(3, q, routing, length)
    for place in (0, 31, 59):
        way = np.array([np.cos(path.direction[place]), np.sin(path.direction[place])]).T
        right = np.column_stack([way[:, 1], -way[:, 0]])
        leaves = path.centre[place] + path.radius[:, np.newaxis] * right
        # The circle after it is met in the direction in which this one was left.
        meets = path.centre[place, 1:] + path.radius[1:, np.newaxis] * right[:-1]
        straight = meets - leaves[:-1]
        assert (straight * right[:-1]).sum(axis=1) == pytest.approx(0.0, abs=1e-12)
        assert ((straight * way[:-1]).sum(axis=1) > 0.0).all(), "forwards, not back"
        for spacing, share in ((1e-3, 1e-6), (None, 1e-3)):
            points = path_points(path, place, *filter(None, [spacing]))
            assert points[0] == pytest.approx(leaves[0])
            drawn = np.hypot(*np.diff(points, axis=0).T).sum()
            assert drawn == pytest.approx(path_length(path)[place], rel=share)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("tendon", range(4))
def test_it_ends_where_it_is_fixed(tendon, seed):
    """On its link, as far from the axis as the rope lies."""
    q, routing, length = sweep(4, seed)
    path, angle = path_of(tendon, q, routing, length), 0.8 + np.cumsum(q, axis=1)
    radius = routing.pulley[tendon, tendon] / 2.0
    for place in (0, 59):
        link = -np.array([np.sin(angle[place, tendon]), np.cos(angle[place, tendon])])
        assert path_points(path, place)[-1] == pytest.approx(path.centre[place, -1] + radius * link)


def test_a_chain_hangs_down_and_turns_clockwise_to_the_left():
    joints = joint_positions(np.array([1.0, 2.0]), np.array([0.0, np.pi / 2.0]))
    assert joints == pytest.approx(np.array([[0.0, 0.0], [0.0, -1.0], [-2.0, -1.0]]))


def test_a_tendon_lies_around_a_pulley_no_oftener_than_it_must():
    """Past a pulley that it only touches not at all, and elsewhere less than once in some posture."""
    touched = np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]])
    assert tendon_path(touched, np.full(3, 0.1), np.full(1, -np.pi / 2.0)).wrap == pytest.approx(
        0.0, abs=1e-12
    )
    for seed in range(6):
        q, routing, length = sweep(4, seed)
        assert (path_of(3, q, routing, length).wrap.min(axis=0) < 2.0 * np.pi).all()


def test_circles_that_overlap_are_refused():
    for apart in (0.1, 0.16):
        with pytest.raises(ValueError, match=r"^circles overlap$"):
            tendon_path(np.array([[[0.0, 0.0], [apart, 0.0]]]), np.array([0.08, -0.08]), np.zeros(1))
