"""The work on one draw, and what is kept: the best gains of every law under every condition and cap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.tuning.bench import (
    ALL_RUNS,
    CLASSES,
    PUBLISHED,
    Candidate,
    Plants,
    measure,
    plants_of,
    published,
)
from tendonrepro.tuning.laws import LAWS, STEPS, TunedLaw
from tendonrepro.tuning.search import SAME, Effort, Search, tune

CAPS: Mapping[str, float] = {"none": np.inf, "1/3": 1 / 3, "1/10": 1 / 10, "1/30": 1 / 30}
"""Caps on torque roughness, over that of Controller 2 as published on the same draw."""

CONDITIONS = tuple(product(CLASSES, (False, True)))
"""What is known, and whether velocities are filtered."""

ALPHAS = (-0.5, -0.2, 0.0, 0.1, 0.2, 0.5, 0.8)
"""Weights of the older estimate along the curve over alpha; all other gains as published."""

Kept: TypeAlias = tuple[dict[str, Any], Candidate | None]
"""A row of what is kept, and the candidate that its numbers are of, if there is one."""

_AT_CAP, _AT_BOUND = 0.95, 0.01
"""Share of a cap from which it is active, and distance from a bound, over the range, up to which that is."""


@dataclass(frozen=True)
class Task:
    """All that a tuning depends on; its seed is that of the searches, the draws have the box's."""

    loaded: LoadedEnsemble
    laws: tuple[TunedLaw, ...]
    effort: Effort
    seed: int

    def draw(self, number: int) -> Plants:
        """Draw of a number from the box."""
        box, seed = make_box(self.loaded.config), int(self.loaded.config.seed.si)
        return plants_of(self.loaded, box, box.values(scrambled_sobol(box, seed, 0, number, 1))[0])

    def tuned(self, number: int) -> dict[str, Any]:
        """Tune every law on one draw, as plain values."""
        plants = self.draw(number)
        scale = measure(plants, [published(plants, "controller_2")]).roughness[0]
        caps = {name: float(share * scale) for name, share in CAPS.items()}
        searches = tune(
            self.laws,
            CONDITIONS,
            list(caps.values()),
            lambda candidates: measure(plants, candidates),
            plants.alpha,
            self.effort,
            (self.seed, number),
        )
        groups: dict[tuple[str, str, bool], list[Search]] = {}
        for key, search in searches.items():
            groups.setdefault(key[:3], []).append(search)
        kept = [*_best(groups, caps, plants.alpha.size), *_as_published(plants)]
        lost = [_named(key, cap) | {"to": to} for key, cap, to in _lost(groups, caps)]
        return {"draw": number, "rows": _measured(plants, kept), "lost": lost}


def _named(key: tuple[str, str, bool], cap: str) -> dict[str, Any]:
    return {"law": key[0], "knows": key[1], "filtered": key[2], "cap": cap}


def _best(
    groups: Mapping[tuple[str, str, bool], Sequence[Search]], caps: Mapping[str, float], n: int
) -> Iterator[Kept]:
    """Yield the best of all searches for every law, condition and cap."""
    for (key, own), (name, cap) in product(groups.items(), caps.items()):
        errors = [search.smallest(cap) for search in own]
        row = _named(key, name) | {"errors": errors}
        search = own[int(np.argmin(errors))]
        place = search.best(cap)
        if place is None:
            yield (row, None)
            continue
        unit = search.units[place]
        limits = {
            "roughness": search.roughness[place] > _AT_CAP * cap,
            "margin": search.gains_without_margin(cap),
            "bound": search.law.at_bound(unit, n, _AT_BOUND),
        }
        row["active"] = [limit for limit, acts in limits.items() if acts]
        yield (row, Candidate(search.law, *key[1:], search.law.values(unit, n)))


def _as_published(plants: Plants) -> Iterator[Kept]:
    """Yield Controllers 1 to 3 as published, and Controller 2 with its estimator's weights moved."""
    for name, condition in product(PUBLISHED, CONDITIONS):
        yield (_named((name, *condition), "published"), published(plants, name, *condition))
    free = next(law for law in LAWS if law.name == "alpha_free")
    for knows, alpha in product(CLASSES, ALPHAS):
        gains = {**published(plants, "controller_2").gains, "alpha": np.full_like(plants.alpha, alpha)}
        row = _named(("controller_2", knows, False), "published") | {"alpha": alpha}
        yield (row, Candidate(free, knows, False, gains))


def _measured(plants: Plants, kept: Sequence[Kept]) -> list[dict[str, Any]]:
    """Rows with what their candidates give, angles in rad: errors by run and joint, and their mean."""
    found = measure(plants, [candidate for _, candidate in kept if candidate], ALL_RUNS)
    rows, place = [], 0
    for row, candidate in kept:
        rows.append(row | {"stable": False})
        if candidate:
            mae, stable = found.mae[place], found.stable[place]
            rows[-1] = row | {
                "stable": bool(stable[:-1].all()),
                "gains": {name: value.tolist() for name, value in candidate.gains.items()},
                "mae": mae[:2].tolist(),
                "error": _mean(mae[:2]),
                "roughness": float(found.roughness[place]),
                "held_out_error": _mean(mae[-1]) if stable[-1] else None,
            }
            place += 1
    return rows


def _mean(mae: Any) -> float:
    """Geometric mean."""
    return float(np.exp(np.log(mae).mean()))


def _lost(
    groups: Mapping[tuple[str, str, bool], Sequence[Search]], caps: Mapping[str, float]
) -> Iterator[tuple[tuple[str, str, bool], str, str]]:
    """Yield where a law does worse than its own special case, which is a failure of the search."""
    for step, (key, own), (name, cap) in product(STEPS, groups.items(), caps.items()):
        general = (step.target, key[1], key[2])
        if step.exact and key[0] == step.source and general in groups:
            special = min(search.smallest(cap) for search in own)
            if min(search.smallest(cap) for search in groups[general]) > special + SAME:
                yield general, name, key[0]
