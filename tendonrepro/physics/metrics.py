"""Sizes of a tracking error, time windows, and the status of a run."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array

Status = Literal["ok", "ringing", "diverged"]

STATUSES = ("ok", "ringing", "diverged", "unresolved")
"""Statuses by their number in stored results; a plant too fast for the compiled stepper is unresolved."""


START = 2.0
"""Time, s, after which 3 % of an offset at the start are left under the published gains."""


def start_level(time: Array, x: Array) -> Array:
    """Level (...) at which a record (T, ...) starts: the median of its first 0.1 s.

    One sample may be spoilt.
    """
    return np.asarray(np.median(x[time <= time[0] + 0.1], axis=0))


def mean(values: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Mean of the finite samples inside, over the first axis; NaN without any."""
    kept = inside & np.isfinite(values)
    count = kept.sum(axis=0)
    total = np.where(kept, values, 0.0).sum(axis=0)
    return np.asarray(np.divide(total, count, out=np.full(values.shape[1:], np.nan), where=count > 0))


def mae(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Mean absolute error of each joint, Tables 2 and 3."""
    return mean(np.abs(e), inside)


def rmse(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Root of the mean square error of each joint, Tables 2 and 3."""
    return np.sqrt(mean(np.square(e), inside))


def max_abs(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Largest magnitude of each joint's finite samples."""
    sizes = np.where(inside & np.isfinite(e), np.abs(e), -np.inf).max(axis=0, initial=-np.inf)
    return np.where(np.isfinite(sizes), sizes, np.nan)


def windows(time: Array, period: float) -> dict[str, slice]:
    """Stretches of a run to take a metric over: ``whole``, ``after_first_period``, ``period_1``, ...

    Period k holds the samples with (k-1)P <= t - t0 < kP, to half a sampling step, if the run covers it. One
    sample past the last whole period belongs to it. ``after_first_period`` is all from t0 + P on. Empty
    windows are left out; a period of 0 s leaves ``whole`` alone.
    """
    count = len(time)
    found = {"whole": slice(0, count)}
    if period <= 0.0 or count < 2:
        return found
    step = _step(time)
    elapsed = time - time[0]
    complete = int((elapsed[-1] + 1.5 * step) // period)
    edges = [int(np.searchsorted(elapsed, k * period - 0.5 * step)) for k in range(complete + 1)]
    if complete and edges[-1] == count - 1:
        edges[-1] = count
    if complete and edges[1] < count:
        found["after_first_period"] = slice(edges[1], count)
    for k in range(complete):
        found[f"period_{k + 1}"] = slice(edges[k], edges[k + 1])
    return found


def without_start(time: Array, seconds: float) -> slice:
    """Samples of a run from so many seconds after its first on, to half a sampling step."""
    half = 0.5 * _step(time) if len(time) > 1 else 0.0
    return slice(int(np.searchsorted(time - time[0], seconds - half)), len(time))


def periodogram(x: Array, step: float) -> tuple[Array, Array]:
    """One-sided periodogram of a signal (T, n) without a window, constant part included.

    Lines (T // 2 + 1,), Hz, and mean squares (T // 2 + 1, n), whose sum is that of ``x`` (Parseval). ``step``
    is in s.
    """
    count = len(x)
    power = np.square(np.abs(np.fft.rfft(x, axis=0) / count))
    # Every line but the constant one, and the Nyquist line of an even count, stands for its mirror image too.
    power[1 : (count + 1) // 2] *= 2.0
    return np.fft.rfftfreq(count, step).astype(np.float64), power


def status_of(
    time: Array, e: Array, divergence_limit: float, ringing_frequency: float, ringing_share: float
) -> tuple[Status, float]:
    """Judge a run by its tracking error ``e`` (T, n), rad, over evenly spaced ``time`` (T,), s.

    ``diverged``: a sample is not finite, or beyond `divergence_limit`, rad. ``ringing``: on a joint more than
    `ringing_share` of the mean square, constant part included, lies above `ringing_frequency`, Hz. ``ok``:
    neither. The time returned is of the first sample out of bounds, else of the last.
    """
    # "not <=" rather than ">", so that NaN is out of bounds too.
    out = ~(np.abs(e) <= divergence_limit).all(axis=1)
    if out.any():
        return "diverged", float(time[np.argmax(out)])
    end = float(time[-1])
    if len(time) < 2:
        return "ok", end
    frequency, power = periodogram(e, _step(time))
    # The margin keeps a line that equals the limit from being rounded above it.
    fast = power[frequency > ringing_frequency * (1.0 + 1e-9)].sum(axis=0)
    ringing = bool((fast > ringing_share * power.sum(axis=0)).any())
    return ("ringing" if ringing else "ok"), end


def window_mean(x: Array, samples: int) -> Array:
    """Centred moving mean over ``samples``, widened to an odd number, along the first axis.

    At both ends the window is cut, so a constant stays constant.
    """
    half = samples // 2
    index = np.arange(len(x))
    first = np.maximum(index - half, 0)
    last = np.minimum(index + half + 1, len(x))
    total = np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(x, axis=0)])
    width = (last - first).reshape(-1, *[1] * (x.ndim - 1))
    return np.asarray((total[last] - total[first]) / width)


def _step(time: Array) -> float:
    return float(time[-1] - time[0]) / (len(time) - 1)
