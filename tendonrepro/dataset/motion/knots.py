"""A recorded motion without its noise and rounding: its rates, and samples for a trajectory file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.trajectory_file import FEWEST
from tendonrepro.dataset.motion.fit import HALF_COUNT
from tendonrepro.dataset.motion.record import Recorded, noise, noise_peak
from tendonrepro.physics.trajectory import minimum_jerk, sampled

SPACINGS = (1.0, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""Spacings tried, widest first, s."""

_STILL = 0.05
"""Share of the peak speed below which a motion that begins or ends counts as at rest."""
_FADE = 1.0
"""Time over which the motion fades in where the record begins in mid-motion, s."""
_BRAKE = 0.5
"""Duration of the stroke that brings a motion to rest where the record ends in mid-motion, s."""
_EXACT = 0.1 * HALF_COUNT
"""RMS residual below which nothing is gained, rad."""
_WHITE = 0.9
"""The same as a share of the record's noise."""
_STAIRS = 0.3
"""The same as a share of the step to which a record is rounded; even rounding leaves 1/√12."""


class Smooth(NamedTuple):
    """Spline of a recorded motion, (T, n), rad, and the spacing of its knots, s."""

    spline: Callable[..., Array]
    spacing: float


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
        Largest deviation of their spline from the record, allowed and found, rad. The error of the record's
        first sample, which all its angles count from, and the time of fading in are left aside.
    faded : float
        Time over which the motion fades in from rest, s; 0 where the record begins at rest.
    braked : bool
        A stroke to rest was added after the end of the record.
    """

    time: Array
    angle: Array
    spacing: float
    tolerance: float
    deviation: float
    faded: float
    braked: bool

    def curve(self, time: Array) -> tuple[Array, Array, Array]:
        """Angle, velocity and acceleration of the spline through them, each (T, n)."""
        parts = [sampled(self.time, column)(time) for column in self.angle.T]
        q, dq, ddq = (np.stack(part, axis=1) for part in zip(*parts, strict=True))
        return q, dq, ddq


def smoothed(record: Recorded) -> Smooth:
    """Lay a quintic least-squares spline through a recorded motion, free at its ends.

    Of all spacings the one with the smallest Bayesian information criterion is taken: a narrower spacing has
    to reduce the residual by more than it would if there were nothing left but noise. A residual as small as
    the record's rounding is not reduced any further.
    """
    from scipy.interpolate import make_lsq_spline

    level = max(_EXACT, _STAIRS * record.rounding, _WHITE * noise(record))
    time, q = record.time, record.q
    best, cheapest = None, np.inf
    for spacing in _tried(record):
        # Without the outermost inner knots an end rests on three spacings: its curvature is noisy otherwise.
        inner = _places(record, spacing)[3:-3]
        knots = np.concatenate([np.repeat(time[:1], 6), inner, np.repeat(time[-1:], 6)])
        # Even samples, many to a knot: normal equations lose nothing and are twenty times faster.
        spline = make_lsq_spline(time, q, knots, k=5, method="norm-eq")
        residual = np.maximum(np.mean((spline(time) - q) ** 2, axis=0), level**2)
        criterion = len(inner) * np.log(len(time)) + len(time) * np.log(residual).mean()
        if criterion < cheapest:
            best, cheapest = Smooth(spline, spacing), criterion
    assert best is not None
    return best


def _tried(record: Recorded) -> list[float]:
    """Spacings of at least two samples that leave enough of them; two samples where there is no other."""
    end = float(record.time[-1])
    tried = [spacing for spacing in SPACINGS if 1.99 * record.step <= spacing <= end / (FEWEST - 1)]
    return tried or [2.0 * record.step]


def _places(record: Recorded, spacing: float) -> Array:
    """Multiples of a spacing, the last one moved to the end of the record, s."""
    end = float(record.time[-1])
    places = spacing * np.arange(max(round(end / spacing), FEWEST - 1) + 1.0)
    places[-1] = end
    return places


def thinned(record: Recorded) -> Knots:
    """Choose samples of a recorded motion, as it is smoothed.

    A trajectory file begins and ends at rest. Where the record begins in mid-motion the motion is faded in,
    where it ends so a stroke to rest is added. The spacing is the widest whose spline stays within half an
    encoder count, or one standard deviation of the record's noise, of the smoothed motion, else the
    narrowest.
    """
    spline, spacing = smoothed(record)
    rate, first = spline(record.time, 1), spline(record.time[:1])
    still = _STILL * np.abs(rate).max()
    faded = min(_FADE, 0.5 * float(record.time[-1])) if np.abs(rate[0]).max() > still else 0.0
    braked = bool(np.abs(rate[-1]).max() > still)

    def followed(time: Array) -> Array:
        q = spline(time) - first
        return q * minimum_jerk(1.0, faded, np.inf)(time)[0][:, np.newaxis] if faded else q

    target, close = followed(record.time), max(HALF_COUNT, noise(record))
    tolerance = max(record.rounding, HALF_COUNT + noise_peak(record))
    for narrower in (one for one in _tried(record) if one <= spacing):
        time = _places(record, narrower)
        angle = followed(time)
        if braked:
            u = np.arange(1, 11)[:, np.newaxis] / 10.0
            angle = np.vstack([angle, angle[-1] + rate[-1] * _BRAKE * (u - u**3 + 0.5 * u**4)])
            time = np.append(time, time[-1] + _BRAKE * u[:, 0])
        knots = Knots(time, angle, narrower, tolerance, 0.0, faded, braked)
        q = knots.curve(record.time)[0]
        if np.abs(q - target).max() <= close:
            break
    late = record.time >= faded
    return replace(knots, deviation=float(np.abs(q + first - record.q)[late].max()))
