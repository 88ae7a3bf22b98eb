"""Few enough samples of a recorded motion that a spline through them does not shake with its rounding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.reference_shapes import HALF_COUNT
from tendonrepro.dataset.reference_signal import Recorded
from tendonrepro.samples import FEWEST
from tendonrepro.trajectory import sampled

SPACINGS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Spacings tried, widest first, s."""

_STILL = 0.05
"""Share of the peak speed below which a motion that ends counts as at rest."""
_BRAKE = 0.5
"""Duration of the stroke that brings a motion to rest where the record ends in mid-motion, s."""
_NOISE = 4.0
"""Standard deviations of the record's noise that a spline may leave aside."""


@dataclass(frozen=True, eq=False)
class Knots:
    """Samples for a trajectory file.

    Parameters
    ----------
    time : array (N,)
        s, from 0.
    angle : array (N, n)
        rad, from 0.
    spacing : float
        s.
    tolerance, deviation : float
        Largest deviation of their spline from the record, allowed and found, rad.
    braked : bool
        A stroke to rest was added after the end of the record.
    """

    time: Array
    angle: Array
    spacing: float
    tolerance: float
    deviation: float
    braked: bool

    def curve(self, time: Array) -> tuple[Array, Array, Array]:
        """Angle, velocity and acceleration of the spline through them, each (T, n)."""
        parts = [sampled(self.time, column)(time) for column in self.angle.T]
        q, dq, ddq = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
        return q, dq, ddq


def thinned(record: Recorded) -> Knots:
    """Choose samples of a recorded motion.

    The spacing is the widest whose spline stays, at every recorded sample, within half an encoder count, one
    step of the record's own rounding, or four standard deviations of its noise, whichever is largest. Where
    the record is rounded or noisy a sample is the value of the parabola through its surroundings.

    Parameters
    ----------
    record : Recorded

    Returns
    -------
    Knots
        With the spacing of the smallest deviation where none stays within the tolerance.
    """
    noise = _noise(record.q)
    tolerance = max(HALF_COUNT, record.rounding, _NOISE * noise)
    rough = record.rounding > 0.0 or _NOISE * noise > 0.1 * HALF_COUNT
    best: Knots | None = None
    for spacing in SPACINGS:
        every = round(spacing / record.step)
        if every < 1 or len(record.time) < (FEWEST - 1) * every + 1:
            continue
        found = _spaced(record, every, tolerance, rough=rough)
        if found.deviation <= tolerance:
            return found
        best = found if best is None or found.deviation < best.deviation else best
    return best or _spaced(record, 1, tolerance, rough=False)


def _noise(q: Array) -> float:
    """Standard deviation of white noise that would explain the median second difference, rad."""
    second = np.median(np.abs(np.diff(q, 2, axis=0)), axis=0)
    return float(second.max() / (0.6745 * np.sqrt(6.0)))


def _spaced(record: Recorded, every: int, tolerance: float, *, rough: bool) -> Knots:
    count = len(record.time)
    places = np.arange(0, count, every)
    if count - 1 - places[-1] > every // 2:
        places = np.append(places, count - 1)
    else:
        places[-1] = count - 1
    angle = _parabolas(record.q, places, every // 2) if rough else record.q[places]
    angle[0] = 0.0
    time, angle, braked = _brought_to_rest(record, record.time[places], angle)
    knots = Knots(time, angle, every * record.step, tolerance, 0.0, braked)
    deviation = float(np.abs(knots.curve(record.time)[0] - record.q).max())
    return Knots(time, angle, every * record.step, tolerance, deviation, braked)


def _parabolas(q: Array, places: NDArray[np.int64], reach: int) -> Array:
    """Value at each place of the parabola through the samples within reach, (N, n)."""
    found = np.empty((len(places), q.shape[1]))
    for k, place in enumerate(places):
        low, high = max(place - reach, 0), min(place + reach + 1, len(q))
        if high - low < FEWEST:
            found[k] = q[place]
            continue
        x = (np.arange(low, high) - place) / reach
        found[k] = np.linalg.lstsq(np.column_stack([np.ones_like(x), x, x**2]), q[low:high], rcond=None)[0][0]
    return found


def _brought_to_rest(record: Recorded, time: Array, angle: Array) -> tuple[Array, Array, bool]:
    """Add a braking stroke where the record ends in mid-motion: a trajectory file ends at rest."""
    back = min(max(round(0.05 / record.step), 2), len(record.q) - 1)
    rate = (record.q[-1] - record.q[-1 - back]) / (back * record.step)
    peak = np.abs(record.q[back:] - record.q[:-back]).max() / (back * record.step)
    if np.abs(rate).max() <= _STILL * peak:
        return time, angle, False
    u = np.arange(1, 11)[:, np.newaxis] / 10.0
    stroke = angle[-1] + rate * _BRAKE * (u - u**3 + 0.5 * u**4)
    return np.append(time, time[-1] + _BRAKE * u[:, 0]), np.vstack([angle, stroke]), True
