"""Search of the unit cube: a population that spreads, then CMA-ES and least squares; kept on disk.

Where plants are judged, differential evolution spreads first: a member whose misfit is below the tolerance is
as good as it needs to be, and walks at random among plants that are. Half of the trials are no differences of
members but follow the regression of the population on its residuals, which finds a few numbers among many
unknowns far sooner and leaves what they do not depend on as spread as it was.

The closest plant is found by CMA-ES, which copes with choices and a rough misfit, and least squares from
where it settles, again from the next start until the plants are used up. docs/ensemble.md says what else
was tried.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.console import Talk
from tendonrepro.files import write_atomically


class Evaluated(NamedTuple):
    """Misfits (N,) of N points, and residuals (N, K): the deviation of each fitted number.

    They are smooth in the unknowns where the misfit is small.
    """

    misfits: Array
    residuals: Array


Misfit: TypeAlias = Callable[[Array], Evaluated]
"""Misfit of many points of the unit cube at once, (N, F); finite."""

AGREED = 1.05
"""Largest ratio of the seeds' best misfits that counts as the same."""

SPREADING = 0.75
"""Share of the generations that spread where plants are judged."""

_FACTOR = (0.1, 0.7)
# Shares of the rows that a trial takes from the mutant: few rows find what a thin valley allows, many what
# needs several rows at once.
_CROSSED = (0.1, 0.3, 0.9)
_REGRESSED = 0.5
_STEP = (0.5, 1.0)

_WIDTH = 0.25
"""First standard deviation of CMA-ES: a quarter of the cube, so that all of it is within reach."""

_PATIENCE, _GAIN = 10, 0.02
"""CMA-ES has settled when so many generations have lowered the misfit by less than this share."""

_DIFFERENCE = 0.03
"""Half of the central difference of a slope; wide, because encoder counts make the misfit rough."""

_DESCENTS = 8
"""Slopes that are left to least squares when the plants run short; one takes two plants per unknown."""

_SETTLED = 1e-4
"""Relative change of cost or point at which least squares end."""


@dataclass(frozen=True)
class Effort:
    """How hard to search: generations of a population of at least 5, by so many seeds.

    Seeds know nothing of each other. A misfit up to `tolerance` is good enough while spreading. The
    residuals depend smoothly on those unknowns, of all F, that are `smooth`; choices are none. It `spreads`
    where near-optimal plants are wanted, not only the closest one.
    """

    generations: int
    population: int
    seeds: int
    tolerance: float
    smooth: tuple[bool, ...]
    spreads: bool = True

    @property
    def spreading(self) -> int:
        """Generations that spread."""
        return int(np.ceil(SPREADING * self.generations)) if self.spreads else 0

    @property
    def plants(self) -> int:
        """Points that each seed looks at."""
        return (self.generations + 1) * self.population

    @property
    def evaluations(self) -> int:
        """Points looked at in all, at most: the last so many polish the best seed's."""
        return self.plants * (self.seeds + 1)


@dataclass(frozen=True)
class Found:
    """What S seeds found.

    The `closest` point (F,) of all, polished, and its misfit; members (S, M, F) of each population when it
    had spread, and their misfits (S, M); `history` (generations + 1, S) has the smallest misfit after each
    so many plants.
    """

    closest: Array
    misfit: float
    spread_units: Array
    spread_misfits: Array
    history: Array

    def near(self, limit: float) -> Array:
        """Members that had spread with a misfit up to a limit, (N, F)."""
        return self.spread_units[self.spread_misfits <= limit]

    def agree(self, tolerance: float) -> bool:
        """Whether all seeds have come to the same misfit, or all below a tolerance."""
        best = self.history[-1]
        return bool(best.max() <= max(AGREED * best.min(), tolerance))


