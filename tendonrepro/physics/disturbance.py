"""The disturbance torque ``tau_d(t)`` of Eq. (4): a step plus sines, which an integrator can follow."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array


class Disturbance(NamedTuple):
    """A step and m sines on n joints.

    Attributes
    ----------
    step : array (n,)
        N m.
    start : float
        Of the step, s.
    amplitude, phase : array (n, m)
        Of the sines, N m and rad.
    omega : array (m,)
        Angular frequencies, rad s⁻¹.
    """

    step: Array
    start: float
    amplitude: Array
    phase: Array
    omega: Array


def no_disturbance(n: int) -> Disturbance:
    """No torque on any of n joints."""
    return step_disturbance(np.zeros(n), 0.0)


def step_disturbance(torque: Array, start: float) -> Disturbance:
    """Constant torque (n,), N m, from a time, s, on."""
    n = torque.size
    return Disturbance(np.array(torque), start, np.zeros((n, 0)), np.zeros((n, 0)), np.zeros(0))


def sine_disturbance(torque: Array, frequency: float) -> Disturbance:
    """Sine of amplitude (n,), N m, and frequency, Hz; zero at the start."""
    n = torque.size
    omega = np.array([2.0 * np.pi * frequency])
    return Disturbance(np.zeros(n), 0.0, torque[:, np.newaxis].copy(), np.zeros((n, 1)), omega)


def noise_disturbance(torque: Array, band: Array, components: int, rng: np.random.Generator) -> Disturbance:
    """Band-limited noise of RMS ``torque`` (n,), N m, independent between joints.

    It sums sines with frequencies within ``band`` (2,), Hz, and phases from ``rng``.
    """
    n = torque.size
    omega = 2.0 * np.pi * rng.uniform(band[0], band[1], components)
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, components))
    amplitude = np.repeat(torque[:, np.newaxis] * np.sqrt(2.0 / components), components, axis=1)
    return Disturbance(np.zeros(n), 0.0, amplitude, phase, omega)


def disturbance_torque(t: Any, i: int, disturbance: Disturbance) -> Any:
    """``tau_d`` of joint i, from 0, at time t, s: (...), N m."""
    torque = disturbance.step[i] * (t >= disturbance.start)
    for k in range(disturbance.omega.shape[0]):
        torque = torque + disturbance.amplitude[i, k] * np.sin(
            disturbance.omega[k] * t + disturbance.phase[i, k]
        )
    return torque
