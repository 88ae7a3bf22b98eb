"""Runs, plant and experiment in memory: plain frozen values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json

SCHEMA_VERSION = 1

Attributes: TypeAlias = Mapping[str, Any]
"""Numbers, texts and lists by name, as HDF5 has them."""

DECOUPLING_RUNS = ("decouple", "pull_tendon_1")
"""Runs of the decoupling experiment; all others belong to the comparison."""

RESERVED = "plant"
"""Group of the plant's values; no run may have this name."""

READ_OFF = "read_off_error_"
"""Attribute of a run read off a figure, before a variable's name: its reading error, rad."""

VARIABLES: dict[str, tuple[str, str]] = {
    "q": ("rad", "joint angle"),
    "dq": ("rad s-1", "joint velocity"),
    "ddq": ("rad s-2", "joint acceleration"),
    "q_encoder": ("rad", "joint angle read by the encoder"),
    "theta": ("rad", "motor angle in joint coordinates, S q_motor"),
    "dtheta": ("rad s-1", "motor velocity in joint coordinates"),
    "q_d": ("rad", "desired joint angle"),
    "dq_d": ("rad s-1", "desired joint velocity"),
    "ddq_d": ("rad s-2", "desired joint acceleration"),
    "e": ("rad", "tracking error, q_d - q_encoder"),
    "s": ("rad s-1", "sliding variable"),
    "H": ("N m", "lumped uncertainty, Eq. (7)"),
    "H_hat": ("N m", "estimate of the lumped uncertainty"),
    "epsilon": ("rad s-2", "estimation error over M_bar, Eq. (19)"),
    "tau_cmd": ("N m", "commanded torque in joint coordinates"),
    "tau_m": ("N m", "applied torque in joint coordinates, held until the next sample"),
    "tau_s": ("N m", "torque through the flexible transmission, Eq. (5)"),
    "q_motor": ("rad", "winch angle"),
    "q_motor_encoder": ("rad", "winch angle read by the motor encoder"),
    "q_calculated": ("rad", "joint angle calculated from the motor encoders, S q_motor_encoder"),
}
"""Unit (UDUNITS) and meaning of every variable a run can hold."""


OF_MOTORS: Mapping[str, str] = {
    "q_encoder": "joint angle calculated from the motor encoders, at which the law looks",
    "e": "tracking error of the motors, q_d - q_encoder",
}
"""Meaning of variables of a run whose law looks at the motors' encoders."""


def median_step(time: Array) -> float:
    """Usual time between samples, s; two are needed."""
    return float(np.median(np.diff(time)))


@dataclass(frozen=True, eq=False)
class Trace:
    """One run.

    Parameters
    ----------
    name : str
        Also of its group in the file.
    time : array (T,)
        Sampling times, s.
    joint : tuple of int
        The paper's numbers of the n joints.
    variables : Mapping
        Arrays (T, n) by names of `VARIABLES`.
    attributes : Mapping
        ``law``, ``payload_mass`` (kg), ``status``, ``status_time`` (s), ``reference_period`` (s, 0 without
        one), ``status_joints`` of a measured run, `READ_OFF` and a variable's name of one
        read off a figure; ``gains`` (name -> list) and ``readings`` (name -> str).
    """

    name: str
    time: Array
    joint: tuple[int, ...]
    variables: Mapping[str, Array]
    attributes: Attributes

    def __getitem__(self, name: str) -> Array:
        """A variable (T, n); a DataMissingError where the run does not hold it."""
        if name not in self.variables:
            message = f"run {self.name!r} holds no variable {name!r}"
            raise DataMissingError(message, hint=f"It holds {', '.join(self.variables)}.")
        return self.variables[name]

    def __contains__(self, name: object) -> bool:
        return name in self.variables

    def of_joints(self, joints: Collection[int]) -> Trace:
        """The run with those of these joints that it has; itself where it has none of them."""
        places = [place for place, joint in enumerate(self.joint) if joint in joints]
        if len(places) in (0, len(self.joint)):
            return self
        variables = {name: values[:, places] for name, values in self.variables.items()}
        return replace(self, joint=tuple(self.joint[place] for place in places), variables=variables)

    @property
    def of_motors(self) -> bool:
        """Whether the law looks at the motors' encoders, so that `e` is the motors' error."""
        return bool(self.attributes.get("readings", {}).get("feedback") == "motor")

    @property
    def meanings(self) -> dict[str, tuple[str, str]]:
        """Unit and meaning of each variable that the run holds, as `VARIABLES`."""
        of_motors = OF_MOTORS if self.of_motors else {}
        return {
            name: (units, of_motors.get(name, meaning))
            for name, (units, meaning) in VARIABLES.items()
            if name in self
        }

    @property
    def status(self) -> str:
        """``ok``, ``ringing`` or ``diverged``."""
        return str(self.attributes["status"])

    @property
    def told_status(self) -> str:
        """The status, the time of a divergence, and the joints where a measured run says."""
        time = f" at {self.attributes['status_time']:.2f} s" if self.status == "diverged" else ""
        joints = ", ".join(map(str, self.attributes.get("status_joints", ())))
        return f"{self.status}{time}" + (f" on joint {joints}" if joints else "")


@dataclass(frozen=True, eq=False)
class PlantValue:
    """A scalar, vector or matrix of the plant, its unit in UDUNITS."""

    value: Array
    units: str
    source: str
    long_name: str


@dataclass(frozen=True, eq=False)
class PlantRecord:
    """Everything needed to rebuild the model.

    `values` are of all joints or of the moving ones. `attributes` say the angle convention, the friction law
    and the like in words.
    """

    values: Mapping[str, PlantValue]
    attributes: Mapping[str, str]

    def matrix(self, name: str, joint: tuple[int, ...]) -> Array:
        """Block (n, n) of a square matrix, such as ``S_inv``, of n joints.

        A stored matrix of n rows is taken to be theirs, a larger one to be of all joints.
        """
        block = self.values[name].value
        if len(block) == len(joint):
            return block
        index = np.array(joint) - 1
        return np.asarray(block[np.ix_(index, index)])


@dataclass(frozen=True, eq=False)
class TraceFile:
    """All runs of an experiment, and what they were made with.

    Parameters
    ----------
    experiment : str
        ``both`` where a measured file holds runs of both.
    runs : Mapping
        By name, in order.
    config_yaml, config_sha256 : str
        The resolved configuration and its digest.
    manifest : Mapping
        What made the file, without its outputs; of one in memory as far as it is known.
    """

    experiment: Literal["compare", "decouple", "both"]
    source: Literal["simulated", "measured"]
    title: str
    runs: Mapping[str, Trace]
    plant: PlantRecord
    config_yaml: str
    config_sha256: str
    manifest: Json

    def part(self, experiment: str) -> TraceFile:
        """The file with the runs of ``compare`` or ``decouple`` alone; there may be none."""
        if self.experiment == experiment:
            return self
        kept = {
            name: trace
            for name, trace in self.runs.items()
            if self.experiment == "both" and (name in DECOUPLING_RUNS) == (experiment == "decouple")
        }
        return replace(self, experiment=experiment, runs=kept)  # type: ignore[arg-type]
