"""Figures 9 to 16 with the measurement over the simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex, to_rgb

from tendonrepro.arrays import Array
from tendonrepro.results.figures.catalogue import FIGURES, save
from tendonrepro.results.figures.compare import MEAN_WINDOW, mean_curve
from tendonrepro.results.figures.panels import Canvas, FigureArtists
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, REFERENCE, Stroke, journal_style, stroke_of
from tendonrepro.results.records import VARIABLES, Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS, LOADS

NUMBERS = (9, 10, 11, 12, 13, 14, 15, 16)
"""Figures that are overlaid."""

_LAW_CAPTION = (
    "Sliding variable, estimate of the lumped uncertainty and torque of the controllers: "
    f"means over {MEAN_WINDOW * 1e3:g} ms."
)
_PALE = 0.5
"""Share of white in the colour of a simulated curve."""
_DASHES = (3.2, 1.6)
_DARK = Stroke("#333333")


@dataclass(frozen=True)
class Pair:
    """A measured run and its simulation.

    Parameters
    ----------
    measured : Trace
    simulated : Trace or None
        On the measured axes; None where the model could not be run.
    """

    measured: Trace
    simulated: Trace | None


@dataclass(frozen=True)
class _Run:
    pair: Pair
    name: str
    stroke: Stroke


Values = Callable[[Trace], Array | None]


def saved_overlay(measured: TraceFile, pairs: Mapping[str, Pair], folder: Path, number: int) -> list[Path]:
    """Draw and save one figure; see `draw_overlay`."""
    return save(draw_overlay(number, measured, pairs), folder)


def available_overlays(measured: TraceFile) -> list[int]:
    """Numbers of the figures that a measured file can show."""
    return [number for number in NUMBERS if FIGURES[number].traces(measured)]


def draw_overlay(number: int, measured: TraceFile, pairs: Mapping[str, Pair]) -> FigureArtists:
    """Draw one figure, measured solid over simulated dashed and pale.

    Parameters
    ----------
    number : int
        One of `available_overlays`.
    measured : TraceFile
        Gives the coupling matrices and the name of the version.
    pairs : Mapping
        Measured runs with their simulations, by run.

    Returns
    -------
    FigureArtists
    """
    runs = [pairs[trace.name] for trace in FIGURES[number].traces(measured)]
    with journal_style():
        if number == 9:
            sheet = _motors(runs[0])
        elif number in (10, 11, 12):
            sheet = _joint(runs[0], number - 9)
        elif number == 13:
            sheet = _motor_differences(runs[0], measured)
        elif number == 15:
            sheet = _law(_dressed(runs))
        else:
            sheet = _tracking(_dressed(runs))
        return sheet.finish(number, _caption(number, measured, runs))


def _caption(number: int, measured: TraceFile, runs: list[Pair]) -> str:
    shown = _LAW_CAPTION if number == 15 else FIGURES[number].caption
    if not any(pair.simulated for pair in runs):
        return f"Figure {number}. {shown} Measured; there is no simulation beside it."
    models = [pair.simulated for pair in runs if pair.simulated is not None]
    ends = [
        f"The simulated run {trace.name} diverged at {trace.attributes['status_time']:.2f} s."
        for trace in models
        if trace.status == "diverged"
    ]
    origin = f"Made by tendonrepro {measured.tendonrepro_version}."
    words = "Measured solid; simulated on the measured motion pale and dashed."
    return " ".join([f"Figure {number}. {shown}", words, *ends, origin])


def _dressed(pairs: list[Pair]) -> list[_Run]:
    """Name and dress runs of a comparison: a payload takes the second stroke, further laws the later ones."""
    found: list[_Run] = []
    for pair in pairs:
        name = pair.measured.name
        words = name.replace("_", " ").capitalize()
        if name == LOADS["with_load"]:
            mass = float(pair.measured.attributes["payload_mass"])
            label = f"Controller 1, {mass:g} kg" if mass else "Controller 1, payload"
            found.append(_Run(pair, label, stroke_of(2)))
        elif name in CONTROLLERS:
            found.append(_Run(pair, words, stroke_of(CONTROLLERS.index(name) + 1)))
        else:
            others = sum(run.pair.measured.name not in CONTROLLERS for run in found)
            found.append(_Run(pair, words, stroke_of(4 + others)))
    return found


def _curves(sheet: Canvas, letter: str, run: _Run, values: Values, *, averaged: bool = False) -> None:
    """Draw the simulation, then the measurement over it; nothing where it was not measured."""
    ours = values(run.pair.measured)
    if ours is None:
        return
    model = run.pair.simulated
    modelled = None if model is None else values(model)
    if model is not None and modelled is not None:
        pale = Stroke(_pale(run.stroke.colour), _DASHES, 0.8)
        diverged = model.status == "diverged"
        label = f"{run.name}, simulated" if run.name else ""
        x, y = mean_curve(model.time, modelled) if averaged else (model.time, modelled)
        sheet.curve(letter, f"{run.name} simulated", x, y, pale, label=label, diverged=diverged)
    solid = Stroke(run.stroke.colour, (), 0.8)
    time = run.pair.measured.time
    x, y = mean_curve(time, ours) if averaged else (time, ours)
    label = f"{run.name}, measured" if run.name else ""
    sheet.curve(letter, f"{run.name} measured", x, y, solid, label=label)


def _variable(name: str, joint: int) -> Values:
    """Values of a variable on one joint, angles in degrees; None where a run does not hold it."""

    def values(trace: Trace) -> Array | None:
        if name not in trace or joint not in trace.joint:
            return None
        found = trace[name][:, trace.joint.index(joint)]
        return np.rad2deg(found) if VARIABLES[name][0] == "rad" else found

    return values


def _difference(first: Values, second: Values) -> Values:
    def values(trace: Trace) -> Array | None:
        one, other = first(trace), second(trace)
        return None if one is None or other is None else one - other

    return values


def _through(S_inv: Array, name: str, motor: int) -> Values:
    """Motor angle of a joint variable."""

    def values(trace: Trace) -> Array | None:
        if name not in trace or len(trace.joint) != len(S_inv):
            return None
        return np.asarray(np.rad2deg(trace[name] @ S_inv[trace.joint.index(motor)]))

    return values


def _motors(pair: Pair) -> Canvas:
    sheet = Canvas(COLUMN_MM, 66.0, [[("", "Motor angle (deg)")]])
    for joint in pair.measured.joint:
        run = _Run(pair, f"Motor {joint}", stroke_of(joint))
        _curves(sheet, "a", run, _variable("q_motor_encoder", joint))
    return sheet


def _joint(pair: Pair, joint: int) -> Canvas:
    labels = [[(f"Joint {joint}", "Joint angle (deg)")], [("Calculated − encoder", "Difference (deg)")]]
    sheet = Canvas(COLUMN_MM, 96.0, labels)
    calculated, encoder = (_variable(name, joint) for name in ("q_calculated", "q_encoder"))
    _curves(sheet, "a", _Run(pair, "Encoder", _DARK), encoder)
    _curves(sheet, "a", _Run(pair, "Calculated", stroke_of(1)), calculated)
    sheet.zero_line("b")
    _curves(sheet, "b", _Run(pair, "", stroke_of(1)), _difference(calculated, encoder))
    return sheet


def _motor_differences(pair: Pair, measured: TraceFile) -> Canvas:
    labels = [[("Motors", "Motor angle (deg)")], [("From encoders − from desired", "Difference (deg)")]]
    sheet = Canvas(COLUMN_MM, 100.0, labels)
    S_inv = measured.plant.matrix("S_inv", pair.measured.joint)
    sheet.zero_line("b")
    for motor in pair.measured.joint:
        run = _Run(pair, f"Motor {motor}", stroke_of(motor))
        encoder, desired = (_through(S_inv, name, motor) for name in ("q_encoder", "q_d"))
        asked = desired(pair.measured)
        if asked is not None:
            name = f"Motor {motor} desired"
            sheet.curve("a", name, pair.measured.time, asked, REFERENCE, label="From desired, measured")
        _curves(sheet, "a", run, encoder)
        _curves(sheet, "b", _Run(pair, "", run.stroke), _difference(encoder, desired))
    return sheet


def _tracking(runs: list[_Run]) -> Canvas:
    joints = sorted({joint for run in runs for joint in run.pair.measured.joint})
    rows = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    sheet = Canvas(PAGE_MM, 112.0, labels)
    for letter, (variable, joint) in zip(sheet.letters, product(rows, joints), strict=True):
        if variable == "e":
            sheet.zero_line(letter)
        else:
            _desired(sheet, letter, runs, joint)
        _panel(sheet, letter, runs, _variable(variable, joint))
    return sheet


def _desired(sheet: Canvas, letter: str, runs: list[_Run], joint: int) -> None:
    """Draw the reference of the first run that recorded it."""
    for run in runs:
        angles = _variable("q_d", joint)(run.pair.measured)
        if angles is not None:
            sheet.curve(
                letter, "Desired", run.pair.measured.time, angles, REFERENCE, label="Desired, measured"
            )
            return


def _law(runs: list[_Run]) -> Canvas:
    joints = sorted({joint for run in runs for joint in run.pair.measured.joint})
    rows = {
        "s": r"Sliding variable $s$ (rad/s)",
        "H_hat": r"Estimate $\hat{H}$ (N m)",
        "tau_m": r"Torque $\tau_m$ (N m)",
    }
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    sheet = Canvas(PAGE_MM, 156.0, labels)
    for letter, (variable, joint) in zip(sheet.letters, product(rows, joints), strict=True):
        sheet.zero_line(letter)
        _panel(sheet, letter, runs, _variable(variable, joint), averaged=True)
    return sheet


def _panel(sheet: Canvas, letter: str, runs: list[_Run], values: Values, *, averaged: bool = False) -> None:
    if all(values(run.pair.measured) is None for run in runs):
        sheet.not_recorded(letter)
    for run in runs:
        _curves(sheet, letter, run, values, averaged=averaged)


def _pale(colour: str) -> str:
    red, green, blue = (share + _PALE * (1.0 - share) for share in to_rgb(colour))
    return to_hex((red, green, blue))
