"""What numbers themselves say about what they are."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from tendonrepro.arrays import Array

COUNT_DEG = 360.0 / 16384.0
"""One count of the paper's joint encoder, deg: 4096 pulses, four counts each."""
SAME_COURSE = 0.1
"""Largest RMS difference of two signals that follow each other, as a share of the range."""
COUPLED = 0.05
"""Largest RMS of what a coupling leaves of a motor angle, as a share of its range."""
_UNEVEN = 0.5
_FEWEST = 8
_ENOUGH = 2000  # samples that comparisons look at


def sampling_step(values: Array) -> float | None:
    """Median step of a signal that can be a time axis, in its own unit.

    Parameters
    ----------
    values : Array
        Shape (N,).

    Returns
    -------
    float or None
        None unless there are at least 8 numbers that increase strictly, by steps that differ from their
        median by less than half of it.
    """
    if len(values) < _FEWEST or not np.isfinite(values).all():
        return None
    steps = np.diff(values)
    middle = float(np.median(steps))
    even = steps.min() > 0.0 and np.abs(steps - middle).max() < _UNEVEN * middle
    return middle if even else None


def counted_in(values: Array) -> str | None:
    """Tell degrees from radians by the encoder's count.

    Parameters
    ----------
    values : Array
        Shape (N,).

    Returns
    -------
    str or None
        ``deg`` or ``rad`` when all numbers lie on the grid of the paper's encoder in that unit.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < _FEWEST:
        return None
    offsets = finite - finite[0]
    for unit, count in (("deg", COUNT_DEG), ("rad", float(np.deg2rad(COUNT_DEG)))):
        counts = offsets / count
        if np.ptp(counts) > 20.0 and np.median(np.abs(counts - np.round(counts))) < 0.02:
            # A coarser grid, such as whole degrees, or a finer one is not the encoder's.
            steps = np.diff(np.unique(np.round(counts)))
            return unit if steps.min() == 1.0 else None
    return None


def looked_at(values: Array) -> Array:
    """Evenly chosen samples, few enough for quick comparisons."""
    return values[:: max(1, len(values) // _ENOUGH)]


def distance(a: Array, b: Array) -> float:
    """RMS of the difference of two signals over the range of the first; infinite when that is constant."""
    x, y = looked_at(a), looked_at(b)
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return np.inf
    extent = float(np.ptp(x[known]))
    return float(np.sqrt(np.mean((x[known] - y[known]) ** 2))) / extent if extent > 0.0 else np.inf


def roughness(values: Array) -> float:
    """Mean magnitude of the third difference over the range: small for a computed motion."""
    finite = values[np.isfinite(values)]
    if len(finite) < 4 or np.ptp(finite) == 0.0:
        return 0.0
    return float(np.mean(np.abs(np.diff(finite, 3))) / np.ptp(finite))


def difference_of(values: Array, others: dict[str, Array]) -> tuple[str, str] | None:
    """Find two signals whose difference a third one is.

    Parameters
    ----------
    values : Array
        Shape (N,).
    others : dict
        Candidates of the same length, by name.

    Returns
    -------
    tuple of str or None
        Names of minuend and subtrahend; None when no two differ by it to 1 % of its own size, at 8 samples
        or more that all three have.
    """
    x = looked_at(values)
    size = float(np.abs(x[np.isfinite(x)]).max(initial=0.0))
    if size == 0.0:
        return None
    thinned = {name: looked_at(other) for name, other in others.items()}
    for a, b in combinations(thinned, 2):
        known = np.isfinite(x) & np.isfinite(thinned[a]) & np.isfinite(thinned[b])
        if known.sum() < _FEWEST:
            continue
        difference = thinned[a][known] - thinned[b][known]
        for names, sign in (((a, b), 1.0), ((b, a), -1.0)):
            if np.abs(sign * difference - x[known]).max() <= 0.01 * size:
                return names
    return None
