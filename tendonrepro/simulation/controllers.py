"""The sampled controllers: their law, and what they add to a trace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, Servo
from tendonrepro.physics.dynamics import Plant
from tendonrepro.simulation.sampled import CommandFunction


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


Controller: TypeAlias = TimeDelayController | PositionController
