"""One run: plant, instruments, controller and reference; and the trace it leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, Servo
from tendonrepro.physics.drive import tendon_torque, to_joint_torque
from tendonrepro.physics.dynamics import Plant, link_acceleration
from tendonrepro.physics.instruments import Actuator, Encoder
from tendonrepro.physics.trajectory import late
from tendonrepro.simulation.sampled import CommandFunction


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
    cold: bool
    seed: int
    start_offset: Array | None = None
    reference_lag: float = 0.0

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


RECORDED = ("q_encoder", "q_motor_encoder", "tau_cmd", "tau_m")
"""What is recorded at a sample, between the state (4 n,) and the law's signals."""


def recorded_columns(loop: Loop) -> int:
    """Numbers that are recorded at a sample."""
    return (4 + len(RECORDED) + len(loop.controller.signals)) * loop.plant.preload.size


def trace_variables(record: Array, loop: Loop) -> dict[str, Array]:
    """Time (T,) and variables (T, n) of a trace, from a record (T, columns)."""
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
    trace = time | variables | desired | error | recorded | derived
    return {name: np.ascontiguousarray(values) for name, values in trace.items()}
