"""Figures of the paper: 6 and 9 to 12 of the decoupling experiment, 13 to 16 of the comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, SECOND
from tendonrepro.physics.metrics import mae, max_abs, rmse, window_mean
from tendonrepro.physics.statics import path_points
from tendonrepro.results.figures import arm, style
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import VARIABLES, Trace, TraceFile
from tendonrepro.results.summary import run_title
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

_LAW = {"s": r"$s$ (rad/s)", "H_hat": r"Estimate $\hat{H}$ (N m)", "tau_m": r"Torque $\tau_m$ (N m)"}
_SAMPLES = {name: _LAW[name] for name in ("s", "tau_m")}
_TRACKING = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
_LARGER = "larger"
_LARGER_TOLD = (
    "Lowest panels: size of each error less that {whose}, as a centred "
    f"{MEAN_WINDOW * 1e3:g} ms mean. Above zero the error is the larger one. The mean of a curve is the "
    "difference of the mean absolute errors."
)
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
# A bound up to this many times as high as the curves is said in their panel.
_NEAR = 2.0
_REMARK: style.Look = {"loc": "right", "fontsize": "small", "linespacing": 1.35}
"""A title at the right above a panel."""


def draw_pull(file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 6: the arm before and after motor 1 alone has turned, and the angles on the way."""
    (trace,) = traces
    labels = [[(f"{name}s", f"{name} angle (deg)")] for name in _ANGLES.values()]
    turned = _shown(trace, "q_motor_encoder", 1)
    last = int(np.nanargmax(np.abs(turned - turned[0])))
    titles = ["Start", f"Motor 1 turned {turned[last] - turned[0]:.0f}°"]
    sheet = style.Sheet(style.PAGE_MM, 78.0, labels, beside=titles)
    for letter, variable in zip(sheet.axes, _ANGLES, strict=True):
        _draw_angles(sheet, letter, trace, variable, "Motor/joint")
    sheet.axes["d"].set_title(_slope(file, trace), **_REMARK)
    _draw_postures([*sheet.pictures.values()], file, trace, [0, last])
    return sheet


def _draw_postures(panels: list[Axes], file: TraceFile, trace: Trace, places: list[int]) -> None:
    """Draw the arm at two samples of a run, at the second one also where section 3.1 sees link 2."""
    joints, angle = (values[places] for values in arm.postures(file.plant, trace))
    try:
        paths = arm.tendon_paths(file.plant, joints, angle)[:-1]
    except (KeyError, ValueError):  # the file does not say where they go, or they find no way
        paths = []
    for place, axes in enumerate(panels):
        if place:
            arm.draw_links(axes, joints[0], "#F0F0F0")
        arm.draw_arm(axes, joints, paths, place)
        for number, path in enumerate(paths, start=1):
            axes.plot(*path_points(path, place).T, **style.stroke_of(number).line, zorder=4.0)
        axes.set_anchor("N")
    turned = np.rad2deg(np.diff(angle, axis=1, prepend=0.0))
    turned = turned[1] - turned[0]
    if of_paper(file) and turned[0] * turned[1] > 0.0:
        start = joints[1, 1]
        ends = np.array([start, start + joints[0, 2] - joints[0, 1]])
        look: style.Look = {"color": "black", "linestyle": (0.0, (2.0, 1.5)), "linewidth": 1.3, "zorder": 5.0}
        panels[-1].plot(*ends.T, **look, label="Link 2 in section 3.1, where joint 2 turns back")
        words = f"joint 1 turned {turned[0]:+.0f}°\njoint 2 turned {turned[1]:+.0f}°, the same way"
        at: style.Look = {"transform": panels[-1].transAxes, "ha": "center", "va": "top", "fontsize": "small"}
        panels[-1].text(0.5, 0.0, words, **at)


