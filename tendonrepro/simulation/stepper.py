"""The closed loop in time: a sampled controller around a plant integrated between samples.

At every sample the encoders are read, the controller decides, and the torque is held until the next sample.
The integrator starts afresh each period, so it never steps across a jump of the torque, and each run is
integrated alone, so adding or removing a run cannot change another.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.drive import tendon_torque, to_joint_torque
from tendonrepro.physics.dynamics import Plant, link_acceleration
from tendonrepro.physics.instruments import Actuator, Encoder
from tendonrepro.simulation.controllers import Controller

if TYPE_CHECKING:
    from tendonrepro.simulation.single import Arm

MOST_STEPS = 5000
"""Steps in one period after which a plant counts as one that cannot be resolved."""

FIRST_STEP = 0.5
"""First step as a share of the longest: most periods begin with a torque step, after which a full one would
be tried in vain."""

PROGRESS_INTERVAL = 500
"""Samples between two reports of progress."""


@dataclass(frozen=True)
class Solver:
    """How the plant is integrated between two samples.

    Attributes
    ----------
    method : str
        ``dopri5``, ``dop853`` or ``lsoda`` of :class:`scipy.integrate.ode`.
    rtol, atol : float
        Tolerances on the state, in rad and rad s⁻¹.
    max_step : float
        Longest step, s.
    """

    method: Literal["dopri5", "dop853", "lsoda"]
    rtol: float
    atol: float
    max_step: float


@dataclass(frozen=True)
class DesiredMotion:
    """Desired motion at every sample.

    Attributes
    ----------
    time : array (T,)
        s.
    q_d, dq_d, ddq_d : array (T, n)
        rad, rad s⁻¹, rad s⁻².
    period : float
        Duration after which it repeats, s; 0 if it does not.
    """

    time: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    period: float = 0.0


@dataclass(frozen=True)
class Loop:
    """One run: plant, instruments, controller and reference.

    Attributes
    ----------
    plant : Plant
    joint_encoder, motor_encoder : Encoder
    actuator : Actuator
    controller : Controller
    reference : DesiredMotion
    L : float
        Sampling period, s.
    solver : Solver
    divergence_limit : float
        Tracking error beyond which the run ends, rad.
    cold : bool
        The arm is held by a brake until the start, and the controller has seen no torque; else it has been
        at rest under the controller's own holding torque.
    seed : int
        Seed of the instruments' noise. It does not depend on the run, so all runs meet the same noise.
    """

    plant: Plant
    joint_encoder: Encoder
    motor_encoder: Encoder
    actuator: Actuator
    controller: Controller
    reference: DesiredMotion
    L: float
    solver: Solver
    divergence_limit: float
    cold: bool
    seed: int


RECORDED = ("q_encoder", "q_motor_encoder", "tau_cmd", "tau_m")
"""What is recorded at a sample, (n,) each, after the state (4 n,) and before the law's signals."""


def simulate(loop: Loop, progress: Callable[[int], None] | None = None) -> dict[str, Array]:
    """Run a closed loop from rest to the end of its reference, or until it diverges.

    Parameters
    ----------
    loop : Loop
    progress : callable, optional
        Called now and then with the number of samples done since its last call.

    Returns
    -------
    dict of array
        ``time`` (T,) and the variables of a trace, each (T, n), in SI units. A run that diverged ends
        with the first sample beyond the limit.

    Raises
    ------
    TendonreproError
        If the integrator cannot follow the plant within its tolerances.
    """
    # Where nothing is run, whoever builds a loop needs no compiler.
    from tendonrepro.simulation.single import Arm, MachineLaw, PlainLaw

    trace, time, arm = (
        np.empty((loop.reference.time.size, recorded_columns(loop))),
        loop.reference.time,
        Arm(loop),
    )
    sample = (MachineLaw if loop.controller.command is None else PlainLaw)(loop, arm, trace)
    advance, report = _integrator(loop.solver, arm), progress or (lambda _: None)
    # SciPy warns on standard error where advance() raises, and NumPy where a run diverges.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        k = 0
        while sample(k):
            advance(time[k], time[k + 1])
            k += 1
            if k % PROGRESS_INTERVAL == 0:
                report(PROGRESS_INTERVAL)
        report((k + 1) % PROGRESS_INTERVAL)
        return trace_variables(trace[: k + 1], loop)


def _integrator(solver: Solver, arm: Arm) -> Callable[[float, float], None]:
    """What takes the arm through one period, afresh in every one, for the torque jumps there."""
    from scipy.integrate import ode

    problem = ode(arm.slope).set_integrator(
        solver.method,
        rtol=solver.rtol,
        atol=solver.atol,
        max_step=solver.max_step,
        first_step=FIRST_STEP * solver.max_step,
        nsteps=MOST_STEPS,
    )

    def advance(start: float, end: float) -> None:
        arm.state[:] = reached = problem.set_initial_value(arm.state, start).integrate(end)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not problem.successful() and np.isfinite(reached).all():
            other = "solver.method=lsoda with rtol 1e-7 and atol 1e-9" if solver.method != "lsoda" else ""
            hint = f"the plant is too stiff for this method: try {other or 'softer tendons'}"
            message = f"{solver.method} cannot follow the plant beyond t = {start:.3f} s"
            raise TendonreproError(message, hint=hint)

    return advance


def recorded_columns(loop: Loop) -> int:
    """Numbers that are recorded at a sample."""
    return (4 + len(RECORDED) + len(loop.controller.signals)) * loop.plant.preload.size


def trace_variables(record: Array, loop: Loop) -> dict[str, Array]:
    """Time (T,) and all variables of a trace, each (T, n), from what was recorded, (T, columns)."""
    plant, reference, done = loop.plant, loop.reference, len(record)
    names = RECORDED + tuple(loop.controller.signals)
    state, rest = np.split(record.T, [4 * plant.preload.size])
    recorded = dict(zip(names, map(np.transpose, np.split(rest, len(names))), strict=True))
    q, dq, theta, dtheta = np.split(state, 4)
    tau_s = to_joint_torque(tendon_torque(q, dq, theta, dtheta, plant.drive), plant.drive)
    ddq = link_acceleration(reference.time[:done], q, dq, tau_s, plant)
    variables = {"q": q.T, "dq": dq.T, "ddq": ddq.T, "theta": theta.T, "dtheta": dtheta.T, "tau_s": tau_s.T}
    desired = {"q_d": reference.q_d[:done], "dq_d": reference.dq_d[:done], "ddq_d": reference.ddq_d[:done]}
    error = {"e": desired["q_d"] - recorded["q_encoder"]}
    derived = loop.controller.derived(variables | recorded, plant)
    time = {"time": reference.time[:done]}
    found = time | variables | desired | error | recorded | derived
    return {name: np.ascontiguousarray(values) for name, values in found.items()}
