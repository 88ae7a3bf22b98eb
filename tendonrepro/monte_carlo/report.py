"""What an ensemble says of the printed ranking under each reading, or of every two runs around an own arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import combinations, product
from operator import getitem
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.box import Draw
from tendonrepro.configuration.models.control import unloaded_run
from tendonrepro.configuration.models.readings import Reading, parse_reading, under
from tendonrepro.experiments.loops import slow_error_ratio
from tendonrepro.files import Json
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.population import Population
from tendonrepro.monte_carlo.shares import quantiles_of, reading_summary, share_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS, PAIRS
from tendonrepro.results.tables import Table, TableRows

_BOTH = "all_ok.mae_and_rmse.both"
_RANKINGS = {
    "order": "share_c1_lt_c2_lt_c3",
    "first": "share_c1_best",
    "last": "share_c1_worst",
    "reverse": "share_c3_lt_c2_lt_c1",
    "tie": "share_c2_ties_c3",
}
_RATIOS = {
    **{f"{name}_joint_{joint}": f"ratio_{name}.all_ok.mae.joint_{joint}"
       for name in ("c1_c2", "c2_c3") for joint in (2, 3)},
    "joint_3_over_2": "joint_3_over_2.controller_1.mae",
    "growth": "rmse_over_mae_growth.joint_2",
}  # fmt: skip
COLUMNS = {
    "plants": f"share_c1_best.{_BOTH}.plants",
    **{column: f"{key}.{_BOTH}.share" for column, key in _RANKINGS.items()},
    "behind": "share_c2_lt_c1.all_ok.mae.joint_2.share",
    "late": f"without_start.share_c1_worst.{_BOTH}.share",
    "smooth": "share_c1_smoother.share",
    "rises": "share_rmse_over_mae_rises.both.share",
    "plants_diverged_last": "share_c1_best.diverged_last.mae_and_rmse.both.plants",
    **{f"{column}_diverged_last": f"{_RANKINGS[column]}.diverged_last.mae_and_rmse.both.share"
       for column in ("order", "first", "last")},
    **{f"{column}_{quantile}": f"{key}.{quantile}.value"
       for column, key in _RATIOS.items() for quantile in ("q05", "median", "q95")},
    **{f"stable_{run}": f"status.{run}.ok.share" for run in CONTROLLERS},
}  # fmt: skip
"""Columns, and where each number stands among those of a reading in ``summary.json``.

Shares are of the plants on which all three controllers are stable. A place counts where it holds in MAE and
RMSE on both joints: `order` is the published one, `first` and `last` are Controller 1's, `late` is `last`
without the first two seconds. `behind` is Controller 1 behind 2 in the MAE of joint 2, `smooth` its torque
the smoothest, and `rises` RMSE over MAE from Controller 1 to 3.
"""

_NO_SHARES = (*_RATIOS, "distance", "ratio")
"""How columns begin that are no shares."""

SOME = 8
"""Draws by which it shows whether a drawn number enters the ratio of slow errors."""


def population_summary(population: Population, data: EnsembleData) -> Json:
    """What there is to say about a population; ``laws`` counts statuses under the printed reading."""
    readings, joints = [reading_summary(data, name) for name in data.readings], data.joints
    seed = int(population.loaded.config.seed.si)
    draws = population.sample(seed, 0, 0, SOME)
    plants = [(population.configured(draw), population.asked_by_readings(draw)) for draw in draws]
    for reading in readings:
        ratio = common_slow_ratio(plants, parse_reading(reading["name"]))
        reading["theory"] = dict(zip((f"joint_{joint}" for joint in joints), ratio.tolist(), strict=True))
    laws = {
        run: {status: share["count"] for status, share in shares.items()}
        for run, shares in readings[0]["status"].items()
    }
    summary: Json = {"plants": len(data), "joints": list(joints), "laws": laws, "readings": readings}
    return {**summary, "pairs": [*pair_rows(data)]} if data.around else summary


def common_slow_ratio(plants: Sequence[tuple[CompareConfig, Draw]], reading: Reading) -> Array:
    """Ratio C1/C2 of slowly changing errors under a reading (n,), docs/theory.md.

    It is NaN where a drawn number enters, so that some plants, each with its draw, differ.
    """
    ratios = [slow_error_ratio(under(reading, config, draw), CONTROLLERS[:2]) for config, draw in plants]
    return np.where(np.isclose(ratios, ratios[0]).all(axis=0), ratios[0], np.nan)


def rows_of(summary: Json) -> Iterator[dict[str, object]]:
    """Yield the rows of ``readings.csv``; a KeyError for a summary of an older version."""
    for population, held in summary["populations"].items():
        for reading in held["readings"]:
            yield {"population": population, "reading": reading["name"], **_numbers_of(reading)}


def _numbers_of(reading: Json) -> dict[str, float | None]:
    """Numbers of a reading by `COLUMNS`."""
    return {column: _at(reading, path) for column, path in COLUMNS.items()}


def _at(reading: Json, path: str) -> Any:
    """What stands at a dotted path."""
    return reduce(getitem, path.split("."), reading)


def ensemble_tables(summary: Json) -> Iterator[Table | str]:
    """Yield the table of readings; around an arm those of pairs."""
    if "around" in summary:
        yield from _pair_tables(summary)
        return
    ((name, population),) = summary["populations"].items()
    caption = (
        f"Population {name}, {population['plants']} plants. Shares of the box, low and high from the "
        f"95 % interval by {summary['scramblings']} scramblings. Ratios are medians of the ratio of MAE "
        "over plants on which all three laws are ok. Their ranges, and other intervals, are in "
        "summary.json."
    )
    rows = [_with_verdict(reading) for reading in population["readings"]]
    shown = ["reading", *(f"stable_{run}" for run in CONTROLLERS), "order", "first"]
    shown += [*(f"{pair}_joint_2_median" for pair in PAIRS), "verdict"]
    yield Table(f"readings_{name}", caption, rows, _columns(rows), shown, ("csv", "md"))


def _with_verdict(reading: Json) -> dict[str, object]:
    """A reading's row, with the interval of the order, and what agrees with the print."""
    order = _at(reading, f"{_RANKINGS['order']}.{_BOTH}")
    return {
        "reading": reading["name"],
        **_numbers_of(reading),
        "order_low": order["low"],
        "order_high": order["high"],
        "distance": reading["distance"]["median"]["value"],
        "printed_ratios_inside": len(reading["agreement"]["inside"]),
        "verdict": reading["agreement"]["verdict"],
    }


