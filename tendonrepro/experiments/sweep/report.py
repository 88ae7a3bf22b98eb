"""A sweep as text for a terminal, and as a table with a row per point, run and joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table

PAIRS = {"c1_c2": CONTROLLERS[:2], "c2_c3": CONTROLLERS[1:]}
"""Ratios by their keys, and the runs they compare."""

COLUMNS: Mapping[str, tuple[str, str, float]] = {
    "mae_deg": ("mae", "MAE (deg)", np.rad2deg(1.0)),
    "rmse_deg": ("rmse", "RMSE (deg)", np.rad2deg(1.0)),
    "max_deg": ("max_error", "Max (deg)", np.rad2deg(1.0)),
    "overshoot_deg": ("overshoot", "Overshoot (deg)", np.rad2deg(1.0)),
    "s_rms": ("s_rms", "RMS s (rad/s)", 1.0),
    "torque_rms": ("torque_rms", "RMS torque (N m)", 1.0),
    "torque_step_rms": ("torque_step_rms", "RMS torque step (N m)", 1.0),
    "H_hat_rms": ("H_hat_rms", "RMS H_hat (N m)", 1.0),
    "epsilon_rms": ("epsilon_rms", "RMS epsilon (rad/s2)", 1.0),
    "saturated": ("saturated", "Saturated (share)", 1.0),
    "fast_share": ("fast_share", "Fast error (share)", 1.0),
}
"""What is kept of each run: name, statistic of the batch, heading, and factor from SI units."""


def sweep_tables(data: Mapping[str, Any]) -> list[Table]:
    """A row per point for the terminal, and a row per point, run and joint with every number."""
    keys = " and ".join(axis["key"] for axis in data["keys"])
    rows = list(table_rows(data))
    headings = {"run": "Run", "joint": "Joint", "status": "Status", "status_time_s": "Until (s)"}
    headings |= {name: heading for name, (_, heading, _) in COLUMNS.items()}
    caption = f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
    caption += "A diverged run has its numbers up to its end."
    every = {name: (headings.get(name, name), ".4g") for name in rows[0]}
    points = list(point_rows(data))
    short = {name: (name, ".3f") for name in points[0]}
    return [
        Table("points", f"Sweep over {keys}: MAE of each joint, deg, and ratios of MAE", points, short),
        Table("sweep", caption, rows, every, terminal=()),
    ]


def point_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row per point: MAE of every run and joint, ratios, and the statuses."""
    for point in data["points"]:
        row: dict[str, Any] = {"point": point["label"]}
        for run, found in point["runs"].items():
            row |= _joined(short_name(run), data["joints"], found["mae_deg"])
        for pair, ratio in point["ratio"].items():
            row |= _joined(pair_name(pair), data["joints"], ratio)
        ended = {short_name(run): found["status"] for run, found in point["runs"].items()}
        several = [f"{run} {status}" for run, status in ended.items() if status != "ok"]
        yield row | {"status": several if len({*ended.values()}) > 1 else next(iter(ended.values()))}


def _joined(name: str, joints: Sequence[int], values: Sequence[float]) -> dict[str, float]:
    return {f"{name} {joint}": value for joint, value in zip(joints, values, strict=True)}


def short_name(run: str) -> str:
    """Name of a run where there is little room."""
    return run.replace("controller_", "C").replace("_", " ")


def pair_name(pair: str) -> str:
    """Name of a ratio of two controllers."""
    return pair.upper().replace("_", "/")


def table_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row per point, run and joint: values of the keys as written, then all numbers."""
    keys = [axis["key"] for axis in data["keys"]]
    for point in data["points"]:
        texts = [axis["texts"][place] for axis, place in zip(data["keys"], point["places"], strict=True)]
        for run, found in point["runs"].items():
            for k, joint in enumerate(data["joints"]):
                row = dict(zip(keys, texts, strict=True)) | {"run": run, "joint": joint}
                row |= {name: found[name] for name in ("status", "status_time_s")}
                yield row | {name: found[name][k] for name in COLUMNS}
