"""Loads beside the arm's own: friction ``F(q, dq)`` and disturbance ``tau_d(t)`` of Eq. (4).

The paper only names them. Friction is a smooth Coulomb law with an optional Stribeck rise, of joints and
winches. A disturbance is a step plus sines, which an integrator can follow.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array


class Friction(NamedTuple):
    """One friction law per joint or winch; arrays (n,).

    Attributes
    ----------
    viscous
        N m s.
    coulomb
        Torque at speed, N m.
    static_ratio
        Torque near standstill over ``coulomb``; 1 is no Stribeck rise.
    stribeck_velocity
        At which that rise dies out, rad s⁻¹.
    smoothing_velocity
        Over which the sign is smoothed, rad s⁻¹.
    """

    viscous: Array
    coulomb: Array
    static_ratio: Array
    stribeck_velocity: Array
    smoothing_velocity: Array


def friction_torque(velocity: Array, friction: Friction) -> Array:
    """Friction torque (n, ...), N m, that opposes a velocity (n, ...), rad s⁻¹.

    ``viscous v + coulomb [1 + (static_ratio - 1) exp(-(v/v_s)²)] tanh(v/v_c)``
    """
    torque = np.empty_like(velocity)
    for i in range(velocity.shape[0]):
        relative = velocity[i] / friction.stribeck_velocity[i]
        rise = 1.0 + (friction.static_ratio[i] - 1.0) * np.exp(-relative * relative)
        sense = np.tanh(velocity[i] / friction.smoothing_velocity[i])
        torque[i] = friction.viscous[i] * velocity[i] + friction.coulomb[i] * rise * sense
    return torque


def without_dry_friction(friction: Friction) -> Friction:
    """The law without Coulomb part, and so without Stribeck rise."""
    return friction._replace(coulomb=np.zeros_like(friction.coulomb))


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
