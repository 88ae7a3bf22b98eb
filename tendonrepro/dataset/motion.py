"""The desired motion behind measured runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.reference import FEWEST
from tendonrepro.configuration.published import COMPARED
from tendonrepro.console import count_of
from tendonrepro.dataset.windows import Timing
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.trajectory import sampled
from tendonrepro.results.records import Trace, TraceFile, median_step
from tendonrepro.results.summary import CONTROLLERS

_HALF_COUNT = float(np.deg2rad(0.011))
"""Half of the encoder's printed resolution, rad."""
_SPACINGS = (1.0, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""Spacings of knots that are tried, widest first, s."""

_STILL = 0.05
"""Share of the peak speed below which a motion that begins or ends counts as at rest."""
_FIRST = 0.05
"""Stretch that tells whether a record begins at rest, s."""
_BRAKE = 0.5
"""Duration of the stroke that brings a motion to rest where the record ends in mid-motion, s."""
_ONSET = 1e-3
"""Share of the range at which a motion is first seen to have begun."""
_SAME, _DIFFERENT = 0.05, 0.5
"""Difference of a motion from itself, over its size: of a repeat at most, and once before it at least."""
_MOVES = 0.4
"""Share of the whole range that a stretch has to move through before it can tell a repeat."""
_LAGS = 600
"""Samples of a record that are compared at every lag."""


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Joint angles of a run on an even grid of `time` (T,), s, from 0.

    `q` (T, n) is from `start_angle` (n,), rad; gaps are bridged. `rounding` is the step to which the record
    is rounded, rad; 0 if it is not.
    """

    time: Array
    q: Array
    joint: tuple[int, ...]
    start_angle: Array
    rounding: float

    @property
    def step(self) -> float:
        """Sampling step, s."""
        return float(self.time[1] - self.time[0])

    def at(self, time: Array) -> Array:
        """Displacement at times (T,), s: (T, n) rad, held beyond the end."""
        return np.column_stack([np.interp(time, self.time, column) for column in self.q.T])

    def moving(self) -> tuple[int, int]:
        """First and last sample in motion."""
        tolerance = max(1.5 * self.rounding, _noise_peak(self), _ONSET * float(np.ptp(self.q, axis=0).max()))
        left = np.flatnonzero((np.abs(self.q - self.q[0]) > tolerance).any(axis=1))
        ahead = np.flatnonzero((np.abs(self.q - self.q[-1]) > tolerance).any(axis=1))
        if not left.size:
            return 0, len(self.time) - 1
        return max(int(left[0]) - 1, 0), min(int(ahead[-1]) + 1, len(self.time) - 1)


@dataclass(frozen=True, eq=False)
class Knots:
    """Samples for a trajectory file: `time` (N,), s, and `angle` (N, n), rad, from 0.

    `spacing` is in s. Their spline deviates from the record by `deviation`, where `tolerance` is allowed,
    rad. `braked`: a stroke to rest was added.
    """

    time: Array
    angle: Array
    spacing: float
    tolerance: float
    deviation: float
    braked: bool


@dataclass(frozen=True, eq=False)
class Beginning:
    """Where the motion of a run begins: `begin`, s, after the first sample."""

    run: str
    record: RecordedMotion
    begin: float


@dataclass(frozen=True, eq=False)
class Reference(Beginning):
    """A reference recovered from a run, which ends `end` s after the first sample.

    `period`, s, is 0 if it does not repeat.
    """

    period: float
    knots: Knots
    end: float

    def as_dict(self) -> dict[str, object]:
        """Plain data, in degrees."""
        return {
            "run": self.run,
            "joints": list(self.record.joint),
            "period_s": round(self.period, 9) or None,
            "begin_s": round(self.begin, 9),
            "end_s": self.end,
            "start_angle_deg": np.rad2deg(self.record.start_angle).tolist(),
            "amplitude_deg": np.rad2deg(np.ptp(self.record.q, axis=0)).tolist(),
            "rounding_deg": math.degrees(self.record.rounding),
            "spacing_s": self.knots.spacing,
            "deviation_deg": math.degrees(self.knots.deviation),
            "tolerance_deg": math.degrees(self.knots.tolerance),
            "brought_to_rest": self.knots.braked,
        }


def recorded(trace: Trace, name: str = "q_d") -> RecordedMotion:
    """Put a recorded angle on an even grid.

    Raises
    ------
    DataMissingError
        If it has few samples, pauses most of the time, or does not move.
    """
    values = trace[name]
    there = np.isfinite(values).all(axis=1)
    time, kept = trace.time[there], values[there]
    if len(time) < FEWEST:
        message = f"run {trace.name!r} holds {count_of(len(time), 'sample')} of {name}, {FEWEST} are needed"
        raise DataMissingError(message)
    time = time - time[0]
    step = median_step(time)
    if time[-1] > 10.0 * step * len(time):
        message = f"run {trace.name!r} pauses: {count_of(len(time), 'sample')} of {name} in {time[-1]:.4g} s"
        raise DataMissingError(message, hint="cut pauses off with from_s and to_s in the mapping")
    if not np.ptp(kept, axis=0).any():
        raise DataMissingError(f"run {trace.name!r}: {name} does not move")
    even = step * np.arange(round(float(time[-1]) / step) + 1.0)
    filled = np.column_stack([np.interp(even, time, column) for column in kept.T])
    return RecordedMotion(even, filled - filled[0], trace.joint, filled[0], rounding_step(kept))


def rounding_step(angles: Array) -> float:
    """Step to which angles are rounded, rad; 0 if they are not."""
    values = np.unique(angles)
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-7]
    if len(gaps) < FEWEST or gaps.min() > 0.02 * np.ptp(values):
        return 0.0
    whole = np.round((values - values[0]) / gaps.min())
    step = float(whole @ (values - values[0]) / (whole @ whole))
    apart = np.abs(values - values[0] - step * whole).max()
    return step if apart < 1e-3 * step else 0.0


