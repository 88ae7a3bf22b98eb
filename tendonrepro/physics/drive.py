"""Winches and tendons: the motor side of the flexible joint, Eqs. (3) and (5).

Everything here is diagonal in winch coordinates, ``q_motor = S_inv theta``: one inertia, one friction law
and one tendon per winch. Written in joint coordinates the same sums are the paper's matrices,
``I = S_invᵀ diag(inertia) S_inv`` and likewise ``D_m``, ``K_s``, ``D_s``
(`tendonrepro.physics.kinematics.to_joint_matrix`); by virtual work a winch feels ``Sᵀ`` of a joint torque.

All functions take the joint axis first; further axes are independent lanes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.friction import Friction, friction_torque
from tendonrepro.physics.linalg import times


class Drive(NamedTuple):
    """Parameters of n winches and their tendons.

    Attributes
    ----------
    S, S_inv : array (n, n)
        Coupling matrix and its inverse, Eq. (2).
    inertia : array (n,)
        Rotor, reducer and drum at the winch, kg m².
    stiffness, damping : array (n,)
        Tendon stiffness, N m rad⁻¹, and damping, N m s rad⁻¹, at the winch.
    slack : array (n,)
        Half the assembly clearance, as a winch angle, rad; 0 without clearance.
    one_way : array (n,)
        1 where a tendon only pulls and goes slack where it would push, 0 where it does both, as in Eq. (5).
    friction : Friction
        Friction at the winch; its viscous part is ``D_m``.
    pulley_loss : array (n,)
        Share of a tendon's tension lost as friction on its guide pulleys, all of them together.
    reducer_loss : array (n,)
        Share of the motor torque lost in the reducer, one minus its efficiency.
    wobble : array (n,)
        Amplitude of the reducer's transmission error at the winch, rad.
    wobble_rate : array (n,)
        Periods of that error per radian of the winch, times 2π.
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
    """Winch angles that belong to joint angles, ``S_inv angle``; also for velocities.

    Parameters
    ----------
    angle : array (n, ...)
        Angles in joint coordinates, rad.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    return times(drive.S_inv, angle)


def to_winch_torque(torque: Array, drive: Drive) -> Array:
    """Winch torques that balance joint torques, ``Sᵀ torque``, N m.

    Parameters
    ----------
    torque : array (n, ...)
        Torque in joint coordinates, N m.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    return times(np.swapaxes(drive.S, 0, 1), torque)


def to_joint_torque(torque: Array, drive: Drive) -> Array:
    """Joint torques that winch torques produce, ``S_invᵀ torque``, N m.

    Parameters
    ----------
    torque : array (n, ...)
        Torque at the winches, N m.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    return times(np.swapaxes(drive.S_inv, 0, 1), torque)


def lever(theta: Array, drive: Drive) -> Array:
    """Turns of a winch per turn of its motor's angle, one but for the transmission error.

    By virtual work it is also the motor's share of a tendon's torque.

    Parameters
    ----------
    theta : array (n, ...)
        Motor angles in joint coordinates, rad.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    motor = to_winch_angle(theta, drive)
    turns = np.empty_like(theta)
    for i in range(theta.shape[0]):
        slope = drive.wobble[i] * drive.wobble_rate[i]
        turns[i] = 1.0 + slope * np.cos(drive.wobble_rate[i] * motor[i])
    return turns


def pulled(torque: Array, drive: Drive) -> Array:
    """What is left of tendons' torques at their winches when those that only pull go slack, N m.

    Parameters
    ----------
    torque : array (n, ...)
        Torque of springs and dampers, N m; positive where a tendon pulls.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    kept = np.empty_like(torque)
    for i in range(torque.shape[0]):
        kept[i] = choose(drive.one_way[i] * torque[i] < 0.0, 0.0, torque[i])
    return kept


def tendon_torque(q: Array, dq: Array, theta: Array, dtheta: Array, drive: Drive) -> Array:
    """Torque of every tendon at its winch, N m; Eq. (5) in winch coordinates.

    A clearance is a dead zone of the elastic part. The damping acts throughout: it stands for everything
    that dissipates along the tendon's path, and an on-off damping would be a guess on top of a guess. A
    transmission error turns the winch a little ahead of or behind its motor.

    Parameters
    ----------
    q, theta : array (n, ...)
        Joint angles and motor angles in joint coordinates, rad.
    dq, dtheta : array (n, ...)
        Their velocities, rad s⁻¹.
    drive : Drive

    Returns
    -------
    array (n, ...)
        ``Sᵀ tau_s``; positive where the tendon pulls.
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
    """Friction torque at the winches, N m: own bearings, guide pulleys and reducer.

    Pulleys and reducer lose a share of what they transmit, in the direction of the motion.

    Parameters
    ----------
    winch_rate : array (n, ...)
        Winch velocities, rad s⁻¹.
    tendon, motor : array (n, ...)
        Tendon and motor torques at the winch, N m.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    torque = friction_torque(winch_rate, drive.friction)
    for i in range(winch_rate.shape[0]):
        sense = np.tanh(winch_rate[i] / drive.friction.smoothing_velocity[i])
        torque[i] += drive.pulley_loss[i] * np.abs(tendon[i]) * sense
        torque[i] += drive.reducer_loss[i] * np.abs(motor[i]) * sense
    return torque


def motor_acceleration(theta: Array, dtheta: Array, tendon: Array, tau_m: Array, drive: Drive) -> Array:
    """Motor acceleration in joint coordinates, rad s⁻²; Eq. (3) solved for ``ddtheta``.

    Parameters
    ----------
    theta, dtheta : array (n, ...)
        Motor angles, rad, and velocities, rad s⁻¹, in joint coordinates.
    tendon : array (n, ...)
        Tendon torques at the winch, N m.
    tau_m : array (n, ...)
        Motor torque in joint coordinates, N m.
    drive : Drive

    Returns
    -------
    array (n, ...)
    """
    motor = to_winch_torque(tau_m, drive)
    load = lever(theta, drive) * tendon + winch_friction(to_winch_angle(dtheta, drive), tendon, motor, drive)
    acceleration = np.empty_like(dtheta)
    for i in range(dtheta.shape[0]):
        acceleration[i] = (motor[i] - load[i]) / drive.inertia[i]
    return times(drive.S, acceleration)


def theta_at_rest(q: Array, tau_s: Array, drive: Drive) -> Array:
    """Motor angles at which resting tendons carry a joint torque, rad in joint coordinates.

    Parameters
    ----------
    q : array (n,)
        Joint angles, rad.
    tau_s : array (n,)
        Joint torque the tendons carry, N m.
    drive : Drive

    Returns
    -------
    array (n,)
        The motor angle ``theta`` with ``tendon_torque(q, 0, theta, 0) = Sᵀ tau_s``; a tendon without load
        rests in the middle of its clearance, and so does one that would have to push and cannot.
    """
    load = pulled(to_winch_torque(tau_s, drive), drive)
    stretch = load / drive.stiffness + drive.slack * np.sign(load)
    winch = target = to_winch_angle(q, drive) + stretch
    # The transmission error's slope is far below one, so a few fixed-point steps reach rounding.
    for _ in range(60):
        before, winch = winch, target - drive.wobble * np.sin(drive.wobble_rate * winch)
        if np.array_equal(before, winch):
            break
    return times(drive.S, winch)
