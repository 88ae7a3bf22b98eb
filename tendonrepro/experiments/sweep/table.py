"""The table of a sweep: a row per point, run and joint."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.files import write_atomically
from tendonrepro.results.typeset import NOTHING, Sheet, markdown

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


def write_table(data: Mapping[str, Any], folder: Path) -> list[Path]:
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
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(every[0])
    writer.writerows([["" if _missing(cell) else cell for cell in row.values()] for row in every])
    headings = {"run": "Run", "joint": "Joint", "status": "Status", "status_time_s": "Until (s)"}
    headings |= {name: heading for name, (_, heading, _) in COLUMNS.items()}
    keys = " and ".join(axis["key"] for axis in data["keys"])
    sheet = Sheet(
        caption=f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
        "A diverged run has its numbers up to its end.",
        headings=[headings.get(name, name) for name in every[0]],
        numeric=[name in {"joint", "status_time_s", *COLUMNS} for name in every[0]],
        rows=[[_cell(cell) for cell in row.values()] for row in every],
    )
    paths = [folder / "sweep.csv", folder / "sweep.md"]
    for path, text in zip(paths, (stream.getvalue(), markdown(sheet)), strict=True):
        write_atomically(path, text)
    return paths


def _missing(cell: object) -> bool:
    return isinstance(cell, float) and not np.isfinite(cell)


def _cell(cell: object) -> str:
    if _missing(cell):
        return NOTHING
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
