from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tendonrepro.physics.loads import (
    Disturbance,
    disturbance_torque,
    noise_disturbance,
    sine_disturbance,
    step_disturbance,
)

Array = NDArray[np.float64]

TORQUE = np.array([0.5, -2.0])
BAND = np.array([2.0, 5.0])
# 400 s in steps of 5 ms: lines 2.5 mHz apart, up to 100 Hz.
TIME = np.arange(80000) * 5e-3


def both(t: Array, disturbance: Disturbance) -> Array:
    return np.array([disturbance_torque(t, i, disturbance) + 0.0 * t for i in range(2)])


def noise(seed: int = 1) -> Disturbance:
    return noise_disturbance(np.abs(TORQUE), BAND, 300, np.random.default_rng(seed))


def test_step_acts_from_its_very_start_on() -> None:
    step = step_disturbance(TORQUE, 0.25)
    times = np.array([0.0, np.nextafter(0.25, 0.0), 0.25, 10.0])
    assert both(times, step).tolist() == [[0.0, 0.0, 0.5, 0.5], [0.0, 0.0, -2.0, -2.0]]
    assert step.phase.shape == step.amplitude.shape == (2, step.omega.size)


def test_sine_starts_at_zero_and_has_its_amplitude_and_frequency() -> None:
    sine = sine_disturbance(TORQUE, 2.0)
    quarters = np.arange(9) / 8.0
    expected = np.outer(TORQUE, [0, 1, 0, -1, 0, 1, 0, -1, 0])
    # sin(2 pi k) is off by the rounding of 2 pi k.
    assert both(quarters, sine) == pytest.approx(expected, abs=1e-14)
    assert sine.phase.shape == sine.amplitude.shape == (2, sine.omega.size)


class TestNoise:
    def test_root_mean_square_of_its_components(self) -> None:
        rms = np.sqrt((noise().amplitude ** 2).sum(axis=1) / 2.0)
        assert rms == pytest.approx(np.abs(TORQUE), rel=1e-14)

    def test_power_lies_in_the_band_and_fills_it(self) -> None:
        power = np.abs(np.fft.rfft(both(TIME, noise()) * np.hanning(TIME.size))) ** 2
        frequency = np.fft.rfftfreq(TIME.size, 5e-3)
        inside = (frequency > BAND[0] - 0.01) & (frequency < BAND[1] + 0.01)
        # The window's side lobes fall with the third power of the distance: four lines away, 1e-4.
        assert (power[:, ~inside].sum(axis=1) < 1e-4 * power.sum(axis=1)).all()
        tenths = np.array_split(power[:, inside], 10, axis=1)
        # 30 sines are expected in a tenth of the band.
        assert all((part.sum(axis=1) > 0.03 * power.sum(axis=1)).all() for part in tenths)

    def test_no_instant_is_special(self) -> None:
        """Phases point everywhere alike; with more on one side the noise begins stronger or weaker."""
        many = noise_disturbance(np.abs(TORQUE), BAND, 30_000, np.random.default_rng(1))
        assert (np.abs(np.exp(1j * many.phase).mean(axis=1)) < 0.02).all()
