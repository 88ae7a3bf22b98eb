"""The desired motion as it was recorded: its rounding, where it moves, and after how long it repeats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.records import Trace

_SAME = 0.05
"""Largest difference, as a share of the motion's size, between two periods that are repeats."""
_DIFFERENT = 0.5
"""Difference that has to be passed before a small one is a repeat and not the motion's slowness."""
_MOVES = 0.4
"""Share of the whole range that a stretch has to move through before it can tell a repeat.

Half a period of a sine moves through half of its range at least."""
_LAGS = 600
_FEWEST = 20
_SPARSE = 10.0
"""Time that a record may last, over that of its samples in a row: more is a pause and not a gap."""
_REACH = 0.05
"""Half the stretch of a rounded record whose ends tell its rate, s."""
_NEAR = 0.5
"""Farthest that the beginning of a motion is misjudged, s."""
_STEPS = 8


@dataclass(frozen=True, eq=False)
class Recorded:
    """Desired joint angles of a run on an even time grid.

    Parameters
    ----------
    time : array (T,)
        s, from 0 at the run's first sample.
    q : array (T, n)
        Displacement from the first angles, rad.
    joint : tuple of int
        The paper's numbers.
    start_angle : array (n,)
        First recorded angles, rad.
    rounding : float
        Step to which the record itself is rounded, rad; 0 if it is not.
    missing : int
        Samples that were missing, filled by interpolation.
    """

    time: Array
    q: Array
    joint: tuple[int, ...]
    start_angle: Array
    rounding: float
    missing: int

    @property
    def step(self) -> float:
        """Sampling step, s."""
        return float(self.time[1] - self.time[0])

    @property
    def range(self) -> float:
        """Largest range of a joint, rad."""
        return float(np.ptp(self.q, axis=0).max())

    def moving(self) -> tuple[int, int]:
        """First and last sample of the motion: rest before it and after it are left out."""
        tolerance = max(1.5 * self.rounding, 1e-3 * self.range)
        left = (np.abs(self.q - self.q[0]) > tolerance).any(axis=1)
        ahead = (np.abs(self.q - self.q[-1]) > tolerance).any(axis=1)
        if not left.any():
            return 0, len(self.time) - 1
        last = len(ahead) - int(np.argmax(ahead[::-1])) if ahead.any() else len(ahead) - 1
        return max(int(np.argmax(left)) - 1, 0), min(last, len(ahead) - 1)


def recorded(trace: Trace, name: str = "q_d") -> Recorded:
    """Put a recorded variable on an even grid.

    Parameters
    ----------
    trace : Trace
    name : str
        Variable, an angle.

    Raises
    ------
    DataMissingError
        If the run does not hold it, or too few samples of it, or pauses for most of its time.
    """
    values = trace[name]
    known = np.isfinite(values).all(axis=1)
    if known.sum() < _FEWEST:
        message = f"run {trace.name!r} holds {int(known.sum())} samples of {name}, {_FEWEST} are needed"
        raise DataMissingError(message)
    time, kept = trace.time[known] - trace.time[0], values[known]
    step = float(np.median(np.diff(time)))
    lasts = float(trace.time[-1] - trace.time[0])
    if lasts > _SPARSE * step * len(time):
        count = f"{len(time)} samples of {name} in {lasts:.4g} s, {step:.4g} s apart"
        message = f"run {trace.name!r} holds {count}"
        raise DataMissingError(message, hint="cut pauses off with from_s and to_s in the mapping")
    even = step * np.arange(round(lasts / step) + 1.0)
    if len(even) != len(time) or np.abs(even - time).max() > 1e-6 * step:
        filled = np.column_stack([np.interp(even, time, column) for column in kept.T])
    else:
        filled = kept
    start = filled[0]
    return Recorded(even, filled - start, trace.joint, start, rounding_step(kept), int((~known).sum()))


def rounding_step(angles: Array) -> float:
    """Step to which angles are rounded, rad; 0 if they are not."""
    values = np.unique(angles)
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-7]
    if len(gaps) < _FEWEST or gaps.min() > 0.02 * np.ptp(values):
        return 0.0
    whole = np.round((values - values[0]) / gaps.min())
    step = float(whole @ (values - values[0]) / (whole @ whole))
    apart = np.abs(values - values[0] - step * whole).max()
    return step if apart < 1e-3 * step else 0.0


