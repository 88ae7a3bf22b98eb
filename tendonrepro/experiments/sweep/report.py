"""The tables of a sweep: a row per point for the terminal, and a row per point, run and joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table

PAIRS = {"c1_c2": CONTROLLERS[:2], "c2_c3": CONTROLLERS[1:]}
"""Ratios by their keys, and the runs they compare."""

COLUMNS: Mapping[str, tuple[str, float]] = {
    "mae_deg": ("mae", np.rad2deg(1.0)),
    "rmse_deg": ("rmse", np.rad2deg(1.0)),
    "max_deg": ("max_error", np.rad2deg(1.0)),
    "overshoot_deg": ("overshoot", np.rad2deg(1.0)),
    "s_rms": ("s_rms", 1.0),
    "torque_rms": ("torque_rms", 1.0),
    "torque_step_rms": ("torque_step_rms", 1.0),
    "H_hat_rms": ("H_hat_rms", 1.0),
    "epsilon_rms": ("epsilon_rms", 1.0),
    "saturated": ("saturated", 1.0),
    "fast_share": ("fast_share", 1.0),
}
"""What is kept of each run: name, statistic of the batch, and factor from SI units."""


def sweep_tables(data: Mapping[str, Any]) -> list[Table]:
    """Both tables."""
    keys = " and ".join(axis["key"] for axis in data["keys"])
    caption = f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
    caption += "A diverged run has its numbers up to its end."
    points = list(point_rows(data))
    short = {name: (name, ".3f") for name in points[0]}
    return [
        Table("points", f"Sweep over {keys}: MAE of each joint, deg, and ratios of MAE", points, short),
        Table("sweep", caption, list(table_rows(data)), terminal=()),
    ]


def point_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row per point: MAE of every run and joint, ratios, and the statuses."""
    for point in data["points"]:
        row: dict[str, Any] = {"point": point["label"]}
        for run, found in point["runs"].items():
            row |= _joined(short_name(run), data["joints"], found["mae_deg"])
        for pair, ratio in point["ratio"].items():
            row |= _joined(pair_name(pair), data["joints"], ratio)
        bad = [f"{short_name(run)} {x['status']}" for run, x in point["runs"].items() if x["status"] != "ok"]
        yield row | {"status": bad or "ok"}


def _joined(name: str, joints: Sequence[int], values: Sequence[float]) -> dict[str, float]:
    return {f"{name} {joint}": value for joint, value in zip(joints, values, strict=True)}


def short_name(run: str) -> str:
    """Name of a run where there is little room."""
    return run.replace("controller_", "C").replace("_", " ")


def pair_name(pair: str) -> str:
    """Name of a ratio of two controllers."""
    return pair.upper().replace("_", "/")


def table_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row per point, run and joint: values of the keys, then all numbers."""
    for point in data["points"]:
        texts = {axis["key"]: axis["texts"][k] for axis, k in zip(data["keys"], point["places"], strict=True)}
        for run, found in point["runs"].items():
            for k, joint in enumerate(data["joints"]):
                row = texts | {"run": run, "joint": joint}
                row |= {name: found[name] for name in ("status", "status_time_s")}
                yield row | {name: found[name][k] for name in COLUMNS}
