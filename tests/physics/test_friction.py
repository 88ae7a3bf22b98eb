from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.oracles import friction_by_formula, random_friction, slope

from tendonrepro.physics.friction import Friction, friction_torque, without_dry_friction

ALL = frozenset({"viscous", "coulomb", "stribeck"})
SPEEDS = np.concatenate([[0.0], np.geomspace(1e-6, 1e3, 400)])

velocities = st.floats(-1e3, 1e3)
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, features: frozenset[str] = ALL) -> Friction:
    return random_friction(1, np.random.default_rng(seed), 1.0, features)


def torque_at(velocity: float, friction: Friction) -> float:
    return float(friction_torque(np.array([velocity]), friction)[0])


class TestLaw:
    @given(velocities, seeds)
    def test_odd_and_never_driving(self, velocity: float, seed: int) -> None:
        friction = drawn(seed)
        torque = torque_at(velocity, friction)
        assert torque_at(-velocity, friction) == -torque
        assert torque * velocity >= 0.0

    @given(velocities, seeds)
    def test_formula(self, velocity: float, seed: int) -> None:
        expected = friction_by_formula(np.array([velocity]), drawn(seed))[0]
        assert torque_at(velocity, drawn(seed)) == pytest.approx(expected, rel=1e-14)

    @given(seeds)
    def test_without_a_static_ratio_it_only_rises(self, seed: int) -> None:
        friction = drawn(seed, ALL - {"stribeck"})
        torque = np.array([torque_at(speed, friction) for speed in SPEEDS])
        assert (np.diff(torque) >= 0.0).all()
        assert (torque <= (friction.coulomb + friction.viscous * SPEEDS) * (1.0 + 1e-15)).all()

    @given(seeds)
    def test_smooth_through_standstill(self, seed: int) -> None:
        friction = drawn(seed)
        steepness = slope(lambda v: friction_torque(v, friction), np.array([0.0]), np.array([1.0]))
        expected = friction.viscous + friction.static_ratio * friction.coulomb / friction.smoothing_velocity
        assert steepness == pytest.approx(expected, rel=1e-13)


def test_each_joint_has_its_own_law_and_lanes_are_independent() -> None:
    rng = np.random.default_rng(1)
    friction = random_friction(3, rng, 1.0, ALL)
    velocity = rng.uniform(-1.0, 1.0, (3, 37))
    together = friction_torque(velocity, friction)
    for i in range(3):
        own = Friction(*(values[i : i + 1] for values in friction))
        assert together[i].tolist() == [torque_at(v, own) for v in velocity[i]]


@pytest.mark.parametrize("features", [ALL, frozenset({"viscous"})], ids=["all", "viscous"])
def test_without_dry_friction_the_viscous_part_remains(features: frozenset[str]) -> None:
    friction = random_friction(2, np.random.default_rng(1), 1.0, features)
    velocity = np.array([0.3, -0.7])
    assert (friction_torque(velocity, without_dry_friction(friction)) == friction.viscous * velocity).all()
