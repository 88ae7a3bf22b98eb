"""From a reports folder to ``docs/results``, and to the closest plant that is shipped."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import stored_results
from bounds import bounds
from planted_papers import scatter_of_repeats, store_errors, store_rates, stored_errors
from stored_results import DOCS, nearest, of_joints, read, rounded, store, store_table, stored, write

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import WORDS
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import parse_reading
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.identification.bench import Simulated, bench_of, log_misfit
from tendonrepro.configuration.models.readings import KEPT, SHOWN
from tendonrepro.identification.bench import Goal, printed_numbers
from tendonrepro.monte_carlo.data import EnsembleData, read_ensemble
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.verdicts.planted import MOST_PLANTS, stable_errors
from tendonrepro.monte_carlo.report import COLUMNS, rows_of
from tendonrepro.reporting.contents import head_of
from tendonrepro.tuning.bench import PUBLISHED

CLOSEST = DOCS.parent / "configs" / "closest.yaml"


def take(reports: Path) -> None:
    """Take results over from a reports folder."""
    ledger = read(reports / "claims" / "claims.json")
    if (ledger.get("ensemble") or {}).get("source") != "local":
        sys.exit("these verdicts are the shipped ones; run tendonrepro claims again, beside the ensemble")
    summary = read(reports / "ensemble" / "summary.json")
    if read(reports / "claims" / "manifest.json").get("ensemble") != [summary["identity"], summary["draws"]]:
        sys.exit("these verdicts are of another ensemble; run tendonrepro claims again")
    store_ensemble(summary)
    ensemble = read_ensemble(reports / "ensemble")
    write("sample.json", sample_of(ensemble))
    store_errors(stable_errors(ensemble, [name for name in SHOWN if name in ensemble.readings], MOST_PLANTS))
    store_rates(stored_errors())
    store("repeats.json", scatter_of_repeats(ensemble))
    store("draws.json", misfit_of_draws(ensemble))
    store("bounds.json", bounds(ensemble))
    store("claims.json", ledger)
    decides = read(reports / "claims" / "decides.json")
    store("decides.json", {name: held | {"rows": held["rows"][:5]} for name, held in decides.items()})
    for folder in sorted(reports.glob("identify_all*")):
        take_closest(folder)
    if (reports / "closest").exists():
        if read(reports / "closest" / "manifest.json")["config"]["sha256"] != load_config("closest", "compare").sha256:
            sys.exit("reports/closest is of another plant; run tendonrepro compare --config closest --out reports/closest "
                     "--force, and make findings again")
        table2 = pd.read_csv(reports / "closest" / "tables" / "table2.csv")
        store("closest.json", table2[["run", "joint", "mae_deg", "rmse_deg"]].to_dict("records"))
    if (reports / "predict").exists():
        store("predict_starts.json", read(reports / "predict" / "predict.json"))
    if (reports / "edits").exists():
        store("edits.json", edits_of(read(reports / "edits" / "edits.json")))
    if (reports / "tune").exists():
        found = read(reports / "tune" / "tune.json")
        kept = {key: value for key, value in found.items() if key != "by_plant"}
        store("tune.json", kept | {"tuned_over_published": tuned_over_published(found["by_plant"])})


EDIT = ("edit", "runs", "also", "stable", "stable_share", "order_share", "ratios", "torque_steps_over_none",
        "first_smoothest_share", "spoils", "like", "ranked", "rank", "log10_likelihood_ratio", "named")  # fmt: skip
APART = ("stable_share", "order_share", "rank", "log10_likelihood_ratio", "named")


def edits_of(found: Mapping[str, Any]) -> dict[str, Any]:
    """Keep of every edit what pages show, and the ratios of those that have a rank."""
    rows = [
        {name: row[name] for name in EDIT if row["ranked"] or name not in ("ratios", "spoils")}
        | {"apart": {name: row["apart"][name] for name in APART}}
        for row in found["edits"]
    ]
    return {**found, "edits": rows}


def store_ensemble(summary: Mapping[str, Any]) -> None:
    """Keep what pages show of an ensemble, a row for each interpretation, and what made it."""
    store("ensemble.json", head_of(summary))
    store_table("readings.csv", ("population", "reading", *COLUMNS), rows_of(summary))


def tuned_over_published(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Controller 2 tuned, over itself as published on the same arm: median error and roughness, by cap."""
    plain = [row for row in rows if row["stable"] and row["condition"] == PUBLISHED and not row["alone"] and "alpha" not in row]
    published = {row["draw"]: row for row in plain if row["law"] == "controller_2"}
    found = {}
    for cap in ("none", "1/3"):
        pairs = [(row, published[row["draw"]]) for row in plain
                 if (row["law"], row["cap"]) == ("ntsm", cap) and row["draw"] in published]
        found[cap] = {key: float(np.median([ours[key] / theirs[key] for ours, theirs in pairs]))
                      for key in ("error", "roughness")}
    return found


SAMPLED, SAMPLE = "encoder=ideal", 32
"""Interpretation of which the first plants are stored, stable or not, and how many."""

OF_EACH = 4
"""Plants of every other interpretation: the first on which all its runs are stable."""


