"""Motor-side position loop of the decoupling experiment.

The paper says nothing of how its motors were positioned there. A stiff loop on each motor's own encoder is
what servo drives do; it is an assumption, and claim K3 does not depend on its gains, because calculated joint
angles start from the motor angles that were really reached.
"""

from __future__ import annotations

from typing import NamedTuple

from tendonrepro.arrays import Array


class Servo(NamedTuple):
    """Gains of one position loop per winch.

    Attributes
    ----------
    stiffness : array (n,)
        Torque per winch angle, N m rad⁻¹.
    damping : array (n,)
        Torque per winch velocity, N m s rad⁻¹.
    L : float
        Sampling period, s.
    """

    stiffness: Array
    damping: Array
    L: float


def servo_torque(
    q_motor: Array, q_motor_before: Array, q_motor_d: Array, dq_motor_d: Array, servo: Servo
) -> Array:
    """Winch torque beyond the one that held the arm at the start, N m.

    Parameters
    ----------
    q_motor, q_motor_before : array (n,)
        Motor encoder values now and one sample ago, rad at the winch.
    q_motor_d, dq_motor_d : array (n,)
        Commanded winch angle, rad, and velocity, rad s⁻¹.
    servo : Servo

    Returns
    -------
    array (n,)
    """
    rate = (q_motor - q_motor_before) / servo.L
    return servo.stiffness * (q_motor_d - q_motor) + servo.damping * (dq_motor_d - rate)
