"""Figures 9 to 16 of a measurement, the simulation as a second layer of the same panels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from tendonrepro.results.figures.catalogue import FIGURES, available, save
from tendonrepro.results.figures.compare import MEAN_WINDOW, draw_law
from tendonrepro.results.figures.panels import Canvas, FigureArtists
from tendonrepro.results.figures.style import REFERENCE, Stroke, journal_style, paler
from tendonrepro.results.records import Trace, TraceFile

_LAW = 15
_LAW_CAPTION = (
    "Sliding variable, estimate of the lumped uncertainty and torque of the controllers: "
    f"means over {MEAN_WINDOW * 1e3:g} ms."
)
_LABEL = "Thin, dashed: simulated"
_DASHES = (4.0, 1.6)
_WIDE, _THIN = 1.9, 0.7
"""Width of a measured curve and of the simulated one on top of it, pt; neither hides the other."""
_PALE = 0.55
"""Share of white in the colour of a measured curve."""


def available_overlays(measured: TraceFile) -> list[int]:
    """Numbers of the figures that a measured file can show; none measured Figure 6."""
    return [number for number in available(measured) if number >= 9]


def saved_overlay(measured: TraceFile, models: Mapping[str, Trace], folder: Path, number: int) -> list[Path]:
    """Draw and save one figure; see `draw_overlay`."""
    return save(draw_overlay(number, measured, models), folder)


def draw_overlay(number: int, measured: TraceFile, models: Mapping[str, Trace]) -> FigureArtists:
    """Draw one of `available_overlays`, simulated thin and dashed over measured wide and pale.

    `models` are simulations on the measured axes, by run; what was not measured of one is not drawn.
    """
    spec = FIGURES[number]
    traces = spec.traces(measured)
    joints = {joint for trace in traces for joint in trace.joint}
    # Bands of raw samples of all runs, twice, would hide the means.
    draw = partial(draw_law, bands=False) if number == _LAW else spec.draw
    drawn = []
    with journal_style():
        sheet = draw(measured, traces)
        for line in sheet.lines.values():
            line.set_linestyle("-")
            line.set_zorder(1.5 if line.get_linewidth() < REFERENCE.width else 1.2)
        for trace in traces:
            model = models[trace.name].of_joints(joints) if trace.name in models else None
            file = replace(measured, runs={trace.name: model} if model else {})
            for model in spec.traces(file):
                _lay_over(sheet, draw(file, [model]), model)
                drawn.append(model)
        origin = "Measured, and simulated on the measured motion" if drawn else "Measured"
        return sheet.finish(number, _caption(number, measured, drawn), origin)


def _lay_over(sheet: Canvas, over: Canvas, model: Trace) -> None:
    """Add the curves of a simulated run to those measured; it follows the measured motion, drawn already."""
    # Letters count panels, and a measurement may have joints that the model has not.
    letters = {place: letter for letter, place in sheet.places.items()}
    measured = sheet.lines
    for (there, name), line in over.lines.items():
        letter = letters.get(over.places[there], "")
        if (letter, name) not in measured or "desired" in name.lower():
            continue
        below = measured[letter, name]
        colour = "#333333"
        if below.get_linewidth() < REFERENCE.width:
            colour = str(below.get_color())
            below.set(color=paler(colour, _PALE), linewidth=_WIDE)
        x, y = (np.asarray(values, float) for values in line.get_data())
        diverged = model.status == "diverged"
        stroke = Stroke(colour, _DASHES, _THIN)
        sheet.curve(letter, f"{name} simulated", x, y, stroke, label=_LABEL, diverged=diverged)
        sheet.lines[letter, f"{name} simulated"].set_zorder(2.0)


def _caption(number: int, measured: TraceFile, drawn: list[Trace]) -> str:
    words = ["Measured wide and pale; simulated on the measured motion thin and dashed."]
    if not drawn:
        words = ["Measured; there is no simulation beside it."]
    words += [
        f"The simulated run {trace.name} diverged at {trace.attributes['status_time']:.2f} s."
        for trace in drawn
        if trace.status == "diverged"
    ]
    origin = f"Made by tendonrepro {measured.tendonrepro_version}."
    shown = _LAW_CAPTION if number == _LAW else FIGURES[number].caption
    return " ".join([f"Figure {number}. {shown}", *words, origin])
