"""Figures of the paper: 6 and 9 to 12 of the decoupling experiment, 13 to 16 of the comparison."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from matplotlib.ticker import MultipleLocator

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST
from tendonrepro.physics.metrics import mae, max_abs, rmse, window_mean
from tendonrepro.physics.tendon_path import TendonPath, path_points
from tendonrepro.results.figures.arm import (
    draw_discs,
    draw_links,
    frame,
    number_winches,
    postures,
    tendon_paths,
)
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, REFERENCE, Look, Stroke, paler, stroke_of
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import VARIABLES, Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS, run_title
from tendonrepro.results.tables import rounded

MEAN_WINDOW = 0.05
"""Width of the centred moving mean, s."""

RIPPLE_WINDOW = 0.5
"""Width of the window over which the RMS of samples about their mean is taken, s.

Encoder counts come as lone pulses near standstill; in a narrow window the edges would show each of them.
"""

ZOOM = 0.02
"""Time shown of raw samples, s."""

RAW = "samples"
"""Name of the figure that shows them."""

_RAW_ROWS = {"s": r"$s$ (rad/s)", "tau_m": r"Torque $\tau_m$ (N m)"}
_ANGLES = {"q_motor_encoder": "Motor", "q_encoder": "Joint"}
# Columns of panels up to which a title and a remark stand on one line.
_WIDE_PANELS = 3
# Largest share of an error's RMS that may come and go within a mean's window for it to be drawn raw.
_FUZZY = 0.1
# Free space above and below a motion, as a share of its range, so that equal motions have equal axes.
_ROOM = 0.04
_BANDS = f"mean over {MEAN_WINDOW * 1e3:g} ms ± RMS of the samples about it; grey: shared by all"
# Share of white in the wide curves of Figure 13, below the narrow ones of the same colour.
_EXPECTED = 0.62


def draw_pull(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 6: the arm before and after motor 1 alone has turned, and the angles on the way."""
    (trace,) = traces
    labels = [[(f"{name}s", f"{name} angle (deg)")] for name in _ANGLES.values()]
    turned = _degrees(trace, "q_motor_encoder", 1)
    last = int(np.nanargmax(np.abs(turned - turned[0])))
    titles = ["Start", f"Motor 1 turned {turned[last] - turned[0]:.0f}°"]
    canvas = Canvas(PAGE_MM, 78.0, labels, beside=titles)
    for letter, variable in zip(canvas.axes, _ANGLES, strict=True):
        _draw_angles(canvas, letter, trace, variable, "Motor/joint")
    canvas.note("d", _slope(file, trace))
    _draw_postures(canvas, file, trace, [0, last])
    return canvas


def _draw_postures(canvas: Canvas, file: TraceFile, trace: Trace, places: list[int]) -> None:
    """Draw the arm at two samples of a run, at the second one also where section 3.1 sees link 2."""
    joints, angle = postures(file.plant, trace)
    joints, angle = joints[places], angle[places]
    paths = _paths_of(file, joints, angle)
    for place, axes in enumerate(canvas.pictures.values()):
        if place:
            draw_links(axes, joints[0], "#F0F0F0")
        draw_links(axes, joints[place])
        draw_discs(axes, paths, place)
        number_winches(axes, paths)
        for number, path in enumerate(paths, start=1):
            axes.plot(*path_points(path, place).T, **stroke_of(number).line, zorder=4.0)
        frame(axes, joints, paths)
        axes.set_anchor("N")
    turned = np.rad2deg(np.diff(angle, axis=1, prepend=0.0))
    turned = turned[1] - turned[0]
    if of_paper(file) and turned[0] * turned[1] > 0.0:
        start = joints[1, 1]
        ends = np.array([start, start + joints[0, 2] - joints[0, 1]])
        letter = list(canvas.pictures)[-1]
        canvas.draw_path(letter, ends, "Link 2 in section 3.1, where joint 2 turns back")
        canvas.say_below(
            letter, f"joint 1 turned {turned[0]:+.0f}°\njoint 2 turned {turned[1]:+.0f}°, the same way"
        )


def _paths_of(file: TraceFile, joints: Array, angle: Array) -> list[TendonPath]:
    """The motors' tendons; none where a file does not say where they go, or where they find no way."""
    if "tensioner_side" not in file.plant.attributes:
        return []
    try:
        return tendon_paths(file.plant, joints, angle)[:-1]
    except ValueError:
        return []


