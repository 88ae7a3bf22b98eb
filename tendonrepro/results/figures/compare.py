"""Figures of the comparison of controllers: 13 to 16."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count, product

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import window_mean
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, REFERENCE, Stroke, stroke_of
from tendonrepro.results.records import VARIABLES, Trace, TraceFile

MEAN_WINDOW = 0.05
"""Width of the centred moving mean, s."""

_PAYLOAD = "_payload"


def controllers(file: TraceFile) -> list[Trace]:
    """List the runs to compare with each other: all but those with a payload."""
    runs = file.part("compare").runs
    return [trace for trace in runs.values() if not trace.name.endswith(_PAYLOAD)]


def draw_motors(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 13: motor angles from measured and from desired joint angles, and their difference."""
    (trace,) = traces
    labels = [[("Motors", "Motor angle (deg)")], [("From encoders − from desired", "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 92.0, labels)
    S_inv = file.plant.matrix("S_inv", trace.joint)
    desired, measured = (np.rad2deg(trace[name] @ S_inv.T) for name in ("q_d", "q_encoder"))
    canvas.note("a", _controller_runs(traces)[0].label)
    canvas.zero_line("b")
    for column, motor in enumerate(trace.joint):
        name, stroke = f"Motor {motor}", stroke_of(motor)
        canvas.curve(
            "a", f"{name} desired", trace.time, desired[:, column], REFERENCE, label="From desired angles"
        )
        canvas.curve("a", name, trace.time, measured[:, column], stroke, label=f"{name}, from encoders")
        canvas.curve("b", name, trace.time, measured[:, column] - desired[:, column], stroke, label="")
    return canvas


def draw_tracking(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 14, a column a joint: trajectories above, tracking errors below."""
    return _tracking(_controller_runs(traces))


def draw_payload(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 16: as Figure 14, of Controller 1 without and with a payload."""
    runs = []
    for trace in traces:
        mass = float(trace.attributes["payload_mass"])
        load = f"{mass:g} kg payload" if mass else "no payload"
        runs.append(_DrawnRun(trace, f"Controller 1, {load}", stroke_of(2 if mass else 1)))
    return _tracking(runs)


def draw_law(_file: TraceFile, traces: list[Trace], *, bands: bool = True) -> Canvas:
    """Figure 15, a column a joint: s, H_hat, tau_m, each as the band its samples fill and as their mean.

    Without `bands` the means stand alone.
    """
    rows = {
        "s": r"Sliding variable $s$ (rad/s)",
        "H_hat": r"Estimate $\hat{H}$ (N m)",
        "tau_m": r"Torque $\tau_m$ (N m)",
    }
    joints = _joints(traces)
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    canvas = Canvas(PAGE_MM, 150.0, labels)
    runs = _controller_runs(traces)
    for letter, (variable, joint) in zip(canvas.letters, product(rows, joints), strict=True):
        canvas.zero_line(letter)
        _curves(canvas, letter, runs, variable, joint, averaged=True, bands=bands)
    if bands:
        canvas.explain_bands(f"Pale: range of raw samples, dark: {MEAN_WINDOW * 1e3:g} ms mean")
    return canvas


@dataclass(frozen=True)
class _DrawnRun:
    """A run with the name and look it has in a figure."""

    trace: Trace
    name: str
    stroke: Stroke

    @property
    def label(self) -> str:
        match self.trace.status:
            case "diverged":
                return f"{self.name} (diverged at {self.trace.attributes['status_time']:.2f} s)"
            case "ringing":
                return f"{self.name} (ringing)"
        return self.name

    def holds(self, variable: str, joint: int) -> bool:
        return variable in self.trace and joint in self.trace.joint

    def values(self, variable: str, joint: int) -> Array:
        """Shape (T,), angles in degrees."""
        found = self.trace[variable][:, self.trace.joint.index(joint)]
        return np.rad2deg(found) if VARIABLES[variable][0] == "rad" else found


def _controller_runs(traces: list[Trace]) -> list[_DrawnRun]:
    """Name and dress the runs: Controllers 1 to 3 keep their strokes, further laws take the rest in turn."""
    known = {f"controller_{number}": number for number in (1, 2, 3)}
    others = count(4)
    return [
        _DrawnRun(
            trace, trace.name.replace("_", " ").capitalize(), stroke_of(known.get(trace.name) or next(others))
        )
        for trace in traces
    ]


def _joints(traces: list[Trace]) -> list[int]:
    return sorted({joint for trace in traces for joint in trace.joint})


def _tracking(runs: list[_DrawnRun]) -> Canvas:
    joints = _joints([run.trace for run in runs])
    rows = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    canvas = Canvas(PAGE_MM, 108.0, labels)
    for letter, (variable, joint) in zip(canvas.letters, product(rows, joints), strict=True):
        if variable == "e":
            canvas.zero_line(letter)
        else:
            _desired(canvas, letter, runs, joint)
        _curves(canvas, letter, runs, variable, joint)
    return canvas


def _desired(canvas: Canvas, letter: str, runs: list[_DrawnRun], joint: int) -> None:
    """Draw the reference of the run that lasts longest."""
    holding = [run for run in runs if run.holds("q_d", joint)]
    if holding:
        longest = max(holding, key=lambda run: run.trace.time[-1])
        canvas.curve(letter, "Desired", longest.trace.time, longest.values("q_d", joint), REFERENCE)


def _curves(
    canvas: Canvas,
    letter: str,
    runs: list[_DrawnRun],
    variable: str,
    joint: int,
    *,
    averaged: bool = False,
    bands: bool = True,
) -> None:
    """Draw a variable of every run that holds it, as it is or as a mean over the pale band of its samples."""
    holding = [run for run in runs if run.holds(variable, joint)]
    if not holding:
        canvas.not_recorded(letter)
    for run in holding:
        time, values = run.trace.time, run.values(variable, joint)
        diverged = run.trace.status == "diverged"
        if averaged and bands:
            canvas.band(letter, run.name, time, values, run.stroke, diverged=diverged)
        if averaged:
            time, values = mean_curve(time, values)
        canvas.curve(letter, run.name, time, values, run.stroke, label=run.label, diverged=diverged)


def mean_curve(time: Array, values: Array) -> tuple[Array, Array]:
    """Mean over `MEAN_WINDOW` of the samples (T,) that are there, once a window and at the end.

    More often would draw the beat of encoder counts.
    """
    known = np.isfinite(values)
    time, values = time[known], values[known]
    if len(time) < 2:
        return time, values
    samples = max(round(MEAN_WINDOW / (float(time[-1] - time[0]) / (len(time) - 1))), 1)
    places = np.append(np.arange(0, len(time) - 1, samples), len(time) - 1)
    return time[places], window_mean(values, samples)[places]
