"""Search of the box by CMA-ES, which copes with choices and a rough misfit, and least squares."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.monte_carlo.kept import Kept
from tendonrepro.monte_carlo.population import Population, evolution


class Evaluated(NamedTuple):
    """Misfits (N,) and residuals (N, K) of the fitted numbers."""

    misfits: Array
    residuals: Array

    @property
    def sized(self) -> Array:
        """Residuals (N, K), larger where a run ended badly, so that their size is the misfit."""
        size = np.sqrt(np.mean(self.residuals**2, axis=1))
        worse = np.maximum(self.misfits / np.maximum(size, np.finfo(float).tiny), 1.0)
        return np.asarray(self.residuals * worse[:, np.newaxis])


Misfit: TypeAlias = Callable[[Array], Evaluated]
"""Of points of the unit cube, (N, P); finite."""

Rows: TypeAlias = NDArray[np.bool_]
"""Which rows of the box, (P,)."""

AGREED = 1.05
"""Largest ratio of the seeds' best misfits that counts as the same."""

_WIDTH = 0.25
"""First standard deviation of CMA-ES, so that all of the cube is within reach."""

_PATIENCE, _GAIN = 10, 0.02
"""CMA-ES has settled when so many generations have lowered the misfit by less than this share."""

_DIFFERENCE = 0.03
"""Half of the central difference of a slope; wide, because encoder counts make the misfit rough."""

_DESCENTS = 8
"""Slopes that are left to least squares when the plants run short; one takes two plants per unknown."""

_SETTLED = 1e-4
"""Relative change of cost or point at which least squares end."""

_SWITCHES = {
    "reducer_loss_acts": {"reducer_efficiency"},
    "disturbance": {"disturbance_torque", "disturbance_frequency"},
}
"""What a row switches where its name does not say it."""


@dataclass(frozen=True)
class SearchEffort:
    """How hard to search; seeds know nothing of each other."""

    generations: int
    population: int
    seeds: int

    @property
    def plants(self) -> int:
        """Points of each seed."""
        return (self.generations + 1) * self.population

    @property
    def evaluations(self) -> int:
        """Points at most; the best seed is polished."""
        return self.plants * (self.seeds + 1)


@dataclass(frozen=True)
class SearchResult:
    """Best points (S, P) and misfits (S,) of S seeds, and the closest, polished.

    `seen` (M, P) are all points that were looked at, with `seen_misfits` (M,).
    """

    closest: Array
    misfit: float
    points: Array
    misfits: Array
    seen: Array
    seen_misfits: Array

    @property
    def agree(self) -> bool:
        """Whether all seeds found the same misfit."""
        return bool(self.misfits.max() <= AGREED * self.misfits.min())


class _UsedUp(Exception):
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
        """Look at points, or find on disk what was seen there."""
        if len(points) > self.left:
            raise _UsedUp
        values = self._kept(points)
        self.left -= len(points)
        self._progress(len(points))
        return Evaluated(values[:, 0], values[:, 1:])

    @property
    def count(self) -> int:
        """How many were looked at."""
        return self._kept.count

    @property
    def seen(self) -> tuple[Array, Array]:
        """All points that were looked at, (N, P), and their misfits, (N,)."""
        table = self._kept.table
        return table[:, : self._width], table[:, self._width : self._width + 1].reshape(-1)

    def best(self, since: int = 0) -> tuple[float, Array]:
        """Smallest misfit since so many points, and its point (P,)."""
        points, misfits = self.seen
        row = since + int(np.argmin(misfits[since:]))
        return float(misfits[row]), points[row]


