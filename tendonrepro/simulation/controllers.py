"""The sampled controllers: what each decides at a sample, and what it remembers.

A controller runs once per period on encoder values and is told afterwards what the drive made of its torque.
Its memory is a value that it returns, never state of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, Memory, Servo, start_memory
from tendonrepro.physics.dynamics import Plant
from tendonrepro.simulation.sampled import decide_by_position, keep_estimate, keep_position

CommandFunction = Callable[[Memory, Array, Array, Array, Array, Law], tuple[Array, Array, Array, Array]]
"""Signature of :func:`tendonrepro.physics.control.command`."""


class Measurement(NamedTuple):
    """Angles (n,) read by joint encoders, rad, and motor encoders, rad at the winch; zero at the start."""

    q: Array
    q_motor: Array


class DriveTorque(NamedTuple):
    """What became of a command, in joint coordinates, N m, each (n,).

    ``applied`` acts from this sample on, after delay, rounding and saturation; ``commanded`` is this sample's
    command within the motors' limits.
    """

    applied: Array
    commanded: Array


class ControlDecision(NamedTuple):
    """What a controller makes of one sample: torque in joint coordinates, N m, (n,), and its signals.

    `carry` is whatever ``remember`` needs besides the measurement and the torque.
    """

    tau: Array
    signals: tuple[Array, ...]
    carry: Any


class Controller(Protocol):
    """A sampled controller whose memory is a value."""

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the variables it adds to a trace."""

    @property
    def motor_side(self) -> bool:
        """Whether ``measured.q`` has to be ``S q_motor`` of the motors' encoders."""

    @property
    def machine_law(self) -> Law | Servo | None:
        """Numbers by which machine code takes it through a run, see `codegen.run_loop`; None for a user's."""

    def init(self, measured: Measurement, tau_before: Array) -> Any:
        """Memory at the first sample, given the torque that acted until then."""

    def decide(
        self, memory: Any, measured: Measurement, q_d: Array, dq_d: Array, ddq_d: Array
    ) -> ControlDecision:
        """Torque for this sample."""

    def remember(
        self, memory: Any, measured: Measurement, decision: ControlDecision, tau: DriveTorque
    ) -> Any:
        """Memory for the next sample, given what became of the command."""

    def derived(self, variables: Mapping[str, Array], plant: Plant) -> dict[str, Array]:
        """Further variables of a trace, each (T, n), that follow from the run's own."""


@dataclass(frozen=True)
class TimeDelayController:
    """Controllers 1 to 3, plain TDC, and any law with the signature of `tendonrepro.physics.control.command`.

    Attributes
    ----------
    law : Law
    command : CommandFunction, optional
        A user's; the package's own, as machine code, if there is none.
    """

    law: Law
    command: CommandFunction | None = None

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the variables it adds to a trace."""
        return ("H_hat", "s")

    @property
    def motor_side(self) -> bool:
        """Whether its angles come from the motors' encoders."""
        return self.law.motor_side

    @property
    def machine_law(self) -> Law | None:
        """The law, unless its command is a user's."""
        return self.law if self.command is None else None

    def init(self, measured: Measurement, tau_before: Array) -> Memory:
        """Memory by the start-up rule."""
        return start_memory(measured.q, tau_before, self.law.lag)

    def decide(
        self, memory: Memory, measured: Measurement, q_d: Array, dq_d: Array, ddq_d: Array
    ) -> ControlDecision:
        """Torque by Eq. (17)."""
        # Where nothing is run, whoever builds a loop needs no compiler.
        from tendonrepro.simulation.codegen import compiled

        command = self.command or compiled.command
        tau, H_hat, s, de = command(memory, measured.q, q_d, dq_d, ddq_d, self.law)
        # A user's law may have neither estimate nor rate; its memory then holds zeros.
        kept = (de, H_hat) if self.command is None else (np.nan_to_num(de), np.nan_to_num(H_hat))
        return ControlDecision(tau, (H_hat, s), (memory, q_d, *kept))

    def remember(
        self, memory: Memory, measured: Measurement, decision: ControlDecision, tau: DriveTorque
    ) -> Memory:
        """Shift the delay lines."""
        del memory
        return keep_estimate(measured, tau, decision.carry, self.law)

    def derived(self, variables: Mapping[str, Array], plant: Plant) -> dict[str, Array]:
        """Lumped dynamics by Eq. (6) and estimation error by Eq. (19), in joint coordinates."""
        del plant
        M_bar = self.law.to_joint @ np.diag(self.law.M_bar)
        H = variables["tau_m"] - variables["ddq"] @ M_bar.T
        epsilon = np.linalg.solve(M_bar, (H - variables["H_hat"]).T).T
        return {"H": H, "epsilon": np.asarray(epsilon, dtype=np.float64)}


@dataclass(frozen=True)
class PositionController:
    """Stiff motor-side position loop; knows the motors only through ``S_inv`` of the desired joint angles.

    Attributes
    ----------
    servo : Servo
    """

    servo: Servo

    @property
    def signals(self) -> tuple[str, ...]:
        """It adds no variable to a trace."""
        return ()

    @property
    def motor_side(self) -> bool:
        """It reads the motors' angles themselves."""
        return False

    @property
    def machine_law(self) -> Servo:
        """The loops."""
        return self.servo

    def init(self, measured: Measurement, tau_before: Array) -> tuple[Array, Array]:
        """Return the motor angles one sample ago and the torque until now, which stays as an offset."""
        return measured.q_motor, tau_before

    def decide(
        self, memory: tuple[Array, Array], measured: Measurement, q_d: Array, dq_d: Array, ddq_d: Array
    ) -> ControlDecision:
        """Torque of the position loops."""
        tau, _, offset = decide_by_position(memory, measured, (q_d, dq_d, ddq_d), self.servo)
        return ControlDecision(tau, (), offset)

    def remember(
        self, memory: tuple[Array, Array], measured: Measurement, decision: ControlDecision, tau: DriveTorque
    ) -> tuple[Array, Array]:
        """Keep this sample's motor angles."""
        del memory
        return keep_position(measured, tau, decision.carry, self.servo)

    def derived(self, variables: Mapping[str, Array], plant: Plant) -> dict[str, Array]:
        """Motor angles since the start, and the joint angles that ``S`` calculates from their encoders."""
        start = variables["theta"][0]
        return {
            "q_motor": (variables["theta"] - start) @ plant.drive.S_inv.T,
            "q_calculated": variables["q_motor_encoder"] @ plant.drive.S.T,
        }
