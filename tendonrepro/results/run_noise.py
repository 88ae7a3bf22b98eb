"""How far the errors of runs that repeat each other scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array

NOISE = 0.02
"""Relative noise of a run's errors on a joint, one standard deviation.

Assumed, as the paper shows no repeated run. Simulated runs as published scatter about as much, root mean
square, when masses move by a millionth (docs/results/repeats.json).
"""

NOISE_OF_SHAPE = 0.25
"""Noise of RMSE/MAE over `NOISE`, assumed; in those repeats it is about a third."""


def with_noise(errors: Array, noise: float, rng: np.random.Generator) -> Array:
    """Errors (N, runs, metrics, n) with the noise of a run on each joint, much alike in MAE and RMSE."""
    of_size, of_shape = noise * rng.standard_normal((2, *errors[:, :, 0].shape))
    return np.asarray(errors * np.exp(np.stack([of_size, of_size + NOISE_OF_SHAPE * of_shape], axis=2)))


def noise_covariance(kept: NDArray[np.bool_]) -> Array:
    """Covariance (K, K) of the logs of K errors kept of (runs, metrics, n) that :func:`with_noise` gives."""
    run, metric, joint = np.nonzero(kept)
    same_run = (run[:, np.newaxis] == run) & (joint[:, np.newaxis] == joint)
    of_shape = NOISE_OF_SHAPE**2 * np.diag(metric.astype(float))
    return np.asarray(NOISE**2 * (same_run + of_shape))
