"""The disturbance torque ``tau_d(t)`` of Eq. (4): a step, a sine, or band-limited noise.

All three are one form, a step plus a sum of sines, so that the plant stays a smooth function of time that
an adaptive integrator can follow. Noise is a sum of many sines with frequencies and phases drawn from a seed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array


class Disturbance(NamedTuple):
    """A step and m sines on n joints.

    Attributes
    ----------
    step : array (n,)
        Torque of the step, N m.
    start : float
        Time of the step, s.
    amplitude, phase : array (n, m)
        Amplitudes, N m, and phases, rad, of the sines.
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
    """Constant torque from a start time on.

    Parameters
    ----------
    torque : array (n,)
        N m.
    start : float
        s.
    """
    n = torque.size
    return Disturbance(np.array(torque), start, np.zeros((n, 0)), np.zeros((n, 0)), np.zeros(0))


def sine_disturbance(torque: Array, frequency: float) -> Disturbance:
    """Sine torque that is zero at the start.

    Parameters
    ----------
    torque : array (n,)
        Amplitude, N m.
    frequency : float
        Hz.
    """
    n = torque.size
    omega = np.array([2.0 * np.pi * frequency])
    return Disturbance(np.zeros(n), 0.0, torque[:, np.newaxis].copy(), np.zeros((n, 1)), omega)


def noise_disturbance(torque: Array, band: Array, components: int, rng: np.random.Generator) -> Disturbance:
    """Band-limited noise, independent from joint to joint.

    Parameters
    ----------
    torque : array (n,)
        Root mean square, N m.
    band : array (2,)
        Lowest and highest frequency, Hz.
    components : int
        Number of sines.
    rng : numpy.random.Generator
        Source of frequencies and phases.
    """
    n = torque.size
    omega = 2.0 * np.pi * rng.uniform(band[0], band[1], components)
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, components))
    amplitude = np.repeat(torque[:, np.newaxis] * np.sqrt(2.0 / components), components, axis=1)
    return Disturbance(np.zeros(n), 0.0, amplitude, phase, omega)


def disturbance_torque(t: Any, i: int, disturbance: Disturbance) -> Any:
    """``tau_d`` of joint i, N m.

    Parameters
    ----------
    t : float or array (...)
        Time, s.
    i : int
        Joint, from 0.
    disturbance : Disturbance

    Returns
    -------
    float or array (...)
    """
    torque = disturbance.step[i] * (t >= disturbance.start)
    for k in range(disturbance.omega.shape[0]):
        torque = torque + disturbance.amplitude[i, k] * np.sin(
            disturbance.omega[k] * t + disturbance.phase[i, k]
        )
    return torque
