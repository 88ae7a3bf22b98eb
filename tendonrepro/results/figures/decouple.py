"""Figures of the decoupling experiment: 6 and 9 to 12."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, REFERENCE, stroke_of
from tendonrepro.results.records import Trace, TraceFile


def draw_pull(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 6: motor 1 alone turns; the slope of joint 2 over joint 1 beside the coupling's."""
    (trace,) = traces
    canvas = Canvas(COLUMN_MM, 92.0, [[("Motors", "Motor angle (deg)")], [("Joints", "Joint angle (deg)")]])
    for joint in trace.joint:
        label, stroke = f"Motor/joint {joint}", stroke_of(joint)
        canvas.curve(
            "a", f"Motor {joint}", trace.time, _degrees(trace, "q_motor_encoder", joint), stroke, label=label
        )
        canvas.curve(
            "b", f"Joint {joint}", trace.time, _degrees(trace, "q_encoder", joint), stroke, label=label
        )
    S = file.plant.matrix("S", (1, 2))
    first, second = (_degrees(trace, "q_encoder", joint) for joint in (1, 2))
    first, second = first - first[0], second - second[0]
    if first.any():
        slope, coupling = first @ second / (first @ first), S[1, 0] / S[0, 0]
        canvas.note("b", f"$\\Delta q_2/\\Delta q_1$ = {slope:.4f},  $S_{{21}}/S_{{11}}$ = {coupling:.4f}")
    return canvas


def draw_motor_angles(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 9: angles of all motors."""
    (trace,) = traces
    canvas = Canvas(COLUMN_MM, 58.0, [[("", "Motor angle (deg)")]])
    for joint in trace.joint:
        values = _degrees(trace, "q_motor_encoder", joint)
        canvas.curve("a", f"Motor {joint}", trace.time, values, stroke_of(joint))
    return canvas


def draw_joint(file: TraceFile, traces: list[Trace], *, joint: int) -> Canvas:
    """Figures 10 to 12: a joint's angle by the motors and by its encoder, and their difference."""
    (trace,) = traces
    labels = [[(f"Joint {joint}", "Joint angle (deg)")], [("Calculated − encoder", "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 88.0, labels)
    calculated, encoder = (_degrees(trace, name, joint) for name in ("q_calculated", "q_encoder"))
    canvas.curve("a", "Encoder", trace.time, encoder, REFERENCE, label=f"Encoder ({file.source})")
    label = r"Calculated, $S\,q_\mathrm{motor}$"
    canvas.curve("a", "Calculated", trace.time, calculated, stroke_of(1), label=label)
    canvas.zero_line("b")
    difference = calculated - encoder
    canvas.curve("b", "Difference", trace.time, difference, stroke_of(1), label="")
    known = difference[np.isfinite(difference)]
    if len(known):
        canvas.note("b", f"MAE {mae(known):.4f}°")
    return canvas


def _degrees(trace: Trace, name: str, joint: int) -> Array:
    return np.rad2deg(trace[name][:, trace.joint.index(joint)])
