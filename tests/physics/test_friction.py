from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.oracles import friction_by_formula, random_friction

from tendonrepro.physics.friction import Friction, friction_torque, without_dry_friction

ALL = frozenset({"viscous", "coulomb", "stribeck"})

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
