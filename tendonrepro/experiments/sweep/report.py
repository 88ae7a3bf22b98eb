"""A sweep as text for a terminal, and as a table with a row per point, run and joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.console import columns
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import write_table

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


def sweep_text(data: Mapping[str, Any]) -> str:
    """Text of what a sweep found.

    Parameters
    ----------
    data : mapping
        As :func:`tendonrepro.experiments.sweep.command.run_sweep` returns it.

    Returns
    -------
    str
    """
    keys = " and ".join(axis["key"] for axis in data["keys"])
    if data.get("dry_run"):
        plan = columns([(label, f"{samples} samples") for label, samples in data["samples"].items()])
        head = f"sweep over {keys}: {len(data['samples'])} points of {len(data['runs'])} runs are valid"
        return f"{head}\n{plan}\nwould write to {data['out']}"
    joints, points = data["joints"], data["points"]
    sizes = [f"{short_name(run)} {joint}" for run in data["runs"] for joint in joints]
    ratios = [f"{pair_name(pair)} {joint}" for pair in points[0]["ratio"] for joint in joints]
    lines = [["", *sizes, *ratios, "status"]]
    for point in points:
        numbers = [x for found in point["runs"].values() for x in found["mae_deg"]]
        numbers += [x for ratio in point["ratio"].values() for x in ratio]
        cells = [f"{x:.3f}" if np.isfinite(x) else "-" for x in numbers]
        ended = {short_name(run): found["status"] for run, found in point["runs"].items()}
        several = ", ".join(f"{run} {status}" for run, status in ended.items() if status != "ok")
        status = several if len({*ended.values()}) > 1 else next(iter(ended.values()))
        lines.append([point["label"], *cells, status])
    head = f"Sweep over {keys}: MAE of each joint, deg, and ratios of MAE"
    return f"{head}\n{columns(lines)}\n\nTable and figure are in {data['out']}"


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


def write_sweep_table(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write the table of a sweep as csv (full digits) and Markdown (rounded)."""
    rows = list(table_rows(data))
    headings = {"run": "Run", "joint": "Joint", "status": "Status", "status_time_s": "Until (s)"}
    headings |= {name: heading for name, (_, heading, _) in COLUMNS.items()}
    keys = " and ".join(axis["key"] for axis in data["keys"])
    caption = f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
    caption += "A diverged run has its numbers up to its end."
    return write_table(rows, folder, "sweep", caption, {x: (headings.get(x, x), ".4g") for x in rows[0]})
