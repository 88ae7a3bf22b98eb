"""Figures of the decoupling experiment: 6 and 9 to 12."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import mae
from tendonrepro.physics.tendon_path import joint_positions
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, REFERENCE, Stroke, stroke_of
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import PlantRecord, Trace, TraceFile
from tendonrepro.results.tables import rounded

_LINKS = Stroke("#000000", (), 1.4)
_CARRIED = Stroke("#228833", (3.0, 1.5), 1.0)


def draw_pull(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 6: motor 1 alone turns; slope of joint 2 over joint 1 beside the coupling's; two postures."""
    (trace,) = traces
    labels = [
        [("Motors", "Motor angle (deg)")],
        [("Joints", "Joint angle (deg)")],
        [("Postures, to scale", "Height (m)")],
    ]
    canvas = Canvas(COLUMN_MM, 150.0, labels, apart=("Position (m)",))
    for joint in trace.joint:
        label, stroke = f"Motor/joint {joint}", stroke_of(joint)
        for letter, what, angle in (("a", "Motor", "q_motor_encoder"), ("b", "Joint", "q_encoder")):
            values = _degrees(trace, angle, joint)
            canvas.curve(letter, f"{what} {joint}", trace.time, values, stroke, label=label)
    S = file.plant.matrix("S", (1, 2))
    first, second = (_degrees(trace, "q_encoder", joint) for joint in (1, 2))
    first, second = first - first[0], second - second[0]
    if first.any():
        slope, coupling = first @ second / (first @ first), S[1, 0] / S[0, 0]
        canvas.note("b", f"$\\Delta q_2/\\Delta q_1$ = {slope:.4f},  $S_{{21}}/S_{{11}}$ = {coupling:.4f}")
    _draw_postures(canvas, "c", file.plant, trace)
    return canvas


def _draw_postures(canvas: Canvas, letter: str, plant: PlantRecord, trace: Trace) -> None:
    """Draw the links at the start and where joint 1 turned furthest, and link 2 as Fig. 6 is worded."""
    if not {"length", "posture"} <= plant.values.keys():
        canvas.not_recorded(letter)
        return
    length, posture = (plant.values[name].value for name in ("length", "posture"))
    q = trace["q_encoder"]
    furthest = int(np.abs(np.nan_to_num(q[:, 0] - q[0, 0])).argmax())
    start, turned = (joint_positions(length, np.cumsum(posture + q[place])) for place in (0, furthest))
    carried = turned[1] + start[[1, 2]] - start[1]
    canvas.chain(letter, "Start", start, REFERENCE, label="Links at the start")
    canvas.chain(letter, "Turned", turned, _LINKS, label="Links, motor 1 turned")
    canvas.chain(letter, "Carried", carried, _CARRIED, label="Link 2, were it only translated")


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
    canvas = Canvas(COLUMN_MM, 92.0, labels)
    calculated, encoder = (_degrees(trace, name, joint) for name in ("q_calculated", "q_encoder"))
    canvas.curve("a", "Encoder", trace.time, encoder, REFERENCE, label=f"Encoder ({file.source})")
    label = r"Calculated, $S\,q_\mathrm{motor}$"
    canvas.curve("a", "Calculated", trace.time, calculated, stroke_of(1), label=label)
    canvas.zero_line("b")
    difference = calculated - encoder
    canvas.curve("b", "Difference", trace.time, difference, stroke_of(1), label="")
    beside = "\nthe paper gives no value" if of_paper(file) else ""
    canvas.note("b", f"MAE {rounded(float(mae(difference)), '.4f')}°{beside}")
    return canvas


def _degrees(trace: Trace, name: str, joint: int) -> Array:
    return np.rad2deg(trace[name][:, trace.joint.index(joint)])
