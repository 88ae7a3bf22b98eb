"""Winches and tendons: their coupling to the joints, Eqs. (1) and (2), and the motor side, Eqs. (3) and (5).

A tendon passes the joints before its own over guide pulleys, so their motion winds it. In winch coordinates,
``q_motor = S_inv theta``, everything is diagonal. In joint coordinates the same sums are the paper's ``I``,
``D_m``, ``K_s``, ``D_s``. Last stands what is between law and plant: encoders, and the motors' limits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose, times
from tendonrepro.physics.loads import Friction, friction_torque


def coupling_inverse(winch_diameter: Array, pulley_diameter: Array, sign: Array) -> Array:
    """Map ``S_inv`` (n, n) from joint to winch angles, ``q_motor = S_inv q``, lower triangular.

    Eq. (2): the diagonal is ``c[n,n] D[n,n] / D[n]``, below it stands ``-c[i,n] D[i,n] / D[n]``. Of the
    matrices only ``p <= q`` is read.

    Parameters
    ----------
    winch_diameter : array (n,)
        ``D[n]``, m.
    pulley_diameter : array (n, n)
        ``D[p, q]``, m: pulley at joint p that guides tendon q, on the diagonal the joint winch.
    sign : array (n, n)
        ``c[p, q]``: +1 if joint p, turning clockwise, makes tendon q drive joint q clockwise too.

    Examples
    --------
    Table 1, with the signs of section 3.3:

    >>> D = np.array([37.0, 37.0, 37.0])
    >>> D_pq = np.array([[77.0, 35.0, 35.0], [0.0, 77.0, 35.0], [0.0, 0.0, 37.0]])
    >>> c = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    >>> coupling_matrix(coupling_inverse(D, D_pq, c)).round(4)
    array([[ 0.4805,  0.    ,  0.    ],
           [ 0.2184,  0.4805,  0.    ],
           [-0.2479,  0.4545,  1.    ]])
    """
    ratio = (sign * pulley_diameter).T / winch_diameter[:, np.newaxis]
    return np.diag(np.diag(ratio)) - np.tril(ratio, k=-1)


def coupling_matrix(S_inv: Array) -> Array:
    """Map ``S`` (n, n) from winch to joint angles, ``q = S q_motor``, by forward substitution."""
    S = np.zeros_like(S_inv)
    for row in range(S_inv.shape[0]):
        S[row, row] = 1.0 / S_inv[row, row]
        S[row, :row] = -S[row, row] * (S_inv[row, :row] @ S[:row, :row])
    return S


def to_joint_matrix(winch_values: Array, S_inv: Array) -> Array:
    """Refer values of the winches (n,) to the joints: ``S_invᵀ diag(w) S_inv``, symmetric (n, n), same unit.

    So inertia, damping and stiffness become ``I``, ``D_m``, ``D_s``, ``K_s`` at the same energy.
    """
    return S_inv.T @ np.diag(winch_values) @ S_inv


class Drive(NamedTuple):
    """Parameters of n winches and their tendons, arrays (n,).

    Attributes
    ----------
    S, S_inv : array (n, n)
        Eq. (2).
    inertia
        Rotor, reducer and drum at the winch, kg m².
    stiffness, damping
        Of the tendon at the winch, N m rad⁻¹ and N m s rad⁻¹.
    slack
        Half the assembly clearance, as a winch angle, rad.
    one_way
        1 where a tendon goes slack instead of pushing, 0 where it pushes, as in Eq. (5).
    friction : Friction
        At the winch; its viscous part is ``D_m``.
    pulley_loss
        Share of a tendon's tension lost on all its guide pulleys together.
    reducer_loss
        Share of the motor torque lost in the reducer.
    wobble
        Amplitude of the reducer's transmission error at the winch, rad.
    wobble_rate
        Its periods per radian of the winch, times 2π.
    """

    S: Array
    S_inv: Array
    inertia: Array
    stiffness: Array
    damping: Array
    slack: Array
    one_way: Array
    friction: Friction
    pulley_loss: Array
    reducer_loss: Array
    wobble: Array
    wobble_rate: Array


def to_winch_angle(angle: Array, drive: Drive) -> Array:
    """Winch angles ``S_inv angle``, rad; also for velocities."""
    return times(drive.S_inv, angle)


def to_winch_torque(torque: Array, drive: Drive) -> Array:
    """Winch torques that balance joint torques, ``Sᵀ torque``, N m."""
    return times(np.swapaxes(drive.S, 0, 1), torque)


def to_joint_torque(torque: Array, drive: Drive) -> Array:
    """Joint torques of winch torques, ``S_invᵀ torque``, N m."""
    return times(np.swapaxes(drive.S_inv, 0, 1), torque)


def lever(theta: Array, drive: Drive) -> Array:
    """Turns (n, ...) of a winch per turn of its motor, one but for the transmission error.

    By virtual work also the motor's share of a tendon's torque. ``theta``, rad, is in joint coordinates.
    """
    motor = to_winch_angle(theta, drive)
    turns = np.empty_like(theta)
    for i in range(theta.shape[0]):
        slope = drive.wobble[i] * drive.wobble_rate[i]
        turns[i] = 1.0 + slope * np.cos(drive.wobble_rate[i] * motor[i])
    return turns


def pulled(torque: Array, drive: Drive) -> Array:
    """Tendon torque (n, ...), N m, positive in a pull, without what it would have to push."""
    kept = np.empty_like(torque)
    for i in range(torque.shape[0]):
        kept[i] = choose(drive.one_way[i] * torque[i] < 0.0, 0.0, torque[i])
    return kept


def tendon_torque(q: Array, dq: Array, theta: Array, dtheta: Array, drive: Drive) -> Array:
    """Torque ``Sᵀ tau_s`` (n, ...) of every tendon at its winch, N m, positive where it pulls; Eq. (5).

    A clearance is a dead zone of the elastic part. Damping always acts: it stands for all losses along the
    path. ``theta`` (n, ...), rad, is in joint coordinates.
    """
    stretch = to_winch_angle(theta - q, drive)
    motor, motor_rate = to_winch_angle(theta, drive), to_winch_angle(dtheta, drive)
    joint_rate = to_winch_angle(dq, drive)
    turns = lever(theta, drive)
    torque = np.empty_like(q)
    for i in range(q.shape[0]):
        reach = stretch[i] + drive.wobble[i] * np.sin(drive.wobble_rate[i] * motor[i])
        reach_rate = turns[i] * motor_rate[i] - joint_rate[i]
        inside = 0.5 * (np.abs(reach + drive.slack[i]) - np.abs(reach - drive.slack[i]))
        torque[i] = drive.stiffness[i] * (reach - inside) + drive.damping[i] * reach_rate
    return pulled(torque, drive)


def winch_friction(winch_rate: Array, tendon: Array, motor: Array, drive: Drive) -> Array:
    """Friction torque (n, ...) at the winches, N m: bearings, guide pulleys and reducer.

    The last two lose a share of what they transmit, signed as the motion. ``winch_rate`` is in rad s⁻¹;
    ``tendon`` and ``motor`` are torques at the winch, N m.
    """
    torque = friction_torque(winch_rate, drive.friction)
    for i in range(winch_rate.shape[0]):
        sense = np.tanh(winch_rate[i] / drive.friction.smoothing_velocity[i])
        torque[i] += drive.pulley_loss[i] * np.abs(tendon[i]) * sense
        torque[i] += drive.reducer_loss[i] * np.abs(motor[i]) * sense
    return torque


def motor_acceleration(theta: Array, dtheta: Array, tendon: Array, tau_m: Array, drive: Drive) -> Array:
    """Motor acceleration (n, ...) in joint coordinates, rad s⁻²; Eq. (3) solved for ``ddtheta``.

    ``tendon`` is at the winch, ``tau_m`` in joint coordinates, N m.
    """
    motor = to_winch_torque(tau_m, drive)
    load = lever(theta, drive) * tendon + winch_friction(to_winch_angle(dtheta, drive), tendon, motor, drive)
    acceleration = np.empty_like(dtheta)
    for i in range(dtheta.shape[0]):
        acceleration[i] = (motor[i] - load[i]) / drive.inertia[i]
    return times(drive.S, acceleration)


def theta_at_rest(q: Array, tau_s: Array, drive: Drive) -> Array:
    """Motor angles (n,), rad in joint coordinates, at which resting tendons carry a joint torque (n,), N m.

    There ``tendon_torque(q, 0, theta, 0) = Sᵀ tau_s``. A tendon without load rests in the middle of its
    clearance.
    """
    load = pulled(to_winch_torque(tau_s, drive), drive)
    target = to_winch_angle(q, drive)
    for i in range(q.shape[0]):
        sense = choose(load[i] > 0.0, 1.0, choose(load[i] < 0.0, -1.0, 0.0))
        target[i] = target[i] + (load[i] / drive.stiffness[i] + drive.slack[i] * sense)
    winch = target
    # The transmission error's slope is far below one, so a few fixed-point steps reach rounding.
    for _ in range(60):
        before, winch = winch, np.empty_like(target)
        for i in range(q.shape[0]):
            winch[i] = target[i] - drive.wobble[i] * np.sin(drive.wobble_rate[i] * before[i])
        if np.array_equal(before, winch):
            break
    return times(drive.S, winch)


class Encoder(NamedTuple):
    """One encoder type.

    Attributes
    ----------
    resolution
        Of one count, rad; 0 is ideal.
    noise
        RMS before counting, rad.
    """

    resolution: float
    noise: float


def quantise(value: Any, step: Any) -> Any:
    """Round to whole steps, halves upwards; a step of exactly 0 changes nothing.

    On lanes each experiment has its own step.
    """
    if isinstance(step, float) and step == 0.0:
        return value
    counted = step * np.floor(value / step + 0.5)
    return counted if isinstance(step, float) else choose(step > 0.0, counted, value)


class Actuator(NamedTuple):
    """Limits of motors and drives, all at the winch.

    Attributes
    ----------
    limit : array (n,)
        N m.
    resolution
        Step of the drive's input, N m; 0 is none.
    noise
        RMS noise of its output, N m.
    delay
        Whole samples between command and output.
    """

    limit: Array
    resolution: float
    noise: float
    delay: int


def applied_torque(command: Array, actuator: Actuator, S: Array, S_inv: Array) -> Array:
    """Torque (n,) after the drive's resolution and the motors' saturation, N m in joint coordinates.

    An actuator that changes nothing returns the command to the last bit.
    """
    winch = times(S.T, command)
    change = np.empty_like(command)
    for i in range(command.shape[0]):
        output = quantise(winch[i], actuator.resolution)
        change[i] = np.minimum(np.maximum(output, -actuator.limit[i]), actuator.limit[i]) - winch[i]
    return command + times(S_inv.T, change)
