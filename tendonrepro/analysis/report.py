"""What was found about the loops of a configuration, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tendonrepro.analysis.analysis import PAIRS, Explanation, WhatIf, view_pairs
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, estimate_age, stiffness
from tendonrepro.results.tables import Table

_MARGINS = {
    "run": "Run",
    "joint": "Joint",
    "spectral_radius": "Spectral radius",
    "decay_per_s": "Decay (1/s)",
    "ringing_decay_per_s": "Ringing decays (1/s)",
    "ringing_hz": "Rings at (Hz)",
    "gain_margin": "Gain margin",
    "gain_margin_hz": "at (Hz)",
    "gain_reduction_margin": "Gain reduction margin",
    "phase_margin_deg": "Phase margin (deg)",
    "crossover_hz": "Crossover (Hz)",
    "delay_margin_ms": "Delay margin (ms)",
    "disk_margin": "Disk margin",
    "loop_gain": "Loop gain",
}
_SHOWN = (
    "run",
    "joint",
    "spectral_radius",
    "decay_per_s",
    "ringing_hz",
    "gain_margin",
    "phase_margin_deg",
    "disk_margin",
    "loop_gain",
)


def explanation_parts(found: Explanation) -> list[Table | str]:
    """Margins of every run, its slow errors against its neighbour's, and what changes would do."""
    parts: list[Table | str] = [
        Table(
            "explain",
            f"Stability of the sampled loop, worst of {len(found.postures)} postures ({found.origin}); "
            "margins with the other joints' loops closed, gain as a factor.",
            list(margin_rows(found)),
            {name: (_MARGINS[name], ".6f" if name == "spectral_radius" else ".4g") for name in _MARGINS},
            _SHOWN,
        )
    ]
    unstable = [run for run, margin in found.margins.items() if not margin.stable]
    if unstable:
        parts.append(f"Unstable, so without margins or slow errors: {', '.join(unstable)}.")
    if slow := list(slow_rows(found)):
        caption = f"Errors near {TYPICAL_ERROR_DEG:g} deg under slow loads; no plant enters while loops are "
        parts.append(Table("slow_errors", f"{caption}stable and well damped. Ages in periods.", slow))
    caption = "What a change would do: slowest decay of each run, 1/s (negative: unstable), and slow errors"
    parts.append(Table("changes", caption, list(change_rows(found))))
    return parts


def margin_rows(found: Explanation) -> Iterator[dict[str, Any]]:
    """Yield one row per run and joint: all numbers about them."""
    for run, margin in found.margins.items():
        for joint, channel in zip(found.joints, margin.channels, strict=True):
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
                "phase_margin_deg": float(np.rad2deg(channel.phase)),
                "crossover_hz": channel.crossover_hz,
                "delay_margin_ms": 1e3 * channel.delay,
                "disk_margin": margin.disk,
                "loop_gain": channel.loop_gain,
            }


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
                "ratio": float(found.ratios[pair][TYPICAL_ERROR_DEG][k]),
                "age_of_the_first": float(ages[0][k]),
                "age_of_the_second": float(ages[1][k]),
                "surface_softer_by": float(softer[k]),
            }


def change_rows(found: Explanation) -> Iterator[dict[str, Any]]:
    """Yield a row for the configuration and for every change to it."""
    now = WhatIf(
        {run: margin.decay for run, margin in found.margins.items()},
        {pair: sizes[TYPICAL_ERROR_DEG] for pair, sizes in found.ratios.items()},
    )
    for name, what in {"as configured": now, **found.what_if}.items():
        row: dict[str, Any] = {"change": name} | dict(what.decay)
        for pair, ratio in what.ratios.items():
            row[pair.replace("_", "/") if pair in PAIRS else pair] = ratio.tolist()
        yield row
