"""Two searches of the ranges with equal effort, which begin at the nearest of the same draws.

Damped least squares moves every smooth unknown at once, and leaves choices as the draw has them. CMA-ES moves
choices too, and copes with a misfit that a chattering torque makes rough.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tendonrepro.arrays import Array
from tendonrepro.monte_carlo.kept import Kept
from tendonrepro.monte_carlo.population import evolution


class Evaluated(NamedTuple):
    """Misfits (N,) and residuals (N, K) of the fitted numbers."""

    misfits: Array
    residuals: Array


Misfit: TypeAlias = Callable[[Array], Evaluated]
"""Of points of the unit cube, (N, P); finite."""

Rows: TypeAlias = NDArray[np.bool_]
"""Which rows of the box, (P,)."""

STABLE = 1.0
"""Misfit above which some run ended badly."""

_DIFFERENCE = 0.03
"""Difference of a slope, wide because encoder steps make the misfit rough."""

_DAMPINGS = np.geomspace(1e-3, 1e3, 10)
"""Of a step of least squares, all tried at once.

In the unit cube slopes of logarithms are about one; near the edge of stability only a small step ends well.
"""

_GAIN = 0.01
"""Least squares go to the next draw when a step has lowered the misfit by less than this share."""

_WIDTH = 0.1
"""First standard deviation of CMA-ES, a share of each range."""

_PATIENCE, _SETTLED = 15, 0.02
"""CMA-ES goes to the next draw when so many generations have lowered the misfit by less than this share."""


class UsedUp(Exception):
    """No points are left to look at."""


class SearchPoints:
    """At most so many points (N, `width`) to look at, kept on disk.

    However often interrupted, a search ends the same.
    """

    def __init__(
        self, misfit: Misfit, width: int, most: int, path: Path, progress: Callable[[int], None]
    ) -> None:
        self._kept = Kept(lambda points: np.column_stack(misfit(points)), path)
        self._width, self._progress, self.left = width, progress, most

    def __call__(self, points: Array) -> Evaluated:
        """Look at points, or find on disk what was seen there; at none where fewer are left."""
        if len(points) > self.left:
            raise UsedUp
        values = self._kept(points)
        self.left -= len(points)
        self._progress(len(points))
        return Evaluated(values[:, 0], values[:, 1:])

    @property
    def seen(self) -> tuple[Array, Array]:
        """Points that were looked at, (N, P), and their misfits, (N,); none if the first step is too long."""
        table = self._kept.table if len(self._kept.table) else np.empty((0, self._width + 1))
        return table[:, : self._width], table[:, self._width : self._width + 1].reshape(-1)


def least_squares(starts: Array, rows: Rows, smooth: Rows, look: SearchPoints, seed: int) -> None:
    """Damped least squares over the smooth ones of some rows, from one start (N, P) after the other."""
    del seed
    moved = np.flatnonzero(rows & smooth)
    with suppress(UsedUp):
        for start in starts if moved.size else ():
            _descend(start, moved, look)


def _descend(point: Array, moved: NDArray[np.int64], look: SearchPoints) -> None:
    """Go down from a point (P,) as long as steps gain; rows that do nothing there are asked once.

    Slopes are asked at the start, and again where a step by those that Broyden's rule updates gains nothing.
    """
    (misfit,), (residual,) = look(point[np.newaxis])
    slopes = None
    while True:
        updated, tried = slopes is not None, []
        if slopes is None:
            alone, widths = _moved_alone(point, moved)
            seen = look(alone)
            tried.append((alone, seen))
            slopes = (seen.residuals - residual) / widths[:, np.newaxis]
            # Where a run ends badly a slope says nothing.
            slopes[seen.misfits > max(STABLE, misfit)] = 0.0
            acting = np.any(slopes != 0.0, axis=1)
            moved, slopes = moved[acting], slopes[acting].T
            if not moved.size:
                return
        together = np.tile(point, (_DAMPINGS.size, 1))
        together[:, moved] += [_step(slopes, residual, point[moved], damping) for damping in _DAMPINGS]
        tried.append((together, look(together)))
        misfits = np.concatenate([seen.misfits for _, seen in tried])
        best = int(np.argmin(misfits))
        if misfits[best] >= (1.0 - _GAIN) * misfit:
            if not updated:
                return
            slopes = None
            continue
        nearest = np.vstack([points for points, _ in tried])[best]
        change = np.vstack([seen.residuals for _, seen in tried])[best] - residual
        step = (nearest - point)[moved]
        slopes = slopes + np.outer(change - slopes @ step, step) / (step @ step)
        point, misfit, residual = nearest, misfits[best], residual + change


def _moved_alone(point: Array, moved: NDArray[np.int64]) -> tuple[Array, Array]:
    """Points (F, P) with one row moved each, and how far (F,)."""
    widths = np.where(point[moved] + _DIFFERENCE <= 1.0, _DIFFERENCE, -_DIFFERENCE)
    points = np.tile(point, (moved.size, 1))
    points[np.arange(moved.size), moved] += widths
    return points, widths


def _step(slopes: Array, residual: Array, point: Array, damping: float) -> Array:
    """Damped step (F,) from a point within the unit cube."""
    damped = np.vstack([slopes, np.sqrt(damping) * np.eye(point.size)])
    wanted = np.concatenate([-residual, np.zeros(point.size)])
    step = lsq_linear(damped, wanted, bounds=(-point - 1e-9, 1.0 - point + 1e-9), method="bvls").x
    return np.asarray(np.clip(point + step, 0.0, 1.0) - point)


def cma_es(starts: Array, rows: Rows, smooth: Rows, look: SearchPoints, seed: int) -> None:
    """CMA-ES over some rows, choices among them, from one start (N, P) after the other.

    Each start has twice the population of the one before.
    """
    del smooth
    generator = np.random.default_rng(seed)
    population = 4 + int(3.0 * np.log(np.count_nonzero(rows)))
    with suppress(UsedUp):
        for start in starts:
            strategy, course = evolution(start[rows], _WIDTH, population, generator), list[float]()
            while not strategy.stop() and not _stands(course):
                asked = np.array(strategy.ask())
                points = np.tile(start, (len(asked), 1))
                points[:, rows] = asked
                misfits = look(points).misfits
                strategy.tell([*asked], misfits.tolist())
                course.append(min([*course[-1:], float(misfits.min())]))
            population *= 2


def _stands(course: list[float]) -> bool:
    return len(course) > _PATIENCE and course[-1] > (1.0 - _SETTLED) * course[-1 - _PATIENCE]


Search: TypeAlias = Callable[[Array, Rows, Rows, SearchPoints, int], None]
"""Looks at points from starts (N, P) on, moves some rows (P,) of which some are smooth, and has a seed."""

SEARCHES: Mapping[str, Search] = {"least squares": least_squares, "CMA-ES": cma_es}
"""What is tried, with equal effort."""
