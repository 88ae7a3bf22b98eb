"""The closed loop in time: a sampled controller around a plant integrated between samples.

At every sample the encoders are read, the controller decides, and the torque is held until the next sample.
The integrator starts afresh each period, so it never steps across a jump of the torque, and each run is
integrated alone, so adding or removing a run cannot change another.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.drive import tendon_torque, to_joint_torque
from tendonrepro.physics.dynamics import Plant, holding_torque, link_acceleration, rest_state
from tendonrepro.physics.instruments import Actuator, Encoder, applied_torque, noise_sequence, quantise
from tendonrepro.simulation import sampled
from tendonrepro.simulation.controllers import Controller, DriveTorque, Measurement

JOINT_NOISE, MOTOR_NOISE, TORQUE_NOISE = range(3)
"""Random streams of the instruments."""

PROGRESS_INTERVAL = 500
"""Samples between two reports of progress."""


@dataclass(frozen=True)
class Solver:
    """How the plant is integrated between two samples.

    Attributes
    ----------
    method : str
        ``dopri5``, ``dop853`` or ``lsoda`` of :class:`scipy.integrate.ode`; of the shipped ``dop853`` the
        same steps are taken without calls of Python in them, see `tendonrepro.simulation.codegen.dop853`.
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

    @property
    def encoder(self) -> Encoder:
        """The encoders whose angles the controller is given."""
        return self.motor_encoder if self.controller.motor_side else self.joint_encoder

    @property
    def is_compiled(self) -> bool:
        """Whether all of it is machine code, a matter of moments: the package's own law by `dop853`."""
        return self.controller.machine_law is not None and self.solver.method == "dop853"


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
    record = _allocate(loop)
    # SciPy warns on standard error where advance() raises, and NumPy where a run diverges.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        done = _run(loop, record, progress or (lambda _: None))
    signals = np.moveaxis(record.pop("signals"), 1, 0)
    record |= zip(loop.controller.signals, map(np.ascontiguousarray, signals), strict=True)
    recorded = {name: rows[:done] for name, rows in record.items()}
    return {"time": loop.reference.time[:done]} | trace_variables(recorded, loop)


def _allocate(loop: Loop) -> dict[str, Array]:
    samples, n = loop.reference.q_d.shape
    record = {name: np.empty((samples, n)) for name in ("q_encoder", "q_motor_encoder", "tau_cmd", "tau_m")}
    signals = np.empty((samples, len(loop.controller.signals), n))
    return {"state": np.empty((samples, 4 * n)), "signals": signals} | record


def _run(loop: Loop, record: Mapping[str, Array], progress: Callable[[int], None]) -> int:
    """Fill the record; return the number of samples done."""
    reference, controller, plant = loop.reference, loop.controller, loop.plant
    samples, n = reference.q_d.shape
    hardware, state = _hardware(loop), rest_state(np.zeros(n), plant)

    def measure(k: int, state: Array) -> Measurement:
        return Measurement(*sampled.measure(k, state, hardware))

    tau_before = np.zeros(n) if loop.cold else holding_torque(np.zeros(n), plant)
    memory = controller.init(measure(0, state), tau_before)
    if loop.is_compiled:
        pending = np.tile(tau_before, (loop.actuator.delay, 1))
        begin = state, memory, pending, controller.machine_law, hardware
        return _run_compiled(loop, begin, record, progress)
    advance, waiting = _integrator(loop), [tau_before] * loop.actuator.delay
    limits = loop.actuator._replace(resolution=0.0)
    for k in range(samples):
        measured = measure(k, state)
        decision = controller.decide(
            memory, measured, reference.q_d[k], reference.dq_d[k], reference.ddq_d[k]
        )
        waiting.append(decision.tau)
        tau_m = applied_torque(waiting.pop(0), loop.actuator, hardware.S, hardware.S_inv)
        signals = np.reshape(decision.signals, (-1, n))
        values = (state, signals, measured.q, measured.q_motor, decision.tau, tau_m)
        for rows, value in zip(record.values(), values, strict=True):
            rows[k] = value
        error = reference.q_d[k] - measured.q
        if k + 1 == samples or not sampled.is_bounded(error, tau_m, loop.divergence_limit):
            break
        commanded = applied_torque(decision.tau, limits, hardware.S, hardware.S_inv)
        memory = controller.remember(memory, measured, decision, DriveTorque(tau_m, commanded))
        # The noise acts on the plant alone: no controller can know it.
        state = advance(reference.time[k], reference.time[k + 1], state, tau_m + hardware.torque_noise[k])
        if k % PROGRESS_INTERVAL == PROGRESS_INTERVAL - 1:
            progress(PROGRESS_INTERVAL)
    progress((k + 1) % PROGRESS_INTERVAL)
    return k + 1


def _run_compiled(
    loop: Loop, begin: tuple[Any, ...], record: Mapping[str, Array], progress: Callable[[int], None]
) -> int:
    """The same for the package's own laws, without a call of Python in each sample."""
    from tendonrepro.simulation.codegen import compiled, run_loop

    state, memory, *rest = begin
    reference, solver = loop.reference, loop.solver
    desired = reference.time, reference.q_d, reference.dq_d, reference.ddq_d
    course, rows = run_loop.Course(*desired, loop.divergence_limit), run_loop.Rows(**record)
    steps = run_loop.Steps(*compiled.compiled_plant(loop.plant), solver.rtol, solver.atol, solver.max_step)
    k, how = 0, run_loop.GOES_ON
    while how == run_loop.GOES_ON:
        first, last = k, min(k + PROGRESS_INTERVAL, reference.time.size)
        k, how, state, memory = compiled.run(first, last, state, memory, *rest, course, steps, rows)
        progress(k - first)
    if how == run_loop.STUCK:
        raise _cannot_follow(solver, reference.time[k])
    return k


