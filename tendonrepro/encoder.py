"""Incremental encoders: counts, and noise before counting."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array


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


def quantise(value: Array, step: float) -> Array:
    """Round to whole steps, halves upwards.

    Parameters
    ----------
    value : array (...)
    step : float
        Same unit; 0 leaves the value as it is.

    Returns
    -------
    array (...)
    """
    return step * np.floor(value / step + 0.5) if step > 0.0 else value


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
