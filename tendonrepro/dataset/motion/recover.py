"""The desired motion of a measured comparison: recovered, named, and written for the simulator to run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.published import COMPARED
from tendonrepro.dataset.motion.fit import Fit, Turns, amplitude_of, cycle_of, fits, limit, movers, turns_of
from tendonrepro.dataset.motion.knots import Knots, smoothed, thinned
from tendonrepro.dataset.motion.record import FEWEST, Recorded, recorded
from tendonrepro.dataset.motion.windows import Timing
from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS

_SAME_TIME = 0.05
"""Share of a sample by which two runs' motions may be apart and still begin at one time."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A recovered reference.

    Parameters
    ----------
    run : str
        Run it was read from.
    record : Recorded
        The desired angles.
    knots : Knots
        What a trajectory file holds.
    period : float
        s; 0 where it does not repeat and has no named shape.
    begin, end : float
        First and last instant of the motion, s after the first sample.
    fitted : tuple of Fit
        Shapes that were tried, best first.
    turns : Turns or None
        Cycles of a motion with a named shape that comes back to its start.
    """

    run: str
    record: Recorded
    knots: Knots
    period: float
    begin: float
    end: float
    fitted: tuple[Fit, ...] = ()
    turns: Turns | None = None

    @property
    def shape(self) -> Fit | None:
        """The shape, where the best one's residual is small enough to name it."""
        best = self.fitted[0] if self.fitted else None
        return best if best is not None and best.largest <= limit(self.record) else None

    @property
    def delay(self) -> float:
        """Rest before a named motion, s; a sampled one is written with its rest."""
        return _delay(self.shape) if self.shape else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Plain data, angles in degrees."""
        record, shape = self.record, self.shape
        periods = None
        if self.turns:
            periods = self.turns.pattern()[1]
        elif self.period:
            periods = max(int(np.ceil((self.end - self.begin) / self.period - 0.02)), 1)
        return {
            "run": self.run,
            "joints": list(record.joint),
            "kind": shape.kind if shape else "sampled",
            "parameters": shape.parameters() if shape else {},
            "period_s": round(self.period, 9) or None,
            "periods": periods,
            "begin_s": round(self.begin, 9),
            "end_s": self.end,
            "start_angle_deg": np.rad2deg(record.start_angle).tolist(),
            "amplitude_deg": np.rad2deg(np.ptp(record.q, axis=0)).tolist(),
            "rounding_deg": math.degrees(record.rounding),
            "missing_samples": record.missing,
            "residual_limit_deg": math.degrees(limit(record)),
            "shapes": [
                {
                    "kind": fit.kind,
                    "largest_residual_deg": math.degrees(fit.largest),
                    "rms_residual_deg": math.degrees(fit.rms),
                }
                for fit in self.fitted
            ],
            "spacing_s": self.knots.spacing,
            "deviation_deg": math.degrees(self.knots.deviation),
            "tolerance_deg": math.degrees(self.knots.tolerance),
            "faded_in_s": self.knots.faded,
            "brought_to_rest": self.knots.braked,
        }


def _delay(shape: Fit) -> float:
    return max(float(shape.values["delay"]), 0.0)


def recover(file: TraceFile) -> Reference:
    """Recover the reference of a measured comparison from the first run that recorded it for both joints.

    Raises
    ------
    DataMissingError
        If no run holds the desired angles, or they do not move.
    """
    holding = [trace for trace in file.part("compare").runs.values() if "q_d" in trace]
    if not holding:
        raise DataMissingError("no run of the comparison holds the desired joint angles q_d")
    problems = []
    for trace in sorted(holding, key=lambda trace: (not _complete(trace), trace.name not in CONTROLLERS)):
        try:
            return recover_run(trace.of_joints(COMPARED))
        except DataMissingError as problem:
            problems.append(problem)
    raise problems[0]


def _complete(trace: Trace) -> bool:
    """Whether a run recorded the desired angles of both joints of the comparison."""
    columns = zip(trace.joint, trace["q_d"].T, strict=True)
    return {*COMPARED} <= {joint for joint, values in columns if np.isfinite(values).any()}


def recover_run(trace: Trace) -> Reference:
    """Recover the motion of one run; see `recover`."""
    record = recorded_motion(trace, "q_d")
    first, last = record.moving()
    begin, end = float(record.time[first]), float(record.time[last])
    repeats = repeat_after(record)
    found = Reference(trace.name, record, thinned(record), repeats, begin, end, tuple(fits(record, repeats)))
    if found.shape is None:
        return replace(found, begin=_begin_of(record), period=roundest(repeats, 0.5 * record.step))
    turns = None if found.shape.kind == "sine" else turns_of(record)
    period = cycle_of(found.shape.values) * (len(turns.pattern()[0]) if turns else 1)
    return replace(found, begin=found.delay, period=period, turns=turns)


def _begin_of(record: Recorded) -> float:
    """When a motion begins whose joints have no common shape: told by those that have one of their own."""
    joints = [record.of(column) for column in movers(amplitude_of(record))]
    best = [(joint, fit) for joint in joints for fit in fits(joint, repeat_after(joint))[:1]]
    delays = [_delay(fit) for joint, fit in best if fit.largest <= limit(joint)]
    return min(delays) if delays else float(record.time[record.moving()[0]])


def recorded_motion(trace: Trace, variable: str) -> Recorded:
    """Put a recorded variable on an even grid, and refuse one at rest; see `recorded`."""
    record = recorded(trace, variable)
    if record.range == 0.0:
        raise DataMissingError(f"run {trace.name!r}: {variable} does not move")
    return record


def timing_of(file: TraceFile, reference: Reference | None) -> dict[str, Timing]:
    """Start and period of the motion of every run of a comparison.

    A run's own start is told by when its desired angles first move, against the run of the reference. The
    period is the one a run states, else that of the reference.
    """
    found = {}
    for name, trace in file.part("compare").runs.items():
        stated = float(trace.attributes["reference_period"])
        start, period = float(trace.time[0]), stated
        if reference is not None:
            period = stated or reference.period
            start += reference.begin + _later(trace, reference)
        found[name] = Timing(start, period)
    return found


def zero_of(trace: Trace, reference: Reference) -> float:
    """Time on a run's own axis at which a rerun on the recovered reference begins, s."""
    return float(trace.time[0]) + reference.delay + _later(trace, reference)


