"""What numbers themselves say about what they are."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations, product

import numpy as np

from tendonrepro.arrays import Array

COUNT_DEG = 360.0 / 16384.0
"""One count of the paper's joint encoder, deg: 4096 pulses, four counts each."""
COUNTS_DEG = (COUNT_DEG, 0.022)
"""The same, and as the paper prints it, for some multiply counts by that."""
SAME_COURSE = 0.1
"""Largest RMS difference of two signals that follow each other, as a share of the range."""
COUPLED = 0.05
"""Largest RMS of what a coupling leaves of a motor angle, as a share of its range."""
_UNEVEN = 0.5
_REGULAR = 0.95  # share of steps that are even; a logger drops a cycle now and then
_FEWEST = 8
_MOST_COUNTED = 20000  # samples that are laid on the grid of the encoder
_MOST_LABELS = 8
_ENOUGH = 2000  # samples that comparisons look at


def sampling_step(values: Array) -> float | None:
    """Median step of a signal that can be a time axis, in its own unit.

    Parameters
    ----------
    values : Array
        Shape (N,); cells without a number at the end, where a longer column stands beside it, do not count.

    Returns
    -------
    float or None
        None unless there are at least 8 numbers that increase strictly, nearly all by steps that differ from
        their median by less than half of it.
    """
    values = without_tail(values)
    if len(values) < _FEWEST or not np.isfinite(values).all():
        return None
    steps = np.diff(values)
    middle = float(np.median(steps))
    if steps.min() <= 0.0:
        return None
    return middle if np.mean(np.abs(steps - middle) < _UNEVEN * middle) >= _REGULAR else None


def same_curve(a: Array, b: Array) -> bool:
    """Whether two columns hold the same numbers, one perhaps with empty cells below."""
    if a[0] != b[0] and not np.isnan(a[0]):
        return False
    return np.array_equal(without_tail(a), without_tail(b), equal_nan=True)


def without_tail(values: Array) -> Array:
    """Numbers up to the last finite one, shape (M,)."""
    known = np.flatnonzero(np.isfinite(values))
    return values[: known[-1] + 1] if known.size else values[:0]


def is_label(values: Array) -> bool:
    """Whether numbers tell rows apart, as that of a joint or a trial does: few, whole, close together.

    Parameters
    ----------
    values : Array
        Shape (N,).
    """
    if not np.isfinite(values).all() or (values != np.round(values)).any():
        return False
    kinds = np.unique(values)
    return bool(0 < np.ptp(kinds) < _MOST_LABELS and len(values) >= _FEWEST * len(kinds))


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
    # Each number once: a joint that rests for most of the time is on any grid there.
    offsets = np.unique(finite[:: max(1, len(finite) // _MOST_COUNTED)]) - finite[0]
    for unit, count in product(("deg", "rad"), COUNTS_DEG):
        counts = offsets / (count if unit == "deg" else np.deg2rad(count))
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


def differences_of(values: Array, others: Mapping[int, Array]) -> list[tuple[int, int]]:
    """Find all pairs of signals whose difference another one is.

    Parameters
    ----------
    values : Array
        Shape (N,).
    others : mapping
        Candidates of the same length, by their places in the table.

    Returns
    -------
    list of tuple of int
        Places of minuend and subtrahend, those next to each other first. Two signals count when their
        difference is the given one to 1 % of its own size, at 8 samples or more that all three have.
    """
    x = looked_at(values)
    size = float(np.abs(x[np.isfinite(x)]).max(initial=0.0))
    if size == 0.0:
        return []
    thinned = {place: looked_at(other) for place, other in others.items()}

    def fits(minuend: int, subtrahend: int) -> bool:
        a, b = thinned[minuend], thinned[subtrahend]
        known = np.isfinite(x) & np.isfinite(a) & np.isfinite(b)
        return bool(known.sum() >= _FEWEST and np.abs(a[known] - b[known] - x[known]).max() <= 0.01 * size)

    found = [pair for pair in permutations(thinned, 2) if fits(*pair)]
    return sorted(found, key=lambda pair: abs(pair[0] - pair[1]))