def repeat_after(record: Recorded) -> float:
    """Time after which the motion repeats, s; 0 if it does not.

    Every lag is tried. The motion repeats after the first one at which it agrees with itself, all of it or
    at least its last half period, since some motions begin with a blend.
    """
    first, last = record.moving()
    if last - first < _FEWEST or record.range == 0.0:
        return 0.0
    coarse = -(-(last - first) // _LAGS)
    x = record.q[first : last + 1 : coarse]
    misfit = np.array([_misfit(x, lag) for lag in range(1, len(x))])
    far = np.flatnonzero(misfit > _DIFFERENT)
    near = np.flatnonzero(misfit < _SAME)
    near = near[near > far[0]] if len(far) else near[:0]
    if not len(near):
        return 0.0
    runs = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1)
    lag = (int(runs[0][np.argmin(misfit[runs[0]])]) + 1) * coarse
    return _refined(record.q[first : last + 1], lag, coarse) * record.step


def _misfit(x: Array, lag: int) -> float:
    """Difference of a motion from itself a lag later, over its size; infinite where nothing tells."""
    difference = x[lag:] - x[:-lag]
    tail = min(len(difference), max(lag // 2, 1))
    size = np.sqrt(2.0 * x.var(axis=0).sum())
    found = [
        float(np.sqrt((difference[-count:] ** 2).sum(axis=1).mean()) / size)
        for count in (len(difference), tail)
        if 3 * len(difference) >= lag and np.ptp(x[-count:], axis=0).max() >= _MOVES * np.ptp(x, axis=0).max()
    ]
    return min(found, default=np.inf)


def _refined(x: Array, lag: int, step: int) -> float:
    """Lag with the smallest misfit near a first guess that is good to a step, to a part of a sample."""
    while step > 1:
        step = max(step // 4, 1)
        coarse, place = x[::step], lag // step
        near = range(max(place - 5, 1), min(place + 6, len(coarse) - 1))
        lag = step * min(near, key=lambda k: _misfit(coarse, k))
    if not 1 < lag < len(x) - 2:
        return float(lag)
    before, here, after = (_misfit(x, k) ** 2 for k in (lag - 1, lag, lag + 1))
    bend = before - 2.0 * here + after
    return lag + 0.5 * (before - after) / bend if here > 1e-12 and bend > 0.0 else float(lag)


def refined_shift(ours: Recorded, other: Recorded, guess: float) -> float:
    """How much later one record moves than another of the same motion, s.

    Gauss-Newton steps on all samples, with an angle apart, since both first angles are rounded.

    Parameters
    ----------
    ours, other : Recorded
        Of the same joints.
    guess : float
        s; the answer where no shift near it explains more.
    """
    shift = guess
    for _ in range(_STEPS):
        time = ours.time - shift
        inside = (time >= _REACH) & (time <= other.time[-1] - _REACH)
        if inside.sum() < _FEWEST:
            return guess
        before, here, after = (_at(other, time[inside] + apart) for apart in (-_REACH, 0.0, _REACH))
        rate, difference = (after - before) / (2.0 * _REACH), ours.q[inside] - here
        rate, difference = rate - rate.mean(axis=0), difference - difference.mean(axis=0)
        power = float((rate**2).sum())
        shift -= float((difference * rate).sum()) / power if power > 0.0 else 0.0
        if abs(shift - guess) > _NEAR:
            return guess
    return shift


def _at(record: Recorded, time: Array) -> Array:
    return np.column_stack([np.interp(time, record.time, column) for column in record.q.T])


def noise(record: Recorded) -> float:
    """Standard deviation of white noise, from the median fourth difference, rad; 0 where it is rounding."""
    fourth = np.median(np.abs(np.diff(record.q, 4, axis=0)), axis=0)
    found = float(fourth.max() / (0.6745 * np.sqrt(70.0)))
    return found if found > 0.6 * record.rounding else 0.0


def noise_peak(record: Recorded) -> float:
    """Largest deviation that noise is expected to cause among all samples, that of the first added, rad."""
    return float(noise(record) * (1.0 + np.sqrt(2.0 * np.log(record.q.size))))
