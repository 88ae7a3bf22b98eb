"""What a sampled run is between law and plant: its instruments, and when it has diverged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.instruments import Actuator, quantise
from tendonrepro.physics.linalg import times

LARGEST_TORQUE = 1e6
"""Torque, N m, beyond which a run has diverged even before its error shows it."""


class Hardware(NamedTuple):
    """What is between law and plant, for a run of T samples of n joints.

    Attributes
    ----------
    S, S_inv : array (n, n)
        Coupling of Eq. (2).
    actuator : Actuator
    theta_start : array (n,)
        Where motor angles are zero, in joint coordinates, rad.
    q_step, motor_step : float
        Counts of the encoders, rad.
    q_noise, motor_noise : array (T, n)
        rad.
    torque_noise : array (T, n)
        In joint coordinates, N m.
    """

    S: Array
    S_inv: Array
    actuator: Actuator
    theta_start: Array
    q_step: float
    motor_step: float
    q_noise: Array
    motor_noise: Array
    torque_noise: Array


def measure(k: int, state: Array, hardware: Hardware, motor_side: bool) -> tuple[Array, Array]:
    """Angles of joints, those of the motors through S where the law looks at these, and of motors, rad."""
    n = hardware.theta_start.size
    turned = times(hardware.S_inv, state[2 * n : 3 * n] - hardware.theta_start)
    q_motor = quantise(turned + hardware.motor_noise[k], hardware.motor_step)
    if motor_side:
        return times(hardware.S, q_motor), q_motor
    return quantise(state[:n] + hardware.q_noise[k], hardware.q_step), q_motor


def is_bounded(error: Array, tau_m: Array, limit: float) -> bool:
    """Whether a run can go on; comparisons with NaN are false."""
    return bool((np.abs(error) <= limit).all() and (np.abs(tau_m) <= LARGEST_TORQUE).all())