def noise(record: RecordedMotion) -> float:
    """Standard deviation of white noise, rad; 0 where it is rounding."""
    fourth = np.median(np.abs(np.diff(record.q, 4, axis=0)), axis=0)
    deviation = float(fourth.max() / (0.6745 * np.sqrt(70.0)))
    return deviation if deviation > 0.6 * record.rounding else 0.0


def _noise_peak(record: RecordedMotion) -> float:
    """Largest deviation by noise among all samples, rad."""
    return float(noise(record) * (1.0 + np.sqrt(2.0 * np.log(record.q.size))))


def recover_reference(file: TraceFile, joints: Sequence[int] = COMPARED) -> Reference:
    """Recover the reference from the first run with the desired angles of these joints.

    Raises
    ------
    DataMissingError
        If there is none, or they do not move.
    """
    begun = beginning(file, joints)
    end = float(begun.record.time[begun.record.moving()[1]])
    knots, period = thinned(begun.record), repeat_after(begun.record)
    return Reference(begun.run, begun.record, begun.begin, period, knots, end)


def beginning(file: TraceFile, joints: Sequence[int]) -> Beginning:
    """Find where the motion begins in the first run with the desired angles of these joints.

    Raises
    ------
    DataMissingError
        If there is none, or they do not move.
    """
    runs = file.part("compare").runs.values()
    holding = [trace for trace in runs if {*joints} <= {*joints_with_motion(trace)}]
    if not holding:
        named = f"joints {', '.join(map(str, joints))}" if len(joints) > 1 else f"joint {joints[0]}"
        raise DataMissingError(f"no run holds the desired angles q_d of {named}")
    trace = min(holding, key=lambda trace: trace.name not in CONTROLLERS)
    record = recorded(trace.of_joints(joints))
    return Beginning(trace.name, record, onset(record))


def joints_with_motion(trace: Trace) -> list[int]:
    """Joints of which a run recorded the desired angle."""
    if "q_d" not in trace:
        return []
    columns = zip(trace.joint, trace["q_d"].T, strict=True)
    return [joint for joint, column in columns if np.isfinite(column).any()]


