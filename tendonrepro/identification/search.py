"""Search of the box by CMA-ES, which copes with choices and a rough misfit, and least squares.

Before it, one rule for every interpretation says which rows are moved: those that bring the arm at hand
nearest to the fitted numbers. It begins at the base's own arm. At each step it moves every row alone, asks
which one explains most of what is still missing, together with those chosen before, and goes there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple, NotRequired, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tendonrepro.arrays import Array
from tendonrepro.files import Json
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


STEP = 0.25
"""How far a row is moved alone, and all of them together at a step, as a share of the range."""

_SHARES = (1.0, 0.5, 0.25)
"""Of a step that may be too far, what is tried."""

_EXPLAINS = 0.01
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
        if chosen and left > (1.0 - _EXPLAINS) * without:
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


class ParameterRow(TypedDict):
    """A row of the ranges on the best plant, and on the seeds' plants that come near."""

    name: str
    unit: str
    low: float
    high: float
    searched: bool
    choice: bool
    best: float | str
    at_bound: str | None
    plants: list[float | str]


class KnownRow(TypedDict):
    """What the numbers tell of a row that was searched; `value` is that of an arm of one's own."""

    name: str
    unit: str
    best: float | str
    lowest: float | str
    highest: float | str
    of_range: float
    determined: bool
    known: str
    value: NotRequired[float]
    value_unit: NotRequired[str]


class SearchAnswer(TypedDict):
    """The search of one reading; rows of `best_shape` and `numbers` have keys that name whose they are."""

    name: str
    search: str
    misfit_log: float
    misfit_rounding: float | None
    fits: bool
    near_limit: float
    near_count: int
    misfit_by_seed: list[float]
    seeds_agree: bool
    rows_searched: list[str]
    best_shape: list[Json]
    numbers: list[Json]
    parameters: list[ParameterRow]
    known: list[KnownRow]


def nearest_search(searches: Sequence[SearchAnswer]) -> SearchAnswer:
    """The reading that fits best."""
    return min(searches, key=lambda search: search["misfit_log"])
