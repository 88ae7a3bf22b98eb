"""Between the law and the plant: incremental encoders, and what drives and motors make of a command."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.linalg import times


class Encoder(NamedTuple):
    """One encoder type on n axes.

    Attributes
    ----------
    resolution : float
        Angle of one count, rad; 0 is an ideal encoder.
    noise : float
        Root mean square of the angle noise before counting, rad.
    """

    resolution: float
    noise: float


def quantise(value: Any, step: Any) -> Any:
    """Round to whole steps, halves upwards.

    Parameters
    ----------
    value : float or array (...)
    step : float
        Same unit; exactly 0 leaves the value as it is. On lanes each experiment has its own.

    Returns
    -------
    float or array (...)
    """
    if isinstance(step, float) and step == 0.0:
        return value
    counted = step * np.floor(value / step + 0.5)
    return counted if isinstance(step, float) else choose(step > 0.0, counted, value)


def noise_sequence(rms: float, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """White Gaussian noise for a whole run.

    Parameters
    ----------
    rms : float
        Root mean square.
    shape : (int, int)
        Samples and axes.
    rng : numpy.random.Generator

    Returns
    -------
    array of that shape
    """
    return rms * rng.standard_normal(shape)


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
    winch = times(S.T, command)
    change = np.empty_like(command)
    for i in range(command.shape[0]):
        output = quantise(winch[i], actuator.resolution)
        change[i] = np.minimum(np.maximum(output, -actuator.limit[i]), actuator.limit[i]) - winch[i]
    return command + times(S_inv.T, change)