def onset(record: RecordedMotion) -> float:
    """When a motion begins, s: before it is first seen.

    It begins as the second or third power of time; when it passes three levels tells which.
    """
    size = np.abs(record.q).max(axis=0)
    q = np.abs(record.q[:, int(np.argmax(size))])
    level = max(_ONSET * float(size.max()), 3.0 * record.rounding, _noise_peak(record))
    candidates: list[tuple[float, float]] = []
    for power in (2, 3):
        passes = [_passes(record.time, q, level * factor) for factor in (1.0, 2.0**power, 4.0**power)]
        # Distances from the beginning are as 1 to 2 to 4.
        begin = 2.0 * passes[0] - passes[1]
        candidates.append((abs(2.0 * passes[1] - passes[2] - begin), begin))
    return max(min(candidates)[1], 0.0)


def _passes(time: Array, q: Array, level: float) -> float:
    after = int(np.argmax(q > level))
    before = max(after - 1, 0)
    share = (level - q[before]) / (q[after] - q[before]) if q[after] > q[before] else 0.0
    return float(time[before] + share * (time[after] - time[before]))


def starts_of(file: TraceFile, reference: Beginning) -> dict[str, float]:
    """When the motion of every run of the comparison begins, s."""
    runs = file.part("compare").runs
    return {name: zero_of(trace, reference) + reference.begin for name, trace in runs.items()}


def timing_of(file: TraceFile, reference: Reference | None) -> dict[str, Timing]:
    """Start and period of every run; a stated period goes first."""
    runs = file.part("compare").runs
    starts = starts_of(file, reference) if reference else {}
    repeats = reference.period if reference else 0.0
    return {
        name: Timing(
            starts.get(name, float(trace.time[0])), float(trace.attributes["reference_period"]) or repeats
        )
        for name, trace in runs.items()
    }


def zero_of(trace: Trace, reference: Beginning) -> float:
    """When in a run a rerun of the reference begins, s."""
    from scipy.optimize import minimize_scalar

    other, first = reference.record, float(trace.time[0])
    if trace.name == reference.run or not {*other.joint} <= {*joints_with_motion(trace)}:
        return first
    ours = recorded(trace.of_joints(other.joint))

    def apart(late: float) -> float:
        moved = other.at(ours.time - late)
        return float((ours.q - moved).var(axis=0).sum())

    guess = onset(ours) - reference.begin
    tried = guess + np.linspace(-0.5, 0.5, 41)
    best = float(tried[np.argmin([apart(late) for late in tried])])
    late = float(minimize_scalar(apart, bounds=(best - 0.05, best + 0.05), method="bounded").x)
    return first + (late if abs(late) > 0.05 * ours.step else 0.0)


def derivatives(trace: Trace) -> tuple[Array, Array]:
    """Desired velocity and acceleration, (T, n): recorded, else of the smoothed motion.

    Raises
    ------
    DataMissingError
        If the run holds no desired angles.
    """
    if all(name in trace and np.isfinite(trace[name]).all() for name in ("dq_d", "ddq_d")):
        return trace["dq_d"], trace["ddq_d"]
    spline, _ = smoothed(recorded(trace))
    time = trace.time - trace.time[0]
    return spline(time, 1), spline(time, 2)


def repeat_after(record: RecordedMotion) -> float:
    """Time after which the motion repeats, s; 0 if it does not.

    It is the first lag, once the motion was unlike itself, at which all or its last half period is like
    itself.
    """
    first, last = record.moving()
    q = record.q[first : last + 1]
    every = max(len(q) // _LAGS, 1)
    lags = np.arange(every, len(q), every)
    misfit = np.array([_misfit(q, int(lag), every) for lag in lags])
    far, near = np.flatnonzero(misfit > _DIFFERENT), np.flatnonzero(misfit < _SAME)
    near = near[near > far[0]] if len(far) else near[:0]
    if not len(near):
        return 0.0
    run = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)[0]
    lag = int(lags[run[np.argmin(misfit[run])]])
    fine = np.arange(max(lag - every, 1), lag + every + 1)
    squares = np.array([_misfit(q, int(late), 1) ** 2 for late in fine])
    best = int(fine[np.argmin(squares)])
    # A parabola through the neighbours tells a part of a sample.
    left, here, right = (_misfit(q, late, 1) ** 2 for late in (best - 1, best, best + 1))
    bend = left - 2.0 * here + right
    return (best + (0.5 * (left - right) / bend if np.isfinite(bend) and bend > 0.0 else 0.0)) * record.step