def search(
    initial: Array,
    misfit: Misfit,
    effort: Effort,
    seed: int,
    path: Path,
    identity: str,
    talk: Talk,
    progress: Callable[[int], None] = lambda _: None,
) -> Found:
    """Search from first members (S, M, F).

    What was looked at is kept beside `path`, a file for each seed, and not looked at again where `identity`,
    a digest of all that the search depends on, is the same. However often interrupted, it ends the same to
    the last bit.
    """

    def memory_of(name: object) -> _Memory:
        file = path.with_name(f"{path.stem}-{name}{path.suffix}")
        return _Memory(misfit, effort.plants, file, identity, talk, progress)

    found = []
    for place, members in enumerate(initial):
        memory = memory_of(place)
        spread = _search(members, memory, effort, np.random.default_rng([seed, place]))
        # What was left was too little for one more slope or generation.
        progress(memory.left)
        course = np.minimum.accumulate(memory.kept.misfits[: memory.count])
        ends = np.minimum(np.arange(1, effort.generations + 2) * effort.population, memory.count) - 1
        found.append((memory.best(), spread, course[ends]))
    best, spreads, history = zip(*found, strict=True)
    point, size = min(best, key=lambda held: float(held[1]))
    memory, smooth = memory_of("best"), np.array(effort.smooth)
    if smooth.any():
        with suppress(_UsedUp):
            _descend(point, smooth, memory)
        point, size = min((point, size), memory.best(), key=lambda held: float(held[1]))
    progress(memory.left)
    units, misfits = (np.stack(column) for column in zip(*spreads, strict=True))
    return Found(point, size, units, misfits, np.stack(history).T)


class _UsedUp(Exception):
    """No plants are left to look at."""


class _Memory:
    """Misfit of a number of points, in their order, and on disk."""

    def __init__(
        self,
        misfit: Misfit,
        plants: int,
        path: Path,
        identity: str,
        talk: Talk,
        progress: Callable[[int], None],
    ) -> None:
        self._misfit, self._path, self._identity, self._progress = misfit, path, identity, progress
        self.left, self.count = plants, 0
        self.units, self.kept = _remembered(path, identity, talk) or (
            np.empty((0, 0)),
            Evaluated(np.empty(0), np.empty((0, 0))),
        )

    def __call__(self, points: Array) -> Evaluated:
        if len(points) > self.left:
            raise _UsedUp
        asked = slice(self.count, self.count + len(points))
        if not np.array_equal(self.units[asked], points):
            self._look(points)
        self.count += len(points)
        self.left -= len(points)
        self._progress(len(points))
        return Evaluated(*(held[asked] for held in self.kept))

    def best(self) -> tuple[Array, float]:
        """Best point that was asked for (F,), and its misfit."""
        place = int(np.argmin(self.kept.misfits[: self.count]))
        return self.units[place], float(self.kept.misfits[place])

    def _look(self, points: Array) -> None:
        found = self._misfit(points)
        if self.count:
            before = self.units, *self.kept
            pairs = zip(before, (points, *found), strict=True)
            points, *found = (np.concatenate([old[: self.count], new]) for old, new in pairs)  # type: ignore[assignment]
        self.units, self.kept = points, Evaluated(*found)
        save_arrays(self._path, self._identity, units=points, **self.kept._asdict())


def _remembered(path: Path, identity: str, talk: Talk) -> tuple[Array, Evaluated] | None:
    stored = load_arrays(path, identity, talk)
    if stored is None:
        return None
    return stored["units"], Evaluated(stored["misfits"], stored["residuals"])


