"""Incremental encoders: counts, and noise before counting."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose


class Encoder(NamedTuple):
    """One encoder type on n axes.

    Attributes
    ----------
    resolution : float
        Angle of one count, rad; 0 is an ideal encoder.
    noise : float
        Root mean square of the angle noise before counting, rad.
    """

    resolution: float
    noise: float


def quantise(value: Any, step: Any) -> Any:
    """Round to whole steps, halves upwards.

    Parameters
    ----------
    value : float or array (...)
    step : float
        Same unit; exactly 0 leaves the value as it is. On lanes each experiment has its own.

    Returns
    -------
    float or array (...)
    """
    if isinstance(step, float) and step == 0.0:
        return value
    counted = step * np.floor(value / step + 0.5)
    return counted if isinstance(step, float) else choose(step > 0.0, counted, value)


def noise_sequence(rms: float, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """White Gaussian noise for a whole run.

    Parameters
    ----------
    rms : float
        Root mean square.
    shape : (int, int)
        Samples and axes.
    rng : numpy.random.Generator

    Returns
    -------
    array of that shape
    """
    return rms * rng.standard_normal(shape)