def search(
    starts: Array,
    rows: Rows,
    smooth: Rows,
    plants: Callable[[str], SearchPoints],
    effort: SearchEffort,
    seed: int,
    known: Array | None = None,
) -> SearchResult:
    """Search from M starts of each seed, and polish the best of them, or a known point if that is better.

    Parameters
    ----------
    starts : array (S, M, P)
    rows, smooth : array (P,) of bool
        What is moved, and what of it is no choice.
    plants : callable
        Gives the points of a search by its name.
    known : array (P,), optional
        A point that was found otherwise; no seed knows it.
    """
    best, looks = [], []
    for place, members in enumerate(starts):
        look, generator = plants(str(place)), np.random.default_rng([seed, place])
        order = np.argsort(look(members).misfits, kind="stable")
        with suppress(_UsedUp):
            for start in members[order]:
                _descend(_settled(start, rows, smooth, look, effort, generator), smooth, look)
        best.append(look.best())
        looks.append(look)
    closest = min(best, key=itemgetter(0))
    look = plants("best")
    if known is not None:
        look(known[np.newaxis])
        closest = min(closest, look.best(), key=itemgetter(0))
    with suppress(_UsedUp):
        _descend(closest[1], smooth, look)
    if look.count:
        closest = min(closest, look.best(), key=itemgetter(0))
        looks.append(look)
    misfits, points = (np.array(column) for column in zip(*best, strict=True))
    seen, seen_misfits = (np.concatenate(parts) for parts in zip(*(look.seen for look in looks), strict=True))
    return SearchResult(closest[1], closest[0], points, misfits, seen, seen_misfits)


def _settled(
    start: Array,
    rows: Rows,
    smooth: Rows,
    look: SearchPoints,
    effort: SearchEffort,
    generator: np.random.Generator,
) -> Array:
    """Best point of CMA-ES until it settles, or few plants are left."""
    population, reserve = effort.population // 2, _DESCENTS * 2 * int(smooth.sum())
    strategy = evolution(start[rows], _WIDTH, max(population, 4), generator)
    first = look.count
    course: list[float] = []
    while look.left > reserve + population and not strategy.stop() and not _stands(course):
        asked = strategy.ask()
        strategy.tell(asked, look(_moved(start, rows, np.array(asked))).misfits.tolist())
        course.append(look.best(first)[0])
    return look.best(first)[1] if course else start


def _stands(course: list[float]) -> bool:
    return len(course) > _PATIENCE and course[-1] > (1.0 - _GAIN) * course[-1 - _PATIENCE]


def _moved(start: Array, rows: Rows, values: Array) -> Array:
    """Points (N, P): a start (P,) with other values (N, F) of some rows."""
    points = np.tile(start, (len(values), 1))
    points[:, rows] = values
    return points


def _descend(start: Array, smooth: Rows, look: SearchPoints) -> None:
    """Least squares over the smooth unknowns; choices stay."""
    from scipy.optimize import least_squares

    def at(values: Array) -> Array:
        return look(_moved(start, smooth, values)).sized

    def residuals(values: Array) -> Array:
        return np.asarray(at(values[np.newaxis])[0])

    def slopes(values: Array) -> Array:
        ends = np.minimum(values + _DIFFERENCE, 1.0), np.maximum(values - _DIFFERENCE, 0.0)
        own = np.eye(values.size, dtype=np.bool_)
        above, below = np.split(at(np.concatenate([np.where(own, end, values) for end in ends])), 2)
        return np.asarray(((above - below) / (ends[0] - ends[1])[:, np.newaxis]).T)

    if smooth.any():
        least_squares(residuals, start[smooth], slopes, bounds=(0.0, 1.0), ftol=_SETTLED, xtol=_SETTLED)


def switched_by(name: str) -> set[str]:
    """Rows that do nothing where a choice is off or none."""
    return _SWITCHES.get(name, {name.removesuffix("_acts")})


def held_unit(box: Population) -> Array:
    """Unit-cube point (P,) nearest to the values that rows keep where they are not free."""
    low, high = box.low, box.high
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(box.nominal / low) / np.log(high / low)
        shares = (box.nominal - low) / (high - low)
    unit = np.where([row.scale == "log" for row in box.rows], logs, shares)
    for p, row in enumerate(box.rows):
        if row.choices:
            apart = np.abs(np.array(row.choices) - row.nominal)
            unit[p] = (int(np.argmin(apart)) + 0.5) / len(row.choices)
    # A user's arm may lie beyond the ranges.
    return np.asarray(np.clip(np.nan_to_num(unit), 0.0, 1.0))