def _later(trace: Trace, reference: Reference) -> float:
    """How much later than in the reference's run a run's desired angles move, s.

    When they first leave their start is a first guess; rounding hides that, so all of the motion refines it.
    """
    if "q_d" not in trace or trace.name == reference.run:
        return 0.0
    try:
        record = recorded(trace.of_joints(COMPARED))
    except DataMissingError:
        return 0.0
    if record.joint != reference.record.joint:
        return 0.0
    guess = float(record.time[record.moving()[0]] - reference.record.time[reference.record.moving()[0]])
    late = refined_shift(record, reference.record, guess)
    return late if abs(late) > _SAME_TIME * record.step else 0.0


def derivatives(trace: Trace) -> tuple[Array, Array]:
    """Desired velocity and acceleration at a run's samples, (T, n): recorded, else of the smoothed motion.

    Raises
    ------
    DataMissingError
        If the run holds no desired angles.
    """
    if all(name in trace and np.isfinite(trace[name]).all() for name in ("dq_d", "ddq_d")):
        return trace["dq_d"], trace["ddq_d"]
    spline = smoothed(recorded(trace)).spline
    time = trace.time - trace.time[0]
    return spline(time, 1), spline(time, 2)


_SAME = 0.05
"""Largest difference, as a share of the motion's size, between two periods that are repeats."""
_DIFFERENT = 0.5
"""Difference that has to be passed before a small one is a repeat and not the motion's slowness."""
_MOVES = 0.4
"""Share of the whole range that a stretch has to move through before it can tell a repeat.

Half a period of a sine moves through half of its range at least."""
_LAGS = 600
"""Most samples of a record that are compared at every lag."""
_NEAR = 1.0
"""Farthest that the beginning of a motion is misjudged, s."""
_REACH = 0.05
"""Half the stretch of a rounded record whose ends tell its rate, s."""
_STEPS = 8


