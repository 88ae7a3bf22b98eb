"""Sizes of a tracking error, the time windows they are taken over, and the status of a run."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array

Status = Literal["ok", "ringing", "diverged"]

STATUSES = ("ok", "ringing", "diverged", "unresolved")
"""Statuses by their number in stored results; a plant too fast for the compiled stepper is unresolved."""


def start_level(time: Array, x: Array) -> Array:
    """Level (...) at which a record (T, ...) starts: the median of its first tenth of a second.

    One sample may be spoilt, and nothing moves far in so short a time.
    """
    return np.asarray(np.median(x[time <= time[0] + 0.1], axis=0))


def mean(values: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Mean over the first axis of the finite samples inside; NaN where there is none."""
    kept = inside & np.isfinite(values)
    count = kept.sum(axis=0)
    total = np.where(kept, values, 0.0).sum(axis=0)
    return np.asarray(np.divide(total, count, out=np.full(values.shape[1:], np.nan), where=count > 0))


def mae(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Mean absolute error of each joint, Tables 2 and 3; see `mean`."""
    return mean(np.abs(e), inside)


def rmse(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Root of the mean square error of each joint, Tables 2 and 3; see `mean`."""
    return np.sqrt(mean(np.square(e), inside))


def max_abs(e: Array, inside: NDArray[np.bool_] | bool = True) -> Array:
    """Largest magnitude of each joint's finite samples; see `mean`."""
    sizes = np.where(inside & np.isfinite(e), np.abs(e), -np.inf).max(axis=0, initial=-np.inf)
    return np.where(np.isfinite(sizes), sizes, np.nan)


def windows(time: Array, period: float) -> dict[str, slice]:
    """Stretches of a run to take a metric over: ``whole``, ``after_first_period``, ``period_1``, ...

    Period k holds the samples with (k-1)P <= t - t0 < kP, to half a sampling step, and is listed when the run
    covers all of it. One sample past the last whole period, as a run that records both ends has, belongs to
    that period. ``after_first_period`` is everything from t0 + P on, whole or not. Windows without samples
    are left out. A reference without period, 0 s, leaves ``whole`` alone.
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


def periodogram(x: Array, step: float) -> tuple[Array, Array]:
    """One-sided periodogram of a signal (T, n) without a window: lines, Hz, and their mean squares.

    The shapes are (T // 2 + 1,) and (T // 2 + 1, n), constant part included. The sum is the mean square of
    ``x`` (Parseval). ``step`` is the sampling period, s.
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

    ``diverged``: a sample is not finite, or beyond `divergence_limit`, rad, on a joint. ``ringing``: bounded,
    but on a joint more than `ringing_share` of the error's mean square, constant part included, lies above
    `ringing_frequency`, Hz; a spectral line exactly there counts as below. ``ok``: neither. The time returned
    is that of the first sample out of bounds, else of the last.
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
    """Centred moving mean over a number of samples along the first axis.

    An even width is widened by one sample. At both ends the window is cut to the samples that exist, so a
    constant stays a constant.
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