def _search(
    members: Array, look: _Memory, effort: Effort, generator: np.random.Generator
) -> tuple[Array, Array]:
    """One seed's members (M, F) when they had spread, and their misfits; all else is in the memory."""
    found = look(members)
    for _ in range(effort.spreading):
        members, found = _step(members, found, look, effort, generator)
    smooth = np.array(effort.smooth)
    reserve = _DESCENTS * 2 * int(smooth.sum())
    with suppress(_UsedUp):
        for place in np.argsort(found.misfits, kind="stable"):
            start = _settled(members[place], look, effort.population // 2, reserve, generator)
            if smooth.any():
                _descend(start, smooth, look)
    return members, found.misfits


def _step(
    units: Array, held: Evaluated, look: Misfit, effort: Effort, generator: np.random.Generator
) -> tuple[Array, Evaluated]:
    """One generation of a population that spreads."""
    trials = _trials(units, *held, generator, effort.smooth, effort.tolerance)
    found = look(trials)
    taken = found.misfits <= np.maximum(held.misfits, effort.tolerance)
    pairs = zip((units, *held), (trials, *found), strict=True)
    units, *rest = (np.where(taken.reshape(-1, *[1] * (old.ndim - 1)), new, old) for old, new in pairs)
    return units, Evaluated(*rest)


def _trials(
    units: Array,
    misfits: Array,
    residuals: Array,
    generator: np.random.Generator,
    smooth: tuple[bool, ...],
    tolerance: float,
) -> Array:
    """One trial per member of a population, (M, F)."""
    members, rows = units.shape
    # Itself comes last in a member's random order of the others.
    order = np.argsort(generator.random((members, members)) + 2.0 * np.eye(members), axis=1)
    start, plus, minus = (units[order[:, k]] for k in range(3))
    # A step from where it stands is as likely as the step back, so walkers cover what is allowed evenly.
    walks = (misfits <= tolerance)[:, np.newaxis]
    base = np.where(walks, units, start)
    mutant = base + generator.uniform(*_FACTOR, (members, 1)) * (plus - minus)
    crossed = generator.random((members, rows)) < generator.choice(_CROSSED, (members, 1))
    crossed[np.arange(members), generator.integers(rows, size=members)] = True
    trials = np.where(crossed, mutant, units)
    regressed = (generator.random((members, 1)) < _REGRESSED) & ~walks
    # From a better member and a step away from it, so that what follows is no copy.
    better = np.flatnonzero(misfits <= np.median(misfits))
    parent = generator.choice(better, members)
    stepped = units[parent] + np.where(crossed, mutant - base, 0.0)
    move = residuals[parent] @ _slope(units[better], residuals[better]) * np.array(smooth)
    towards = stepped - generator.uniform(*_STEP, (members, 1)) * move
    return _reflected(np.where(regressed, towards, trials))


def _slope(units: Array, residuals: Array) -> Array:
    """Regression of points on their residuals, (K, F)."""
    x, y = residuals - residuals.mean(axis=0), units - units.mean(axis=0)
    return np.asarray(np.linalg.lstsq(x, y, rcond=1e-3)[0])


def _settled(
    start: Array, look: _Memory, population: int, reserve: int, generator: np.random.Generator
) -> Array:
    """Best point of CMA-ES from a start until it settles, or so few plants are left."""
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "popsize": max(population, 4),
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # else it would seed a generator that all of NumPy shares
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(start, _WIDTH, options)
    best, point = np.inf, start
    course: list[float] = []
    while look.left > reserve + population and not strategy.stop() and not _stands(course):
        points = np.array(strategy.ask())
        misfits = look(points).misfits
        strategy.tell(list(points), misfits.tolist())
        if misfits.min() < best:
            best, point = misfits.min(), points[misfits.argmin()]
        course.append(best)
    return point


def _stands(course: list[float]) -> bool:
    return len(course) > _PATIENCE and course[-1] > (1.0 - _GAIN) * course[-1 - _PATIENCE]


def _descend(start: Array, smooth: NDArray[np.bool_], look: Misfit) -> None:
    """Least squares from a point over the smooth unknowns; choices stay."""
    from scipy.optimize import least_squares

    def at(values: Array) -> Array:
        points = np.tile(start, (len(values), 1))
        points[:, smooth] = values
        found = look(points)
        # The misfit of a plant that ends badly is more than its residuals say.
        size = np.sqrt(np.mean(found.residuals**2, axis=1))
        worse = np.maximum(found.misfits / np.maximum(size, np.finfo(float).tiny), 1.0)
        return np.asarray(found.residuals * worse[:, np.newaxis])

    def residuals(values: Array) -> Array:
        return np.asarray(at(values[np.newaxis])[0])

    def slopes(values: Array) -> Array:
        ends = np.minimum(values + _DIFFERENCE, 1.0), np.maximum(values - _DIFFERENCE, 0.0)
        own = np.eye(values.size, dtype=np.bool_)
        above, below = np.split(at(np.concatenate([np.where(own, end, values) for end in ends])), 2)
        return np.asarray(((above - below) / (ends[0] - ends[1])[:, np.newaxis]).T)

    least_squares(residuals, start[smooth], slopes, bounds=(0.0, 1.0), ftol=_SETTLED, xtol=_SETTLED)


def _reflected(units: Array) -> Array:
    """Fold what left the cube back into it; what is more than a side away ends at the far bound."""
    return np.asarray(1.0 - np.abs(1.0 - np.minimum(np.abs(units), 2.0)))


def save_arrays(path: Path, identity: str, **content: Any) -> None:
    """Store arrays, whole or not at all."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, identity=identity, **content)
    write_atomically(path, stream.getvalue())


def load_arrays(path: Path, identity: str, talk: Talk) -> dict[str, NDArray[Any]] | None:
    """Read arrays of this search; None when there are none to go on from, and why is told."""
    if not path.exists():
        return None
    damage = suppress(OSError, EOFError, ValueError, LookupError, BadZipFile)
    with damage, path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
        if str(stored["identity"]) == identity:
            return {name: stored[name] for name in stored.files}
    talk.note(f"{path}: is damaged or of another search; the search starts anew")
    return None
