"""Search for the gains of every law on one draw, by CMA-ES, all searches side by side.

A search belongs to a law, a class of knowledge, a filter and a seed. It keeps all that it has looked at, and
works under every cap on roughness at once: what one cap finds serves the others. Halfway and at the end laws
hand their best gains to laws that do the same with other gains (`laws.STEPS`).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.tuning.bench import CLASSES, Candidate, Measured
from tendonrepro.tuning.laws import STEPS, TunedLaw

Measure: TypeAlias = Callable[[Sequence[Candidate]], Measured]

FIRST, FIRST_WIDTH = 32, 0.15
"""Candidates that a search begins with, and how wide they lie around its start, as a share of the ranges."""
WIDTHS = 0.08, 0.04
"""First standard deviation of CMA-ES, as a share of the ranges, in the first half and in the second."""
SAME = 0.02
"""Difference of errors, in logs, up to which a special case is matched: rounding moves encoder counts."""
_OVER_CAP = 3.0
"""How many times the excess over the cap counts, in logs: more than the error gains by it."""
_HERE = 1e-9
"""Distance in the unit cube up to which a place is the same."""
_UNSTABLE = 10.0
"""What an unstable run costs, in logs: more than any error."""


class Effort(NamedTuple):
    """Searches of each law under each condition, generations of each, and members of a generation."""

    searches: int
    generations: int
    population: int


class Key(NamedTuple):
    """What a search belongs to."""

    law: str
    knows: str
    filtered: bool
    seed: int


@dataclass
class Search:
    """What one search has looked at: places in the unit cube, and what was measured there.

    ``error`` is the mean log error of all joints without and with payload; ``stable`` has all three runs.
    """

    law: TunedLaw
    key: Key
    units: list[Array] = field(default_factory=list)
    error: list[float] = field(default_factory=list)
    roughness: list[float] = field(default_factory=list)
    stable: list[NDArray[np.bool_]] = field(default_factory=list)

    def keep(self, units: Sequence[Array], found: Measured, part: slice) -> None:
        """Add candidates, which a part of what was measured is of."""
        self.units += units
        self.error += np.log(found.mae[part, :2]).mean(axis=(1, 2)).tolist()
        self.roughness += found.roughness[part].tolist()
        self.stable += list(found.stable[part])

    def unseen(self, units: Sequence[Array]) -> list[Array]:
        """Those of some places that were not looked at before."""
        seen = np.array(self.units).reshape(len(self.units), -1)
        return (
            [unit for unit in units if not (np.abs(seen - unit).max(axis=1) < _HERE).any()]
            if self.units
            else [*units]
        )

    def costs(self, cap: float, last: int = 0) -> Array:
        """What is minimised under a cap, of all candidates or the last ones."""
        error, rough, stable = (np.array(part[-last:]) for part in (self.error, self.roughness, self.stable))
        over = np.log(np.maximum(rough / cap, 1.0))
        return np.asarray(error + _OVER_CAP * over + _UNSTABLE * (~stable).sum(axis=1))

    def _allowed(self, cap: float, runs: int) -> Array:
        """Errors where the cap is kept and so many runs are stable, infinite elsewhere."""
        kept = (np.array(self.roughness) <= cap) & np.array(self.stable)[:, :runs].all(axis=1)
        return np.where(kept, self.error, np.inf)

    def smallest(self, cap: float) -> float:
        """Smallest error allowed under a cap, in logs; infinite without any."""
        return float(self._allowed(cap, 3).min())

    def best(self, cap: float) -> int | None:
        """Place of the smallest error allowed under a cap; None without any."""
        errors = self._allowed(cap, 3)
        return int(errors.argmin()) if np.isfinite(errors.min()) else None

    def gains_without_margin(self, cap: float) -> bool:
        """Whether an error is smaller where the run with less damping need not be stable."""
        return bool(self._allowed(cap, 2).min() < self.smallest(cap) - SAME)


def tune(
    laws: Sequence[TunedLaw],
    conditions: Sequence[tuple[str, bool]],
    caps: Sequence[float],
    measure: Measure,
    alpha: Array,
    effort: Effort,
    seed: tuple[int, int],
) -> dict[Key, Search]:
    """Search for the gains of every law under every condition.

    Parameters
    ----------
    laws : sequence of TunedLaw
    conditions : sequence of (str, bool)
        What is known, and whether velocities are filtered.
    caps : sequence of float
        On roughness, N m; infinity is none.
    measure : callable
        Runs candidates of one law.
    alpha : array (n,)
        As published.
    effort : Effort
    seed : (int, int)

    Returns
    -------
    dict of Key to Search
    """
    n = alpha.size
    found = {
        key: Search(law, key)
        for law in laws
        for knows, filtered in conditions
        for k in range(effort.searches)
        for key in [Key(law.name, knows, filtered, k)]
    }
    _look(
        found,
        {key: _spread(search.law, n, [*seed, *_mark(key)]) for key, search in found.items()},
        measure,
        n,
    )
    halves = effort.generations - effort.generations // 2, effort.generations // 2
    for half, generations in enumerate(halves):
        _exchange(found, caps, measure, alpha)
        _generations(found, caps, measure, n, effort._replace(generations=generations), half, seed)
    _exchange(found, caps, measure, alpha)
    return found


def _mark(key: Key) -> list[int]:
    """Numbers that are a search's own whatever other searches there are."""
    return [zlib.crc32(f"{key.law} {key.knows} {key.filtered}".encode()), key.seed]