def _misfit(x: Array, lag: int, every: int) -> float:
    """Difference from itself a lag earlier, over its size; infinite if that tells nothing."""
    late = x[lag::every]
    difference = late - x[: len(x) - lag : every]
    size, span = np.sqrt(2.0 * x[::every].var(axis=0).sum()), np.ptp(x[::every], axis=0).max()
    tail = min(len(late), max(lag // (2 * every), 1))
    misfits = [
        float(np.sqrt((difference[-count:] ** 2).sum(axis=1).mean()) / size)
        for count in (len(late), tail)
        if 3 * len(late) * every >= lag and np.ptp(late[-count:], axis=0).max() >= _MOVES * span
    ]
    return min(misfits, default=np.inf)


def smoothed(record: RecordedMotion, least: float = 0.1 * _HALF_COUNT) -> tuple[Callable[..., Array], float]:
    """Quintic least-squares spline through a motion, and the spacing of its knots, s.

    That has the smallest Bayesian information criterion; residuals below rounding or noise, or `least`, rad,
    count as these.
    """
    from scipy.interpolate import make_lsq_spline

    level = max(least, 0.3 * record.rounding, 0.9 * noise(record))
    time, q = record.time, record.q
    candidates = []
    for spacing in _tried(record):
        # Without the outermost inner knots an end rests on three spacings: its curvature is noisy otherwise.
        inner = _places(record, spacing)[3:-3]
        knots = np.concatenate([np.repeat(time[:1], 6), inner, np.repeat(time[-1:], 6)])
        spline = make_lsq_spline(time, q, knots, k=5, method="norm-eq")
        residual = np.maximum(np.mean((spline(time) - q) ** 2, axis=0), level**2)
        candidates.append(
            (len(inner) * np.log(len(time)) + len(time) * np.log(residual).mean(), spline, spacing)
        )
    _, spline, spacing = min(candidates, key=lambda candidate: candidate[0])
    return spline, spacing


def _tried(record: RecordedMotion) -> list[float]:
    end = float(record.time[-1])
    tried = [spacing for spacing in _SPACINGS if 1.99 * record.step <= spacing <= end / (FEWEST - 1)]
    return tried or [2.0 * record.step]


def _places(record: RecordedMotion, spacing: float) -> Array:
    """Multiples of a spacing, s, and the end."""
    end = float(record.time[-1])
    places = spacing * np.arange(max(round(end / spacing), FEWEST - 1) + 1.0)
    places[-1] = end
    return places


def thinned(record: RecordedMotion) -> Knots:
    """Few samples of the smoothed motion, that keep it to half an encoder step or the noise.

    Raises
    ------
    DataMissingError
        If the record begins in mid-motion: a trajectory file begins at rest.
    """
    spline, spacing = smoothed(record)
    rate = spline(record.time, 1)
    still = _STILL * np.abs(rate).max()
    # The rate of the spline is least sure at its ends.
    early = min(round(_FIRST / record.step), len(record.time) - 1) or 1
    if np.abs(record.q[early]).max() / record.time[early] > still:
        raise DataMissingError("the record begins in mid-motion", hint="give from_s in the mapping")
    braked = bool(np.abs(rate[-1]).max() > still)
    first, target = spline(record.time[:1]), spline(record.time)
    for narrower in (tried for tried in _tried(record) if tried <= spacing):
        time = _places(record, narrower)
        angle = spline(time) - first
        if braked:
            u = np.arange(1, 11)[:, np.newaxis] / 10.0
            angle = np.vstack([angle, angle[-1] + rate[-1] * _BRAKE * (u - u**3 + 0.5 * u**4)])
            time = np.append(time, time[-1] + _BRAKE * u[:, 0])
        q = np.column_stack([sampled(time, column)(record.time)[0] for column in angle.T]) + first
        if np.abs(q - target).max() <= max(_HALF_COUNT, noise(record)):
            break
    tolerance = max(record.rounding, _HALF_COUNT + _noise_peak(record))
    return Knots(time, angle, narrower, tolerance, float(np.abs(q - record.q).max()), braked)
