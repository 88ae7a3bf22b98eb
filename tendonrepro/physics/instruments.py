"""Between law and plant: incremental encoders, and what drives and motors make of a command."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose, times


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
