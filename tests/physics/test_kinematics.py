from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import TABLE_1, Routing, random_routing, rope_used

from tendonrepro.physics.drive import coupling_inverse, coupling_matrix

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


def S_of_table_1() -> Array:
    return coupling_matrix(coupling_inverse(*TABLE_1))


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

    def test_S_in_exact_fractions(self) -> None:
        S21 = Fraction(35 * 37, 77 * 77)
        S32 = Fraction(35, 77)
        S31 = -Fraction(35, 77) + Fraction(35, 37) * S21
        exact = [[Fraction(37, 77), 0, 0], [S21, Fraction(37, 77), 0], [S31, S32, 1]]
        # One rounding per operation of the forward substitution.
        assert S_of_table_1() == pytest.approx(np.array(exact, dtype=float), abs=4e-16)

    def test_only_sign_patterns_of_product_minus_one_print_that_S(self) -> None:
        for signs in product([1.0, -1.0], repeat=3):
            S = coupling_matrix(coupling_inverse(*with_signs(*signs)))
            assert (np.abs(S).round(4).tolist() == PRINTED_S.tolist()) == (np.prod(signs) == -1.0)
