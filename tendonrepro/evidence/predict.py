"""What each experiment would give under every reading, and which readings that tells apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import FIRST, RUNS
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.console import Talk
from tendonrepro.evidence.bench_runs import DOUBLED_PERIOD, BenchExperiment, experiments_on
from tendonrepro.monte_carlo.kept import Kept
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.parallel import processors
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

LEAST = 20
"""Stable plants below which no interval is given."""
AT_ONCE = 16
"""Plants simulated together."""
Gaps: TypeAlias = Mapping[tuple[str, str], float]
"""By pair of readings."""


@dataclass(frozen=True)
class Prediction:
    """Ratio of errors of one experiment, reading and joint.

    ``low`` and ``high`` are the central 90 % of the plants on which both runs are stable; NaN with few.
    """

    experiment: str
    reading: str
    joint: int
    plants: int
    median: float
    low: float
    high: float


def predictions(
    loaded: LoadedEnsemble,
    readings: Sequence[Reading],
    draws: int,
    talk: Talk,
    files: Path | None = None,
) -> Iterator[Prediction]:
    """Yield every experiment's ratio under every reading on every joint.

    With a folder for `files`, what was simulated is kept there, and taken up again.
    """
    joints, experiments = loaded.compare.joints, experiments_on(loaded)
    base = [run for run in RUNS if run in loaded.compare.runs]
    names = [*dict.fromkeys(experiment.error for experiment in experiments)]
    runs = len(base) + len(experiments)
    values = population_of(loaded).sample(int(loaded.config.seed.si), 0, 0, draws)
    with talk.bar("simulating", draws * len(readings)) as progress:
        for reading in readings:
            kept = Kept(partial(_simulated, loaded, reading, names), files and files / f"{reading.name}.npy")
            for rows in np.split(values, range(AT_ONCE, draws, AT_ONCE)):
                kept(rows)
                progress(len(rows))
            columns = kept.table[:, values.shape[1] :]
            status, sizes = columns[:, :runs], columns[:, runs:].reshape(draws, len(names), runs, -1)
            by_name = np.moveaxis(sizes, 1, 0)
            errors, stable = dict(zip(names, by_name, strict=True)), status == STATUSES.index("ok")
            yield from error_ratios(experiments, base, errors, stable, reading.name, joints)


def _simulated(loaded: LoadedEnsemble, reading: Reading, names: Sequence[str], values: Array) -> Array:
    """Status of each run of plants (N, P) under a reading, then each of its statistics, (N, K)."""
    loops = [*loops_of_plants(loaded, values, reading)]
    batch = simulate_batch(loops, loaded.compare.status, threads=processors())
    parts = [batch.status.astype(np.float64), *(batch.statistics[name] for name in names)]
    return np.column_stack([part.reshape(len(values), -1) for part in parts])


def loops_of_plants(loaded: LoadedEnsemble, values: Array, reading: Reading) -> Iterator[Loop]:
    """Loops of plants (N, P) under a reading, plant by plant: those of `RUNS`, then of experiments."""
    plants, experiments = population_of(loaded), experiments_on(loaded)
    runs = [run for run in RUNS if run in loaded.compare.runs]
    cases = {run: (run, reading) for run in runs}
    if any(experiment.name == "period_doubled" for experiment in experiments):
        slower = Reading(DOUBLED_PERIOD, (*reading.settings, ("sampling_period", "2ms")))
        cases[DOUBLED_PERIOD] = FIRST, slower
    drawn = plants.loops(values, [*cases.values()])
    # What experiments ask of readings, no draw decides.
    readings = under(reading, loaded.compare, plants.named(values[0])).control.readings
    for of_plant in drawn:
        loops = dict(zip(cases, of_plant, strict=True))
        yield from (loops[run] for run in runs)
        yield from (experiment.change(loops, readings) for experiment in experiments)


def error_ratios(
    experiments: Sequence[BenchExperiment],
    base: Sequence[str],
    errors: Mapping[str, Array],
    stable: NDArray[np.bool_],
    reading: str,
    joints: Sequence[int],
) -> Iterator[Prediction]:
    """Ratios from errors (N, runs, n) by name, and stability (N, runs); runs are `base`, then experiments."""
    for place, experiment in enumerate(experiments, start=len(base)):
        beside = base.index(experiment.beside)
        kept = stable[:, place] & stable[:, beside]
        for i, joint in enumerate(joints):
            ratio = errors[experiment.error][kept, place, i] / errors[experiment.error][kept, beside, i]
            spread = np.quantile(ratio, (0.5, 0.05, 0.95)) if kept.sum() >= LEAST else np.full(3, np.nan)
            yield Prediction(experiment.name, reading, joint, int(kept.sum()), *map(float, spread))


def gaps_between(predicted: Sequence[Prediction], readings: Sequence[str]) -> dict[str, Gaps]:
    """Gap of 90 % ranges, on the joint where it is widest, by experiment and pair of readings.

    Pairs that overlap have a negative gap, and pairs with an unknown range none.
    """
    by_experiment: dict[str, Gaps] = {}
    for experiment in dict.fromkeys(row.experiment for row in predicted):
        rows = {(row.reading, row.joint): row for row in predicted if row.experiment == experiment}
        joints = dict.fromkeys(joint for _, joint in rows)
        gaps = {
            (a, b): max(_gap(rows[a, joint], rows[b, joint]) for joint in joints)
            for a, b in combinations(readings, 2)
        }
        by_experiment[experiment] = {pair: gap for pair, gap in gaps.items() if gap > -np.inf}
    return by_experiment


def told_apart(gaps: Mapping[str, Gaps]) -> dict[str, Gaps]:
    """Pairs of readings that each experiment tells apart, with their gaps."""
    return {name: {pair: gap for pair, gap in by_pair.items() if gap > 0.0} for name, by_pair in gaps.items()}


def never_told_apart(gaps: Mapping[str, Gaps], readings: Sequence[str]) -> list[list[str]]:
    """Pairs of readings that no experiment tells apart, of those with a known gap."""
    widest: dict[tuple[str, str], float] = {}
    for by_pair in gaps.values():
        for pair, gap in by_pair.items():
            widest[pair] = max(gap, widest.get(pair, gap))
    return [[*pair] for pair in combinations(readings, 2) if widest.get(pair, 1.0) <= 0.0]


def _gap(a: Prediction, b: Prediction) -> float:
    """Gap between two ranges; negative where they meet, minus infinity where one is unknown."""
    gap = max(a.low, b.low) - min(a.high, b.high)
    return gap if np.isfinite([a.low, b.low]).all() else -np.inf
