"""What was found about the loops of a configuration as plain numbers, tables and files."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from tendonrepro.analysis.analysis import PAIRS, Explanation, explain, view_pairs
from tendonrepro.analysis.margins import LOW_FREQUENCY, ChannelMargins
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age, stiffness
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.tables import Table

SCHEMA_VERSION = 1

_OF_RUN = (
    "law",
    "payload_kg",
    "output_delay",
    "stable",
    "decay",
    "decay_hz",
    "ringing_decay",
    "ringing_hz",
    "disk_margin",
    "disk_margin_hz",
)
_OF_TORQUE = tuple(name for name in ChannelMargins._fields if name != "stable")
_MARGINS = {
    "run": "Run",
    "joint": "Joint",
    "spectral_radius": "Spectral radius",
    "decay": "Decay (1/s)",
    "ringing_decay": "Ringing decays (1/s)",
    "ringing_hz": "Rings at (Hz)",
    "gain_margin": "Gain margin",
    "gain_margin_hz": "at (Hz)",
    "gain_reduction_margin": "Gain reduction margin",
    "phase_margin_deg": "Phase margin (deg)",
    "crossover_hz": "Crossover (Hz)",
    "delay_margin_s": "Delay margin (s)",
    "disk_margin": "Disk margin",
    "loop_gain": "Loop gain",
}
_SHOWN = (
    "run",
    "joint",
    "spectral_radius",
    "decay",
    "ringing_hz",
    "gain_margin",
    "phase_margin_deg",
    "disk_margin",
    "loop_gain",
)


def run_explain(request: Request, talk: Talk) -> dict[str, Any]:
    """Explain a configuration and write numbers, table, figures and manifest.

    Parameters
    ----------
    request : Request
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints: :func:`explanation_data`, ``text``, ``out`` and ``manifest``.

    Raises
    ------
    TendonreproError
        If the configuration has no controllers or no linear loop, or results cannot be written.
    """
    loaded = request.load("compare")
    return run_study("explain", loaded, request, lambda: study_explain(loaded), talk)


def study_explain(loaded: LoadedConfig) -> Outcome:
    """Explain a configuration."""
    from tendonrepro.analysis.figures import figures

    try:
        found = explain(loaded)
    except ValueError as error:
        # NumPy's and SciPy's words for matrices that numbers cannot hold.
        message, hint = f"the loop cannot be linearised: {error}", "look at masses and stiffness"
        raise TendonreproError(message, where=loaded.origin, hint=hint) from error
    return Outcome(explanation_data(found), explanation_parts(found), figures(found))


def explanation_data(found: Explanation) -> dict[str, Any]:
    """Plain numbers with the keys of ``--json``; what does not exist is NaN, which JSON writes as null."""

    def of_joints(name: str) -> dict[str, list[Any]]:
        return {run: [row[name] for row in rows] for run, rows in found.rows.items()}

    columns = {name: of_joints(name) for name in (*_OF_TORQUE, "estimate_age")}
    first = {run: rows[0] for run, rows in found.rows.items()}
    return {
        "schema_version": SCHEMA_VERSION,
        "joints": list(found.joints),
        "postures_deg": np.rad2deg(found.postures).tolist(),
        "spectral_radius": {run: row["spectral_radius"] for run, row in first.items()},
        "gain_margin": columns["gain_margin"],
        "phase_margin": columns["phase_margin_deg"],
        "loop_gain": columns["loop_gain"],
        "loop_gain_frequency_hz": LOW_FREQUENCY,
        "predicted_ratio": dict.fromkeys(PAIRS) | _typical(found),
        "predicted_ratio_error_deg": TYPICAL_ERROR_DEG,
        "predicted_ratio_by_error_deg": {
            pair: {f"{size:g}": ratio for size, ratio in sizes.items()}
            for pair, sizes in found.ratios.items()
        },
        "predicted_ratio_holds": all(row["stable"] for row in first.values()),
        "runs": {
            run: {name: row[name] for name in _OF_RUN}
            | {"estimate_age": columns["estimate_age"][run]}
            | {"torque": {name: columns[name][run] for name in _OF_TORQUE}}
            for run, row in first.items()
        },
        "what_if": found.what_if,
        "load_to_error": {
            "hz": found.loads.hertz.tolist(),
            "rad_per_nm": {law: size.tolist() for law, size in found.loads.error.items()},
            "arm_mode_hz": found.loads.mode_hz,
            "motion_hz": found.loads.motion_hz,
        },
    }


def _typical(found: Explanation) -> dict[str, list[float]]:
    """Ratios of every pair at the typical error."""
    return {pair: sizes[TYPICAL_ERROR_DEG] for pair, sizes in found.ratios.items()}


def explanation_parts(found: Explanation) -> list[Table | str]:
    """Margins of every run, its slow errors against its neighbour's, and what changes would do."""
    caption = (
        f"Stability of the sampled loop, worst of {len(found.postures)} postures ({found.origin}); "
        "margins with the other joints' loops closed, gain as a factor."
    )
    columns = {name: (head, ".6f" if name == "spectral_radius" else ".4g") for name, head in _MARGINS.items()}
    rows = list(chain.from_iterable(found.rows.values()))
    parts: list[Table | str] = [Table("explain", caption, rows, columns, _SHOWN)]
    if unstable := [run for run, held in found.rows.items() if not held[0]["stable"]]:
        parts.append(f"Unstable, so without margins or slow errors: {', '.join(unstable)}.")
    if slow := list(slow_rows(found)):
        caption = f"Errors near {TYPICAL_ERROR_DEG:g} deg under slow loads; no plant enters while loops are "
        parts.append(Table("slow_errors", f"{caption}stable and well damped. Ages in periods.", slow))
    caption = "What a change would do: slowest decay of each run, 1/s (negative: unstable), and slow errors"
    parts.append(Table("changes", caption, list(change_rows(found))))
    return parts


def slow_rows(found: Explanation) -> Iterator[dict[str, Any]]:
    """Yield the ratio of neighbouring laws' errors on each joint, and its factors: ages and slopes."""
    e = float(np.deg2rad(TYPICAL_ERROR_DEG))
    for pair, a, b in view_pairs(found.views):
        ages = [estimate_age(view.law, view.delay) for view in (a, b)]
        softer = stiffness(b.law, e) / stiffness(a.law, e)
        for k, joint in enumerate(found.joints):
            yield {
                "laws": f"{a.law_name} / {b.law_name}",
                "joint": joint,
                "ratio": found.ratios[pair][TYPICAL_ERROR_DEG][k],
                "age_of_the_first": float(ages[0][k]),
                "age_of_the_second": float(ages[1][k]),
                "surface_softer_by": float(softer[k]),
            }


def change_rows(found: Explanation) -> Iterator[dict[str, Any]]:
    """Yield a row for the configuration and for every change to it."""
    now = {"decay": {run: rows[0]["decay"] for run, rows in found.rows.items()}, "ratio": _typical(found)}
    for name, what in {"as configured": now, **found.what_if}.items():
        yield {"change": name, **what["decay"], **what["ratio"]}
