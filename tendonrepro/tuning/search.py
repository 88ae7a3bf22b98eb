"""Search for the gains of every law on one draw, by CMA-ES, all searches side by side.

A search belongs to a law, a class of knowledge, a filter and a seed. It keeps all that it has looked at, and
works under every cap on roughness at once: what one cap finds serves the others. Halfway and at the end laws
hand their best gains to laws that do the same with other gains (`laws.STEPS`).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.monte_carlo.evolution import evolution
from tendonrepro.tuning.bench import CLASSES, Candidate, Plants, measure
from tendonrepro.tuning.laws import STEPS, Change, TunedLaw

# Candidates that a search begins with, and how wide they lie around its start, as a share of the ranges.
FIRST, FIRST_WIDTH = 32, 0.15
# First standard deviation of CMA-ES, as a share of the ranges, in the first half and in the second.
WIDTHS = 0.08, 0.04
_OVER_CAP = 3.0  # how many times the excess over the cap counts, in logs: more than the error gains by it
_UNSTABLE = 10.0  # what an unstable run costs, in logs: more than any error
_HERE = 1e-9  # distance in the unit cube up to which a place is the same


class Key(NamedTuple):
    """What a search belongs to."""

    law: str
    knows: str
    filtered: bool
    seed: int


class Seen(NamedTuple):
    """A place in the unit cube: its log error, mean of all joints without and with payload, and the rest."""

    unit: Array
    error: float
    roughness: float
    stable: NDArray[np.bool_]


def costs(seen: Sequence[Seen], cap: float) -> Array:
    """What is minimised under a cap."""
    _, error, roughness, stable = map(np.array, zip(*seen, strict=True))
    over = np.log(np.maximum(roughness / cap, 1.0))
    return np.asarray(error + _OVER_CAP * over + _UNSTABLE * (~stable).sum(axis=1))


def best(seen: Sequence[Seen], cap: float) -> Seen | None:
    """Smallest error where the cap is kept and all runs are stable."""
    kept = [one for one in seen if one.roughness <= cap and one.stable.all()]
    return min(kept, key=lambda one: one.error, default=None)


@dataclass(frozen=True)
class Tuning:
    """Searches on one draw that go on together, under caps on roughness, N m; infinity is none.

    Effort is ``searches`` of each law under each condition, ``generations`` of each, and the ``population``
    of a generation.
    """

    laws: Mapping[str, TunedLaw]
    caps: Sequence[float]
    plants: Plants
    effort: Mapping[str, int]
    seed: tuple[int, int]
    found: dict[Key, list[Seen]] = field(default_factory=dict)

    def run(self, conditions: Sequence[tuple[str, bool]]) -> dict[Key, list[Seen]]:
        """Search under every condition: what is known, and whether velocities are filtered."""
        for law, condition, k in product(self.laws, conditions, range(self.effort["searches"])):
            self.found[Key(law, *condition, k)] = []
        self._look([(key, unit) for key in self.found for unit in self._spread(key)])
        self._exchange()
        generations = self.effort["generations"]
        for half, count in enumerate((generations - generations // 2, generations // 2)):
            self._generations(half, count)
            self._exchange()
        return self.found

    def _spread(self, key: Key) -> list[Array]:
        """First candidates: where searches start, and points around it."""
        start = self.laws[key.law].start(self.plants.alpha.size)
        steps = np.random.default_rng(self._seed(key)).standard_normal((FIRST - 1, start.size))
        return [start, *np.clip(start + FIRST_WIDTH * steps, 0.0, 1.0)]

    def _seed(self, key: Key, *half: int) -> list[int]:
        """Numbers that are a search's own whatever other searches there are."""
        return [*self.seed, *half, zlib.crc32(f"{key.law} {key.knows} {key.filtered}".encode()), key.seed]

    def _generations(self, half: int, count: int) -> None:
        """Go on from the best gains of every search under every cap."""
        size, strategies = self.effort["population"], {}
        for (key, seen), (k, cap) in product(self.found.items(), enumerate(self.caps)):
            generator = np.random.default_rng([*self._seed(key, half), k])
            start = seen[costs(seen, cap).argmin()].unit
            strategies[key, k] = evolution(start, WIDTHS[half], size, generator)
        for _ in range(count):
            asked = {place: one.ask() for place, one in strategies.items()}
            self._look([(key, unit) for (key, _), units in asked.items() for unit in units])
            for (key, k), one in strategies.items():
                own = self.found[key][-size * len(self.caps) :][k * size :][:size]
                one.tell(asked[key, k], costs(own, self.caps[k]).tolist())

    def _look(self, asked: Sequence[tuple[Key, Array]]) -> None:
        """Measure what searches ask for, all together."""
        n, candidates = self.plants.alpha.size, []
        for key, unit in asked:
            law = self.laws[key.law]
            candidates.append(Candidate(law, key.knows, key.filtered, law.values(unit, n)))
        if candidates:
            found = measure(self.plants, candidates)
            errors = np.log(found.mae[:, :2]).mean(axis=(1, 2)).tolist()
            parts = zip(asked, errors, found.roughness.tolist(), found.stable, strict=True)
            for (key, unit), error, roughness, stable in parts:
                self.found[key].append(Seen(unit, error, roughness, stable))

    def _exchange(self) -> None:
        """Hand the best gains of each law to itself with more knowledge, and to those that do the same."""
        for before, after in pairwise(CLASSES):
            self._hand_on("knows", before, after)
        for step in STEPS:
            self._hand_on("law", step.source, step.target, step.change)

    def _hand_on(self, axis: str, source: str, target: str, change: Change | None = None) -> None:
        """Have searches look at the best places of others, with changed gains, if they are new to them."""
        alpha, asked = self.plants.alpha, []
        for key, seen in self.found.items():
            changed: dict[str, Any] = {axis: target}
            to = key._replace(**changed)
            if getattr(key, axis) != source or to not in self.found:
                continue
            units, law, other = self._best_units(seen), self.laws[key.law], self.laws[to.law]
            if change:
                gains = [change(law.values(unit, alpha.size), alpha) for unit in units]
                units = [other.unit(one, alpha.size) for one in gains]
            there = np.array([one.unit for one in self.found[to]])
            asked += [(to, unit) for unit in units if (np.abs(there - unit).max(axis=1) >= _HERE).all()]
        self._look(asked)

    def _best_units(self, seen: Sequence[Seen]) -> list[Array]:
        """Places of the smallest cost and the smallest error that is allowed, under each cap; each once."""
        held = [seen[int(costs(seen, cap).argmin())] for cap in self.caps]
        held += filter(None, (best(seen, cap) for cap in self.caps))
        return [one.unit for one in seen if any(one is other for other in held)]
