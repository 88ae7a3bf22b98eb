"""Which rows of the box a search moves: those that bring the arm at hand nearest to the printed numbers.

One rule for every interpretation. It begins at the base's own arm. At each step it moves every row alone,
asks which one explains most of what is still missing, together with those chosen before, and goes there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tendonrepro.arrays import Array
from tendonrepro.identification.search import Evaluated, Misfit, Rows, held_unit
from tendonrepro.monte_carlo.box import Box

STEP = 0.25
"""How far a row is moved alone, and all of them together at a step, as a share of the range."""

_SHARES = (1.0, 0.5, 0.25)
"""Of a step that may be too far, what is tried."""

_GAIN = 0.01
"""A row that takes away less of what is left, as a share of the sum of squares, is not searched."""

_ENOUGH = 1e-3
"""Misfit below half the last printed digit, about 0.2 %: no further row is needed."""


@dataclass(frozen=True)
class _Moves:
    """Rows that are moved alone, (M,), to `points` (M, P) with `residuals` (M, K), from a point (P,)."""

    point: Array
    rows: NDArray[np.int64]
    points: Array
    residuals: Array


def rows_that_explain(box: Box, look: Misfit, most: int) -> Rows:
    """Choose at most `most` rows, (P,), one after the other, from the point at which every row is held.

    A row counts by what its change explains in a linear fit within the ranges, with the rows chosen before.
    One at least is chosen, and none any more that explains next to nothing.
    """
    point = held_unit(box)
    found = look(point[np.newaxis])
    misfit, here = float(found.misfits[0]), _worse(found)[0]
    chosen: list[int] = []
    while len(chosen) < most and not (chosen and misfit < _ENOUGH):
        moves = _moved_alone(box, point, look)
        others = [row for row in range(len(box.names)) if row not in chosen]
        without, _ = _fitted(moves, [held for held in chosen if not box.choices[held].size], here, point)
        steps = {row: _step(box, moves, here, chosen, row) for row in others}
        row = min(steps, key=lambda row: steps[row][0])
        left, target = steps[row]
        if chosen and left > (1.0 - _GAIN) * without:
            break
        chosen.append(row)
        tried = point + np.outer(_SHARES, target - point)
        if box.choices[row].size:
            tried[:, row] = target[row]
        found = look(tried)
        best = int(np.argmin(found.misfits))
        if found.misfits[best] < misfit:
            misfit, here, point = float(found.misfits[best]), _worse(found)[best], tried[best]
    return np.isin(np.arange(len(box.names)), chosen)


def _worse(found: Evaluated) -> Array:
    """Residuals (N, K), larger where a run ended badly, so that their size is the misfit."""
    size = np.sqrt(np.mean(found.residuals**2, axis=1))
    worse = np.maximum(found.misfits / np.maximum(size, np.finfo(float).tiny), 1.0)
    return np.asarray(found.residuals * worse[:, np.newaxis])


def _moved_alone(box: Box, point: Array, look: Misfit) -> _Moves:
    """Every row moved up and down, and every other choice."""
    rows, ends = zip(*_ends(box, point), strict=True)
    points = np.tile(point, (len(rows), 1))
    points[np.arange(len(rows)), rows] = ends
    return _Moves(point, np.array(rows), points, _worse(look(points)))


def _ends(box: Box, point: Array) -> Iterator[tuple[int, float]]:
    for row, choices in enumerate(box.choices):
        if choices.size:
            here = int(min(point[row] * choices.size, choices.size - 1))
            yield from ((row, (k + 0.5) / choices.size) for k in range(choices.size) if k != here)
        else:
            yield row, min(point[row] + STEP, 1.0)
            yield row, max(point[row] - STEP, 0.0)


def _step(box: Box, moves: _Moves, here: Array, chosen: list[int], row: int) -> tuple[float, Array]:
    """Sum of squares that is left with one more row, and where the linear fit has it."""
    ranges = [held for held in (*chosen, row) if not box.choices[held].size]
    if not box.choices[row].size:
        return _fitted(moves, ranges, here, moves.point)
    # A choice: each other word by what the ranges chosen before can make of it.
    found = [
        _fitted(moves, ranges, moves.residuals[k], moves.points[k]) for k in np.flatnonzero(moves.rows == row)
    ]
    return min(found, key=lambda held: held[0]) if found else (np.inf, moves.point)


def _fitted(moves: _Moves, rows: list[int], residuals: Array, point: Array) -> tuple[float, Array]:
    """Least squares over some ranges, within them and within a step."""
    if not rows:
        return float(residuals @ residuals), point
    slopes = np.stack([_slope(moves, row) for row in rows], axis=1)
    low, high = np.maximum(-point[rows], -STEP) - 1e-9, np.minimum(1.0 - point[rows], STEP) + 1e-9
    step = lsq_linear(slopes, -residuals, bounds=(low, high), method="bvls").x
    left = residuals + slopes @ step
    target = point.copy()
    target[rows] = np.clip(point[rows] + step, 0.0, 1.0)
    return float(left @ left), target


def _slope(moves: _Moves, row: int) -> Array:
    above, below = np.flatnonzero(moves.rows == row)
    width = moves.points[above, row] - moves.points[below, row]
    return np.asarray((moves.residuals[above] - moves.residuals[below]) / width)
