"""Search for the gains of every law on one draw, by CMA-ES.

A search works under every cap on roughness at once: what one cap finds serves the others. Each law is
searched alone, and again with laws handing on their best gains (`EQUIVALENCES`), halfway and at the end.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gmean

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import SECOND
from tendonrepro.files import Json
from tendonrepro.monte_carlo.kept import Kept
from tendonrepro.monte_carlo.population import evolution, population_of
from tendonrepro.results.paper import compares_as_paper
from tendonrepro.tuning import bench
from tendonrepro.tuning.bench import Candidate, TunedLaw

# Caps on torque roughness, over that of Controller 2 as published on the same draw.
CAPS: Mapping[str, float] = {"none": np.inf, "1/3": 1 / 3, "1/10": 1 / 10, "1/30": 1 / 30}

# Weights of the older estimate along the curve over alpha; all other gains as published.
ALPHAS = (-0.5, -0.2, 0.0, 0.1, 0.2, 0.5, 0.8)

# Difference of errors, in logs, up to which a special case is matched: rounding moves encoder counts.
SAME = 0.02

# Candidates that a search begins with, and how wide they lie around its start, as a share of the ranges.
FIRST, FIRST_WIDTH = 32, 0.15
# First standard deviation of CMA-ES, as a share of the ranges, in the first half and in the second.
WIDTHS = 0.08, 0.04
_OVER_CAP = 3.0  # how many times the excess over the cap counts, in logs: more than the error gains by it
_UNSTABLE = 10.0  # what an unstable run costs, in logs: more than any error
# So seeds stay what they were.
_SEED_WORDS = {bench.PUBLISHED: "none False", bench.KNOWN: "full True"}
_HERE = 1e-9  # distance in the unit cube up to which a place is the same


class SearchKey(NamedTuple):
    """What a search belongs to."""

    law: str
    condition: str
    alone: bool
    seed: int


class Seen(NamedTuple):
    """A place in the unit cube, its mean log error without and with payload, and the rest."""

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
    kept = [place for place in seen if place.roughness <= cap and place.stable.all()]
    return min(kept, key=lambda place: place.error, default=None)


@dataclass(frozen=True)
class TuningEffort:
    """How hard to search: searches of each law, condition and way, generations of each, members of these."""

    searches: int
    generations: int
    population: int


@dataclass(frozen=True)
class Tuning:
    """Searches on one draw under caps on roughness, N m; infinity is none.

    What was looked at is kept in the file `path`, if one is named.
    """

    laws: Mapping[str, TunedLaw]
    caps: Sequence[float]
    plants: bench.TrialPlants
    effort: TuningEffort
    seed: tuple[int, int]
    path: Path | None = None
    places: dict[SearchKey, list[Seen]] = field(default_factory=dict)

    def run(self, conditions: Sequence[str]) -> dict[SearchKey, list[Seen]]:
        """Search under conditions, with gains handed on and alone."""
        for key in product(self.laws, conditions, (False, True), range(self.effort.searches)):
            self.places[SearchKey(*key)] = []
        self._look([(key, unit) for key in self.places for unit in self._spread(key)])
        self._exchange()
        for half in (0, 1):
            self._generations(half, (self.effort.generations + 1 - half) // 2)
            self._exchange()
        return self.places

    def _spread(self, key: SearchKey) -> list[Array]:
        law = self.laws[key.law]
        start = law.unit({name: bounds.start for name, bounds in law.gains.items()}, self.plants.alpha.size)
        steps = np.random.default_rng(self._seed(key)).standard_normal((FIRST - 1, start.size))
        return [start, *np.clip(start + FIRST_WIDTH * steps, 0.0, 1.0)]

    def _seed(self, key: SearchKey, *half: int) -> list[int]:
        """Numbers that are a search's own whatever other searches there are."""
        words = f"{key.law} {_SEED_WORDS[key.condition]}" + " alone" * key.alone
        return [*self.seed, *half, zlib.crc32(words.encode()), key.seed]

    def _generations(self, half: int, count: int) -> None:
        size, strategies = self.effort.population, {}
        for (key, seen), (k, cap) in product(self.places.items(), enumerate(self.caps)):
            generator = np.random.default_rng([*self._seed(key, half), k])
            start = seen[costs(seen, cap).argmin()].unit
            strategies[key, k] = evolution(start, WIDTHS[half], size, generator)
        for _ in range(count):
            asked = {place: strategy.ask() for place, strategy in strategies.items()}
            self._look([(key, unit) for (key, _), units in asked.items() for unit in units])
            for (key, k), strategy in strategies.items():
                own = self.places[key][-size * len(self.caps) :][k * size :][:size]
                strategy.tell(asked[key, k], costs(own, self.caps[k]).tolist())

    def _look(self, asked: Sequence[tuple[SearchKey, Array]]) -> None:
        if not asked:
            return
        number, n = {key: k for k, key in enumerate(self.places)}, self.plants.alpha.size
        # A row for each candidate: its search, and its place in the cube of its law.
        points = np.full((len(asked), 1 + max(sum(law.sizes(n)) for law in self.laws.values())), np.nan)
        for row, (key, unit) in zip(points, asked, strict=True):
            row[0], row[1 : 1 + unit.size] = number[key], unit
        for (key, unit), (error, roughness, *stable) in zip(asked, self._kept(points).tolist(), strict=True):
            self.places[key].append(Seen(unit, error, roughness, np.array(stable) > 0.0))

    @cached_property
    def _kept(self) -> Kept:
        return Kept(self._measured, self.path)

    def _measured(self, points: Array) -> Array:
        """Mean log error, roughness and stability of each run of candidates."""
        keys, n, candidates = [*self.places], self.plants.alpha.size, []
        for place, *unit in points:
            key = keys[int(place)]
            law = self.laws[key.law]
            gains = law.values(np.array(unit[: sum(law.sizes(n))]), n)
            candidates.append(Candidate(law, key.condition, gains))
        measured = bench.measure(self.plants, candidates)
        errors = np.log(measured.mae[:, :2]).mean(axis=(1, 2))
        return np.column_stack([errors, measured.roughness, measured.stable])

    def _exchange(self) -> None:
        """Have searches look at the best places of others, in their own gains, if these are new to them."""
        alpha, n = self.plants.alpha, self.plants.alpha.size
        for equal in bench.EQUIVALENCES:
            asked = []
            for key, seen in self.places.items():
                to = key._replace(law=equal.target)
                if key.alone or key.law != equal.source or to not in self.places:
                    continue
                law, other = self.laws[key.law], self.laws[to.law]
                gains = [law.values(unit, n) for unit in self._best_units(seen)]
                units = [other.unit(equal.change(each, alpha), n) for each in gains]
                there = np.array([place.unit for place in self.places[to]])
                asked += [(to, unit) for unit in units if (np.abs(there - unit).max(axis=1) >= _HERE).all()]
            self._look(asked)

    def _best_units(self, seen: Sequence[Seen]) -> list[Array]:
        """Places of least cost and least error under each cap; each once."""
        least = [seen[int(costs(seen, cap).argmin())] for cap in self.caps]
        least += filter(None, (best(seen, cap) for cap in self.caps))
        return [place.unit for place in seen if any(place is other for other in least)]


