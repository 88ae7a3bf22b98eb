"""Which rows of the box a search moves: those that bring the arm at hand nearest to the fitted numbers.

One rule for every interpretation. It begins at the base's own arm. At each step it moves every row alone,
asks which one explains most of what is still missing, together with those chosen before, and goes there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tendonrepro.arrays import Array
from tendonrepro.identification.search import Misfit, Rows, held_unit
from tendonrepro.monte_carlo.population import Population

STEP = 0.25
"""How far a row is moved alone, and all of them together at a step, as a share of the range."""

_SHARES = (1.0, 0.5, 0.25)
"""Of a step that may be too far, what is tried."""

_GAIN = 0.01
"""A row that takes away less of what is left, as a share of the sum of squares, is not searched."""

_MORE = 6
"""Rows that are chosen beyond those asked for, before the least of all go."""

_ENOUGH = 1e-3
"""Misfit below half the last printed digit, about 0.2 %: no further row is needed."""


class _Place(NamedTuple):
    """A point (P,), its residuals (K,), larger where a run ended badly, and its misfit."""

    point: Array
    residuals: Array
    misfit: float


class _Moves(NamedTuple):
    """Rows that are moved alone, (M,), to `points` (M, P) with `residuals` (M, K)."""

    rows: NDArray[np.int64]
    points: Array
    residuals: Array


class Chosen(NamedTuple):
    """Rows to search (P,), and the point (P,) at which choosing them ended: the others are held there."""

    rows: Rows
    point: Array


def rows_that_explain(box: Population, look: Misfit, most: int) -> Chosen:
    """Choose at most `most` of the box's free rows, (P,), from the point at which every row is held.

    Forwards, one after the other, a few more than asked for: each explains most of what is missing, with
    those chosen before, in a linear fit within the ranges. None is added that explains next to nothing.
    Backwards then: the one goes without which the others explain most.
    """
    resting, free = held_unit(box), np.flatnonzero(box.free).tolist()
    place = _nearest(look, resting[np.newaxis])
    chosen: list[int] = []
    while len(chosen) < min(most + _MORE, len(free)) and not (chosen and place.misfit < _ENOUGH):
        moves = _moved_alone(box, place.point, look, free)
        without, _ = _fitted(moves, _ranges(box, chosen), place.residuals, place.point)
        others = [row for row in free if row not in chosen]
        steps = {row: _step(box, moves, place, chosen, row) for row in others}
        row = min(steps, key=lambda row: steps[row][0])
        left, target = steps[row]
        if chosen and left > (1.0 - _GAIN) * without:
            break
        chosen.append(row)
        tried = place.point + np.outer(_SHARES, target - place.point)
        if box.rows[row].choices:
            tried[:, row] = target[row]
        place = min(place, _nearest(look, tried), key=lambda one: one.misfit)
    while len(chosen) > most:
        place = _without_the_least(box, look, place, chosen, resting)
    return Chosen(np.isin(np.arange(len(box.names)), chosen), place.point)


def _without_the_least(
    box: Population, look: Misfit, place: _Place, chosen: list[int], resting: Array
) -> _Place:
    """Take the row out of `chosen` that the others make up for best, and go where they do."""
    starts = np.tile(place.point, (len(chosen), 1))
    starts[np.arange(len(chosen)), chosen] = resting[chosen]
    residuals = look(starts).sized
    moves = _moved_alone(box, place.point, look, chosen)
    fits = [
        _fitted(moves, _ranges(box, [other for other in chosen if other != row]), residuals[k], starts[k])
        for k, row in enumerate(chosen)
    ]
    least = min(range(len(chosen)), key=lambda k: fits[k][0])
    del chosen[least]
    shares = (*_SHARES, 0.0)
    return _nearest(look, starts[least] + np.outer(shares, fits[least][1] - starts[least]))


def _nearest(look: Misfit, points: Array) -> _Place:
    """The best of some points (N, P)."""
    found = look(points)
    best = int(np.argmin(found.misfits))
    return _Place(points[best], found.sized[best], float(found.misfits[best]))


def _ranges(box: Population, rows: Iterable[int]) -> list[int]:
    return [row for row in rows if not box.rows[row].choices]


def _moved_alone(box: Population, point: Array, look: Misfit, rows: Iterable[int]) -> _Moves:
    """Some rows moved up and down, and every other choice of them."""
    moved, ends = zip(*_ends(box, point, rows), strict=True)
    points = np.tile(point, (len(moved), 1))
    points[np.arange(len(moved)), moved] = ends
    return _Moves(np.array(moved), points, look(points).sized)


def _ends(box: Population, point: Array, rows: Iterable[int]) -> Iterator[tuple[int, float]]:
    for row in rows:
        if count := len(box.rows[row].choices):
            here = int(min(point[row] * count, count - 1))
            yield from ((row, (k + 0.5) / count) for k in range(count) if k != here)
        else:
            yield row, min(point[row] + STEP, 1.0)
            yield row, max(point[row] - STEP, 0.0)


def _step(box: Population, moves: _Moves, place: _Place, chosen: list[int], row: int) -> tuple[float, Array]:
    """Sum of squares that is left with one more row, and where the linear fit has it."""
    ranges = _ranges(box, (*chosen, row))
    if not box.rows[row].choices:
        return _fitted(moves, ranges, place.residuals, place.point)
    # A choice: each other word by what the ranges chosen before can make of it.
    fits = [
        _fitted(moves, ranges, moves.residuals[k], moves.points[k]) for k in np.flatnonzero(moves.rows == row)
    ]
    return min(fits, key=itemgetter(0)) if fits else (np.inf, place.point)


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