def draw_motor_angles(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 9: angles of all motors."""
    (trace,) = traces
    canvas = Canvas(COLUMN_MM, 58.0, [[("Motors", "Motor angle (deg)")]])
    _draw_angles(canvas, "a", trace, "q_motor_encoder", "Motor")
    return canvas


def _draw_angles(canvas: Canvas, letter: str, trace: Trace, variable: str, called: str) -> None:
    """Draw the angles of all motors or joints, in the legend as they are `called`."""
    for joint in trace.joint:
        values, name = _degrees(trace, variable, joint), f"{_ANGLES[variable]} {joint}"
        canvas.curve(letter, name, trace.time, values, stroke_of(joint), label=f"{called} {joint}")


def draw_joint(file: TraceFile, traces: list[Trace], *, joint: int) -> Canvas:
    """Figures 10 to 12, and further joints: an angle by motors and by encoder, and their difference."""
    (trace,) = traces
    labels = [[(f"Joint {joint}", "Joint angle (deg)")], [("Calculated − encoder", "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 92.0, labels)
    calculated, encoder = (_degrees(trace, name, joint) for name in ("q_calculated", "q_encoder"))
    _leave_room(canvas, "a", trace, joint)
    canvas.curve("a", "Encoder", trace.time, encoder, REFERENCE, label=f"Encoder ({file.source})")
    label = r"Calculated, $S\,q_\mathrm{motor}$"
    canvas.curve("a", "Calculated", trace.time, calculated, stroke_of(1), label=label)
    canvas.zero_line("b")
    difference = calculated - encoder
    canvas.curve("b", "Difference", trace.time, difference, stroke_of(1))
    step = _step_of(encoder)
    steps = f"encoder step {step:.2g}°\n" if step else ""
    canvas.note("b", f"{steps}MAE {rounded(float(mae(difference)), '.4f')}°")
    return canvas


def _step_of(angle: Array) -> float:
    """Step in which an encoder counts; zero where none can be seen."""
    values = np.unique(angle[np.isfinite(angle)])
    if len(values) < 2:
        return 0.0
    step = float(np.diff(values).min())
    # An angle without steps has more values than samples.
    return step if np.ptp(values) < step * len(angle) else 0.0


def _slope(file: TraceFile, trace: Trace) -> str:
    """Slope of joint 2 over joint 1, beside the coupling's."""
    S = file.plant.matrix("S", (1, 2))
    first, second = (_degrees(trace, "q_encoder", joint) for joint in (1, 2))
    first, second = first - first[0], second - second[0]
    if not first.any():
        return ""
    slope, coupling = first @ second / (first @ first), S[1, 0] / S[0, 0]
    return f"$\\Delta q_2/\\Delta q_1$ = {slope:.4f}\n$S_{{21}}/S_{{11}}$ = {coupling:.4f}"


def _degrees(trace: Trace, name: str, joint: int) -> Array:
    return np.rad2deg(trace[name][:, trace.joint.index(joint)])


def draw_motors(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 13: motor angles from measured and from desired joint angles, and their difference."""
    (trace,) = traces
    titles = "Motors, $S^{-1}$ × joint angles", "By encoder − expected"
    labels = [[(titles[0], "Motor angle (deg)")], [(titles[1], "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 98.0, labels)
    S_inv = file.plant.matrix("S_inv", trace.joint)
    desired, measured = (np.rad2deg(trace[name] @ S_inv.T) for name in ("q_d", "q_encoder"))
    canvas.note("a", controller_runs(traces)[0].label)
    canvas.zero_line("b")
    for column, motor in enumerate(trace.joint):
        name, stroke = f"Motor {motor}", stroke_of(motor)
        wide = replace(REFERENCE, colour=paler(stroke.colour, _EXPECTED))
        canvas.curve("a", f"{name} desired", trace.time, desired[:, column], wide, label=f"{name}, expected")
        canvas.curve("a", name, trace.time, measured[:, column], stroke, label=f"{name}, by encoder")
        canvas.curve("b", name, trace.time, measured[:, column] - desired[:, column], stroke)
    return canvas


def draw_tracking(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 14, a column a joint: trajectories above, errors below."""
    return _tracking(controller_runs(traces))


def draw_payload(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 16, as 14: Controller 1 without and with a payload."""
    runs = []
    for trace in traces:
        mass = float(trace.attributes["payload_mass"])
        load = f"{mass:g} kg payload" if mass else "no payload"
        runs.append(DrawnRun(trace, f"Controller 1, {load}", stroke_of(2 if mass else 1)))
    return _tracking(runs)


def draw_law(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 15, a column a joint: s, H_hat and tau_m as means and bands."""
    rows = {"s": _RAW_ROWS["s"], "H_hat": r"Estimate $\hat{H}$ (N m)", "tau_m": _RAW_ROWS["tau_m"]}
    runs = controller_runs(traces)
    joints = joints_of(runs)
    canvas = Canvas(
        PAGE_MM, 140.0, [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    )
    for letter, (variable, joint) in zip(canvas.axes, product(rows, joints), strict=True):
        canvas.zero_line(letter)
        _curves(canvas, letter, runs, variable, joint, averaged=True)
        if variable == "s":
            # Above the title where panels are narrow.
            raised = "\n" if len(joints) > _WIDE_PANELS else ""
            canvas.note(letter, f"{_bound_of_s(runs, joint)}{raised}")
        if variable in _RAW_ROWS:
            middle = float(np.mean(_near(runs, joint)))
            canvas.mark_time(letter, middle, f"{ZOOM * 1e3:g} ms that the figure “{RAW}” shows")
    canvas.explain_bands(f"Lines: {_BANDS}")
    return canvas


def draw_samples(_file: TraceFile, traces: list[Trace]) -> Canvas:
    """Raw samples of s and tau_m over a short span, a column a joint."""
    runs = controller_runs(traces)
    joints = joints_of(runs)
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in _RAW_ROWS.values()]
    canvas = Canvas(PAGE_MM, 104.0, labels, apart=("", "Time (s)"))
    for letter, (variable, joint) in zip(canvas.axes, product(_RAW_ROWS, joints), strict=True):
        _raw_samples(canvas, letter, runs, variable, joint)
    return canvas


def _bound_of_s(runs: list[DrawnRun], joint: int) -> str:
    """Bound of section 4.3 on s of Controller 1: max |epsilon| over lambda."""
    for run in that_hold(runs, "epsilon", joint):
        # Of a measured run the gains are not known.
        gains = run.trace.attributes["gains"]
        if run.trace.name == FIRST and "lam" in gains:
            place = run.trace.joint.index(joint)
            # The estimation error of the last sample is not known.
            bound = float(max_abs(run.trace["epsilon"][:-1])[place]) / gains["lam"][place]
            return rf"bound: $|s| \leq {bound:.2g}$"
    return ""


@dataclass(frozen=True)
class DrawnRun:
    """A run with the name and look it has in a figure."""

    trace: Trace
    name: str
    stroke: Stroke

    @property
    def label(self) -> str:
        """Text of the legend, with the status of a run that is not ok."""
        return self.name if self.trace.status == "ok" else f"{self.name} ({self.trace.told_status})"

    @property
    def diverged(self) -> bool:
        """Whether the run ended in a divergence."""
        return self.trace.status == "diverged"

    def values(self, variable: str, joint: int) -> Array:
        """Shape (T,), angles in degrees."""
        values = self.trace[variable][:, self.trace.joint.index(joint)]
        return np.rad2deg(values) if VARIABLES[variable][0] == "rad" else values


def controller_runs(traces: list[Trace]) -> list[DrawnRun]:
    """Controllers 1 to 3 keep their strokes, further laws take the rest in turn."""
    names = [*CONTROLLERS, *(trace.name for trace in traces if trace.name not in CONTROLLERS)]
    return [DrawnRun(trace, run_title(trace), stroke_of(1 + names.index(trace.name))) for trace in traces]


def that_hold(runs: list[DrawnRun], variable: str, joint: int) -> list[DrawnRun]:
    """Runs with a variable of a joint."""
    return [run for run in runs if variable in run.trace and joint in run.trace.joint]


def joints_of(runs: list[DrawnRun]) -> list[int]:
    """Every joint that a run holds."""
    return sorted({joint for run in runs for joint in run.trace.joint})


def _tracking(runs: list[DrawnRun]) -> Canvas:
    joints = joints_of(runs)
    rows = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
    # All errors are drawn in one way, so that panels can be compared.
    averaged = any(_is_fuzzy(run, joint) for joint in joints for run in that_hold(runs, "e", joint))
    canvas = Canvas(
        PAGE_MM, 110.0, [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    )
    for letter, (variable, joint) in zip(canvas.axes, product(rows, joints), strict=True):
        if variable == "e":
            canvas.zero_line(letter)
        else:
            _desired(canvas, letter, runs, joint)
        _curves(canvas, letter, runs, variable, joint, averaged=averaged and variable == "e")
    if averaged:
        canvas.explain_bands(f"Errors: {_BANDS}")
    return canvas


def _is_fuzzy(run: DrawnRun, joint: int) -> bool:
    """Whether much of an error is from sample to sample; raw, one run would cover the others."""
    error = run.values("e", joint)
    _, _, ripple = averaged_curve(run.trace.time, error)
    return not run.diverged and bool(rmse(ripple) > _FUZZY * rmse(error))


def _desired(canvas: Canvas, letter: str, runs: list[DrawnRun], joint: int) -> None:
    """Draw the reference of the run that lasts longest."""
    if holding := that_hold(runs, "q_d", joint):
        longest = max(holding, key=lambda run: run.trace.time[-1])
        values = longest.values("q_d", joint)
        canvas.curve(letter, "Desired", longest.trace.time, values, REFERENCE, label="Desired")
        _leave_room(canvas, letter, longest.trace, joint)


def _leave_room(canvas: Canvas, letter: str, trace: Trace, joint: int) -> None:
    """Let equal desired motions have equal axes, whatever the runs do."""
    if "q_d" in trace:
        motion = _degrees(trace, "q_d", joint)
        low, high = float(np.nanmin(motion)), float(np.nanmax(motion))
        room = _ROOM * (high - low)
        canvas.leave_room(letter, np.array([low - room, high + room]))


def _curves(
    canvas: Canvas, letter: str, runs: list[DrawnRun], variable: str, joint: int, *, averaged: bool
) -> None:
    """Draw a variable of every run, as it is or as a mean over the band of its ripple."""
    for run in that_hold(runs, variable, joint):
        time, values = run.trace.time, run.values(variable, joint)
        if averaged:
            time, values, ripple = averaged_curve(time, values)
            if not run.diverged:
                canvas.band(letter, run.name, time, (values - ripple, values + ripple), run.stroke)
        canvas.curve(letter, run.name, time, values, run.stroke, label=run.label, diverged=run.diverged)


def _near(runs: list[DrawnRun], joint: int) -> tuple[float, float]:
    """Span of time where the desired angle of the longest run rises fastest."""
    longest = max((run.trace for run in runs), key=lambda trace: float(trace.time[-1]))
    time, start = longest.time, float(longest.time[0])
    if "q_d" in longest and joint in longest.joint and len(time) > 1:
        speed = np.nan_to_num(np.gradient(longest["q_d"][:, longest.joint.index(joint)], time))
        # The first of equally fast strokes, whatever rounding says.
        start = max(float(time[np.argmax(speed >= 0.999 * speed.max())]) - 0.5 * ZOOM, start)
    return start, start + ZOOM


def _raw_samples(canvas: Canvas, letter: str, runs: list[DrawnRun], variable: str, joint: int) -> None:
    """Draw every sample of a short span; a torque is held from one to the next."""
    start, end = _near(runs, joint)
    canvas.zero_line(letter)
    canvas.axes[letter].set_xlim(start, end)
    canvas.axes[letter].xaxis.set_major_locator(MultipleLocator(ZOOM / 4.0))
    for run in that_hold(runs, variable, joint):
        time = run.trace.time
        inside = (time >= start - 1e-9) & (time <= end + 1e-9)
        values, diverged = run.values(variable, joint)[inside], run.diverged and time[-1] <= end
        look: Look = {"label": run.label, "diverged": diverged, "as_steps": True}
        canvas.curve(letter, run.name, time[inside], values, run.stroke, **look)


def averaged_curve(time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Times, mean over `MEAN_WINDOW` of the samples (T,) that are there, RMS about it over `RIPPLE_WINDOW`.

    Once a mean's window and at the end: more often would draw the beat of encoder counts.
    """
    known = np.isfinite(values)
    time, values = time[known], values[known]
    if len(time) < 2:
        return time, values, np.zeros_like(values)
    step = float(time[-1] - time[0]) / (len(time) - 1)
    narrow, wide = (max(round(width / step), 1) for width in (MEAN_WINDOW, RIPPLE_WINDOW))
    middle = window_mean(values, narrow)
    # The end of a diverged run may be too large to square.
    with np.errstate(over="ignore", invalid="ignore"):
        power = window_mean((values - middle) ** 2, wide)
    # A sum of many squares less another may come out a rounding below zero.
    ripple = np.sqrt(np.maximum(power, 0.0))
    places = np.append(np.arange(0, len(time) - 1, narrow), len(time) - 1)
    return time[places], middle[places], ripple[places]
