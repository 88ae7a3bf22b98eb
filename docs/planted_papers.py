"""Error rates of the verdicts, from stored errors of stable plants: ``python docs/planted_papers.py``.

It makes `planted.json` and `given.json` again from `stable_errors.npz`, without an ensemble.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from stored_results import RESULTS, store

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.monte_carlo.shares import rate_of
from tendonrepro.results.summary import NOISE
from tendonrepro.verdicts.planted import StableErrors, verdicts_on_papers
from tendonrepro.verdicts.rules import Ruling
from tendonrepro.verdicts.statements import OK

NOISES = (NOISE, 0.05)
"""Noises of a run that are tried; the first counts."""

WORST = 0.9
"""Share of the plants on which the best of a paper has to be the worst, for the headline of README."""

FILE = "stable_errors.npz"


def store_errors(held: StableErrors) -> None:
    """Store with the digits of single precision."""
    columns = {f"{name} plants": plants.astype(np.int32) for name, plants in held.plants.items()}
    columns |= {f"{name} errors": np.float32(errors) for name, errors in held.errors.items()}
    np.savez_compressed(RESULTS / FILE, joints=held.joints, draws=held.draws, **columns)


def stored_errors() -> StableErrors:
    """What `store_errors` stored."""
    with np.load(RESULTS / FILE) as stored:
        names = [key.removesuffix(" plants") for key in stored if key.endswith(" plants")]
        return StableErrors(
            joints=tuple(stored["joints"].tolist()),
            draws=int(stored["draws"]),
            plants={name: stored[f"{name} plants"].astype(np.int64) for name in names},
            errors={name: stored[f"{name} errors"].astype(np.float64) for name in names},
        )


def planted_record(held: StableErrors) -> dict[str, Any]:
    """How often made-up papers are contradicted: as published, and under each interpretation and noise."""
    rows = [
        {"reading": name, "noise": noise} | outcomes(held, name, noise)
        for name in held.plants
        for noise in NOISES
    ]
    (first,) = (row for row in rows if (row["reading"], row["noise"]) == (PRINTED, NOISE))
    head = {key: first[key] for key in ("papers", "false_contradicted", "noise")}
    return {"draws": held.draws} | head | {"readings": rows}


def outcomes(held: StableErrors, reading: str, noise: float) -> dict[str, Any]:
    """What became of the made-up papers of one interpretation."""
    papers = list(verdicts_on_papers(held, published(), [*published().judgements], reading=reading, noise=noise))
    hits = {
        "false_contradicted": [any(ruling.verdict == "contradicted" for ruling in rulings.values()) for rulings in papers],
        "order_not_met": [rulings["C2"].verdict == "not_met" for rulings in papers],
        "best_is_worst": [worst_on(rulings["C2"]) >= WORST for rulings in papers],
        "no_order": [rulings["C2"].verdict == "not_testable" for rulings in papers],
    }
    return {"papers": len(papers)} | {name: rate_of(sum(found), len(papers)).as_row() for name, found in hits.items() if papers}


def worst_on(order: Ruling) -> float:
    """Share of the plants on which the best controller of a paper is the worst in all columns; 0 without a best."""
    return order.evidence["beside"][-1]["share"] if "beside" in order.evidence else 0.0


REPEATED, REPEATS, MOVED = 100, 4, 1e-6
"""Stable plants whose runs are repeated, how often, and by how much their masses move, relative."""


def scatter_of_repeats(ensemble: EnsembleData) -> dict[str, float]:
    """Relative scatter of a run's errors as published: median, nine of ten, root mean square; and that of RMSE over MAE."""
    study = load_study(None, (), None, PRINTED)
    box = study.population
    stable = np.logical_and.reduce([ensemble.status(run, PRINTED) == OK for run in RUNS])
    values = np.repeat(ensemble.draws[np.flatnonzero(stable)[:REPEATED]], REPEATS, axis=0)
    masses = [place for place, name in enumerate(box.names) if "mass" in name]
    values[:, masses] *= 1.0 + MOVED * np.random.default_rng(0).standard_normal((len(values), len(masses)))
    cases = [study.cases[study.lookup[run, PRINTED]] for run in RUNS]
    runs = [simulate_batch(loops) for loops in zip(*box.loops(values, cases), strict=True)]
    still = np.logical_and.reduce([run.status == OK for run in runs]).reshape(-1, REPEATS).all(axis=1)
    errors = np.log([[run.statistics[metric] for metric in METRICS] for run in runs])
    errors = errors.reshape(len(RUNS), len(METRICS), -1, REPEATS, errors.shape[-1])[:, :, still]
    size, shape = errors.std(axis=3, ddof=1), (errors[:, 1] - errors[:, 0]).std(axis=2, ddof=1)
    return {
        "plants": int(still.sum()),
        "median": float(np.median(size)),
        "nine_of_ten": float(np.quantile(size, 0.9)),
        "size": float(np.sqrt((size**2).mean())),
        "shape": float(np.sqrt((shape**2).mean())),
    }


def store_rates(held: StableErrors) -> None:
    """Store what follows from the errors of stable plants."""
    # Only who makes stored results has the library.
    from given_tables import given_tables, without_the_nearest

    store("planted.json", planted_record(held))
    given = given_tables(held)
    store("given.json", given | {"without_the_nearest": without_the_nearest(held, given)})


if __name__ == "__main__":
    store_rates(stored_errors())
