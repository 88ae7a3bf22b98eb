"""The table of a sweep: a row per point, run and joint."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.results.tables import write_table

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


def rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row per point, run and joint: values of the keys as written, then all numbers.

    Parameters
    ----------
    data : mapping

    Yields
    ------
    dict
    """
    for point in data["points"]:
        values = {
            axis["key"]: axis["texts"][place]
            for axis, place in zip(data["keys"], point["places"], strict=True)
        }
        for run, found in point["runs"].items():
            for k, joint in enumerate(data["joints"]):
                row = values | {"run": run, "joint": joint, "status": found["status"]}
                row["status_time_s"] = found["status_time_s"]
                yield row | {name: found[name][k] for name in COLUMNS}


def write_sweep_table(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write a sweep's table as csv (full digits) and Markdown (rounded).

    Parameters
    ----------
    data : mapping
    folder : Path
        Made when missing.

    Returns
    -------
    list of Path
    """
    every = list(rows(data))
    headings = {"run": "Run", "joint": "Joint", "status": "Status", "status_time_s": "Until (s)"}
    headings |= {name: heading for name, (_, heading, _) in COLUMNS.items()}
    keys = " and ".join(axis["key"] for axis in data["keys"])
    caption = f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
    caption += "A diverged run has its numbers up to its end."
    columns = {name: (headings.get(name, name), ".4g") for name in every[0]}
    return write_table(every, folder, "sweep", caption, columns)