def pairs_of(data: EnsembleData) -> list[tuple[str, str]]:
    """Runs that are compared: the three controllers, and others without payload with each of these."""
    others = [run for run in data.runs if run not in CONTROLLERS and not unloaded_run(run)]
    return [*combinations(CONTROLLERS, 2), *product(others, CONTROLLERS)]


@np.errstate(invalid="ignore")  # where a run diverged
def pair_rows(data: EnsembleData) -> Iterator[Json]:
    """Mean absolute error of one run over another's on the arms where both are stable, by joint.

    ``ratio`` is the median, ``ratio_low`` and ``ratio_high`` the ends of the central 90 % of the arms.
    ``share_smaller`` is the share of arms on which the first errs less, with its 95 % interval.
    """
    stable = STATUSES.index("ok")
    for reading, (first, over) in product(data.readings, pairs_of(data)):
        kept = (data.status(first, reading) == stable) & (data.status(over, reading) == stable)
        errors = [data.statistic(run, reading, "mae")[kept] for run in (first, over)]
        for i, joint in enumerate(data.joints):
            above, below = (sizes[:, i] for sizes in errors)
            ratio = quantiles_of(above / below, data.replicate[kept])
            share = share_of(above < below, data.replicate[kept]).as_row()
            yield {
                "reading": reading,
                "run": first,
                "over": over,
                "joint": joint,
                "arms": int(kept.sum()),
                "ratio": ratio["median"]["value"],
                "ratio_low": ratio["q05"]["value"],
                "ratio_high": ratio["q95"]["value"],
                "share_smaller": share["share"],
                "share_low": share["low"],
                "share_high": share["high"],
            }


def _columns(rows: TableRows) -> dict[str, tuple[str, str]]:
    """Headings, and formats: per cent of shares."""
    return {
        name: (
            name.replace("_", " ").replace("controller ", "C"),
            ".3f" if name.startswith(_NO_SHARES) else ".1%",
        )
        for name in rows[0]
    }


def _pair_tables(summary: Json) -> Iterator[Table | str]:
    """Yield the comparison of the runs, and how often each is stable."""
    (population,) = summary["populations"].values()
    pairs = population["pairs"]
    stability = [
        {"reading": reading["name"], "run": run} | {name: shares[name]["share"] for name in STATUSES}
        for reading in population["readings"]
        for run, shares in reading["status"].items()
    ]
    on = f"{population['plants']} arms {summary['around']['told']}"
    about = (
        f"Mean absolute error of one run over another's on {on}, where both are stable: median, central "
        "90 % of the arms, and the share of arms on which the first errs less, with its 95 % interval."
    )
    yield Table("pairs", about, pairs, _columns(pairs))
    yield Table(
        "stability", f"Share of {on} on which each run has which status.", stability, _columns(stability)
    )
    if not any(row["arms"] for row in pairs):
        yield "No two runs are stable on one arm. tendonrepro explain says how far from stable each loop is."
