from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.oracles import FEATURES, friction_by_formula, random_friction

from tendonrepro.physics.loads import Friction, friction_torque

velocities = st.floats(-1e3, 1e3)
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int) -> Friction:
    return random_friction(1, np.random.default_rng(seed), 1.0, FEATURES)


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
