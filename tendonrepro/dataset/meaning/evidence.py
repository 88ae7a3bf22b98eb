"""What numbers themselves say about what they are.

Beside names and stored units, four plain signs are taken for evidence, and no other:

1. Numbers that increase evenly are times; their unit is the one that makes the step that of a control loop,
   unless no motion could be so short.
2. A motor angle that is a hundred times the printed coupling ratio of the joint angles is one before the
   reducer.
3. Constants and a few whole numbers are no motion: the latter tell rows apart.
4. The range of angles, or the size of an encoder's steps in them, tells degrees from radians.

What these leave open is asked: the suggestion names the line of the mapping that settles it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from tendonrepro.arrays import Array

COUNTS_DEG = (360.0 / 16384.0, 0.022)
"""One count of the paper's joint encoder, deg: 4096 pulses, four counts each; and as the paper prints it."""
_UNEVEN = 0.5
_REGULAR = 0.95  # share of steps that are even; a logger drops a cycle now and then
_FEWEST = 8
_MOST_COUNTED = 20000  # samples that are laid on the grid of the encoder
_MOST_LABELS = 8
_ENOUGH = 2000  # samples that comparisons look at


def sampling_step(values: Array) -> float | None:
    """Median step of at least 8 numbers (N,) that increase, nearly all evenly; None where they do not.

    Cells without a number at the end, where a longer column stands beside it, do not count.
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
    """Whether numbers (N,) tell rows apart, as those of joints or trials do: few, whole, close together."""
    if not np.isfinite(values).all() or (values != np.round(values)).any():
        return False
    kinds = np.unique(values)
    return bool(0 < np.ptp(kinds) < _MOST_LABELS and len(values) >= _FEWEST * len(kinds))


def counted_in(values: Array) -> str | None:
    """``deg`` or ``rad`` when all numbers (N,) lie on the grid of the paper's encoder in that unit."""
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


def distance(a: Array, b: Array) -> float:
    """RMS of the difference of two signals over the range of the first; infinite when that is constant."""
    thin = max(1, len(a) // _ENOUGH)
    x, y = a[::thin], b[::thin]
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return np.inf
    extent = float(np.ptp(x[known]))
    return float(np.sqrt(np.mean((x[known] - y[known]) ** 2))) / extent if extent > 0.0 else np.inf


def largest(values: Array) -> float:
    """Largest magnitude of the numbers among values; 0 without any."""
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
