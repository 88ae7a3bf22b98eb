"""Coupling as printed and as rope; dead zone and one way of a tendon; encoders, motors, the position loop."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import TABLE_1, Routing, coupling_by_columns, random_plant, random_routing, rope_used

from tendonrepro.physics.control import Servo, servo_torque
from tendonrepro.physics.drive import (
    Actuator,
    Drive,
    applied_torque,
    coupling_inverse,
    coupling_matrix,
    quantise,
    tendon_torque,
    theta_at_rest,
)

Array = NDArray[np.float64]

# Section 5.2 as printed: absolute values.
PRINTED_S = np.array([[0.4805, 0.0, 0.0], [0.2184, 0.4805, 0.0], [0.2479, 0.4545, 1.0]])
# Table 1, times 37.
PRINTED_RATIOS = np.array([[77.0, 0.0, 0.0], [35.0, 77.0, 0.0], [35.0, 35.0, 37.0]])

cases = given(st.integers(1, 6), st.integers(0, 2**32 - 1))
many = settings(max_examples=100, deadline=None)


def routing_of(n: int, seed: int) -> Routing:
    return random_routing(n, np.random.default_rng(seed))


def with_signs(c12: float, c13: float, c23: float) -> Routing:
    sign = np.eye(3)
    sign[0, 1], sign[0, 2], sign[1, 2] = c12, c13, c23
    return TABLE_1._replace(sign=sign)


class TestCoupling:
    @many
    @cases
    def test_equation_1_holds_row_by_row(self, n: int, seed: int) -> None:
        routing = routing_of(n, seed)
        q = np.random.default_rng(seed + 1).uniform(-2.0, 2.0, n)
        q_motor = coupling_inverse(*routing) @ q
        # A sum of n products of numbers up to about 10.
        assert routing.winch * q_motor / 2 == pytest.approx(rope_used(q, routing), abs=1e-14)

    @many
    @cases
    def test_S_and_S_inv_are_inverses_on_both_sides(self, n: int, seed: int) -> None:
        S_inv = coupling_inverse(*routing_of(n, seed))
        S = coupling_matrix(S_inv)
        # Rounding of a product is bounded by that of the absolute values; S itself carries it once more.
        bound = 4 * n * np.finfo(float).eps * np.abs(S) @ np.abs(S_inv) @ np.abs(S) @ np.abs(S_inv)
        assert (np.abs(S @ S_inv - np.eye(n)) <= bound).all()
        assert (np.abs(S_inv @ S - np.eye(n)) <= bound.max()).all()


class TestPrintedNumbers:
    """Section 5.2 and Table 1."""

    def test_table_1_is_the_inverse_coupling(self) -> None:
        assert 37.0 * np.abs(coupling_inverse(*TABLE_1)) == pytest.approx(PRINTED_RATIOS, rel=1e-15)

    def test_only_sign_patterns_of_product_minus_one_print_that_S(self) -> None:
        for signs in product([1.0, -1.0], repeat=3):
            S = coupling_matrix(coupling_inverse(*with_signs(*signs)))
            assert (np.abs(S).round(4).tolist() == PRINTED_S.tolist()) == (np.prod(signs) == -1.0)


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


class TestClearance:
    drive = one_winch(slack=0.02)

    def test_no_torque_inside_and_full_stiffness_beyond(self) -> None:
        stretch = np.array([-0.12, -0.03, -0.02, -0.005, 0.0, 0.015, 0.02, 0.03, 0.12])
        expected = [-5.0, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 5.0]
        assert pull(stretch, self.drive) == pytest.approx(expected, abs=1e-14)

    def test_damping_acts_throughout(self) -> None:
        damped = self.drive._replace(damping=np.array([3.0]))
        assert pull(np.array([0.0, 0.12]), damped, rate=2.0) == pytest.approx([6.0, 11.0], abs=1e-14)


class TestRest:
    def test_a_tendon_without_load_rests_in_the_middle_of_its_clearance(self) -> None:
        q = np.array([0.3])
        assert theta_at_rest(q, np.zeros(1), one_winch(slack=0.02)) == pytest.approx(q, rel=1e-15)
        assert theta_at_rest(q, np.array([5.0]), one_winch(slack=0.02)) == pytest.approx([0.42], rel=1e-15)
        assert theta_at_rest(q, np.array([-5.0]), one_winch(slack=0.02)) == pytest.approx([0.18], rel=1e-15)


S_INV = coupling_by_columns(TABLE_1)
S = np.linalg.inv(S_INV)
IDEAL = Actuator(limit=np.full(3, 1e6), resolution=0.0, noise=0.0, delay=0)

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
