"""The time loop of one run of the package's own laws: plain Python, compiled in `compiled`.

What `stepper` does with any controller and integrator, without a call of Python in each sample.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.instruments import Actuator, applied_torque
from tendonrepro.simulation.codegen.dop853 import advance
from tendonrepro.simulation.sampled import Hardware, decide, is_bounded, keep, measure

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
    """What is recorded at each sample, (T, 4 n), the law's K signals, (T, K, n), and (T, n)."""

    state: Array
    signals: Array
    q_encoder: Array
    q_motor_encoder: Array
    tau_cmd: Array
    tau_m: Array


def sweep(
    first: int,
    last: int,
    state: Array,
    memory: Any,
    pending: Array,
    law: Any,
    hardware: Hardware,
    course: Course,
    steps: Steps,
    rows: Rows,
) -> tuple[int, int, Array, Any]:
    """Take a run from one sample to another, or to its end.

    Parameters
    ----------
    first, last : int
        Samples.
    state : array (4 n,)
    memory : tuple
        Of the law.
    pending : array (delay, n)
        Commands on their way to the motors.
    law : Law or Servo
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
    memory : tuple
    """
    S, S_inv, actuator = hardware.S, hardware.S_inv, hardware.actuator
    limits = Actuator(actuator.limit, 0.0, actuator.noise, actuator.delay)
    for k in range(first, last):
        q, q_motor = measure(k, state, hardware)
        desired = course.q_d[k], course.dq_d[k], course.ddq_d[k]
        tau, signals, carry = decide(memory, (q, q_motor), desired, law)
        due = tau
        if actuator.delay > 0:
            due = pending[k % actuator.delay].copy()
            pending[k % actuator.delay] = tau
        tau_m = applied_torque(due, actuator, S, S_inv)
        rows.state[k], rows.q_encoder[k], rows.q_motor_encoder[k] = state, q, q_motor
        rows.tau_cmd[k], rows.tau_m[k], rows.signals[k] = tau, tau_m, signals
        if k + 1 == course.time.size or not is_bounded(course.q_d[k] - q, tau_m, course.limit):
            return k + 1, ENDED, state, memory
        commanded = applied_torque(tau, limits, S, S_inv)
        memory = keep((q, q_motor), (tau_m, commanded), carry, law)
        # The noise acts on the plant alone: no controller can know it.
        torque, start, end = tau_m + hardware.torque_noise[k], course.time[k], course.time[k + 1]
        tolerances = steps.rtol, steps.atol, steps.max_step
        state, reached = advance(steps.code, start, end, state, torque, steps.p, *tolerances)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not reached and np.isfinite(state).all():
            return k, STUCK, state, memory
    return last, GOES_ON, state, memory
