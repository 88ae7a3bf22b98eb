"""Curves read off figures: how their times tell them, and how they come on an even grid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping import Use
from tendonrepro.errors import ConfigError

_EVEN = 0.1
"""Share of the median step by which a step of a recorder may differ."""
_MOST_POINTS = 5000
"""Points of a curve that somebody may have read off a figure."""
_FINEST = 0.02
"""Step of the grid on which curves are put, at most, s."""


def is_digitised(time: Array) -> bool:
    """Whether times are as uneven as those of points read off a figure.

    A recorder that loses samples still has most steps alike.
    """
    steps = np.diff(time[np.isfinite(time)])
    if not 2 < len(steps) < _MOST_POINTS:
        return False
    middle = np.median(np.abs(steps))
    return bool((np.abs(steps - middle) > _EVEN * middle).mean() > 0.5)


def in_order(time: Array, values: Array) -> tuple[Array, Array]:
    """Points of a curve by time; of points at one time the mean."""
    known = np.isfinite(time) & np.isfinite(values)
    places, index = np.unique(time[known], return_inverse=True)
    return places, np.bincount(index, values[known]) / np.bincount(index)


def read_off(series: Mapping[Use, tuple[Array, Array]]) -> tuple[Array, dict[Use, Array]]:
    """Curves, each times (s) and values, on one even grid, smoothed as cross-validation finds best.

    Raises
    ------
    ConfigError
        If curves have no time in common or too few points.
    """
    from scipy.interpolate import make_smoothing_spline

    if few := [use for use, (time, _) in series.items() if len(time) < 5]:
        raise ConfigError(f"the curve of {few[0]} has fewer than five points")
    times = [time for time, _ in series.values()]
    start, end = max(float(time[0]) for time in times), min(float(time[-1]) for time in times)
    if end <= start:
        raise ConfigError("its curves have no time in common")
    densest = min(float(np.median(np.diff(time))) for time in times)
    count = max(int(np.ceil((end - start) / min(0.5 * densest, _FINEST))), 1)
    grid = np.linspace(start, end, count + 1)
    # Smoothed to the stated error, a motion would lose its corners to a careful reader.
    return grid, {use: make_smoothing_spline(time, values)(grid) for use, (time, values) in series.items()}
