"""One sample of a run beside its plant: instruments, the package's own laws, and when it has diverged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, Memory, Servo, command, remember, servo_torque
from tendonrepro.physics.instruments import Actuator, quantise
from tendonrepro.physics.linalg import times

LARGEST_TORQUE = 1e6
"""Torque, N m, beyond which a run has diverged even before its error shows it."""


Two: TypeAlias = tuple[Array, Array]
Three: TypeAlias = tuple[Array, Array, Array]


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
    motor_side : bool
        Whether the law looks at the motors' angles, through S.
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
    motor_side: bool


def measure(k: int, state: Array, hardware: Hardware) -> tuple[Array, Array]:
    """Angles of joints, those of the motors through S where the law looks at these, and of motors, rad."""
    n = hardware.theta_start.size
    turned = times(hardware.S_inv, state[2 * n : 3 * n] - hardware.theta_start)
    q_motor = quantise(turned + hardware.motor_noise[k], hardware.motor_step)
    if hardware.motor_side:
        return times(hardware.S, q_motor), q_motor
    return quantise(state[:n] + hardware.q_noise[k], hardware.q_step), q_motor


def decide_by_estimate(memory: Memory, measured: Two, desired: Three, law: Law) -> tuple[Array, Array, Any]:
    """Torque by Eq. (17), with its estimate and surface."""
    q_d, dq_d, ddq_d = desired
    tau, H_hat, s, de = command(memory, measured[0], q_d, dq_d, ddq_d, law)
    return tau, np.stack((H_hat, s)), (memory, q_d, de, H_hat)


def keep_estimate(measured: Two, torques: Two, carry: Any, law: Law) -> Memory:
    """Shift the delay lines."""
    memory, q_d, de, H_hat = carry
    applied, commanded = torques
    return remember(memory, measured[0], q_d, de, H_hat, applied if law.stores_applied else commanded, law)


def decide_by_position(memory: Two, measured: Two, desired: Three, law: Servo) -> tuple[Array, Array, Any]:
    """Torque of the motors' position loops beyond the one that held the arm, which stays."""
    before, offset = memory
    q, q_motor = measured
    q_d, dq_d, _ = desired
    return offset + servo_torque(q_motor, before, q_d, dq_d, law), np.empty((0, q.size)), offset


def keep_position(measured: Two, torques: Two, carry: Any, law: Servo) -> Two:  # noqa: ARG001
    """Keep this sample's motor angles."""
    return measured[1], carry


LAWS: Mapping[type, tuple[Callable[..., Any], Callable[..., Any]]] = {
    Law: (decide_by_estimate, keep_estimate),
    Servo: (decide_by_position, keep_position),
}
"""How each kind of law decides, and what it keeps for the next sample."""


def decide(memory: Any, measured: Two, desired: Three, law: Law | Servo) -> tuple[Array, Array, Any]:
    """Torque in joint coordinates, (n,), signals, (K, n), and what `keep` needs."""
    return LAWS[type(law)][0](memory, measured, desired, law)  # type: ignore[no-any-return]


def keep(measured: Two, torques: Two, carry: Any, law: Law | Servo) -> Any:
    """Memory for the next sample, from the torque applied and the one commanded."""
    return LAWS[type(law)][1](measured, torques, carry, law)


def is_bounded(error: Array, tau_m: Array, limit: float) -> bool:
    """Whether a run can go on; comparisons with NaN are false."""
    return bool((np.abs(error) <= limit).all() and (np.abs(tau_m) <= LARGEST_TORQUE).all())
