"""One sample of a run, for both steppers and a user's own law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose, pick
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Memory, Servo, servo_torque, start_memory
from tendonrepro.physics.instruments import Actuator, Encoder, applied_torque, quantise
from tendonrepro.physics.linalg import times

LARGEST_TORQUE = 1e6
"""Torque, N m, beyond which a run has diverged even before its error shows it."""

Two: TypeAlias = tuple[Array, Array]
Three: TypeAlias = tuple[Array, Array, Array]
Remembered: TypeAlias = Memory | Two
"""What a law remembers; a position loop its last motor angles and the torque that held the arm."""

CommandFunction = Callable[[Memory, Array, Array, Array, Array, Law], tuple[Array, Array, Array, Array]]
"""Signature of :func:`tendonrepro.physics.control.command`."""


class Hardware(NamedTuple):
    """What is between law and plant.

    Motor angles are zero at `theta_start` (n,), in joint coordinates. `S` and `S_inv` are of Eq. (2). Beyond
    an error of `limit`, rad, a run has diverged.
    """

    joint_encoder: Encoder
    motor_encoder: Encoder
    theta_start: Array
    actuator: Actuator
    S: Array
    S_inv: Array
    limit: float


class SampledState(NamedTuple):
    """What one sample makes of a state; arrays (n,), SI.

    `measured` is as of :func:`measure`. Torques are `tau` commanded, `tau_m` applied, and `torque` with the
    noise that no controller knows. `rate` is of the error; None of a position loop. `pending` are commands on
    their way to the motors, the newest first.
    """

    measured: Two
    tau: Array
    tau_m: Array
    torque: Array
    signals: Sequence[Array]
    rate: Array | None
    memory: Remembered
    pending: list[Array]
    bounded: Numeric


def sample(
    state: Array,
    memory: Remembered,
    pending: Sequence[Array],
    desired: Three,
    noise: Array,
    law: Law | Servo,
    hardware: Hardware,
    command: CommandFunction = control.command,
) -> SampledState:
    """One sample, from a state (4 n,) and unit noise (3 n,) of joint encoders, motor encoders and torque."""
    n, actuator, S, S_inv = len(state) // 4, hardware.actuator, hardware.S, hardware.S_inv
    measured = measure(state, noise, law, hardware)
    fed = (*desired[:2], law.feed_forward * desired[2]) if isinstance(law, Law) else desired
    tau, signals, rate = _decide(memory, measured, fed, law, command)
    line = [tau, *pending]
    tau_m = applied_torque(pick(line, actuator.delay), actuator, S, S_inv)
    if isinstance(law, Servo):
        memory = measured[1], memory[1]
    else:
        assert isinstance(memory, Memory)
        assert rate is not None
        within = applied_torque(tau, actuator._replace(resolution=0.0), S, S_inv)
        stored = choose(law.stores_applied, tau_m, within)
        # A user's law may have neither rate nor estimate; its memory then holds zeros.
        own = command is not control.command
        kept = (np.nan_to_num(rate), np.nan_to_num(signals[0])) if own else (rate, signals[0])
        memory = control.remember(memory, measured[0], desired[0], *kept, stored, law)
    bounded: Numeric = 1.0
    for i in range(n):
        error = desired[0][i] - measured[0][i]
        bounded = bounded * (abs(error) <= hardware.limit) * (abs(tau_m[i]) <= LARGEST_TORQUE)
    # The noise acts on the plant alone: no controller can know it.
    torque = tau_m + times(S_inv.T, actuator.noise * noise[2 * n :])
    return SampledState(measured, tau, tau_m, torque, signals, rate, memory, line[:-1], bounded)


def measure(state: Array, noise: Array, law: Law | Servo, hardware: Hardware) -> Two:
    """Angles by encoders of joints, or of motors through S where the law looks at these, and of motors."""
    n = len(state) // 4
    turned = times(hardware.S_inv, state[2 * n : 3 * n] - hardware.theta_start)
    q_motor = _counted(turned, noise[n : 2 * n], hardware.motor_encoder)
    q = _counted(state[:n], noise[:n], hardware.joint_encoder)
    if isinstance(law, Law):
        q = choose(law.motor_side, times(hardware.S, q_motor), q)
    return q, q_motor


def _counted(angle: Array, noise: Array, encoder: Encoder) -> Array:
    counted = np.empty_like(angle)
    for i in range(len(angle)):
        counted[i] = quantise(angle[i] + encoder.noise * noise[i], encoder.resolution)
    return counted


def start(measured: Two, q_d: Array, tau: Array, law: Law | Servo) -> Remembered:
    """Memory at the first sample, given the desired angles and the torque before."""
    if isinstance(law, Servo):
        return measured[1], tau
    return start_memory(measured[0], tau, longest(law.lag), q_d)


def longest(count: Numeric) -> int:
    """Largest of whole numbers in which experiments side by side differ, or the one they share."""
    return int(np.max(count))


def _decide(
    memory: Remembered, measured: Two, desired: Three, law: Law | Servo, command: CommandFunction
) -> tuple[Array, tuple[Array, ...], Array | None]:
    """Torque, signals and rate; torque of position loops adds to the one that held the arm."""
    if isinstance(law, Servo):
        return memory[1] + servo_torque(measured[1], memory[0], desired[0], desired[1], law), (), None
    assert isinstance(memory, Memory)
    tau, H_hat, s, rate = command(memory, measured[0], *desired, law)
    return tau, (H_hat, s), rate
