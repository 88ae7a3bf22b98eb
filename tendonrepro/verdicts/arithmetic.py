"""What follows from the printed numbers alone: matrices, percentages and signs, with exact fractions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import (
    SIGN,
    PrintedNumber,
    Published,
    exact,
)
from tendonrepro.physics.kinematics import coupling_inverse

Bounds: TypeAlias = tuple[Fraction | float, Fraction | float]


def meets(first: Bounds, second: Bounds) -> bool:
    """Whether two intervals share a number, ends included."""
    return first[0] <= second[1] and second[0] <= first[1]


def cut(value: Fraction, printed: PrintedNumber) -> str:
    """How a value became the printed number: ``rounded``, ``cut off``, either way, or ``neither``."""
    scale = 10**printed.decimals
    goal = exact(printed) * scale
    ways = {"rounded": math.floor(value * scale + Fraction(1, 2)), "cut off": math.trunc(value * scale)}
    return " or ".join(way for way, found in ways.items() if found == goal) or "neither"


def printed_inverse(paper: Published) -> list[list[Fraction]]:
    """``S_inv`` as printed, lower triangular, with the signs of Eq. (2) and section 3.3."""
    rows = []
    for n in range(3):
        row = [exact(paper.quantity(f"S_inv.{n + 1}{i + 1}")) for i in range(n + 1)]
        rows.append([(1 if i == n else -1) * int(SIGN[i, n]) * x for i, x in enumerate(row)])
    return rows


def inverse(lower: Sequence[Sequence[Fraction]]) -> list[list[Fraction]]:
    """Inverse of a lower-triangular matrix given by its rows up to the diagonal, in the same form."""
    rows: list[list[Fraction]] = []
    for n, row in enumerate(lower):
        before = [-sum((row[k] * rows[k][i] for k in range(i, n)), Fraction(0)) / row[n] for i in range(n)]
        rows.append([*before, 1 / row[n]])
    return rows


def slopes_of_coupling(ratio: Array) -> tuple[Array, Array]:
    """Change of the magnitudes below the diagonal of ``S_inv``, 21, 31, 32, when a diameter grows by 1 %.

    For a larger winch ``D[n]``, and for larger guide pulleys ``D[i, n]``; `ratio` is that of `table_1`.
    """
    below = np.tril_indices(3, -1)
    sizes = [
        np.abs(coupling_inverse(np.full(3, winch), ratio * pulley, SIGN)[below])
        for winch, pulley in ((1.0, 1.0), (1.01, 1.0), (1.0, 1.01))
    ]
    return sizes[1] - sizes[0], sizes[2] - sizes[0]
