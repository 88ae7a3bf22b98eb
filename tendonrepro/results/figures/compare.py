"""Figures of the comparison of controllers: 13 to 16."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import max_abs, mean, rmse, window_mean
from tendonrepro.results.figures.panels import Canvas
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, REFERENCE, Stroke, paler, stroke_of
from tendonrepro.results.paper import identifier_of, plausible_beside, printed_beside
from tendonrepro.results.records import VARIABLES, Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS, LOADS, is_user_law, run_title, tracking_errors
from tendonrepro.results.tables import NOTHING, rounded

MEAN_WINDOW = 0.05
"""Width of the centred moving mean, s."""

RIPPLE_WINDOW = 0.5
"""Width of the window over which the RMS of samples about their mean is taken, s.

Encoder counts come as lone pulses near standstill; in a narrow window the edges would show each of them.
"""

ZOOM = 0.1
"""Time shown of raw samples, s."""

_OF_THE_PAPER = {*CONTROLLERS, *LOADS.values()}
# Largest share of an error's RMS that may come and go within a mean's window for it to be drawn raw.
_FUZZY = 0.1
# Smallest travel of a joint that moves, as a share of that of the joint that moves most.
_HELD = 0.05
# Share of white in the wide curves of Figure 13, below the narrow ones of the same colour.
_EXPECTED = 0.62


def draw_motors(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 13: motor angles from measured and from desired joint angles, and their difference."""
    (trace,) = traces
    labels = [[("Motors", "Motor angle (deg)")], [("From measured − from expected", "Difference (deg)")]]
    canvas = Canvas(COLUMN_MM, 98.0, labels)
    S_inv = file.plant.matrix("S_inv", trace.joint)
    desired, measured = (np.rad2deg(trace[name] @ S_inv.T) for name in ("q_d", "q_encoder"))
    encoders = ", simulated encoders" if file.source == "simulated" else ""
    canvas.note("a", f"{_controller_runs(traces)[0].label}{encoders}")
    canvas.zero_line("b")
    for column, motor in enumerate(trace.joint):
        name, stroke = f"Motor {motor}", stroke_of(motor)
        wide = replace(REFERENCE, colour=paler(stroke.colour, _EXPECTED))
        label = f"{name}, $S^{{-1}}$ × "
        canvas.curve("a", f"{name} desired", trace.time, desired[:, column], wide, label=f"{label}expected")
        canvas.curve("a", name, trace.time, measured[:, column], stroke, label=f"{label}measured")
        canvas.curve("b", name, trace.time, measured[:, column] - desired[:, column], stroke, label="")
    return canvas


