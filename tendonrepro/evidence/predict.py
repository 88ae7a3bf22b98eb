"""What ``tendonrepro predict`` does."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble, load_ensemble
from tendonrepro.configuration.models.readings import Reading, named_readings, under
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.evidence.bench_experiments import EXPERIMENTS, FIRST, LOADED, SECOND, THIRD, Prediction
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.box import Box, configured, make_box, scrambled_sobol
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.tables import Table
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

SCHEMA_VERSION = 1
READINGS = (
    "printed,Delta_unit=deg,gain_unit=phi_in_degrees,phi_branch=power,weights=extrapolating,"
    "weights=extrapolating+Delta_unit=deg,stored_torque=applied+torque_step=0.016,"
    "Delta_unit=deg+stored_torque=applied+torque_step=0.016,feedback=motor"
)
"""Interpretations whose predictions are asked for unless others are named."""
BASE = (FIRST, SECOND, THIRD, LOADED)
"""Runs as configured, before those of the experiments."""
LEAST = 20
"""Stable plants below which no interval is given."""
AT_ONCE = 16
"""Plants simulated together."""


def run_predict(request: Request, talk: Talk, *, draws: int, readings: str = READINGS) -> dict[str, Any]:
    """Predict every experiment, write tables and picture, and return what ``--json`` prints.

    ``request`` has the configuration of an ensemble; ``draws`` plants; ``readings`` with commas between.
    """
    loaded = load_ensemble(request.config, overrides=request.overrides, seed=request.seed)
    digest = hashlib.sha256(f"{loaded.sha256} {draws} {readings}".encode()).hexdigest()
    base = replace(loaded.base, sha256=digest, origin=loaded.origin)
    return run_study(
        "predict", base, request, lambda: study_predict(loaded, talk, draws=draws, readings=readings), talk
    )


def study_predict(loaded: LoadedEnsemble, talk: Talk, *, draws: int, readings: str = READINGS) -> Outcome:
    """Predict every experiment; see :func:`run_predict`."""
    from tendonrepro.evidence.figure_predictions import draw_predictions

    if draws < LEAST:
        raise UsageError(f"must be at least {LEAST} plants, found {draws}", where="--draws")
    chosen, joints = named_readings(readings), loaded.compare.joints
    found = list(predictions(loaded, chosen, draws, talk))
    names = [held.name for held in chosen]
    told = told_apart(found, names)
    never = never_told_apart(told, names)
    data = {
        "schema_version": SCHEMA_VERSION,
        "draws": draws,
        "joints": list(joints),
        "readings": names,
        "never_told_apart": never,
        "experiments": [
            {
                "name": one.name,
                "about": one.about,
                "told_apart": [*map(list, told[one.name])],
                "gaps": [*told[one.name].values()],
                "ratios": [vars(row) for row in found if row.experiment == one.name],
            }
            for one in EXPERIMENTS
        ],
    }
    figures = {"predictions": lambda: draw_predictions(found, names, joints)}
    return Outcome(data, _tables(found, told, never, draws), figures)


def predictions(
    loaded: LoadedEnsemble, readings: Sequence[Reading], draws: int, talk: Talk
) -> Iterator[Prediction]:
    """Yield every experiment's ratio under every reading on every joint."""
    box, joints = make_box(loaded.config), loaded.compare.joints
    values = box.values(scrambled_sobol(box, int(loaded.config.seed.si), 0, 0, draws))
    with talk.bar("simulating", draws * len(readings)) as progress:
        for reading in readings:
            errors, stable = [], []
            for rows in np.split(values, range(AT_ONCE, draws, AT_ONCE)):
                loops = [loop for row in rows for loop in _loops(loaded, box, row, reading)]
                batch = simulate_batch(loops, loaded.compare.status, threads=os.cpu_count() or 1)
                count = len(BASE) + len(EXPERIMENTS)
                errors.append(batch.statistics["mae"].reshape(-1, count, len(joints)))
                stable.append(batch.status.reshape(-1, count) == STATUSES.index("ok"))
                progress(len(rows))
            yield from _ratios(np.concatenate(errors), np.concatenate(stable), reading.name, joints)


