"""The noise of a run is much alike in MAE and RMSE, and its covariance is that of what it makes."""

from __future__ import annotations

import numpy as np
import pytest

from tendonrepro.results.run_noise import NOISE, noise_covariance, with_noise

SHAPE = 3, 2, 2
"""Runs, metrics and joints."""


def logs() -> np.ndarray:
    return np.log(with_noise(np.ones((4000, *SHAPE)), NOISE, np.random.default_rng(1)))


def test_noise_is_shared_by_mae_and_rmse_but_for_a_part() -> None:
    assert logs().std(axis=0) == pytest.approx(0.02, rel=0.1)
    assert (logs()[:, :, 1] - logs()[:, :, 0]).std(axis=0) == pytest.approx(0.005, rel=0.1)


def test_the_covariance_is_that_of_the_noise() -> None:
    kept = np.ones(SHAPE, dtype=bool)
    kept[1, 0, 1] = False
    found = np.cov(logs()[:, kept].T)
    np.testing.assert_allclose(noise_covariance(kept), found, atol=0.1 * NOISE**2)