def draw_tracking(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 14, a column a joint: trajectories above, tracking errors below, MAE beside that of Table 2."""
    return _tracking(file, _controller_runs(traces))


def draw_payload(file: TraceFile, traces: list[Trace]) -> Canvas:
    """Figure 16: as Figure 14, of Controller 1 without and with a payload, beside Table 3."""
    runs = []
    for trace in traces:
        mass = float(trace.attributes["payload_mass"])
        load = f"{mass:g} kg payload" if mass else "no payload"
        runs.append(_DrawnRun(trace, f"Controller 1, {load}", stroke_of(2 if mass else 1)))
    return _tracking(file, runs)


def draw_law(_file: TraceFile, traces: list[Trace], *, bands: bool = True) -> Canvas:
    """Figure 15, a column a joint: s, H_hat, tau_m as means and bands; below raw s and tau_m from near.

    Without `bands` the means stand alone.
    """
    rows = {
        "s": r"$s$ (rad/s)",
        "H_hat": r"Estimate $\hat{H}$ (N m)",
        "tau_m": r"Torque $\tau_m$ (N m)",
    }
    near = {"s": rows["s"], "tau_m": r"$\tau_m$ (N m)"}
    joints, runs = _joints(traces), _controller_runs(traces)
    raw = f"{ZOOM * 1e3:g} ms of raw samples" if len(joints) < 3 else f"{ZOOM * 1e3:g} ms raw"
    labels = [[(f"Joint {joint}", label) for joint in joints] for label in rows.values()]
    labels += [[(f"Joint {joint}, {raw}", label) for joint in joints] for label in near.values()]
    canvas = Canvas(PAGE_MM, 205.0, labels, apart=("", "Time (s)"))
    letters = iter(canvas.axes)
    for variable, joint in product(rows, joints):
        letter = next(letters)
        canvas.zero_line(letter)
        _curves(canvas, letter, runs, variable, joint, averaged=True, bands=bands)
        if variable == "s":
            _bound_of_s(canvas.axes[letter], runs, joint)
        if variable in near:
            canvas.axes[letter].axvspan(*_near(runs, joint), color="#B0B0B0", linewidth=0.0, zorder=0.7)
    for variable, joint in product(near, joints):
        _raw_samples(canvas, next(letters), runs, variable, joint)
    if bands:
        lines = f"Lines: {MEAN_WINDOW * 1e3:g} ms mean"
        canvas.explain_bands(f"{lines}; bands: ± RMS of the samples about it, over {RIPPLE_WINDOW:g} s")
    return canvas


def _bound_of_s(axes: Axes, runs: Sequence[_DrawnRun], joint: int) -> None:
    """Bound of section 4.3 on s of Controller 1, max |epsilon| over lambda: lines where they are in sight."""
    for run in runs:
        # Of a measured run the gains are not known.
        gains = run.trace.attributes["gains"]
        known = run.holds("s", joint) and run.holds("epsilon", joint) and "lam" in gains
        if run.trace.name != "controller_1" or not known:
            continue
        place = run.trace.joint.index(joint)
        # The estimation error of the last sample is not known.
        bound = float(max_abs(run.trace["epsilon"][:-1])[place]) / gains["lam"][place]
        for line in (-bound, bound):
            axes.axhline(line, color="#777777", linewidth=0.7, linestyle=":")
        text = rf"section 4.3: $|s| \leq {bound:.2g}$ rad/s"
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8}
        look: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 6, "color": "#555555"}
        axes.text(0.98, 0.96, text, transform=axes.transAxes, bbox=ground, **look)


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
    names = [*CONTROLLERS, *(trace.name for trace in traces if trace.name not in CONTROLLERS)]
    return [_DrawnRun(trace, run_title(trace), stroke_of(1 + names.index(trace.name))) for trace in traces]


def _holding(
    canvas: Canvas, letter: str, runs: list[_DrawnRun], variable: str, joint: int
) -> list[_DrawnRun]:
    """Runs that a panel can show; where there is none it says so."""
    holding = [run for run in runs if run.holds(variable, joint)]
    if not holding:
        canvas.not_recorded(letter)
    return holding


def _joints(traces: list[Trace]) -> list[int]:
    return sorted({joint for trace in traces for joint in trace.joint})


def _moving(traces: list[Trace]) -> list[int]:
    """Joints that are meant to move; one that is held shows nothing but encoder counts."""
    travel = dict.fromkeys(_joints(traces), 0.0)
    for trace in traces:
        angle = trace["q_d" if "q_d" in trace else "q_encoder" if "q_encoder" in trace else "e"]
        for joint, size in zip(trace.joint, max_abs(angle - mean(angle)), strict=True):
            travel[joint] = max(travel[joint], float(size))
    return [joint for joint, size in travel.items() if size >= _HELD * max(travel.values())]


def _tracking(file: TraceFile, runs: list[_DrawnRun]) -> Canvas:
    joints = _moving([run.trace for run in runs])
    rows = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
    fuzzy = {joint for joint in joints if any(_is_fuzzy(run, joint) for run in runs)}
    averaged = f", {MEAN_WINDOW * 1e3:g} ms mean ± RMS"
    labels = [
        [(f"Joint {joint}{averaged if name == 'e' and joint in fuzzy else ''}", label) for joint in joints]
        for name, label in rows.items()
    ]
    canvas = Canvas(PAGE_MM, 124.0, labels)
    for letter, (variable, joint) in zip(canvas.axes, product(rows, joints), strict=True):
        if variable == "e":
            canvas.zero_line(letter)
            # The empty lines are those of the title, which stands at the left in larger letters.
            if note := _errors_note(file, runs, joint):
                canvas.note(letter, f"{note}\n\n")
        else:
            _desired(canvas, letter, runs, joint)
        _curves(canvas, letter, runs, variable, joint, averaged=variable == "e" and joint in fuzzy)
    return canvas


def _is_fuzzy(run: _DrawnRun, joint: int) -> bool:
    """Whether much of an error is from sample to sample; raw, one run's counts would cover the others."""
    if not run.holds("e", joint):
        return False
    time, error = _known(run.trace.time, run.values("e", joint))
    if run.trace.status == "diverged" or len(time) < 2:
        return False
    fast = error - window_mean(error, _samples(time, MEAN_WINDOW))
    return bool(rmse(fast) > _FUZZY * rmse(error))


def _errors_note(file: TraceFile, runs: list[_DrawnRun], joint: int) -> str:
    """MAE of the paper's runs and of users' laws, what the paper prints, and what plausible plants do."""
    names: list[str] = []
    rows: dict[str, list[str]] = {"ours" if file.source == "simulated" else "measured": []}
    rows |= {"paper": [], "plausible": []}
    for run in runs:
        trace = run.trace
        told = trace.name in _OF_THE_PAPER or is_user_law(trace)
        if told and run.holds("e", joint):
            column, identifier = trace.joint.index(joint), f"{identifier_of(trace)}.mae"
            names.append(run.name.rpartition(", ")[2].replace("Controller ", "C"))
            ours = tracking_errors(trace)["whole"]["mae"][column]
            printed = printed_beside(file, trace, identifier)[column]
            low, high = plausible_beside(file, trace, identifier)[column]
            texts = rounded(float(ours), "z.3f"), rounded(float(printed), "z.3f"), f"{low:.2g}–{high:.2g}"
            for cells, cell in zip(rows.values(), texts, strict=True):
                cells.append(cell.replace("nan–nan", NOTHING))
    lines = [f"{name} {' / '.join(cells)}" for name, cells in rows.items() if set(cells) - {NOTHING}]
    return "\n".join([f"MAE (deg) of {' / '.join(names)}", *lines]) if lines else ""


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
    """Draw a variable of every run that holds it, as it is or as a mean over the band of its ripple."""
    for run in _holding(canvas, letter, runs, variable, joint):
        time, values = run.trace.time, run.values(variable, joint)
        diverged = run.trace.status == "diverged"
        if averaged and bands and not diverged:
            canvas.band(letter, run.name, *ripple_band(time, values), run.stroke)
        if averaged:
            time, values = mean_curve(time, values)
        canvas.curve(letter, run.name, time, values, run.stroke, label=run.label, diverged=diverged)


def _near(runs: list[_DrawnRun], joint: int) -> tuple[float, float]:
    """Span of time to look at from near: where the desired angle of the longest run rises fastest."""
    longest = max((run.trace for run in runs), key=lambda trace: float(trace.time[-1]))
    time, middle = longest.time, float(longest.time[len(longest.time) // 2])
    if "q_d" in longest and joint in longest.joint and len(time) > 1:
        speed = np.nan_to_num(np.gradient(longest["q_d"][:, longest.joint.index(joint)], time))
        # The first of equally fast strokes, whatever rounding says.
        middle = float(time[np.argmax(speed >= 0.999 * speed.max())])
    start = max(middle - 0.5 * ZOOM, float(time[0]))
    return start, start + ZOOM


def _raw_samples(canvas: Canvas, letter: str, runs: list[_DrawnRun], variable: str, joint: int) -> None:
    """Draw every sample of a short span; a torque is held from one to the next."""
    start, end = _near(runs, joint)
    holding = _holding(canvas, letter, runs, variable, joint)
    canvas.zero_line(letter)
    canvas.axes[letter].set_xlim(start, end)
    for run in holding:
        time = run.trace.time
        inside = (time >= start - 1e-9) & (time <= end + 1e-9)
        values, stroke = run.values(variable, joint)[inside], replace(run.stroke, width=0.7)
        diverged = run.trace.status == "diverged" and time[-1] <= end
        canvas.curve(letter, run.name, time[inside], values, stroke, label="", diverged=diverged, held=True)


def mean_curve(time: Array, values: Array) -> tuple[Array, Array]:
    """Mean over `MEAN_WINDOW` of the samples (T,) that are there, once a window and at the end.

    More often would draw the beat of encoder counts.
    """
    time, values = _known(time, values)
    if len(time) < 2:
        return time, values
    samples = _samples(time, MEAN_WINDOW)
    places = _places(len(time), samples)
    return time[places], window_mean(values, samples)[places]


def ripple_band(time: Array, values: Array) -> tuple[Array, tuple[Array, Array]]:
    """Band of one RMS of the samples (T,) about their mean, to both sides of `mean_curve`."""
    time, values = _known(time, values)
    if len(time) < 2:
        return time, (values, values)
    middle = window_mean(values, _samples(time, MEAN_WINDOW))
    power = window_mean((values - middle) ** 2, _samples(time, RIPPLE_WINDOW))
    # A sum of many squares less another may come out a rounding below zero.
    rms = np.sqrt(np.maximum(power, 0.0))
    # Smooth over the window, so a few points in each show all there is.
    places = _places(len(time), 2 * _samples(time, MEAN_WINDOW))
    return time[places], ((middle - rms)[places], (middle + rms)[places])


def _known(time: Array, values: Array) -> tuple[Array, Array]:
    known = np.isfinite(values)
    return time[known], values[known]


def _samples(time: Array, width: float) -> int:
    return max(round(width / (float(time[-1] - time[0]) / (len(time) - 1))), 1)


def _places(count: int, samples: int) -> NDArray[np.int64]:
    """Every window's sample, and the last."""
    return np.append(np.arange(0, count - 1, samples), count - 1)
