"""Friction of joints and winches: a smooth Coulomb law with an optional Stribeck rise.

The paper names ``F(q, dq)`` in Eq. (4) and says no more. All functions take the joint axis first; further
axes are independent lanes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array


class Friction(NamedTuple):
    """Parameters of one friction law per joint or winch, each an array (n,).

    Attributes
    ----------
    viscous : array (n,)
        Torque per velocity, N m s.
    coulomb : array (n,)
        Torque at speed, N m.
    static_ratio : array (n,)
        Torque near standstill over ``coulomb``; 1 switches the Stribeck rise off.
    stribeck_velocity : array (n,)
        Velocity over which that rise dies out, rad s⁻¹.
    smoothing_velocity : array (n,)
        Velocity over which the sign of the motion is smoothed, rad s⁻¹.
    """

    viscous: Array
    coulomb: Array
    static_ratio: Array
    stribeck_velocity: Array
    smoothing_velocity: Array


def friction_torque(velocity: Array, friction: Friction) -> Array:
    """Friction torque that opposes a velocity, N m.

    ``viscous v + coulomb [1 + (static_ratio - 1) exp(-(v/v_s)²)] tanh(v/v_c)``

    Parameters
    ----------
    velocity : array (n, ...)
        Joint or winch velocity, rad s⁻¹.
    friction : Friction

    Returns
    -------
    array (n, ...)
        Odd in the velocity, never of the opposite sign.
    """
    torque = np.empty_like(velocity)
    for i in range(velocity.shape[0]):
        relative = velocity[i] / friction.stribeck_velocity[i]
        rise = 1.0 + (friction.static_ratio[i] - 1.0) * np.exp(-relative * relative)
        sense = np.tanh(velocity[i] / friction.smoothing_velocity[i])
        torque[i] = friction.viscous[i] * velocity[i] + friction.coulomb[i] * rise * sense
    return torque


def without_dry_friction(friction: Friction) -> Friction:
    """Return the same law with its Coulomb part, and so its Stribeck rise, switched off.

    Parameters
    ----------
    friction : Friction

    Returns
    -------
    Friction
    """
    return friction._replace(coulomb=np.zeros_like(friction.coulomb))
