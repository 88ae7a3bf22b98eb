"""Encoders, actuators and the motors' position loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import TABLE_1, coupling_by_columns

from tendonrepro.physics.control import Servo, servo_torque
from tendonrepro.physics.instruments import Actuator, applied_torque, quantise

Array = NDArray[np.float64]

S_INV = coupling_by_columns(TABLE_1)
S = np.linalg.inv(S_INV)
IDEAL = Actuator(limit=np.full(3, 1e6), resolution=0.0, noise=0.0, delay=0)

angles = st.floats(-100.0, 100.0)
steps = st.floats(1e-4, 1.0)
torques = st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3).map(np.array)


def counts(value: float, step: float) -> float:
    return float(quantise(np.array(value), step))


def at_winches(torque: Array) -> Array:
    return S.T @ torque


class TestQuantise:
    @pytest.mark.parametrize(
        ("value", "expected"), [(0.49, 0.0), (0.5, 1.0), (1.5, 2.0), (-0.5, 0.0), (-0.51, -1.0), (-1.5, -1.0)]
    )
    def test_halves_go_upwards(self, value: float, expected: float) -> None:
        assert counts(value, 1.0) == expected
        assert counts(0.25 * value, 0.25) == 0.25 * expected

    @given(angles, steps)
    def test_error_is_at_most_half_a_count(self, value: float, step: float) -> None:
        # The quotient and the product of up to 1e6 counts are rounded.
        assert abs(counts(value, step) - value) <= 0.5 * step + 4.0 * np.spacing(abs(value))


class TestActuator:
    @given(torques)
    def test_each_winch_is_limited_by_itself(self, command: Array) -> None:
        limit = np.array([3.0, 4.0, 5.0])
        applied = applied_torque(command, IDEAL._replace(limit=limit), S, S_INV)
        expected = np.clip(at_winches(command), -limit, limit)
        # Two 3 x 3 products of numbers below 100.
        assert at_winches(applied) == pytest.approx(expected, abs=1e-12)

    @given(torques)
    def test_winch_torques_are_whole_steps(self, command: Array) -> None:
        applied = applied_torque(command, IDEAL._replace(resolution=0.25), S, S_INV)
        steps_taken = at_winches(applied) / 0.25
        assert steps_taken == pytest.approx(np.round(steps_taken), abs=1e-11)
        assert np.abs(at_winches(applied) - at_winches(command)).max() <= 0.125 + 1e-12

    def test_rounding_cannot_push_a_winch_beyond_its_limit(self) -> None:
        limited = IDEAL._replace(limit=np.full(3, 2.0), resolution=0.3)
        command = S_INV.T @ np.array([2.3, -2.3, 0.1])
        applied = applied_torque(command, limited, S, S_INV)
        assert at_winches(applied) == pytest.approx([2.0, -2.0, 0.0], abs=1e-14)


def test_servo_knows_joints_by_their_coupling_alone() -> None:
    """Winches follow ``S_inv q_d``, and their torques act on joints through its transpose."""
    servo = Servo(np.array([10.0, 20.0]), np.array([1.0, 2.0]), np.array([[2.0, 0.0], [-1.0, 3.0]]), 0.5)
    here, before = np.array([0.1, 0.2]), np.array([0.0, 0.3])
    torque = servo_torque(here, before, np.array([0.1, 0.2]), np.array([0.3, 0.0]), servo)
    winch = [10.0 * (0.2 - 0.1) + 1.0 * (0.6 - 0.2), 20.0 * (0.5 - 0.2) + 2.0 * (-0.3 + 0.2)]
    assert torque == pytest.approx([2.0 * winch[0] - winch[1], 3.0 * winch[1]])
