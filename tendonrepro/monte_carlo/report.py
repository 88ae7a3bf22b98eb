"""The table of readings: what each makes of the printed ranking, as numbers, rows, text and words."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.configuration.models.readings import parse_reading
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shards import Block, read_array
from tendonrepro.monte_carlo.shares import (
    QUANTILES,
    RANKINGS,
    RATIO_NAMES,
    RATIOS,
    reading_summary,
)
from tendonrepro.physics.control import estimator_weights
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import NOTHING, Table

_OK, _ORDER, _BEST = "ok C1 / C2 / C3 (%)", "C1 < C2 < C3 MAE (%)", "C1 best, MAE (%)"


def population_summary(data: EnsembleData) -> dict[str, Any]:
    """Everything the table says about one population.

    ``laws`` counts statuses under the printed reading; a reading's ``theory`` is the ratio C1/C2 of slowly
    changing errors per joint, beside what `shares.reading_summary` finds.
    """
    found = [reading_summary(data, name) | {"theory": _slow_ratio(data, name)} for name in data.readings]
    laws = {
        run: {status: share["count"] for status, share in shares.items()}
        for run, shares in found[0]["status"].items()
    }
    return {"plants": len(data), "joints": list(data.joints), "laws": laws, "readings": found}


def _slow_ratio(data: EnsembleData, name: str) -> dict[str, float]:
    """Ratio C1/C2 of slowly changing errors per joint, docs/theory.md; NaN where a drawn number enters."""
    settings = dict(parse_reading(name).settings)
    applied, drawn = settings.get("stored_torque") == "applied", settings.get("hardware") == "drawn"
    waited = float(settings.get("output_delay", 0)) if applied else 0.0
    if settings.get("estimate_filter") == "estimate" or (applied and drawn):
        waited = float("nan")
    ages = (1.0, 2.0) @ estimator_weights(np.array(data.alpha), settings.get("weights", "interpolating"))
    return {
        f"joint_{joint}": float(age)
        for joint, age in zip(data.joints, (ages + waited) / (1.0 + waited), strict=True)
    }


def spot_checks(shards: Path, identity: str, blocks: Sequence[Block]) -> dict[str, Any]:
    """Largest difference from the SciPy stepper among the blocks that were checked, and where it was.

    ``compared`` are those that ran to their end in both steppers, so that sizes could be compared.
    """
    stored = [(block, read_array(shards / block.file_name(identity), "check")) for block in blocks]
    checks = [{"block": block} | check for block, text in stored if (check := json.loads(str(text)))]
    # Two steppers never agree to the last bit; a difference of nothing stands for a run without an end.
    compared = [check for check in checks if check["difference"]]
    worst = max(compared, key=lambda check: float(check["difference"]), default=None)
    return {
        "experiments": len(checks),
        "compared": len(compared),
        "disagreements": sum(check["difference"] is None for check in checks),
        "largest": worst and worst["difference"],
        "where": worst and "{run}, {reading}, {block}, draw {draw}".format(**worst),
    }


def flat_rows(population: str, summary: Mapping[str, Any]) -> Iterator[dict[str, object]]:
    """Yield a row per reading, ranking or ratio, set of plants, metric and joint (or both)."""
    for reading in summary["readings"]:
        for of in (*RANKINGS, *RATIOS):
            for plants, metrics in reading[of].items():
                for metric, joints in metrics.items():
                    for joint, found in joints.items():
                        start = {"population": population, "reading": reading["name"], "of": of}
                        yield start | {"over": plants, "metric": metric, "joint": joint} | _flat(found)


def _flat(found: Mapping[str, Any]) -> dict[str, object]:
    """Quantiles with their intervals as columns of their own."""
    row: dict[str, object] = {}
    for name, value in found.items():
        ends = {f"{name}_{end}": value[end] for end in ("low", "high")} if name in QUANTILES else {}
        row |= {name: value["value"] if ends else value} | ends
    return row


def status_rows(population: str, summary: Mapping[str, Any]) -> Iterator[dict[str, object]]:
    """Yield a row per reading, run and status: count and share with its interval."""
    for reading in summary["readings"]:
        for run, shares in reading["status"].items():
            for status, share in shares.items():
                start = {"population": population, "reading": reading["name"], "run": run, "status": status}
                yield start | {key: share[key] for key in ("count", "share", "low", "high")}


def reader_row(reading: Mapping[str, Any], joints: Sequence[int]) -> dict[str, str]:
    """One reading in the table for a reader."""
    ordered, ratios = reading["share_c1_lt_c2_lt_c3"], {key: reading[key]["all_ok"]["mae"] for key in RATIOS}
    inside, outside = (len(reading["agreement"][key]) for key in ("inside", "outside"))
    alone = ordered["all_ok"]["mae"]
    return {
        "Reading": reading["name"],
        _OK: " / ".join(percent(reading["status"][run]["ok"]["share"], "") for run in CONTROLLERS),
        "plants all ok": str(alone["both"]["plants"]),
        _ORDER: share_text(alone["both"]),
        **{f"joint {joint}": percent(alone[f"joint_{joint}"]["share"], "") for joint in joints},
        "RMSE (%)": share_text(ordered["all_ok"]["rmse"]["both"]),
        "diverged last, MAE (%)": share_text(ordered["diverged_last"]["mae"]["both"]),
        "C3 < C2 < C1 MAE (%)": share_text(reading["share_c3_lt_c2_lt_c1"]["all_ok"]["mae"]["both"]),
        _BEST: share_text(reading["share_c1_best"]["all_ok"]["mae"]["both"]),
        **{
            f"{RATIO_NAMES[key]} joint {joint}": quantile_text(ratio[f"joint_{joint}"])
            for key, ratio in ratios.items()
            for joint in joints
        },
        "RMSE/MAE rises (%)": share_text(reading["share_rmse_over_mae_rises"]["both"]),
        "distance from the print": quantile_text(reading["distance"]),
        "printed ratios inside": f"{inside} of {inside + outside}",
        "verdict": reading["agreement"]["verdict"],
    }


def percent(share: float | None, unit: str = " %") -> str:
    """Share as per cent with one digit behind the point."""
    return NOTHING if share is None else f"{100.0 * share:.1f}{unit}"


def share_text(share: Mapping[str, Any]) -> str:
    """Share and interval in per cent."""
    if share["share"] is None:
        return NOTHING
    if share["low"] is None:
        return percent(share["share"], "")
    return f"{percent(share['share'], '')} ({percent(share['low'], '')} to {percent(share['high'], '')})"


def quantile_text(ratio: Mapping[str, Any]) -> str:
    """Median and the central 90 % of a ratio."""
    values = [ratio[name]["value"] for name in ("median", "q05", "q95")]
    if None in values:
        return NOTHING
    return "{:.3f} ({:.3f} to {:.3f})".format(*values)


def ensemble_tables(summary: Mapping[str, Any]) -> Iterator[Table]:
    """Yield ``readings`` and ``statuses`` with all digits, and a table for a reader of each population."""
    held = summary["populations"].items()
    for name, rows_of in (("readings", flat_rows), ("statuses", status_rows)):
        every = [row for population, one in held for row in rows_of(population, one)]
        yield Table(name, "", every, terminal=(), suffixes=("csv",))
    for place, (name, one) in enumerate(held):
        caption = (
            f"Population {name}, {one['plants']} plants. Shares are shares of the box, with 95 % intervals "
            f"from {summary['scramblings']} scramblings; ratios are medians of the ratio of MAE over plants "
            f"on which all three laws are ok, with their central 90 %."
        )
        rows = [reader_row(reading, one["joints"]) for reading in one["readings"]]
        shown = _terminal(one["joints"]) if place == 0 else ()
        yield Table(f"readings_{name}", caption, rows, {key: (key, "") for key in rows[0]}, shown, ("md",))


def _terminal(joints: Sequence[int]) -> list[str]:
    """Columns that fit a terminal."""
    ratios = [f"{name} joint {joints[0]}" for name in RATIO_NAMES.values()]
    return ["Reading", _OK, _ORDER, _BEST, *ratios, "verdict"]


def cost_text(cost: Mapping[str, float]) -> str:
    """What an ensemble costs, in words.

    Examples
    --------
    >>> cost_text({"experiments": 130560, "processor_hours": 0.29, "gigabytes": 0.0243})
    '130,560 experiments, about 17 minutes of one processor and 24 MB'
    >>> cost_text({"experiments": 1.3e9, "processor_hours": 2900.0, "gigabytes": 243.2})
    '1,300,000,000 experiments, about 2,900 hours of one processor and 243 GB'
    """
    hours, size = cost["processor_hours"], cost["gigabytes"]
    lasts = f"{hours:,.0f} hours" if hours >= 2.0 else f"{max(60.0 * hours, 1.0):.0f} minutes"
    takes = f"{size:.0f} GB" if size >= 2.0 else f"{max(1e3 * size, 1.0):.0f} MB"
    return f"{cost['experiments']:,.0f} experiments, about {lasts} of one processor and {takes}"
