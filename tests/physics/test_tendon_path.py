"""Tendons as tangents and arcs: they touch at right angles, and give back the rope that Eq. (1) says."""

import numpy as np
import pytest
from support.oracles import path_length, random_routing, rope_used

from tendonrepro.physics.statics import joint_positions, path_points, sign_of_side, tendon_path

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


def test_circles_that_overlap_are_refused():
    for apart in (0.1, 0.16):
        with pytest.raises(ValueError, match=r"^circles overlap$"):
            tendon_path(np.array([[[0.0, 0.0], [apart, 0.0]]]), np.array([0.08, -0.08]), np.zeros(1))
