"""The types of the physics, and what numbers, arrays and symbols share: choices, and small systems."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Double-precision array; its shape and unit are stated where it is used.

While code is written for machines, it is an array of symbols instead, or of symbols and numbers.
"""


class Unknown(NDArrayOperatorsMixin):
    """A number not known yet, such as a symbol of a tape: what is done with it is written down."""

    name: str
    # Declared, never there: NumPy's annotations ask for it where its functions take an object.
    __array__: Callable[..., NDArray[Any]]


Numeric: TypeAlias = float | NDArray[Any] | Unknown
"""What the equations calculate with: a number, those of experiments side by side, or one not known yet.

What a comparison gives is a number, too: true, false, or a symbol that is 1 or 0.
"""

Part = TypeVar("Part", bound=Numeric)


def choose(condition: Numeric, then: Part, otherwise: Part) -> Part:
    """``then`` where the condition holds, else ``otherwise``; numbers or arrays, both computed already."""
    each: Any = np.where(condition, then, otherwise)
    chosen: Part = each[()]
    return chosen


def pick(values: Sequence[Array] | Array, place: Numeric) -> Array:
    """Entry at a place, from 0; experiments side by side may each have a place of their own."""
    if isinstance(place, int):
        return values[place]
    picked: Array = values[0]
    for k in range(1, len(values)):
        picked = choose(place >= float(k), values[k], picked)
    return picked


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