@dataclass(frozen=True)
class TuningTask:
    """All that a tuning depends on; its seed is the searches', draws have the box's."""

    loaded: LoadedEnsemble
    laws: Mapping[str, TunedLaw]
    effort: TuningEffort
    seed: int
    any_plant: bool = False

    @property
    def gains_told(self) -> str:
        """Whose gains the search begins beside, in a word: a user's arm or comparison has its own."""
        published = self.loaded.around is None and compares_as_paper(self.loaded.compare)
        return "published" if published else "your own"

    @property
    def experiments(self) -> int:
        """Runs that the searches on one plant ask for, each candidate without and with payload."""
        effort = self.effort
        searches = len(self.laws) * len(bench.CONDITIONS) * 2 * effort.searches
        return 2 * searches * (FIRST + effort.generations * effort.population * len(CAPS))

    def draw(self, number: int) -> bench.TrialPlants:
        """Draw of a number from the box, or around a user's arm."""
        population, seed = population_of(self.loaded), int(self.loaded.config.seed.si)
        config = population.configured(population.sample(seed, 0, number, 1)[0])
        return bench.posed(config)

    def tuned(self, states: Path, number: int) -> list[Json]:
        """Rows of every law, condition and cap on one draw; what was looked at is kept in `states`."""
        plants = self.draw(number)
        scale = bench.measure(plants, [bench.as_published(plants)[SECOND]]).roughness[0]
        caps = {name: float(share * scale) for name, share in CAPS.items()}
        tuning = Tuning(
            self.laws, [*caps.values()], plants, self.effort, (self.seed, number), states / f"{number}.npy"
        )
        tuning.run(bench.CONDITIONS)
        rows = [*_best_rows(tuning, caps), *_published_rows(plants)]
        _measured(plants, rows)
        return [{"draw": number, **row} for row in rows]