def draw_motor_angles(_file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 9: angles of all motors."""
    (trace,) = traces
    sheet = style.Sheet(style.COLUMN_MM, 58.0, [[("Motors", "Motor angle (deg)")]])
    _draw_angles(sheet, "a", trace, "q_motor_encoder", "Motor")
    return sheet


def _draw_angles(sheet: style.Sheet, letter: str, trace: Trace, variable: str, called: str) -> None:
    """Draw the angles of all motors or joints, in the legend as they are `called`."""
    for joint in trace.joint:
        values, name = _shown(trace, variable, joint), f"{_ANGLES[variable]} {joint}"
        sheet.curve(letter, name, trace.time, values, style.stroke_of(joint), label=f"{called} {joint}")


def draw_joint(file: TraceFile, traces: list[Trace], *, joint: int) -> style.Sheet:
    """Figures 10 to 12, and further joints: an angle by motors and by encoder, and their difference."""
    (trace,) = traces
    labels = [[(f"Joint {joint}", "Joint angle (deg)")], [("Calculated − encoder", "Difference (deg)")]]
    sheet = style.Sheet(style.COLUMN_MM, 92.0, labels)
    calculated, encoder = (_shown(trace, name, joint) for name in ("q_calculated", "q_encoder"))
    _leave_room(sheet.axes["a"], trace, joint)
    sheet.curve("a", "Encoder", trace.time, encoder, style.REFERENCE, label=f"Encoder ({file.source})")
    label = r"Calculated, $S\,q_\mathrm{motor}$"
    sheet.curve("a", "Calculated", trace.time, calculated, style.stroke_of(1), label=label)
    sheet.zero_line("b")
    difference = calculated - encoder
    sheet.curve("b", "Difference", trace.time, difference, style.stroke_of(1))
    step = _step_of(encoder)
    steps = f"encoder step {step:.2g}°\n" if step else ""
    sheet.axes["b"].set_title(f"{steps}MAE {rounded(float(mae(difference)), '.4f')}°", **_REMARK)
    return sheet


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
    first, second = (_shown(trace, "q_encoder", joint) for joint in (1, 2))
    first, second = first - first[0], second - second[0]
    if not first.any():
        return ""
    slope, coupling = first @ second / (first @ first), S[1, 0] / S[0, 0]
    return f"$\\Delta q_2/\\Delta q_1$ = {slope:.4f}\n$S_{{21}}/S_{{11}}$ = {coupling:.4f}"


def _shown(trace: Trace, variable: str, joint: int) -> Array:
    """A variable of a joint, (T,), angles in degrees."""
    values = trace[variable][:, trace.joint.index(joint)]
    return np.rad2deg(values) if VARIABLES[variable][0] == "rad" else values


def draw_motors(file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 13: motor angles from measured and from desired joint angles, and their difference."""
    (trace,) = traces
    titles = "Motors, $S^{-1}$ × joint angles", "By encoder − expected"
    labels = [[(titles[0], "Motor angle (deg)")], [(titles[1], "Difference (deg)")]]
    sheet = style.Sheet(style.COLUMN_MM, 98.0, labels)
    S_inv = file.plant.matrix("S_inv", trace.joint)
    desired, measured = (np.rad2deg(trace[name] @ S_inv.T) for name in ("q_d", "q_encoder"))
    sheet.axes["a"].set_title(controller_runs(traces)[0].label.replace(" (", "\n("), **_REMARK)
    sheet.zero_line("b")
    for column, motor in enumerate(trace.joint):
        name, stroke = f"Motor {motor}", style.stroke_of(motor)
        wide = replace(style.REFERENCE, colour=style.paler(stroke.colour, _EXPECTED))
        sheet.curve("a", f"{name} desired", trace.time, desired[:, column], wide, label=f"{name}, expected")
        sheet.curve("a", name, trace.time, measured[:, column], stroke, label=f"{name}, by encoder")
        sheet.curve("b", name, trace.time, measured[:, column] - desired[:, column], stroke)
    return sheet


def draw_tracking(file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 14, a column a joint: trajectories, errors, and these less those of Controller 2."""
    runs = controller_runs(traces)
    # Where there is no Controller 2 to the end, another one stands for it.
    whole = sorted((run for run in runs if not run.diverged), key=lambda run: run.trace.name != SECOND)
    return _tracking(file, runs, whole[0] if whole else None, f"of {whole[0].name}" if whole else "")


def draw_payload(file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 16, as 14: Controller 1 without and with a payload."""
    runs = []
    for trace in traces:
        mass = float(trace.attributes["payload_mass"])
        load = f"{mass:g} kg payload" if mass else "no payload"
        runs.append(DrawnRun(trace, f"Controller 1, {load}", style.strokes_of(())[trace.name]))
    free = next((run for run in runs if run.trace.name == FIRST and not run.diverged), None)
    return _tracking(file, runs, free, "without payload")


def draw_law(_file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Figure 15, a column a joint: s, H_hat and tau_m as means and bands."""
    runs = controller_runs(traces)
    joints = joints_of(runs)
    sheet = style.Sheet(style.PAGE_MM, 140.0, _labels(_LAW, joints))
    far: list[str] = []
    for (letter, axes), (variable, joint) in zip(sheet.axes.items(), product(_LAW, joints), strict=True):
        sheet.zero_line(letter)
        _curves(sheet, letter, runs, variable, joint, averaged=True)
        if variable == "s" and (bound := _bound_of_s(runs, joint)):
            said = f"{bound:.2g} rad/s"
            if bound > _NEAR * np.abs(axes.dataLim.intervaly).max():
                far.append(f"{said} for joint {joint}")
            else:
                # Above the title where panels are narrow.
                raised = "\n" if len(joints) > _WIDE_PANELS else ""
                axes.set_title(rf"bound: $|s| \leq$ {said}{raised}", **_REMARK)
        if variable in _SAMPLES:
            middle = float(np.mean(_near(runs, joint)))
            label = f"{ZOOM * 1e3:g} ms that the figure “{RAW}” shows"
            axes.axvline(middle, color="#6E6E6E", linewidth=0.9, zorder=0.85, label=label)
    sheet.note = f"Lines: {_BANDS}"
    sheet.told = f"That bound lies far outside the panels: {', '.join(far)}." if far else ""
    return sheet


def draw_samples(_file: TraceFile, traces: list[Trace]) -> style.Sheet:
    """Raw samples of s and tau_m over a short span, a column a joint; a torque is held until the next one."""
    runs = controller_runs(traces)
    joints = joints_of(runs)
    sheet = style.Sheet(style.PAGE_MM, 104.0, _labels(_SAMPLES, joints), shared="col")
    for (letter, axes), (variable, joint) in zip(sheet.axes.items(), product(_SAMPLES, joints), strict=True):
        start, end = _near(runs, joint)
        sheet.zero_line(letter)
        axes.set_xlim(start, end)
        axes.xaxis.set_major_locator(MultipleLocator(ZOOM / (4.0 if len(joints) <= _WIDE_PANELS else 2.0)))
        for run in that_hold(runs, variable, joint):
            time = run.trace.time
            inside = (time >= start - 1e-9) & (time <= end + 1e-9)
            # One that diverged before has no end to mark.
            diverged = run.diverged and inside.any() and time[-1] <= end
            values = run.values(variable, joint)[inside]
            look: style.Look = {"label": run.label, "diverged": diverged, "as_steps": True}
            sheet.curve(letter, run.name, time[inside], values, run.stroke, **look)
    return sheet


def _labels(rows: Mapping[str, str], joints: list[int]) -> list[list[tuple[str, str]]]:
    """Title and y label of each panel: a row a variable, a column a joint.

    Where panels are narrow the first of a row has its label alone.
    """
    labelled = joints if len(joints) <= _WIDE_PANELS else joints[:1]
    return [
        [(f"Joint {joint}", label if joint in labelled else "") for joint in joints]
        for label in rows.values()
    ]


def _bound_of_s(runs: list[DrawnRun], joint: int) -> float:
    """Bound of section 4.3 on s of Controller 1, rad/s: max |epsilon| over lambda; 0 where it is unknown."""
    for run in that_hold(runs, "epsilon", joint):
        # Of a measured run the gains are not known.
        gains = run.trace.attributes["gains"]
        if run.trace.name == FIRST and "lam" in gains:
            place = run.trace.joint.index(joint)
            # The estimation error of the last sample is not known.
            return float(max_abs(run.trace["epsilon"][:-1])[place]) / float(gains["lam"][place])
    return 0.0


@dataclass(frozen=True)
class DrawnRun:
    """A run with the name and look it has in a figure."""

    trace: Trace
    name: str
    stroke: style.Stroke

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
        return _shown(self.trace, variable, joint)


def controller_runs(traces: list[Trace]) -> list[DrawnRun]:
    """Runs with their names and strokes."""
    strokes = style.strokes_of(trace.name for trace in traces)
    return [DrawnRun(trace, run_title(trace), strokes[trace.name]) for trace in traces]


def that_hold(runs: list[DrawnRun], variable: str, joint: int) -> list[DrawnRun]:
    """Runs with a variable of a joint."""
    return [run for run in runs if variable in run.trace and joint in run.trace.joint]


def joints_of(runs: list[DrawnRun]) -> list[int]:
    """Every joint that a run holds."""
    return sorted({joint for run in runs for joint in run.trace.joint})


def _tracking(file: TraceFile, runs: list[DrawnRun], base: DrawnRun | None, whose: str) -> style.Sheet:
    """Angles and errors of runs; below, where any can be compared, sizes of errors less those of `base`."""
    joints = joints_of(runs)
    # All errors are drawn in one way, so that panels can be compared.
    averaged = any(_is_fuzzy(run, joint) for joint in joints for run in that_hold(runs, "e", joint))
    # Simulated runs follow one motion and have their samples in common; logs may not.
    comparable = base if file.source == "simulated" else None
    larger = {joint: _larger(runs, comparable, joint) for joint in joints} if comparable else {}
    compared = any(larger.values())
    rows = _TRACKING | ({_LARGER: f"$|e|$ less that\n{whose} (deg)"} if compared else {})
    sheet = style.Sheet(style.PAGE_MM, 145.0 if compared else 110.0, _labels(rows, joints))
    for (letter, axes), (variable, joint) in zip(sheet.axes.items(), product(rows, joints), strict=True):
        if variable != "q_encoder":
            sheet.zero_line(letter)
        elif holding := that_hold(runs, "q_d", joint):
            longest = max(holding, key=lambda run: run.trace.time[-1])
            desired = longest.values("q_d", joint)
            _leave_room(axes, longest.trace, joint)
            sheet.curve(letter, "Desired", longest.trace.time, desired, style.REFERENCE, label="Desired")
        if variable != _LARGER:
            _curves(sheet, letter, runs, variable, joint, averaged=averaged and variable == "e")
            continue
        for run, time, values in larger[joint]:
            sheet.curve(
                letter, f"{run.name} less that {whose}", time, values, run.stroke, diverged=run.diverged
            )
        if of_paper(file):
            axes.set_title("not in the paper", **_REMARK)
    sheet.note = f"Errors: {_BANDS}" if averaged else ""
    if compared:
        sheet.told = _LARGER_TOLD.format(whose=whose)
        sheet.told += " They are not in the paper." if of_paper(file) else ""
    return sheet


def _larger(runs: list[DrawnRun], base: DrawnRun, joint: int) -> list[tuple[DrawnRun, Array, Array]]:
    """Times, s, and mean of ``|e|`` less that of `base`, deg, of each other run."""
    differences = []
    for run in that_hold(runs, "e", joint) if that_hold([base], "e", joint) else ():
        # A diverged one ends before.
        both = min(len(run.trace.time), len(base.trace.time))
        e, e_base = (np.abs(drawn.values("e", joint)[:both]) for drawn in (run, base))
        time, mean, _ = averaged_curve(run.trace.time[:both], e - e_base)
        if run is not base:
            differences.append((run, time, mean))
    return differences


def _is_fuzzy(run: DrawnRun, joint: int) -> bool:
    """Whether much of an error is from sample to sample; raw, one run would cover the others."""
    error = run.values("e", joint)
    _, _, ripple = averaged_curve(run.trace.time, error)
    return not run.diverged and bool(rmse(ripple) > _FUZZY * rmse(error))


def _leave_room(axes: Axes, trace: Trace, joint: int) -> None:
    """Let equal desired motions have equal axes, whatever the runs do."""
    if "q_d" in trace:
        motion = _shown(trace, "q_d", joint)
        low, high = float(np.nanmin(motion)), float(np.nanmax(motion))
        room = _ROOM * (high - low)
        axes.update_datalim([(trace.time[0], low - room), (trace.time[0], high + room)])


def _curves(
    sheet: style.Sheet, letter: str, runs: list[DrawnRun], variable: str, joint: int, *, averaged: bool
) -> None:
    """Draw a variable of every run, as it is or as a mean over the band of its ripple."""
    bands = {}
    for run in that_hold(runs, variable, joint):
        time, values = run.trace.time, run.values(variable, joint)
        if averaged:
            time, values, ripple = averaged_curve(time, values)
            if not run.diverged:
                bands[run.name] = style.Band(time, values - ripple, values + ripple, run.stroke)
        sheet.curve(letter, run.name, time, values, run.stroke, label=run.label, diverged=run.diverged)
    sheet.draw_bands(letter, bands)


def _near(runs: list[DrawnRun], joint: int) -> tuple[float, float]:
    """Span of time where the desired angle of the longest run rises fastest."""
    longest = max((run.trace for run in runs), key=lambda trace: float(trace.time[-1]))
    time, start = longest.time, float(longest.time[0])
    if "q_d" in longest and joint in longest.joint and len(time) > 1:
        speed = np.nan_to_num(np.gradient(longest["q_d"][:, longest.joint.index(joint)], time))
        # The first of equally fast strokes, whatever rounding says.
        start = max(float(time[np.argmax(speed >= 0.999 * speed.max())]) - 0.5 * ZOOM, start)
    return start, start + ZOOM


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
