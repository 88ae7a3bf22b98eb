"""What was found about the loops of a configuration as plain numbers and as files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tendonrepro.analysis.analysis import PAIRS, Explanation, RunMargins, explain
from tendonrepro.analysis.margins import LOW_FREQUENCY, ChannelMargins
from tendonrepro.analysis.report import explanation_parts
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.linear import View
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age
from tendonrepro.results.study import Outcome, run_study

SCHEMA_VERSION = 1


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
    margins = found.margins
    ratio = {pair: sizes[TYPICAL_ERROR_DEG].tolist() for pair, sizes in found.ratios.items()}
    return {
        "schema_version": SCHEMA_VERSION,
        "joints": list(found.joints),
        "postures_deg": np.rad2deg(found.postures).tolist(),
        "spectral_radius": {run: margin.spectral_radius for run, margin in margins.items()},
        "gain_margin": {run: [c.gain_up for c in m.channels] for run, m in margins.items()},
        "phase_margin": {run: [_deg(c.phase) for c in m.channels] for run, m in margins.items()},
        "loop_gain": {run: [c.loop_gain for c in m.channels] for run, m in margins.items()},
        "loop_gain_frequency_hz": LOW_FREQUENCY,
        "predicted_ratio": dict.fromkeys(PAIRS) | ratio,
        "predicted_ratio_error_deg": TYPICAL_ERROR_DEG,
        "predicted_ratio_by_error_deg": {
            pair: {f"{size:g}": values.tolist() for size, values in sizes.items()}
            for pair, sizes in found.ratios.items()
        },
        "predicted_ratio_holds": all(margin.stable for margin in margins.values()),
        "runs": {run: _run_data(found.views[run], margin) for run, margin in margins.items()},
        "what_if": {
            change: {"decay": dict(what.decay), "ratio": {k: v.tolist() for k, v in what.ratios.items()}}
            for change, what in found.what_if.items()
        },
    }


def _deg(angle: float) -> float:
    return float(np.rad2deg(angle))


def _run_data(view: View, margin: RunMargins) -> dict[str, Any]:
    def lists(channels: Sequence[ChannelMargins]) -> dict[str, list[float]]:
        return {
            "gain_margin": [c.gain_up for c in channels],
            "gain_margin_hz": [c.gain_up_hz for c in channels],
            "gain_reduction_margin": [c.gain_down for c in channels],
            "gain_reduction_margin_hz": [c.gain_down_hz for c in channels],
            "phase_margin_deg": [_deg(c.phase) for c in channels],
            "crossover_hz": [c.crossover_hz for c in channels],
            "delay_margin_s": [c.delay for c in channels],
            "loop_gain": [c.loop_gain for c in channels],
        }

    return {
        "law": view.law_name,
        "payload_kg": view.payload,
        "output_delay": view.delay,
        "stable": margin.stable,
        "decay": margin.decay,
        "decay_hz": margin.frequency,
        "ringing_decay": margin.ringing_decay,
        "ringing_hz": margin.ringing_frequency,
        "disk_margin": margin.disk,
        "disk_margin_hz": margin.disk_hz,
        "estimate_age": estimate_age(view.law, view.delay).tolist(),
        "torque": lists(margin.channels),
    }
