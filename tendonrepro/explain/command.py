"""What was found about the loops of a configuration as plain numbers and as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.config.load import LoadedConfig
from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.linear import View
from tendonrepro.explain.analysis import PAIRS, Explanation, RunMargins, explain
from tendonrepro.explain.margins import LOW_FREQUENCY, ChannelMargins
from tendonrepro.explain.report import explanation_text
from tendonrepro.files import to_json
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age
from tendonrepro.results.folder import claimed, foretell_refusal
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.tables import write_table

SCHEMA_VERSION = 1

DATA = "explain.json"


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
    from tendonrepro.explain.figures import draw_explanation

    loaded, folder = request.load("compare"), request.folder("explain")
    if request.dry_run:
        foretell_refusal(folder, loaded.sha256, talk, force=request.force, command="explain")
        return _plan(loaded, folder)
    with claimed(folder, loaded.sha256, force=request.force, command="explain") as held:
        try:
            found = explain(loaded)
        except ValueError as error:
            # NumPy's and SciPy's words for matrices that numbers cannot hold.
            message, hint = f"the loop cannot be linearised: {error}", "look at masses and stiffness"
            raise TendonreproError(message, where=loaded.origin, hint=hint) from error
        data = explanation_data(found)
        manifest = make_manifest(loaded, held.seconds) | {"command": "explain"}
        held.clear()
        rows = list(margin_rows(found))
        caption = f"Stability of the sampled loop, worst of {len(found.postures)} postures ({found.origin})."
        columns = {name: (name, ".6g") for name in rows[0]}
        held.files += write_table(rows, folder / "tables", "explain", caption, columns)
        held.files += draw_explanation(found, folder / "figures")
        held.write(DATA, to_json(data))
        path = held.finish(manifest, talk)
    return data | {"text": explanation_text(found), "out": str(folder), "manifest": path}


def _plan(loaded: LoadedConfig, folder: Path) -> dict[str, Any]:
    plan = {"dry_run": True, "config_sha256": loaded.sha256, "out": str(folder)}
    text = f"{loaded.origin} is valid (sha256 {loaded.sha256[:12]})\nwould write to {folder}"
    return {"schema_version": SCHEMA_VERSION, "command": "explain"} | plan | {"text": text}


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


def margin_rows(found: Explanation) -> Iterator[dict[str, Any]]:
    """One row per run and joint for a table: run, joint and all numbers about them."""
    for run, margin in found.margins.items():
        for k, joint in enumerate(found.joints):
            channel = margin.channels[k]
            yield {
                "run": run,
                "joint": joint,
                "spectral_radius": margin.spectral_radius,
                "decay_per_s": margin.decay,
                "ringing_decay_per_s": margin.ringing_decay,
                "ringing_hz": margin.ringing_frequency,
                "gain_margin": channel.gain_up,
                "gain_margin_hz": channel.gain_up_hz,
                "gain_reduction_margin": channel.gain_down,
                "phase_margin_deg": _deg(channel.phase),
                "crossover_hz": channel.crossover_hz,
                "delay_margin_ms": 1e3 * channel.delay,
                "disk_margin": margin.disk,
                "loop_gain": channel.loop_gain,
            }