def _loops(loaded: LoadedEnsemble, box: Box, row: Array, reading: Reading) -> Iterator[Loop]:
    """Loops of one plant under one reading: those of `BASE`, then one for each experiment."""
    folder = loaded.base.folder
    config = under(reading, configured(loaded.base, box, row), box.named(row))
    loops = dict(build_loops(config, folder))
    yield from (loops[name] for name in BASE)
    yield from (one.change(config, folder, loops) for one in EXPERIMENTS)


def _ratios(
    errors: Array, stable: NDArray[np.bool_], reading: str, joints: Sequence[int]
) -> Iterator[Prediction]:
    """Ratios from mean errors (N, runs, n) and stability (N, runs)."""
    for place, one in enumerate(EXPERIMENTS, start=len(BASE)):
        beside = BASE.index(one.beside)
        kept = stable[:, place] & stable[:, beside]
        for i, joint in enumerate(joints):
            ratio = errors[kept, place, i] / errors[kept, beside, i]
            spread = np.quantile(ratio, (0.5, 0.05, 0.95)) if kept.sum() >= LEAST else np.full(3, np.nan)
            yield Prediction(one.name, reading, joint, int(kept.sum()), *map(float, spread))


def told_apart(
    found: Sequence[Prediction], readings: Sequence[str]
) -> dict[str, dict[tuple[str, str], float]]:
    """Pairs of readings that each experiment tells apart, with the wider joint's gap of 90 % ranges."""
    told: dict[str, dict[tuple[str, str], float]] = {}
    for experiment in dict.fromkeys(row.experiment for row in found):
        rows = {(row.reading, row.joint): row for row in found if row.experiment == experiment}
        joints = dict.fromkeys(joint for _, joint in rows)
        gaps = {
            (a, b): max(_gap(rows[a, joint], rows[b, joint]) for joint in joints)
            for a, b in combinations(readings, 2)
        }
        told[experiment] = {pair: gap for pair, gap in gaps.items() if gap > 0.0}
    return told


def never_told_apart(
    told: Mapping[str, Mapping[tuple[str, str], float]], readings: Sequence[str]
) -> list[list[str]]:
    """Pairs of readings that no experiment tells apart."""
    return [[*pair] for pair in combinations(readings, 2) if not any(pair in gaps for gaps in told.values())]


def _gap(a: Prediction, b: Prediction) -> float:
    """Gap between two ranges; negative where they meet or one is unknown."""
    gap = max(a.low, b.low) - min(a.high, b.high)
    return gap if np.isfinite([a.low, b.low]).all() else -np.inf


def _tables(
    found: Sequence[Prediction],
    told: Mapping[str, Mapping[tuple[str, str], float]],
    never: Sequence[Sequence[str]],
    draws: int,
) -> list[Table | str]:
    widest = {name: max(gaps.values(), default=0.0) for name, gaps in told.items()}
    telling = sorted(EXPERIMENTS, key=lambda one: -widest[one.name])
    rows = [
        {
            "experiment": one.about,
            "widest_gap": widest[one.name],
            "narrowest_gap": min(told[one.name].values(), default=0.0),
            "pairs_told_apart": len(told[one.name]),
        }
        for one in telling
    ]
    caption = "Experiments, the most telling first: gaps between the 90 % ranges of interpretations."
    ratios = [vars(row) for one in telling for row in found if row.experiment == one.name]
    about = f"Ratio of mean errors, median and central 90 % of the stable ones of {draws} plants."
    untold = [{"interpretation": a, "and": b} for a, b in never]
    few = sum(row.plants < LEAST for row in found)
    remark = (
        f"{few} of {len(found)} ranges have fewer than {LEAST} stable plants, and tell nothing: more --draws"
    )
    return [
        *([remark] if few else []),
        Table("experiments", caption, rows),
        Table("never_told_apart", "Interpretations that no experiment tells apart.", untold),
        Table("predictions", about, ratios, terminal=()),
    ]
