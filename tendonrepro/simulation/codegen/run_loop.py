"""The time loop of one run of the paper's own law: plain Python, compiled in `compiled`.

What `stepper` does with any controller and integrator, without a call of Python in each sample.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, Memory, command, remember
from tendonrepro.physics.instruments import Actuator, applied_torque
from tendonrepro.simulation.codegen.dop853 import advance
from tendonrepro.simulation.sampled import Hardware, is_bounded, measure

GOES_ON, ENDED, STUCK = range(3)
"""How :func:`sweep` left a run: at the end of its slice, at its own end, or where the integrator gave up."""


class Steps(NamedTuple):
    """A plant's machine code and numbers, and the tolerances of its integration, see `codegen.dop853`."""

    code: int
    p: Array
    rtol: float
    atol: float
    max_step: float


class Course(NamedTuple):
    """Desired motion, (T,) and (T, n), and the error beyond which a run ends, rad."""

    time: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    limit: float


class Rows(NamedTuple):
    """What is recorded at each sample, (T, 4 n) and (T, n)."""

    state: Array
    q_encoder: Array
    q_motor_encoder: Array
    tau_cmd: Array
    tau_m: Array
    H_hat: Array
    s: Array


def sweep(
    first: int,
    last: int,
    state: Array,
    memory: Memory,
    pending: Array,
    law: Law,
    hardware: Hardware,
    course: Course,
    steps: Steps,
    rows: Rows,
) -> tuple[int, int, Array, Memory]:
    """Take a run from one sample to another, or to its end.

    Parameters
    ----------
    first, last : int
        Samples.
    state : array (4 n,)
    memory : Memory
    pending : array (delay, n)
        Commands on their way to the motors.
    law : Law
    hardware : Hardware
    course : Course
    steps : Steps
    rows : Rows
        Filled.

    Returns
    -------
    k : int
        Sample that comes next.
    how : int
        `GOES_ON`, `ENDED` or `STUCK`.
    state : array (4 n,)
    memory : Memory
    """
    S, S_inv, actuator = hardware.S, hardware.S_inv, hardware.actuator
    limits = Actuator(actuator.limit, 0.0, actuator.noise, actuator.delay)
    for k in range(first, last):
        q, q_motor = measure(k, state, hardware, law.motor_side)
        tau, H_hat, s, de = command(memory, q, course.q_d[k], course.dq_d[k], course.ddq_d[k], law)
        due = tau
        if actuator.delay > 0:
            due = pending[k % actuator.delay].copy()
            pending[k % actuator.delay] = tau
        tau_m = applied_torque(due, actuator, S, S_inv)
        rows.state[k], rows.q_encoder[k], rows.q_motor_encoder[k] = state, q, q_motor
        rows.tau_cmd[k], rows.tau_m[k], rows.H_hat[k], rows.s[k] = tau, tau_m, H_hat, s
        if k + 1 == course.time.size or not is_bounded(course.q_d[k] - q, tau_m, course.limit):
            return k + 1, ENDED, state, memory
        known = tau_m if law.stores_applied else applied_torque(tau, limits, S, S_inv)
        memory = remember(memory, q, course.q_d[k], de, H_hat, known, law)
        # The noise acts on the plant alone: no controller can know it.
        torque, start, end = tau_m + hardware.torque_noise[k], course.time[k], course.time[k + 1]
        tolerances = steps.rtol, steps.atol, steps.max_step
        state, reached = advance(steps.code, start, end, state, torque, steps.p, *tolerances)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not reached and np.isfinite(state).all():
            return k, STUCK, state, memory
    return last, GOES_ON, state, memory
