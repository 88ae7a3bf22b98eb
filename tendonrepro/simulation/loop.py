"""One run: its parts, where it begins, one sample of it, and the trace it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose, pick, times
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Memory, Servo, ServoMemory, servo_torque, start_memory
from tendonrepro.physics.drive import (
    Actuator,
    Encoder,
    applied_torque,
    quantise,
    tendon_torque,
    to_joint_torque,
)
from tendonrepro.physics.dynamics import Plant, holding_torque, link_acceleration, rest_state
from tendonrepro.physics.trajectory import late

LINES_PER_RINGING = 32
"""Blocks of summed errors are this many times shorter than a period of the ringing frequency."""

LARGEST_TORQUE = 1e6
"""Torque, N m, beyond which a run has diverged even before its error shows it."""

Two: TypeAlias = tuple[Array, Array]
Three: TypeAlias = tuple[Array, Array, Array]
Remembered: TypeAlias = Memory | ServoMemory
"""What a law remembers, or a position loop."""

CommandFunction = Callable[[Memory, Array, Array, Array, Array, Law], tuple[Array, Array, Array, Array]]
"""Signature of :func:`tendonrepro.physics.control.command`."""


@dataclass(frozen=True)
class Solver:
    """How :class:`scipy.integrate.ode` integrates the plant between samples, SI."""

    method: Literal["dopri5", "dop853", "lsoda"]
    rtol: float
    atol: float
    max_step: float


@dataclass(frozen=True)
class DesiredMotion:
    """Desired motion at every sample, (T,) and (T, n), SI; it repeats after `period`, s, unless 0."""

    time: Array
    q_d: Array
    dq_d: Array
    ddq_d: Array
    period: float = 0.0


@dataclass(frozen=True)
class TimeDelayController:
    """Controllers 1 to 3, plain TDC, and any `command` with the signature of the physics' own.

    A user's runs in Python, unless it is `on_lanes`: arithmetic that chooses by `choose`.
    """

    signals: ClassVar[tuple[str, ...]] = ("H_hat", "s")
    law: Law
    command: CommandFunction | None = None
    on_lanes: bool = False

    def derived(self, variables: Mapping[str, Array], plant: Plant) -> dict[str, Array]:
        """Lumped dynamics, Eq. (6), and estimation error, Eq. (19)."""
        del plant
        M_bar = self.law.to_joint @ np.diag(self.law.M_bar)
        H = variables["tau_m"] - variables["ddq"] @ M_bar.T
        epsilon = np.linalg.solve(M_bar, (H - variables["H_hat"]).T).T
        return {"H": H, "epsilon": np.asarray(epsilon, dtype=np.float64)}


@dataclass(frozen=True)
class PositionController:
    """Stiff motor-side position loop."""

    signals: ClassVar[tuple[str, ...]] = ()
    command: ClassVar[None] = None
    law: Servo

    def derived(self, variables: Mapping[str, Array], plant: Plant) -> dict[str, Array]:
        """Motor angles since the start, and joint angles from their encoders."""
        start = variables["theta"][0]
        return {
            "q_motor": (variables["theta"] - start) @ plant.drive.S_inv.T,
            "q_calculated": variables["q_motor_encoder"] @ plant.drive.S.T,
        }


@dataclass(frozen=True)
class Loop:
    """One run: plant, instruments, controller and reference.

    Attributes
    ----------
    L
        Sampling period, s.
    divergence_limit
        Tracking error that ends the run, rad.
    ringing_frequency, ringing_share
        A run rings from this share of the error's power above this frequency, Hz, on.
    cold
        A brake held the arm until the start, and the controller has seen no torque; else its own did.
    seed
        Of the instruments' noise, the same in all runs.
    start_offset : array (n,), optional
        Where the arm rests before the start less the reference, rad; on the reference where absent.
    reference_lag
        Time constant by which the law gets the reference's rates late, s.
    """

    plant: Plant
    joint_encoder: Encoder
    motor_encoder: Encoder
    actuator: Actuator
    controller: TimeDelayController | PositionController
    reference: DesiredMotion
    L: float
    solver: Solver
    divergence_limit: float
    ringing_frequency: float
    ringing_share: float
    cold: bool
    seed: int
    start_offset: Array | None = None
    reference_lag: float = 0.0

    @property
    def block(self) -> int:
        """Samples whose errors are summed up for the spectrum."""
        return max(1, int(1.0 / (self.L * LINES_PER_RINGING * self.ringing_frequency)))

    @property
    def start_angles(self) -> Array:
        """Joint angles before the start, rad, (n,)."""
        return np.zeros(self.plant.preload.size) if self.start_offset is None else self.start_offset

    @property
    def fed(self) -> DesiredMotion:
        """Desired motion as the law gets it."""
        motion = self.reference
        if self.reference_lag == 0.0:
            return motion
        dq_d, ddq_d = (late(rates, self.L, self.reference_lag) for rates in (motion.dq_d, motion.ddq_d))
        return replace(motion, dq_d=dq_d, ddq_d=ddq_d)

    def hardware(self, rest: Rest) -> Hardware:
        """Encoders, drives and coupling."""
        drive, encoders = self.plant.drive, (self.joint_encoder, self.motor_encoder)
        limit = np.float64(self.divergence_limit)
        return Hardware(*encoders, rest.zero, self.actuator, drive.S, drive.S_inv, limit)

    def torque_before(self, rest: Rest) -> Array:
        """Torque (n,) that the law has seen before its start."""
        return np.zeros_like(rest.tau) if self.cold else rest.tau

    @property
    def noise_source(self) -> tuple[int, bool, bool, bool]:
        """What noise depends on: the seed, and which instruments have any."""
        instruments = self.joint_encoder, self.motor_encoder, self.actuator
        joint, motor, torque = (part.noise > 0.0 for part in instruments)
        return self.seed, joint, motor, torque

    @property
    def is_noisy(self) -> bool:
        """Whether any instrument has noise."""
        return any(self.noise_source[1:])

    def unit_noise(self) -> Callable[[int], Array]:
        """Unscaled noise, (samples, 3 n), of the next samples at each call; zeros where there is none."""
        n, (seed, *noisy) = self.plant.preload.size, self.noise_source
        streams = [np.random.default_rng([seed, k]) if acts else None for k, acts in enumerate(noisy)]
        return lambda samples: np.hstack(
            [
                np.zeros((samples, n)) if stream is None else stream.standard_normal((samples, n))
                for stream in streams
            ]
        )

    @property
    def recorded_columns(self) -> int:
        """Numbers that are recorded at a sample."""
        return (4 + len(RECORDED) + len(self.controller.signals)) * self.plant.preload.size

    def trace(self, record: Array) -> dict[str, Array]:
        """Time (T,) and variables (T, n) of a trace, from a record (T, columns)."""
        plant, reference, done = self.plant, self.reference, len(record)
        names = RECORDED + tuple(self.controller.signals)
        state, rest = np.split(record.T, [4 * plant.preload.size])
        seen = dict(zip(names, map(np.transpose, np.split(rest, len(names))), strict=True))
        q, dq, theta, dtheta = np.split(state, 4)
        tau_s = to_joint_torque(tendon_torque(q, dq, theta, dtheta, plant.drive), plant.drive)
        ddq = link_acceleration(reference.time[:done], q, dq, tau_s, plant)
        variables = {
            "q": q.T, "dq": dq.T, "ddq": ddq.T, "theta": theta.T, "dtheta": dtheta.T, "tau_s": tau_s.T,
        }  # fmt: skip
        desired = {name: getattr(reference, name)[:done] for name in ("q_d", "dq_d", "ddq_d")}
        error = {"e": desired["q_d"] - seen["q_encoder"]}
        derived = self.controller.derived(variables | seen, plant)
        time = {"time": reference.time[:done]}
        trace = time | variables | desired | error | seen | derived
        return {name: np.ascontiguousarray(values) for name, values in trace.items()}


class Rest(NamedTuple):
    """State (4 n,) in which an arm waits, motor torque (n,) that holds it, and motor angles read as zero."""

    state: Array
    tau: Array
    zero: Array


def rest_at(q: Array, plant: Plant) -> Rest:
    """Rest at joint angles (n,); encoders are zeroed where the reference begins, at the start posture."""
    n = len(q)
    posture = rest_state(np.zeros_like(q), plant)
    return Rest(rest_state(q, plant), holding_torque(q, plant), posture[2 * n : 3 * n])


class Hardware(NamedTuple):
    """What is between law and plant.

    Motor angles are zero at `theta_start` (n,), in joint coordinates. `S` and `S_inv` are of Eq. (2). Beyond
    an error of `limit`, rad, a run has diverged.
    """

    joint_encoder: Encoder
    motor_encoder: Encoder
    theta_start: Array
    actuator: Actuator
    S: Array
    S_inv: Array
    limit: float


class SampledState(NamedTuple):
    """What one sample makes of a state; arrays (n,), SI.

    `measured` is as of :func:`measure`. Torques are `tau` commanded, `tau_m` applied, and `torque` with the
    noise that no controller knows. `rate` is of the error; None of a position loop. `pending` are commands on
    their way to the motors, the newest first.
    """

    measured: Two
    tau: Array
    tau_m: Array
    torque: Array
    signals: Sequence[Array]
    rate: Array | None
    memory: Remembered
    pending: list[Array]
    bounded: Numeric


def sample(
    state: Array,
    memory: Remembered,
    pending: Sequence[Array],
    desired: Three,
    noise: Array,
    law: Law | Servo,
    hardware: Hardware,
    command: CommandFunction = control.command,
) -> SampledState:
    """One sample, from a state (4 n,) and unit noise (3 n,) of joint encoders, motor encoders and torque."""
    n, actuator, S, S_inv = len(state) // 4, hardware.actuator, hardware.S, hardware.S_inv
    measured = measure(state, noise, law, hardware)
    q_d, dq_d, ddq_d = desired
    signals: list[Array] = []
    rate: Array | None = None
    if isinstance(law, Servo):
        assert isinstance(memory, ServoMemory)
        tau = memory.tau + servo_torque(measured[1], memory.q_motor, q_d, dq_d, law)
    else:
        assert isinstance(memory, Memory)
        tau, *signals, rate = command(memory, measured[0], q_d, dq_d, law.feed_forward * ddq_d, law)
    line = [tau, *pending]
    tau_m = applied_torque(pick(line, actuator.delay), actuator, S, S_inv)
    if isinstance(memory, ServoMemory):
        memory = memory._replace(q_motor=measured[1])
    else:
        assert isinstance(law, Law)
        assert rate is not None
        within = applied_torque(tau, actuator._replace(resolution=0.0), S, S_inv)
        stored = choose(law.stores_applied, tau_m, within)
        # A user's law may have neither rate nor estimate; its memory then holds zeros.
        own = command is not control.command
        kept = (np.nan_to_num(rate), np.nan_to_num(signals[0])) if own else (rate, signals[0])
        remember = getattr(command, "remember", control.remember)
        memory = remember(memory, measured[0], q_d, *kept, stored, law)
    bounded: Numeric = 1.0
    for i in range(n):
        error = q_d[i] - measured[0][i]
        bounded = bounded * (abs(error) <= hardware.limit) * (abs(tau_m[i]) <= LARGEST_TORQUE)
    # The noise acts on the plant alone: no controller can know it.
    torque = tau_m + times(S_inv.T, actuator.noise * noise[2 * n :])
    return SampledState(measured, tau, tau_m, torque, signals, rate, memory, line[:-1], bounded)


def measure(state: Array, noise: Array, law: Law | Servo, hardware: Hardware) -> Two:
    """Angles by encoders of joints, or of motors through S where the law looks at these, and of motors."""
    n = len(state) // 4
    turned = times(hardware.S_inv, state[2 * n : 3 * n] - hardware.theta_start)
    q_motor = _counted(turned, noise[n : 2 * n], hardware.motor_encoder)
    q = _counted(state[:n], noise[:n], hardware.joint_encoder)
    if isinstance(law, Law):
        q = choose(law.motor_side, times(hardware.S, q_motor), q)
    return q, q_motor


def _counted(angle: Array, noise: Array, encoder: Encoder) -> Array:
    counted = np.empty_like(angle)
    for i in range(len(angle)):
        counted[i] = quantise(angle[i] + encoder.noise * noise[i], encoder.resolution)
    return counted


def start(measured: Two, q_d: Array, tau: Array, law: Law | Servo) -> Remembered:
    """Memory at the first sample, given the desired angles and the torque before."""
    if isinstance(law, Servo):
        return ServoMemory(measured[1], tau)
    return start_memory(measured[0], tau, longest(law.lag), q_d)


def longest(count: Numeric) -> int:
    """Largest of whole numbers in which experiments side by side differ, or the one they share."""
    return int(np.max(count))


RECORDED = ("q_encoder", "q_motor_encoder", "tau_cmd", "tau_m")
"""What is recorded at a sample, between the state (4 n,) and the law's signals."""


def recorded(state: Array, sampled: SampledState) -> Array:
    """What is recorded at a sample, (columns,)."""
    parts = *sampled.measured, sampled.tau, sampled.tau_m, *sampled.signals
    return np.concatenate([state, *parts])
