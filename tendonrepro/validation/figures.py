"""Figures 9 to 16 of a measurement, with the simulation on the same panels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from tendonrepro.results.figures.catalogue import FIGURES, caption_of, drawings, runs_of
from tendonrepro.results.figures.style import REFERENCE, Drawing, Sheet, Stroke, journal_style, paler
from tendonrepro.results.records import Trace, TraceFile

_LABEL = "Thin, dashed: simulated"
_DASHES = (4.0, 1.6)
_WIDE, _THIN = 1.6, 0.5
"""Width of a measured and of a simulated curve, pt: where they lie on each other both can be seen."""
_PALE = 0.55
"""Share of white in the colour of a measured curve."""


def overlays(measured: TraceFile) -> list[str]:
    """Figures that a measured file can show; none measured Figure 6."""
    return [name for name in drawings(measured) if name != "fig06"]


def draw_overlay(name: str, measured: TraceFile, models: Mapping[str, Trace]) -> Drawing:
    """Draw one of `overlays`: measured wide and pale, simulated thin and dashed above.

    `models` are simulations on the measured axes, by run. What was not measured is not drawn.
    """
    spec = FIGURES[name]
    traces = spec.traces(measured)
    joints = {joint for trace in traces for joint in trace.joint}
    simulated = {trace.name: models[trace.name].of_joints(joints) for trace in traces if trace.name in models}
    file = replace(measured, runs=simulated)
    drawn = spec.traces(file)
    with journal_style():
        sheet = spec.draw(measured, traces)
        for line in sheet.lines.values():
            line.set_linestyle("-")
            line.set_zorder(1.5 if line.get_linewidth() < REFERENCE.width else 1.2)
        if drawn:
            _lay_over(sheet, spec.draw(file, drawn))
        origin = "Measured, and simulated on the measured motion" if drawn else "Measured"
        return sheet.finish(name, caption_of(name, measured, sheet, _made(traces, drawn)), origin)


def _made(measured: list[Trace], simulated: list[Trace]) -> str:
    """What was measured and simulated, in words of a caption."""
    told = f"Measured, {runs_of(measured)}"
    laid_over = f"on it simulated, thin and dashed: {runs_of(simulated)}"
    return f"{told}, wide and pale; {laid_over}" if simulated else f"{told}; no simulation"


def _lay_over(sheet: Sheet, over: Sheet) -> None:
    """Add the curves of simulated runs, without the motion that they follow."""
    # Letters count panels, and a measurement may have joints that the model has not.
    letters = {place: letter for letter, place in sheet.places.items()}
    measured = dict(sheet.lines)
    for (there, name), line in over.lines.items():
        letter = letters.get(over.places[there], "")
        if (letter, name) not in measured or "desired" in name.lower():
            continue
        below = measured[letter, name]
        colour = str(below.get_color())
        below.set(color=paler(colour, _PALE), linewidth=_WIDE)
        x, y = (np.asarray(values, float) for values in line.get_data())
        stroke, diverged = Stroke(colour, _DASHES, _THIN), (there, name) in over.diverged
        sheet.curve(letter, f"{name} simulated", x, y, stroke, label=_LABEL, diverged=diverged)
        sheet.lines[letter, f"{name} simulated"].set_zorder(2.0)
