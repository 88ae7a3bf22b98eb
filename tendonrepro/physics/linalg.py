"""Products and solutions of small systems that compile and run on lanes alike."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array


def times(A: Array, x: Array) -> Array:
    """Matrix (n, n) times vector (n, ...)."""
    product = np.zeros_like(x)
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            product[i] += A[i, j] * x[j]
    return product


def solve_positive_definite(A: Array, b: Array) -> Array:
    """Solve ``A x = b`` for symmetric and positive definite ``A`` (n, n, ...) and ``b`` (n, ...).

    By ``A = L D Lᵀ``, without square roots or a library call.
    """
    n = b.shape[0]
    # Below the diagonal L D, on it D.
    factor = np.empty_like(A)
    x = np.empty_like(b)
    for i in range(n):
        for j in range(i + 1):
            rest = A[i, j] + 0.0
            for k in range(j):
                rest = rest - factor[i, k] * factor[j, k] / factor[k, k]
            factor[i, j] = rest
    for i in range(n):
        rest = b[i] + 0.0
        for k in range(i):
            rest = rest - factor[i, k] * (x[k] / factor[k, k])
        x[i] = rest
    for i in range(n - 1, -1, -1):
        rest = x[i] + 0.0
        for k in range(i + 1, n):
            rest = rest - factor[k, i] * x[k]
        x[i] = rest / factor[i, i]
    return x