def _spread(law: TunedLaw, n: int, seed: Sequence[int]) -> list[Array]:
    """First candidates: where searches start, and points around it."""
    start, generator = law.start(n), np.random.default_rng(seed)
    steps = FIRST_WIDTH * generator.standard_normal((FIRST - 1, start.size))
    return [start, *np.clip(start + steps, 0.0, 1.0)]


def _generations(
    found: Mapping[Key, Search],
    caps: Sequence[float],
    measure: Measure,
    n: int,
    effort: Effort,
    half: int,
    seed: tuple[int, int],
) -> None:
    """Go on from the best gains of every search under every cap."""
    size = effort.population
    strategies = {
        key: [
            _strategy(
                search.units[search.costs(cap).argmin()], WIDTHS[half], size, [*seed, half, *_mark(key), k]
            )
            for k, cap in enumerate(caps)
        ]
        for key, search in found.items()
    }
    for _ in range(effort.generations):
        asked = {key: [one.ask() for one in held] for key, held in strategies.items()}
        together = {key: [unit for part in parts for unit in part] for key, parts in asked.items()}
        _look(found, together, measure, n)
        for key, held in strategies.items():
            for k, (one, cap) in enumerate(zip(held, caps, strict=True)):
                costs = found[key].costs(cap, size * len(caps))[k * size :][:size]
                one.tell(asked[key][k], costs.tolist())


def _strategy(start: Array, width: float, population: int, seed: Sequence[int]) -> Any:
    import cma

    generator = np.random.default_rng(seed)
    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # else it would seed a generator that all of NumPy shares
        "verbose": -9,
    }
    return cma.CMAEvolutionStrategy(start, width, options)


def _look(
    found: Mapping[Key, Search], asked: Mapping[Key, Sequence[Array]], measure: Measure, n: int
) -> None:
    """Measure what searches ask for, all searches of a law together."""
    for law in dict.fromkeys(found[key].law for key in asked):
        own = {key: list(units) for key, units in asked.items() if key.law == law.name}
        candidates = [
            Candidate(law, key.knows, key.filtered, law.values(unit, n))
            for key, units in own.items()
            for unit in units
        ]
        if not candidates:
            continue
        result, first = measure(candidates), 0
        for key, units in own.items():
            found[key].keep(units, result, slice(first, first := first + len(units)))


def _best_units(search: Search, caps: Sequence[float]) -> list[Array]:
    """Places of the smallest cost, and of the smallest error that is allowed, under each cap; each once."""
    places = {int(search.costs(cap).argmin()) for cap in caps} | {search.best(cap) for cap in caps}
    return [search.units[place] for place in sorted(place for place in places if place is not None)]


def _exchange(found: Mapping[Key, Search], caps: Sequence[float], measure: Measure, alpha: Array) -> None:
    """Hand the best gains of each law to itself with more knowledge, and to those that do the same."""
    n = alpha.size
    for before, after in pairwise(CLASSES):
        _look(
            found,
            {
                target: found[target].unseen(_best_units(search, caps))
                for key, search in found.items()
                for target in [key._replace(knows=after)]
                if key.knows == before and target in found
            },
            measure,
            n,
        )
    for step in STEPS:
        asked: dict[Key, list[Array]] = {}
        for key, search in found.items():
            target = key._replace(law=step.target)
            if key.law == step.source and target in found:
                gains = [search.law.values(unit, n) for unit in _best_units(search, caps)]
                units = [found[target].law.unit(step.change(one, alpha), n) for one in gains]
                asked[target] = found[target].unseen(units)
        _look(found, asked, measure, n)
