"""Figures of the decoupling experiment: 6 and 9 to 12."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, REFERENCE, stroke_of
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.tables import rounded

_ANGLES = {"q_motor_encoder": "Motor", "q_encoder": "Joint"}


def draw_angles(file: TraceFile, traces: list[Trace], *, variables: Sequence[str]) -> Canvas:
    """Figures 6 and 9: angles of all motors; where motor 1 turns alone those of all joints, too."""
    (trace,) = traces
    names = [_ANGLES[variable] for variable in variables]
    labels = [[(f"{name}s", f"{name} angle (deg)")] for name in names]
    canvas = Canvas(COLUMN_MM, 18.0 + 40.0 * len(names), labels)
    for letter, name, variable in zip(canvas.axes, names, variables, strict=True):
        for joint in trace.joint:
            values, label = _degrees(trace, variable, joint), f"{'/'.join(names).capitalize()} {joint}"
            canvas.curve(letter, f"{name} {joint}", trace.time, values, stroke_of(joint), label=label)
    if "q_encoder" in variables:
        canvas.note("b", _slope(file, trace))
    return canvas


def _slope(file: TraceFile, trace: Trace) -> str:
    """Slope of joint 2 over joint 1, beside the coupling's."""
    S = file.plant.matrix("S", (1, 2))
    first, second = (_degrees(trace, "q_encoder", joint) for joint in (1, 2))
    first, second = first - first[0], second - second[0]
    if not first.any():
        return ""
    slope, coupling = first @ second / (first @ first), S[1, 0] / S[0, 0]
    return f"$\\Delta q_2/\\Delta q_1$ = {slope:.4f},  $S_{{21}}/S_{{11}}$ = {coupling:.4f}"


def draw_joint(file: TraceFile, traces: list[Trace], *, joint: int) -> Canvas:
    """Figures 10 to 12: a joint's angle by the motors and by its encoder, and their difference."""
    (trace,) = traces
    labels = [[(f"Joint {joint}", "Joint angle (deg)")], [("Calculated − encoder", "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 92.0, labels)
    calculated, encoder = (_degrees(trace, name, joint) for name in ("q_calculated", "q_encoder"))
    canvas.curve("a", "Encoder", trace.time, encoder, REFERENCE, label=f"Encoder ({file.source})")
    label = r"Calculated, $S\,q_\mathrm{motor}$"
    canvas.curve("a", "Calculated", trace.time, calculated, stroke_of(1), label=label)
    canvas.zero_line("b")
    difference = calculated - encoder
    canvas.curve("b", "Difference", trace.time, difference, stroke_of(1))
    beside = "\nthe paper gives no value" if of_paper(file) else ""
    canvas.note("b", f"MAE {rounded(float(mae(difference)), '.4f')}°{beside}")
    return canvas


def _degrees(trace: Trace, name: str, joint: int) -> Array:
    return np.rad2deg(trace[name][:, trace.joint.index(joint)])
