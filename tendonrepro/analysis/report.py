"""What an explanation shows: JSON, tables and pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tendonrepro.analysis.explain import Change, Explanation, RunMargins, explain, view_pairs
from tendonrepro.analysis.margins import LOW_FREQUENCY, ChannelMargins
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import View
from tendonrepro.physics.control import TYPICAL_ERROR_DEG, estimate_age, stiffness
from tendonrepro.results.summary import PAIRS
from tendonrepro.results.tables import Table, TableColumns
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Site

SCHEMA_VERSION = 1

_COLUMNS: TableColumns = {
    "run": ("Run", ""),
    "joint": ("Joint", ""),
    "spectral_radius": ("Spectral radius", ".6f"),
    "decay": ("Decay (1/s)", ".4g"),
    "ringing_decay": ("Ringing decays (1/s)", ".4g"),
    "ringing_hz": ("Rings at (Hz)", ".4g"),
    "gain_margin": ("Gain margin", ".4g"),
    "gain_margin_hz": ("at (Hz)", ".4g"),
    "gain_reduction_margin": ("Gain reduction margin", ".4g"),
    "phase_margin_deg": ("Phase margin (deg)", ".4g"),
    "crossover_hz": ("Crossover (Hz)", ".4g"),
    "delay_margin_s": ("Delay margin (s)", ".4g"),
    "disk_margin": ("Disk margin", ".4g"),
    "loop_gain": ("Loop gain", ".4g"),
}
_FILES_ALONE = {"ringing_decay", "gain_margin_hz", "gain_reduction_margin", "crossover_hz", "delay_margin_s"}
"""Columns that the terminal has no room for."""


def explain_result(loaded: LoadedConfig, site: Site) -> Result:
    """Explain a configuration."""
    from tendonrepro.analysis.figures import figures

    try:
        explanation = explain(loaded, site.talk, site.start)
    except ValueError as error:
        # NumPy's and SciPy's words for matrices that numbers cannot hold.
        message, hint = f"the loop cannot be linearised: {error}", "look at masses and stiffness"
        raise TendonreproError(message, where=loaded.origin, hint=hint) from error
    return Result(explanation_data(explanation), explanation_parts(explanation), figures(explanation))


def explanation_data(explanation: Explanation) -> dict[str, object]:
    """Plain numbers with the keys of ``--json``, some NaN."""
    margins = explanation.margins

    def of_torque(name: str) -> dict[str, list[float]]:
        return {
            run: [getattr(joint, name) for joint in margins_of_run.joints]
            for run, margins_of_run in margins.items()
        }

    return {
        "schema_version": SCHEMA_VERSION,
        "joints": list(explanation.joints),
        "postures_deg": np.rad2deg(explanation.postures).tolist(),
        "spectral_radius": {
            run: margins_of_run.of_run["spectral_radius"] for run, margins_of_run in margins.items()
        },
        "gain_margin": of_torque("gain_margin"),
        "phase_margin": of_torque("phase_margin_deg"),
        "loop_gain": of_torque("loop_gain"),
        "loop_gain_frequency_hz": LOW_FREQUENCY,
        "predicted_ratio": dict.fromkeys(PAIRS) | _typical(explanation),
        "predicted_ratio_error_deg": TYPICAL_ERROR_DEG,
        "predicted_ratio_by_error_deg": {
            pair: {f"{size:g}": ratio for size, ratio in sizes.items()}
            for pair, sizes in explanation.ratios.items()
        },
        "ratio_range": {
            pair: {
                "low": of_pair.of_joints[0].tolist(),
                "high": of_pair.of_joints[1].tolist(),
                "all_joints": of_pair.all_joints.tolist(),
            }
            for pair, of_pair in explanation.ranges.items()
        },
        "ratio_range_below_hz": explanation.ringing_hz,
        "printed_rmse_ratio": explanation.printed,
        "predicted_ratio_holds": all(margins_of_run.of_run["stable"] for margins_of_run in margins.values()),
        "runs": {
            run: _run_data(margins_of_run, explanation.views[run]) for run, margins_of_run in margins.items()
        },
        "what_if": explanation.what_if,
        "load_to_error": {
            "hz": explanation.loads.hertz.tolist(),
            "rad_per_nm": {law: size.tolist() for law, size in explanation.loads.error.items()},
            "arm_mode_hz": explanation.loads.mode_hz,
            "motion_hz": explanation.loads.motion_hz,
        },
    }


def _run_data(margins: RunMargins, view: View) -> dict[str, object]:
    torque = {
        name: [getattr(joint, name) for joint in margins.joints]
        for name in ChannelMargins._fields
        if name != "stable"
    }
    return {**margins.of_run, "estimate_age": estimate_age(view.law, view.delay).tolist(), "torque": torque}


def _typical(explanation: Explanation) -> dict[str, list[float]]:
    return {pair: sizes[TYPICAL_ERROR_DEG] for pair, sizes in explanation.ratios.items()}


def explanation_parts(explanation: Explanation) -> list[Table | str]:
    """Margins of every run, ratios of slow errors, and what changes would do."""
    caption = (
        f"Stability of the sampled loop, worst of {len(explanation.postures)} postures "
        f"({explanation.origin}); "
        "margins with the other joints' loops closed, gain as a factor."
    )
    rows = [
        {"run": run, "joint": joint, **margins._asdict(), **of_run.of_run}
        for run, of_run in explanation.margins.items()
        for joint, margins in zip(explanation.joints, of_run.joints, strict=True)
    ]
    shown = [name for name in _COLUMNS if name not in _FILES_ALONE]
    parts: list[Table | str] = [Table("explain", caption, rows, _COLUMNS, shown)]
    if unstable := [run for run, of_run in explanation.margins.items() if not of_run.of_run["stable"]]:
        parts.append(f"Unstable, so without margins or slow errors: {', '.join(unstable)}.")
    if slow := list(slow_rows(explanation)):
        caption = (
            f"Ratios of errors. Near {TYPICAL_ERROR_DEG:g} deg under slow loads no plant counts while loops "
            "are stable and well damped; least and largest are of small errors on this arm, without "
            f"friction, up to {explanation.ringing_hz:g} Hz. Ages in periods."
        )
        parts.append(Table("slow_errors", caption, slow))
    caption = "What a change would do: slowest decay of each run, 1/s (negative: unstable), and slow errors"
    parts.append(Table("changes", caption, list(change_rows(explanation))))
    return parts


def slow_rows(explanation: Explanation) -> Iterator[dict[str, object]]:
    """Yield neighbouring laws' ratio of errors on each joint, and its factors."""
    e = float(np.deg2rad(TYPICAL_ERROR_DEG))
    for pair, a, b in view_pairs(explanation.views):
        of_pair, printed = explanation.ranges.get(pair), explanation.printed.get(pair)
        ages = [estimate_age(view.law, view.delay) for view in (a, b)]
        softer = stiffness(b.law, e) / stiffness(a.law, e)
        for k, joint in enumerate(explanation.joints):
            yield {
                "laws": f"{a.law_name} / {b.law_name}",
                "joint": joint,
                "ratio": explanation.ratios[pair][TYPICAL_ERROR_DEG][k],
                "least": float(of_pair.of_joints[0, k]) if of_pair else None,
                "largest": float(of_pair.of_joints[1, k]) if of_pair else None,
                "rmse_in_the_paper": printed[k] if printed else None,
                "age_of_the_first": float(ages[0][k]),
                "age_of_the_second": float(ages[1][k]),
                "surface_softer_by": float(softer[k]),
            }


def change_rows(explanation: Explanation) -> Iterator[dict[str, object]]:
    """Yield a row for the configuration and for every change to it."""
    decay = {run: margins.of_run["decay"] for run, margins in explanation.margins.items()}
    now: Change = {"decay": decay, "ratio": _typical(explanation)}
    for name, what in {"as configured": now, **explanation.what_if}.items():
        yield {"change": name, **what["decay"], **what["ratio"]}
