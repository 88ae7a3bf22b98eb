from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.oracles import (
    FEATURES,
    Subject,
    random_plant,
    random_state,
    slope,
    stretch_energy,
    winch_angles,
)

from tendonrepro.physics.drive import (
    Drive,
    tendon_torque,
    theta_at_rest,
    to_joint_torque,
    to_winch_angle,
    to_winch_torque,
    winch_friction,
)

Array = NDArray[np.float64]

each = pytest.mark.parametrize(("n", "seed"), [(1, 0), (2, 1), (2, 2), (3, 3), (3, 4)])

# Sums of a handful of products whose factors are up to about a hundred.
ROUNDING = {"rel": 1e-11, "abs": 1e-11}


def drawn(n: int, seed: int, features: frozenset[str]) -> tuple[Subject, Array, Array, Array, Array]:
    state = random_state(n, np.random.default_rng([n, seed, 1]))
    return random_plant(n, seed, features), *np.split(state, 4)


def one_winch(**changes: float) -> Drive:
    """Single tendon of stiffness 50 and no other feature, unless changed."""
    drive = random_plant(1, 0, frozenset()).plant.drive
    plain = drive._replace(S=np.eye(1), S_inv=np.eye(1), stiffness=np.array([50.0]))
    return plain._replace(**{name: np.array([value]) for name, value in changes.items()})


def pull(stretch: Array, drive: Drive, rate: float = 0.0) -> Array:
    """Torque of the single tendon at given stretches, the joint held at zero."""
    at = np.atleast_2d(stretch)
    return tendon_torque(0.0 * at, 0.0 * at, at, 0.0 * at + rate, drive)[0]


@pytest.mark.parametrize("one_way", [0.0, 1.0])
def test_a_tendon_that_only_pulls_has_no_torque_where_it_would_push(one_way: float) -> None:
    stretch = np.array([-0.02, -0.001, 0.0, 0.001, 0.02])
    both = pull(stretch, one_winch(one_way=0.0))
    assert (both[:2] < 0.0).all()
    found = pull(stretch, one_winch(one_way=one_way))
    assert found == pytest.approx(np.maximum(both, 0.0) if one_way else both, abs=0.0)


@each
class TestCoordinates:
    def test_winch_angles_take_up_the_rope(self, n: int, seed: int) -> None:
        subject, q, *_ = drawn(n, seed, FEATURES)
        assert to_winch_angle(q, subject.plant.drive) == pytest.approx(
            winch_angles(q, subject.routing), **ROUNDING
        )

    def test_power_is_the_same_at_winches_and_joints(self, n: int, seed: int) -> None:
        """Virtual work."""
        subject, rate, torque, *_ = drawn(n, seed, FEATURES)
        drive = subject.plant.drive
        at_winches = to_winch_torque(torque, drive) @ to_winch_angle(rate, drive)
        assert at_winches == pytest.approx(torque @ rate, **ROUNDING)


@each
@pytest.mark.parametrize("features", [frozenset(), frozenset({"clearance"})], ids=["tight", "clearance"])
def test_elastic_torque_is_the_slope_of_the_stretch_energy(
    n: int, seed: int, features: frozenset[str]
) -> None:
    subject, q, dq, theta, _ = drawn(n, seed, features)
    drive = subject.plant.drive
    tau_s = to_joint_torque(tendon_torque(q, dq, theta, dq, drive), drive)
    for i, axis in enumerate(np.eye(n)):
        by_motor = slope(lambda at: stretch_energy(q + 0j, at, subject), theta, axis)
        by_joint = slope(lambda at: stretch_energy(at, theta + 0j, subject), q, axis)
        assert tau_s[i] == pytest.approx(by_motor, **ROUNDING)
        assert tau_s[i] == pytest.approx(-by_joint, **ROUNDING)


class TestClearance:
    drive = one_winch(slack=0.02)

    def test_no_torque_inside_and_full_stiffness_beyond(self) -> None:
        stretch = np.array([-0.12, -0.03, -0.02, -0.005, 0.0, 0.015, 0.02, 0.03, 0.12])
        expected = [-5.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 5.0]
        assert pull(stretch, self.drive) == pytest.approx(expected, abs=1e-14)

    def test_damping_acts_throughout(self) -> None:
        damped = self.drive._replace(damping=np.array([3.0]))
        assert pull(np.array([0.0, 0.12]), damped, rate=2.0) == pytest.approx([6.0, 11.0], abs=1e-14)


class TestTransmissionError:
    @each
    def test_damping_sees_the_rate_of_what_stiffness_sees(self, n: int, seed: int) -> None:
        subject, q, dq, theta, dtheta = drawn(n, seed, frozenset({"damping", "wobble"}))
        drive = subject.plant.drive
        elastic = drive._replace(damping=0.0 * drive.damping)
        damped = drive._replace(stiffness=0.0 * drive.stiffness)

        def stretch(at: Array) -> Array:
            return tendon_torque(at[0], 0.0 * at[0], at[1], 0.0 * at[1], elastic) / drive.stiffness

        rate = slope(stretch, np.array([q, theta]), np.array([dq, dtheta]))
        got = tendon_torque(q, dq, theta, dtheta, damped) / drive.damping
        assert got == pytest.approx(rate, **ROUNDING)

    def test_amplitude_and_cycles_per_turn(self) -> None:
        drive = one_winch(wobble=1e-3, wobble_rate=200.0)
        turn = np.linspace(0.0, 2.0 * np.pi, 4001)[:-1]
        still = np.atleast_2d(turn)
        # The joint follows the winch, so what is left is the error alone.
        error = tendon_torque(still, 0.0 * still, still, 0.0 * still, drive)[0] / 50.0
        spectrum = np.abs(np.fft.rfft(error)) / 2000.0
        assert spectrum.argmax() == 200
        assert spectrum[200] == pytest.approx(1e-3, rel=1e-9)


class TestWinchFriction:
    def test_pulleys_and_reducer_lose_their_share_against_the_motion(self) -> None:
        drive = one_winch(pulley_loss=0.1, reducer_loss=0.3)
        # At 10 rad/s the smoothed sign is 1 to rounding.
        for rate, sense in ((10.0, 1.0), (-10.0, -1.0)):
            for tendon, motor, lost in ((4.0, 0.0, 0.4), (-4.0, 0.0, 0.4), (0.0, 2.0, 0.6), (4.0, -2.0, 1.0)):
                got = winch_friction(np.array([rate]), np.array([tendon]), np.array([motor]), drive)
                assert got == pytest.approx([sense * lost], rel=1e-14)


class TestRest:
    def test_a_tendon_without_load_rests_in_the_middle_of_its_clearance(self) -> None:
        q = np.array([0.3])
        assert theta_at_rest(q, np.zeros(1), one_winch(slack=0.02)) == pytest.approx(q, rel=1e-15)
        assert theta_at_rest(q, np.array([5.0]), one_winch(slack=0.02)) == pytest.approx([0.42], rel=1e-15)
        assert theta_at_rest(q, np.array([-5.0]), one_winch(slack=0.02)) == pytest.approx([0.18], rel=1e-15)
