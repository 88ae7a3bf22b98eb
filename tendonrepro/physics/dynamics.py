"""The flexible-joint arm as one differential equation: Eqs. (3), (4) and (5) together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array, solve_positive_definite
from tendonrepro.physics.arm import Arm, bias_torque, gravity_torque, mass_matrix
from tendonrepro.physics.drive import (
    Drive,
    lever,
    motor_acceleration,
    pulled,
    tendon_torque,
    theta_at_rest,
    to_joint_torque,
    to_winch_torque,
)
from tendonrepro.physics.loads import (
    Disturbance,
    Friction,
    disturbance_torque,
    friction_torque,
    without_dry_friction,
)


class Plant(NamedTuple):
    """Everything that moves.

    Attributes
    ----------
    link_friction
        ``F(dq)`` of Eq. (4).
    preload : array (n,)
        Joint torque of the constant-force tendon 4, N m, positive clockwise.
    """

    arm: Arm
    drive: Drive
    link_friction: Friction
    preload: Array
    disturbance: Disturbance


def link_acceleration(t: float | Array, q: Array, dq: Array, tau_s: Array, plant: Plant) -> Array:
    """Joint acceleration (n, ...) at time t, s, rad s⁻²; Eq. (4) solved for ``ddq``."""
    load = bias_torque(q, dq, plant.arm) + friction_torque(dq, plant.link_friction)
    net = np.empty_like(q)
    for i in range(q.shape[0]):
        net[i] = tau_s[i] + plant.preload[i] - load[i] - disturbance_torque(t, i, plant.disturbance)
    return solve_positive_definite(mass_matrix(q, plant.arm), net)


def state_derivative(t: float, state: Array, tau_m: Array, plant: Plant) -> Array:
    """Time derivative (4 n, ...) of the state at time t, s; Eqs. (3) to (5).

    The state stacks ``q``, ``dq``, ``theta``, ``dtheta``, rad and rad s⁻¹. ``tau_m`` is in joint coordinates,
    N m.
    """
    n = state.shape[0] // 4
    q, dq, theta, dtheta = state[:n], state[n : 2 * n], state[2 * n : 3 * n], state[3 * n :]
    tendon = tendon_torque(q, dq, theta, dtheta, plant.drive)
    derivative = np.empty_like(state)
    derivative[:n] = dq
    derivative[n : 2 * n] = link_acceleration(t, q, dq, to_joint_torque(tendon, plant.drive), plant)
    derivative[2 * n : 3 * n] = dtheta
    derivative[3 * n :] = motor_acceleration(theta, dtheta, tendon, tau_m, plant.drive)
    return derivative


def load_at_rest(q: Array, plant: Plant) -> Array:
    """Torque (n, ...) of the tendons at rest, N m: the weight less the tensioner's pull."""
    torque = gravity_torque(q, plant.arm)
    for i in range(q.shape[0]):
        torque[i] -= plant.preload[i]
    return torque


def holding_torque(q: Array, plant: Plant) -> Array:
    """Motor torque (n,) that holds the arm at rest, N m in joint coordinates.

    A transmission error changes the motors' share of the load. A one-way tendon that would have to push has
    none.
    """
    load, drive = load_at_rest(q, plant), plant.drive
    ahead = lever(theta_at_rest(q, load, drive), drive) - 1.0
    winch = to_winch_torque(load, drive)
    held = pulled(winch, drive)
    return load + to_joint_torque(ahead * held + (held - winch), drive)


def rest_state(q: Array, plant: Plant) -> Array:
    """State (4 n,) of static equilibrium at joint angles q (n,), rad."""
    still = np.zeros_like(q)
    return np.concatenate([q, still, theta_at_rest(q, load_at_rest(q, plant), plant.drive), still])


def both_ways(plant: Plant) -> Plant:
    """The plant with tendons that never go slack."""
    return plant._replace(drive=plant.drive._replace(one_way=np.zeros_like(plant.drive.one_way)))


def frictionless(plant: Plant) -> Plant:
    """The plant without link friction and dry winch friction; ``D_m`` of Eq. (3) stays."""
    none = plant.link_friction._replace(viscous=np.zeros_like(plant.link_friction.viscous))
    drive = plant.drive._replace(
        friction=without_dry_friction(plant.drive.friction),
        pulley_loss=np.zeros_like(plant.drive.pulley_loss),
        reducer_loss=np.zeros_like(plant.drive.reducer_loss),
    )
    return plant._replace(drive=drive, link_friction=without_dry_friction(none))
