"""When a recorded motion begins, though its first tens of milliseconds hide in rounding and noise."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded, noise

_GROWN = 0.08
"""Share of the range up to which a motion out of rest is a power of time with one correction."""
_VISIBLE = 4.0
"""Standard deviations of the record from which a sample tells something."""
_MODEL = 3e-3
"""Relative error of that description."""
_POWERS = (1, 2, 3, 4)
"""A ramp, a step of acceleration, a minimum-jerk stroke, a sine that is blended in."""
_BETTER = 4.0
"""Chi-square by which a higher power has to be better than a lower one."""
_CORRECTION = 0.3
"""Size of the correction at the end of the stretch; it must not make one power look like another."""
_LINES, _ROUNDS = 60, 3


def onset(record: Recorded) -> float:
    """Instant at which the joint that moves first leaves its rest, s.

    Out of rest a motion grows as a power of the time since its beginning, of which the record shows the later
    part. The power and the beginning are searched for, the rest is linear least squares on logarithms. A
    beginning is as round as an error of some milliseconds allows.

    Parameters
    ----------
    record : Recorded
    """
    column, crossed = _first_mover(record)
    q = record.q[:, column]
    sigma = max(record.rounding / np.sqrt(12.0), noise(record), 1e-7 * record.range)
    rest = q[: max(crossed // 2, 1)].mean()
    size = np.abs(q - rest)
    top = int(np.argmax(size > _GROWN * np.ptp(q)))
    hidden = np.flatnonzero(size[:top] <= max(_VISIBLE * sigma, 1e-3 * np.ptp(q)))
    first = int(hidden[-1]) + 1 if len(hidden) else 0
    if top - first < 3:
        return float(record.time[max(first - 1, 0)])
    found = _searched(record.time[first:top], size[first:top], sigma)
    return roundest(found, max(record.step, 3e-3))


def roundest(number: float, error: float) -> float:
    """Positive number with the fewest decimals within an error of another one.

    Examples
    --------
    >>> roundest(1.99871, 0.003), roundest(1.23478, 0.003), roundest(0.0021, 0.003)
    (2.0, 1.235, 0.0)
    """
    for decimals in range(10):
        rounded = round(number, decimals)
        if abs(rounded - number) <= error:
            return rounded
    return number


def _first_mover(record: Recorded) -> tuple[int, int]:
    """Column that leaves its start first, and the sample at which it is seen to."""
    tolerance = max(1.5 * record.rounding, 5.0 * noise(record), 1e-3 * record.range)
    away = np.abs(record.q - record.q[0]) > tolerance
    crossed = np.where(away.any(axis=0), np.argmax(away, axis=0), len(away))
    column = int(np.argmin(crossed))
    return column, int(crossed[column])


def _searched(time: Array, size: Array, sigma: float) -> float:
    """Beginning of a growth that explains sizes best, s."""
    weight = 1.0 / np.hypot(sigma / size, _MODEL)
    best, beginning = np.inf, float(time[0])
    for power in _POWERS:
        low, high = max(0.0, float(2.5 * time[0] - 1.5 * time[-1])), float(time[0]) - 1e-9
        for _ in range(_ROUNDS):
            lines = np.linspace(low, high, _LINES)
            misfits = [_misfit(time - start, size, weight, power) for start in lines]
            place = int(np.argmin(misfits))
            low, high = lines[max(place - 1, 0)], lines[min(place + 1, _LINES - 1)]
        if misfits[place] < best - _BETTER:
            best, beginning = misfits[place], float(lines[place])
    return beginning


def _misfit(since: Array, size: Array, weight: Array, power: int) -> float:
    """Chi-square of ``size = exp(a + b t) t^power`` with a small b, least in a and b."""
    parts = np.column_stack([np.ones_like(since), since]) * weight[:, np.newaxis]
    parts = np.vstack([parts, [0.0, since[-1] / _CORRECTION]])
    target = np.append((np.log(size) - power * np.log(since)) * weight, 0.0)
    solved = np.linalg.lstsq(parts, target, rcond=None)[0]
    return float(((parts @ solved - target) ** 2).sum())
