"""From a commanded joint torque to the torque the winches apply."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.encoder import quantise


class Actuator(NamedTuple):
    """Limits of motors and drives, all at the winch.

    Attributes
    ----------
    limit : array (n,)
        Largest torque, N m.
    resolution : float
        Torque step of the drive's input, N m; 0 is none.
    noise : float
        Root mean square of the torque noise, N m; it adds to what the drive puts out.
    delay : int
        Whole samples between command and output.
    """

    limit: Array
    resolution: float
    noise: float
    delay: int


def applied_torque(command: Array, actuator: Actuator, S: Array, S_inv: Array) -> Array:
    """Torque after the drive's resolution and the motors' saturation, in joint coordinates, N m.

    Only what the actuator changes is mapped back, so an actuator that changes nothing returns the command
    to the last bit.

    Parameters
    ----------
    command : array (n,)
        Joint torque, N m.
    actuator : Actuator
    S, S_inv : array (n, n)
        Coupling of Eq. (2).

    Returns
    -------
    array (n,)
    """
    winch = S.T @ command
    change = np.empty_like(command)
    for i in range(command.shape[0]):
        output = quantise(winch[i], actuator.resolution)
        change[i] = np.minimum(np.maximum(output, -actuator.limit[i]), actuator.limit[i]) - winch[i]
    return command + S_inv.T @ change
