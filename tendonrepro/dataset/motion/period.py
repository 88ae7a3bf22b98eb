"""After how long a recorded motion repeats, and how much later it was than another one."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import FEWEST, Recorded

_SAME = 0.05
"""Largest difference, as a share of the motion's size, between two periods that are repeats."""
_DIFFERENT = 0.5
"""Difference that has to be passed before a small one is a repeat and not the motion's slowness."""
_MOVES = 0.4
"""Share of the whole range that a stretch has to move through before it can tell a repeat.

Half a period of a sine moves through half of its range at least."""
_LAGS = 600
_REACH = 0.05
"""Half the stretch of a rounded record whose ends tell its rate, s."""
_NEAR = 1.0
"""Farthest that the beginning of a motion is misjudged, s."""
_SCAN = np.linspace(-_NEAR, _NEAR, 41)
_STEPS = 8


def repeat_after(record: Recorded) -> float:
    """Time after which the motion repeats, s; 0 if it does not.

    Every lag is tried. The motion repeats after the first one at which it agrees with itself, all of it or
    at least its last half period, since some motions begin with a blend.
    """
    first, last = record.moving()
    if last - first < FEWEST or record.range == 0.0:
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
    apart = [_apart(ours, other, guess + late) for late in _SCAN]
    if not np.isfinite(min(apart)):
        return guess
    shift = guess + float(_SCAN[np.argmin(apart)])
    for _ in range(_STEPS):
        time = ours.time - shift
        inside = (time >= _REACH) & (time <= other.time[-1] - _REACH)
        if inside.sum() < FEWEST:
            return guess
        before, here, after = (_at(other, time[inside] + apart) for apart in (-_REACH, 0.0, _REACH))
        rate, difference = (after - before) / (2.0 * _REACH), ours.q[inside] - here
        rate, difference = rate - rate.mean(axis=0), difference - difference.mean(axis=0)
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
        return float("inf")
    difference = q[inside] - _at(other, time[inside])
    return float(np.mean((difference - difference.mean(axis=0)) ** 2))


def _at(record: Recorded, time: Array) -> Array:
    return np.column_stack([np.interp(time, record.time, column) for column in record.q.T])
