"""After which time a recorded motion repeats, and how much later it was than another one."""

from __future__ import annotations

from collections.abc import Callable

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
