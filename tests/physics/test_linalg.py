from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tendonrepro.arrays import solve_positive_definite, times

Array = NDArray[np.float64]

cases = given(st.integers(1, 6), st.integers(0, 2**32 - 1))


def drawn(n: int, seed: int, lanes: tuple[int, ...] = ()) -> tuple[Array, Array]:
    """Positive definite matrices and right-hand sides, joint axes first."""
    rng = np.random.default_rng(seed)
    factor = rng.uniform(-1.0, 1.0, (n, n, *lanes))
    A = np.einsum("ik...,jk...->ij...", factor, factor) + 0.1 * np.eye(n).reshape(n, n, *[1] * len(lanes))
    return A, rng.uniform(-1.0, 1.0, (n, *lanes))


class TestTimes:
    @cases
    def test_is_the_matrix_product(self, n: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        A, x = rng.integers(-9, 10, (n, n)) * 1.0, rng.integers(-9, 10, n) * 1.0
        # Whole numbers, so nothing is rounded.
        assert (times(A, x) == A @ x).all()


class TestSolve:
    @settings(deadline=None)
    @cases
    def test_solution_leaves_only_rounding(self, n: int, seed: int) -> None:
        A, b = drawn(n, seed)
        x = solve_positive_definite(A, b)
        # Backward stability of Cholesky: the residual is of the size of A x rounded, n + 1 times over.
        bound = 4 * (n + 1) * np.finfo(float).eps * np.linalg.norm(A) * np.linalg.norm(x)
        assert np.linalg.norm(A @ x - b) <= bound

    @cases
    def test_only_the_lower_triangle_is_read(self, n: int, seed: int) -> None:
        A, b = drawn(n, seed)
        nonsense = A + np.triu(np.full((n, n), np.nan), 1)
        assert (solve_positive_definite(nonsense, b) == solve_positive_definite(A, b)).all()
