"""The work on one draw, and what is kept: the best gains of every law under every condition and cap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol
from tendonrepro.tuning.bench import ALL_RUNS, CLASSES, Candidate, Plants, measure, plants_of, published
from tendonrepro.tuning.laws import BY_NAME, STEPS, TunedLaw
from tendonrepro.tuning.search import Seen, Tuning, best

# Caps on torque roughness, over that of Controller 2 as published on the same draw.
CAPS: Mapping[str, float] = {"none": np.inf, "1/3": 1 / 3, "1/10": 1 / 10, "1/30": 1 / 30}

# What is known, and whether velocities are filtered.
CONDITIONS = tuple(product(CLASSES, (False, True)))

# Weights of the older estimate along the curve over alpha; all other gains as published.
ALPHAS = (-0.5, -0.2, 0.0, 0.1, 0.2, 0.5, 0.8)

# Difference of errors, in logs, up to which a special case is matched: rounding moves encoder counts.
SAME = 0.02

Row: TypeAlias = dict[str, Any]
# Best of each search, by law, what is known, whether velocities are filtered, and cap.
Found: TypeAlias = dict[tuple[str, str, bool, str], list[Seen | None]]


@dataclass(frozen=True)
class Task:
    """All that a tuning depends on; its seed is that of the searches, the draws have the box's."""

    loaded: LoadedEnsemble
    laws: Mapping[str, TunedLaw]
    effort: Mapping[str, int]
    seed: int

    def draw(self, number: int) -> Plants:
        """Draw of a number from the box."""
        box, seed = make_box(self.loaded.config), int(self.loaded.config.seed.si)
        return plants_of(self.loaded, box, box.values(scrambled_sobol(box, seed, 0, number, 1))[0])

    def tuned(self, number: int) -> Row:
        """Tune every law on one draw, as plain values."""
        plants = self.draw(number)
        scale = measure(plants, [published(plants)["controller_2"]]).roughness[0]
        caps = {name: float(share * scale) for name, share in CAPS.items()}
        tuning = Tuning(self.laws, [*caps.values()], plants, self.effort, (self.seed, number))
        found: Found = {}
        for (key, seen), (name, cap) in product(tuning.run(CONDITIONS).items(), caps.items()):
            found.setdefault((*key[:3], name), []).append(best(seen, cap))
        kept = [*self._best(found, plants.alpha.size), *_as_published(plants)]
        return {"draw": number, "rows": _measured(plants, kept), "lost": [*_lost(found)]}

    def _best(self, found: Found, n: int) -> Iterator[Row]:
        """Yield the best of all searches for every law, condition and cap, with its gains if there is one."""
        for (name, knows, filtered, cap), own in found.items():
            row = _row(name, knows, filtered, cap, errors=[one.error if one else None for one in own])
            if top := min(filter(None, own), key=lambda one: one.error, default=None):
                law = self.laws[name]
                row["candidate"] = Candidate(law, knows, filtered, law.values(top.unit, n))
            yield row


def _row(law: str, knows: str, filtered: bool, cap: str, **more: Any) -> Row:
    return {"law": law, "knows": knows, "filtered": filtered, "cap": cap, **more}


def _as_published(plants: Plants) -> Iterator[Row]:
    """Yield Controllers 1 to 3 as published, and Controller 2 with its estimator's weights moved."""
    for condition in CONDITIONS:
        for name, candidate in published(plants, *condition).items():
            yield _row(name, *condition, "published", candidate=candidate)
    for knows, alpha in product(CLASSES, ALPHAS):
        gains = {**published(plants)["controller_2"].gains, "alpha": np.full_like(plants.alpha, alpha)}
        moved = Candidate(BY_NAME["alpha_free"], knows, False, gains)
        yield _row("controller_2", knows, False, "published", alpha=alpha, candidate=moved)


def _measured(plants: Plants, rows: Sequence[Row]) -> list[Row]:
    """Rows with what their candidates give, angles in rad: errors by run and joint, and their mean."""
    found = measure(plants, [row["candidate"] for row in rows if "candidate" in row], ALL_RUNS)
    results = zip(found.mae, found.roughness.tolist(), found.stable, strict=True)
    for row in rows:
        row["stable"] = False
        if "candidate" in row:
            mae, row["roughness"], stable = next(results)
            row["stable"] = bool(stable[:-1].all())
            row["gains"] = {name: value.tolist() for name, value in row.pop("candidate").gains.items()}
            row["mae"], row["error"] = mae[:2].tolist(), _mean(mae[:2])
            row["held_out_error"] = _mean(mae[-1]) if stable[-1] else None
    return [*rows]


def _mean(mae: Any) -> float:
    """Geometric mean."""
    return float(np.exp(np.log(mae).mean()))


def _lost(found: Found) -> Iterator[Row]:
    """Yield where a law does worse than its own special case, which is a failure of the search."""
    errors = {key: min(one.error if one else np.inf for one in own) for key, own in found.items()}
    for step, (key, special) in product(STEPS, errors.items()):
        general = (step.target, *key[1:])
        if step.exact and key[0] == step.source and errors.get(general, -np.inf) > special + SAME:
            yield _row(*general, to=key[0])