def repeat_after(record: Recorded) -> float:
    """Time after which the motion repeats, s; 0 if it does not.

    Every lag is tried. The motion repeats after the first one at which it agrees with itself, all of it or
    at least its last half period, since some motions begin with a blend.
    """
    first, last = record.moving()
    if last - first < FEWEST or record.range == 0.0:
        return 0.0
    q = record.q[first : last + 1]
    every = -(-(last - first) // _LAGS)
    misfit = np.array([_misfit(q, lag, every) for lag in range(every, len(q), every)])
    far, near = np.flatnonzero(misfit > _DIFFERENT), np.flatnonzero(misfit < _SAME)
    near = near[near > far[0]] if len(far) else near[:0]
    if not len(near):
        return 0.0
    run = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)[0]
    lag = every * (int(run[np.argmin(misfit[run])]) + 1)
    return _least(lambda lag: _misfit(q, lag, every) ** 2, lag, every) * record.step


def _misfit(x: Array, lag: int, every: int) -> float:
    """Difference of a motion, at every so many samples, from itself a lag earlier, over its size.

    It is infinite where nothing tells.
    """
    late = x[lag::every]
    difference = late - x[: len(x) - lag : every]
    size, span = np.sqrt(2.0 * x[::every].var(axis=0).sum()), np.ptp(x[::every], axis=0).max()
    tail = min(len(late), max(lag // (2 * every), 1))
    found = [
        float(np.sqrt((difference[-count:] ** 2).sum(axis=1).mean()) / size)
        for count in (len(late), tail)
        if 3 * len(late) * every >= lag and np.ptp(late[-count:], axis=0).max() >= _MOVES * span
    ]
    return min(found, default=np.inf)


def _least(square: Callable[[int], float], lag: int, every: int) -> float:
    """Lag, to a part of a sample, with the smallest squared misfit near a first guess."""
    lag = min(range(max(lag - every, 1), lag + every + 1), key=square)
    near = np.arange(-every, every + 1)
    found = np.array([square(max(lag + late, 1)) for late in near.tolist()])
    if not np.isfinite(found).all():
        return float(lag)
    bend, slope, _ = np.polyfit(near, found, 2)
    return lag - 0.5 * slope / bend if bend > 0.0 else float(lag)


def refined_shift(ours: Recorded, other: Recorded, guess: float) -> float:
    """How much later one record moves than another of the same motion and joints, s.

    Gauss-Newton steps on all samples, with an angle apart, since both first angles are rounded. The guess, s,
    is the answer where no shift near it explains more.
    """
    tried = guess + np.linspace(-_NEAR, _NEAR, 41)
    apart = [_apart(ours, other, late) for late in tried]
    if not np.isfinite(min(apart)):
        return guess
    shift = float(tried[np.argmin(apart)])
    for _ in range(_STEPS):
        time = ours.time - shift
        inside = (time >= _REACH) & (time <= other.time[-1] - _REACH)
        if inside.sum() < FEWEST:
            return guess
        before, here, after = (_at(other, time[inside] + late) for late in (-_REACH, 0.0, _REACH))
        rate, difference = (after - before) / (2.0 * _REACH), ours.q[inside] - here
        rate -= rate.mean(axis=0)
        power = float((rate**2).sum())
        shift -= float((difference * rate).sum()) / power if power > 0.0 else 0.0
        if abs(shift - guess) > _NEAR:
            return guess
    return shift


def _apart(ours: Recorded, other: Recorded, late: float) -> float:
    """Mean square of what differs when one record is moved, on some hundred samples; infinite for few.

    Records that hardly overlap are alike wherever both are at rest.
    """
    every = -(-len(ours.time) // _LAGS)
    time, q = ours.time[::every] - late, ours.q[::every]
    inside = (time >= 0.0) & (time <= other.time[-1])
    if inside.sum() < max(FEWEST, 0.5 * min(1.0, other.time[-1] / ours.time[-1]) * len(time)):
        return np.inf
    return float((q[inside] - _at(other, time[inside])).var(axis=0).mean())


def _at(record: Recorded, time: Array) -> Array:
    return np.column_stack([np.interp(time, record.time, column) for column in record.q.T])


def roundest(number: float, error: float) -> float:
    """Positive number with the fewest decimals within an error of another one."""
    rounded = (round(number, decimals) for decimals in range(10))
    return next((one for one in rounded if abs(one - number) <= error), number)