def sample_of(ensemble: EnsembleData) -> dict[str, Any]:
    """Some plants of an ensemble as drawn, to the last digit, and how their runs ended: a test makes them again.

    Random noise depends on every row of the ranges, also on later ones. So plants with noise are left out.
    """
    of_row = dict(zip(ensemble.names, ensemble.draws.T, strict=True))
    noisy = (of_row["torque_noise_acts"] > 0.0) | (of_row["disturbance"] == WORDS["disturbance"].index("noise"))
    quiet, stable = np.flatnonzero(~noisy), STATUSES.index("ok")
    chosen = {
        name: quiet[np.all([ensemble.status(run, name)[quiet] == stable for run in RUNS], axis=0)][:OF_EACH]
        for name in SHOWN
        if name in ensemble.readings
    } | {SAMPLED: quiet[:SAMPLE]}
    plants = np.unique(np.concatenate([*chosen.values()]))

    def runs_of(name: str) -> dict[str, Any]:
        return {
            run: {"status": [STATUSES[code] for code in ensemble.status(run, name)[chosen[name]]]}
            | {key: rounded(ensemble.statistic(run, name, key)[chosen[name]].tolist()) for key in ("mae", "rmse")}
            for run in RUNS
        }

    return {
        "draws": {name: values[plants].tolist() for name, values in of_row.items()},
        "readings": {
            name: {"plants": np.searchsorted(plants, places).tolist(), "runs": runs_of(name)}
            for name, places in chosen.items()
        },
    }


NEAREST, REPEATS = 16, 16
"""Draws of each interpretation that are repeated, and how often: a search's misfit is a median of repeats, too."""


def nearest_draws(ensemble: EnsembleData, goal: Goal, reading: str) -> Array:
    """Values (N, P) of the rows of the `NEAREST` draws whose runs all end well, the nearest first."""
    status = np.stack([ensemble.status(run, reading) for run in goal.runs], axis=1)
    sizes = np.array([[ensemble.statistic(run, reading, metric) for metric in METRICS] for run in goal.runs])
    # How long a bad run lasted is not stored, and does not matter: only good ones count.
    drawn = Simulated(np.rad2deg(np.moveaxis(sizes, 2, 0)), status, np.ones(status.shape))
    stable = np.flatnonzero(drawn.ok.all(axis=1))
    nearest = stable[np.argsort(log_misfit(drawn, goal)[stable], kind="stable")]
    return np.asarray(ensemble.draws[nearest[:NEAREST]])


def misfit_of_draws(ensemble: EnsembleData) -> dict[str, Any]:
    """How near the draws of each interpretation shown come to Tables 2 and 3, without any search."""
    goal = printed_numbers(published(), ensemble.joints)
    bench = bench_of(load_ensemble(None))

    def misfit(name: str) -> float:
        near = nearest_draws(ensemble, goal, name)
        return float(bench.repeated(near, parse_reading(name), goal, REPEATS, [0]).median.min())

    return {"draws": len(ensemble), "misfit_log": {name: misfit(name) for name in SHOWN if name in ensemble.readings}}


BUDGET = ("budget", "draws", "evaluations", "rows", "ensemble_sha256")
"""What searches have to share to stand in one table: their effort, and the arm and ranges that they began with."""


def take_closest(folder: Path) -> None:
    """Add what `tendonrepro identify --fit all` found to what is stored, and ship the closest plant.

    It is the one that keeps every equation as published and has joint encoders, so that its errors are of joints.
    Stored searches of another budget are left out; a smaller budget than the stored one is refused.
    """
    found = read(folder / "identify.json")
    found["ensemble_sha256"] = read(folder / "manifest.json")["config"]["ensemble_sha256"]
    budget = {key: found[key] for key in BUDGET}
    before = stored("identify") if (stored_results.RESULTS / "identify.json").exists() else {"readings": []}
    if found["evaluations"] < before.get("budget", budget)["evaluations"]:
        sys.exit(f"the searches in {folder} are shorter than those that are stored; delete identify.json to start again")
    earlier = before["readings"]
    if before.get("budget") != budget:
        print(f"leaving out {len(earlier)} stored searches of another budget or arm", file=sys.stderr)
        earlier = []
    fresh = {search["name"]: search for search in searches_of(found)}
    searches = {search["name"]: search for search in earlier} | fresh
    of_all = {key: found[key] for key in ("fit", "window")} | {"budget": budget}
    store("identify.json", of_all | {"readings": sorted(searches.values(), key=lambda search: search["misfit_log"])})
    best = nearest(stored("identify")["readings"], of_joints(KEPT))
    if best and best["name"] in fresh:
        text = (folder / "plants" / f"{best['name']}.yaml").read_text(encoding="utf-8")
        CLOSEST.write_text(f"# yaml-language-server: $schema=schema.json\n#\n{text}", encoding="utf-8")


def searches_of(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What is kept of each interpretation in an ``identify.json``."""
    return [
        {key: reading[key] for key in ("name", "misfit_log", "searches", "best_shape")}
        | {
            "unknowns": len(reading["rows_searched"]),
            "largest": max(reading["numbers"], key=lambda row: abs(math.log(row["ratio"]))),
            "at_bound": {row["name"]: row["at_bound"] for row in reading["parameters"] if row["at_bound"]},
            # A test repeats it. Six digits of it are as much as its masses are moved by.
            "arm": {row["name"]: row["best"] for row in reading["parameters"]},
        }
        for reading in found["readings"]
    ]