def random_stream(loop: Loop, stream: int) -> np.random.Generator:
    """Random numbers of one instrument of a loop."""
    return np.random.default_rng([loop.seed, stream])


def _hardware(loop: Loop) -> sampled.Hardware:
    """Encoders, zeroed at the start posture, and drives, with all their noise."""
    shape, drive = loop.reference.q_d.shape, loop.plant.drive
    noise = noise_sequence(loop.actuator.noise, shape, random_stream(loop, TORQUE_NOISE))
    return sampled.Hardware(
        S=drive.S,
        S_inv=drive.S_inv,
        actuator=loop.actuator,
        theta_start=np.split(rest_state(np.zeros(shape[1]), loop.plant), 4)[2],
        q_step=loop.joint_encoder.resolution,
        motor_step=loop.motor_encoder.resolution,
        q_noise=noise_sequence(loop.joint_encoder.noise, shape, random_stream(loop, JOINT_NOISE)),
        motor_noise=noise_sequence(loop.motor_encoder.noise, shape, random_stream(loop, MOTOR_NOISE)),
        torque_noise=np.asarray(noise @ drive.S_inv),
        motor_side=loop.controller.motor_side,
    )


def motor_angles(theta: Array, loop: Loop) -> Array:
    """What the motor encoders read along a run, rad at the winch, (T, n), from theta in joint coordinates."""
    shape = loop.reference.q_d.shape
    noise = noise_sequence(loop.motor_encoder.noise, shape, random_stream(loop, MOTOR_NOISE))
    q_motor = (theta - theta[0]) @ loop.plant.drive.S_inv.T
    return np.asarray(quantise(q_motor + noise[: len(theta)], loop.motor_encoder.resolution))


def _integrator(loop: Loop) -> Callable[[float, float, Array, Array], Array]:
    """The plant's state at the end of a period, integrated afresh in every one: the torque jumps there."""
    solver = loop.solver
    steps = _compiled_steps(loop) if solver.method == "dop853" else _scipy_steps(loop)

    def advance(start: float, end: float, state: Array, tau_m: Array) -> Array:
        reached, successful = steps(start, end, state, tau_m)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not successful and np.isfinite(reached).all():
            raise _cannot_follow(solver, start)
        return reached

    return advance


def _cannot_follow(solver: Solver, start: float) -> TendonreproError:
    other = "solver.method=lsoda with rtol 1e-7 and atol 1e-9" if solver.method != "lsoda" else ""
    hint = f"the plant is too stiff for this method: try {other or 'softer tendons'}"
    return TendonreproError(f"{solver.method} cannot follow the plant beyond t = {start:.3f} s", hint=hint)


def _compiled_steps(loop: Loop) -> Callable[[float, float, Array, Array], tuple[Array, bool]]:
    """SciPy's own steps without a call of Python in each."""
    from tendonrepro.simulation.codegen import compiled

    (code, p), solver = compiled.compiled_plant(loop.plant), loop.solver
    tolerances = solver.rtol, solver.atol, solver.max_step
    return lambda start, end, state, tau_m: compiled.advance(code, start, end, state, tau_m, p, *tolerances)


def _scipy_steps(loop: Loop) -> Callable[[float, float, Array, Array], tuple[Array, bool]]:
    """SciPy's integrators, whatever their method."""
    from scipy.integrate import ode

    from tendonrepro.simulation.codegen import compiled, dop853

    (code, p), solver = compiled.compiled_plant(loop.plant), loop.solver
    result = np.empty(4 * loop.plant.preload.size)

    def derivative(t: float, state: Array, tau_m: Array) -> Array:
        compiled.derivative(code, t, state, tau_m, p, result)
        return result

    problem = ode(derivative).set_integrator(
        solver.method,
        rtol=solver.rtol,
        atol=solver.atol,
        max_step=solver.max_step,
        first_step=dop853.FIRST_STEP * solver.max_step,
        nsteps=dop853.MOST_STEPS,
    )

    def steps(start: float, end: float, state: Array, tau_m: Array) -> tuple[Array, bool]:
        problem.set_initial_value(state, start).set_f_params(tau_m)
        return np.asarray(problem.integrate(end)), problem.successful()

    return steps


def trace_variables(recorded: dict[str, Array], loop: Loop) -> dict[str, Array]:
    """All variables of a trace, each (T, n), from the recorded states (T, 4 n) and signals."""
    plant, reference, done = loop.plant, loop.reference, recorded["tau_m"].shape[0]
    state = recorded.pop("state")
    q, dq, theta, dtheta = (part.T for part in np.split(state, 4, axis=1))
    tau_s = to_joint_torque(tendon_torque(q, dq, theta, dtheta, plant.drive), plant.drive)
    ddq = link_acceleration(reference.time[:done], q, dq, tau_s, plant)
    variables = {"q": q.T, "dq": dq.T, "ddq": ddq.T, "theta": theta.T, "dtheta": dtheta.T, "tau_s": tau_s.T}
    desired = {"q_d": reference.q_d[:done], "dq_d": reference.dq_d[:done], "ddq_d": reference.ddq_d[:done]}
    error = {"e": desired["q_d"] - recorded["q_encoder"]}
    return variables | desired | error | recorded | loop.controller.derived(variables | recorded, plant)