def _best_rows(tuning: Tuning, caps: Mapping[str, float]) -> Iterator[Json]:
    """Yield the best of all searches of a law, and the same gains with α = 0."""
    n, searches = tuning.plants.alpha.size, dict.fromkeys(key[:3] for key in tuning.places)
    for (name, condition, alone), (cap, most) in product(searches, caps.items()):
        own = [best(seen, most) for key, seen in tuning.places.items() if key[:3] == (name, condition, alone)]
        row = _row(name, condition, alone, cap, errors=[place.error if place else None for place in own])
        if top := min(filter(None, own), key=lambda place: place.error, default=None):
            law = tuning.laws[name]
            gains = law.values(top.unit, n)
            row["candidate"] = Candidate(law, condition, gains)
            if "alpha" in gains:
                without = Candidate(law, condition, {**gains, "alpha": np.zeros(n)})
                yield _row(name, condition, alone, cap, alpha=0.0, candidate=without)
        yield row


def _row(law: str, condition: str, alone: bool, cap: str, **more: object) -> Json:
    return {"law": law, "condition": condition, "alone": alone, "cap": cap, **more}


def _published_rows(plants: bench.TrialPlants) -> Iterator[Json]:
    """Yield Controllers 1 to 3 as published, and Controller 2 over its estimator's weights."""
    for condition in bench.CONDITIONS:
        for name, candidate in bench.as_published(plants, condition).items():
            yield _row(name, condition, False, "published", candidate=candidate)
    for condition, alpha in product(bench.CONDITIONS, ALPHAS):
        gains = {**bench.as_published(plants)[SECOND].gains, "alpha": np.full_like(plants.alpha, alpha)}
        moved = Candidate(bench.LAWS["alpha_free"], condition, gains)
        yield _row(SECOND, condition, False, "published", alpha=alpha, candidate=moved)


def _measured(plants: bench.TrialPlants, rows: Sequence[Json]) -> None:
    """Add to rows what their candidates give, angles in rad."""
    candidates = [row.pop("candidate", None) for row in rows]
    results = zip(*bench.measure(plants, [*filter(None, candidates)], bench.ALL_RUNS), strict=True)
    for row, candidate in zip(rows, candidates, strict=True):
        row["stable"] = False
        if candidate:
            mae, roughness, stable = next(results)
            row["roughness"], row["stable"] = float(roughness), bool(stable[:-1].all())
            row["gains"] = {name: value.tolist() for name, value in candidate.gains.items()}
            row["mae"], row["error"] = mae[:2].tolist(), float(gmean(mae[:2], axis=None))
            row["held_out_error"] = float(gmean(mae[-1])) if stable[-1] else None
