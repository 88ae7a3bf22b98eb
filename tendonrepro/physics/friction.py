"""Friction of joints and winches: a smooth Coulomb law with an optional Stribeck rise.

The paper only names ``F(q, dq)`` in Eq. (4).
"""

from __future__ import annotations

from typing import NamedTuple

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
