"""What an explanation shows: JSON, tables and a figure."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tendonrepro.analysis.explain import Explanation, explain, slow_ratio, view_pairs
from tendonrepro.analysis.margins import LOW_FREQUENCY, ChannelMargins
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.control import TYPICAL_ERROR_DEG, estimate_age, stiffness
from tendonrepro.results.summary import PAIRS
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

_OF_RUN = ("spectral_radius", "decay", "ringing_decay", "ringing_hz", "disk_margin")
_OF_JOINT = tuple(name for name in ChannelMargins._fields if name != "stable")
_NOT_SHOWN = {"ringing_decay", "gain_margin_hz", "crossover_hz", "delay_margin_s"}
"""Columns that the terminal has no room for."""


def explain_result(loaded: LoadedConfig) -> Result:
    """Explain a configuration."""
    from tendonrepro.analysis.figures import draw_margins

    try:
        explanation = explain(loaded)
    except ValueError as error:
        # NumPy's and SciPy's words for matrices that numbers cannot hold.
        message, hint = f"the loop cannot be linearised: {error}", "look at masses and stiffness"
        raise TendonreproError(message, where=loaded.origin, hint=hint) from error
    figures = {"explain_margins": lambda: draw_margins(explanation)}
    return Result(explanation_data(explanation), explanation_parts(explanation), figures)


def explanation_data(explanation: Explanation) -> dict[str, object]:
    """Plain numbers with the keys of ``--json``, some NaN."""
    modes, margins = explanation.modes, explanation.margins
    torque = {
        run: {name: [getattr(joint, name) for joint in joints] for name in _OF_JOINT}
        for run, joints in margins.items()
    }
    configured, *changes = explanation.changes.items()
    return {
        "schema_version": 2,
        "joints": list(explanation.joints),
        "postures_deg": np.rad2deg(explanation.postures).tolist(),
        "spectral_radius": {run: of_run["spectral_radius"] for run, of_run in modes.items()},
        "gain_margin": {run: of_run["gain_margin"] for run, of_run in torque.items()},
        "phase_margin": {run: of_run["phase_margin_deg"] for run, of_run in torque.items()},
        "loop_gain": {run: of_run["loop_gain"] for run, of_run in torque.items()},
        "loop_gain_frequency_hz": LOW_FREQUENCY,
        "predicted_ratio": dict.fromkeys(PAIRS) | configured[1]["ratio"],
        "predicted_ratio_error_deg": TYPICAL_ERROR_DEG,
        "predicted_ratio_holds": all(of_run["stable"] for of_run in modes.values()),
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
        "runs": {run: {**of_run, "torque": torque[run]} for run, of_run in modes.items()},
        "what_if": dict(changes),
    }


def explanation_parts(explanation: Explanation) -> list[Table | str]:
    """Margins of every run, ratios of slow errors, and what changes would do."""
    stability = (
        f"Stability of the sampled loop, worst of {len(explanation.postures)} postures "
        f"({explanation.origin}); margins with the other joints' loops closed, gain as a factor."
    )
    ratios = (
        f"Ratios of errors. Near {TYPICAL_ERROR_DEG:g} deg under slow loads no plant counts while loops "
        "are stable and well damped; least and largest are of small errors on this arm, without "
        f"friction, up to {explanation.ringing_hz:g} Hz. Ages in periods."
    )
    what_if = "What a change would do: slowest decay of each run, 1/s (negative: unstable), and slow errors"
    changes = [
        {"change": name, **what["decay"], **what["ratio"]} for name, what in explanation.changes.items()
    ]
    rows = list(margin_rows(explanation))
    shown = [name for name in rows[0] if name not in _NOT_SHOWN]
    parts: list[Table | str] = [Table("explain", stability, rows, terminal=shown)]
    if unstable := [run for run, modes in explanation.modes.items() if not modes["stable"]]:
        parts.append(f"Unstable, so without margins or slow errors: {', '.join(unstable)}.")
    if slow := list(slow_rows(explanation)):
        parts.append(Table("slow_errors", ratios, slow))
    return [*parts, Table("changes", what_if, changes)]


def margin_rows(explanation: Explanation) -> Iterator[dict[str, object]]:
    """Yield modes and margins of every run and joint."""
    for run, modes in explanation.modes.items():
        of_run = {name: value for name, value in modes.items() if name in _OF_RUN}
        for joint, margins in zip(explanation.joints, explanation.margins[run], strict=True):
            yield {
                "run": run,
                "joint": joint,
                **of_run,
                **{name: getattr(margins, name) for name in _OF_JOINT},
            }


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
                "ratio": slow_ratio(a, b)[k],
                "least": float(of_pair.of_joints[0, k]) if of_pair else None,
                "largest": float(of_pair.of_joints[1, k]) if of_pair else None,
                "rmse_in_the_paper": printed[k] if printed else None,
                "age_of_the_first": float(ages[0][k]),
                "age_of_the_second": float(ages[1][k]),
                "surface_softer_by": float(softer[k]),
            }
