"""Elementary functions from arithmetic stay within their stated bounds."""

from __future__ import annotations

import numpy as np
import pytest

from tendonrepro.simulation.codegen import elementary

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("largest", [1.0, 20.0, 700.0])
def test_exp(largest: float) -> None:
    x = RNG.uniform(-largest, largest, 200_000)
    assert np.abs(elementary.exp(x) / np.exp(x) - 1.0).max() < 1e-15
    ends = elementary.exp(np.array([-1e9, 1e9]))
    assert 0.0 < ends[0] < 1e-300
    assert 1e300 < ends[1] < np.inf


def test_tanh() -> None:
    x = np.concatenate([RNG.uniform(-30.0, 30.0, 200_000), RNG.normal(size=20_000) * 1e-4, [0.0, 1e9, -1e9]])
    assert np.abs(elementary.tanh(x) - np.tanh(x)).max() < 4e-16


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine(name: str) -> None:
    near_zeros = np.pi * np.arange(-300, 301) + RNG.uniform(-1e-9, 1e-9, 601)
    x = np.concatenate([RNG.uniform(-1000.0, 1000.0, 300_000), near_zeros])
    assert np.abs(getattr(elementary, name)(x) - getattr(np, name)(x)).max() < 1e-15


def test_log() -> None:
    x = 10.0 ** RNG.uniform(-300.0, 300.0, 200_000)
    error = np.abs(elementary.log(x) - np.log(x)) / np.maximum(1.0, np.abs(np.log(x)))
    assert error.max() < 4e-16
    assert elementary.log(np.array([1.0]))[0] == 0.0


def test_power() -> None:
    x, b = 10.0 ** RNG.uniform(-12.0, 3.0, 200_000), RNG.uniform(-1.0, 1.0, 200_000)
    error = np.abs(elementary.power(x, b) / x**b - 1.0) / (1.0 + np.abs(b * np.log(x)))
    assert error.max() < 1e-15
    assert 0.0 <= elementary.power(np.array([0.0]), 0.9)[0] < 1e-250
