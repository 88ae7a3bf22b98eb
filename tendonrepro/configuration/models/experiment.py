"""The two experiments of a configuration, and the checks that span their sections."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import ConfigDict, Field, StrictInt, ValidationInfo, field_validator

from tendonrepro.configuration.fields.model import (
    Model,
    Outline,
    RunName,
    SchemaVersion,
    is_multiple,
    refuse,
    refuse_all,
)
from tendonrepro.configuration.fields.quantity import (
    Physical,
    Scalar,
    Vector,
    from_zero,
    per_joint,
    per_moving_joint,
    positive,
)
from tendonrepro.configuration.models.control import Control
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.reference import ReferenceConfig

_T = TypeVar("_T")

MOST_SAMPLES = 1e6
"""Longest run; ten times as much would not fit into the memory of a small machine."""

MOST_STEPS = 1e3
"""Steps of the integrator in a sampling period; five times as many count as a plant it cannot follow."""


class NoDisturbance(Model):
    """No disturbance torque."""

    kind: Literal["none"]


class StepDisturbance(Model):
    """A constant torque from a start time on."""

    kind: Literal["step"]
    torque: Annotated[Vector, per_moving_joint("N m", "torque on each joint")]
    start: Annotated[Scalar, from_zero("s", "time of the step")]


class SineDisturbance(Model):
    """A sine that is zero at the start."""

    kind: Literal["sine"]
    torque: Annotated[Vector, per_moving_joint("N m", "amplitude on each joint")]
    frequency: Annotated[Scalar, positive("Hz", "frequency")]


class NoiseDisturbance(Model):
    """Band-limited noise drawn from the seed."""

    kind: Literal["noise"]
    torque: Annotated[Vector, per_moving_joint("N m", "RMS torque on each joint", at_least=0.0)]
    band: Annotated[Vector, from_zero("Hz", "lowest and highest frequency", size="pair")]
    components: Annotated[Scalar, Physical("1", "number of sines", at_least=1.0, at_most=100.0, whole=True)]

    @field_validator("band")
    @classmethod
    def _check_band(cls, band: Vector) -> Vector:
        low, high = band.value
        if low >= high:
            refuse(f"must rise from low to high, found {low:g} to {high:g} Hz", "value")
        return band


DisturbanceConfig: TypeAlias = Annotated[
    NoDisturbance | StepDisturbance | SineDisturbance | NoiseDisturbance, Field(discriminator="kind")
]


class SolverConfig(Model):
    """Integrator of the plant between two samples."""

    method: Literal["dopri5", "dop853", "lsoda"]
    rtol: Annotated[Scalar, positive("1", "relative tolerance", below=1.0)]
    atol: Annotated[Scalar, positive("1", "absolute tolerance, rad and rad/s", below=1.0)]
    max_step: Annotated[Scalar, positive("s", "longest step; divides the sampling period")]


class StatusLimits(Model):
    """When a run counts as diverged or ringing."""

    divergence_limit: Annotated[Scalar, positive("rad", "error at which a run has diverged")]
    ringing_frequency: Annotated[Scalar, positive("Hz", "frequency above which error is ringing")]
    ringing_share: Annotated[Scalar, positive("1", "share of the error's power that is ringing", below=1.0)]


def _or_file(schema: dict[str, Any]) -> None:
    """State in the JSON schema that a file may name the manipulator instead of holding it."""
    held = dict(schema)
    schema.clear()
    schema["anyOf"] = [{"type": "string", "description": "file beside this one, or a shipped one"}, held]


def _or_base(schema: dict[str, Any]) -> None:
    """State in the JSON schema that a file may name a base, of which it then says only what differs."""
    schema["properties"]["base"] = {"type": "string", "description": "file that has the other keys"}
    with_base = {"required": ["schema_version", "experiment", "base"]}
    schema["anyOf"] = [{"required": schema.pop("required")}, with_base]


class Experiment(Model):
    """What both experiments state."""

    model_config = ConfigDict(json_schema_extra=_or_base)

    schema_version: SchemaVersion
    title: Annotated[str, Field(min_length=1, description="title of figures and files")]
    manipulator: Annotated[Manipulator, Field(json_schema_extra=_or_file)]
    joints: Annotated[tuple[StrictInt, ...], Field(min_length=1)]
    """moving joints: the last ones, in order"""
    posture: Annotated[Vector, per_joint("rad", "joint angles at which the encoders read zero")]
    sampling_period: Annotated[Scalar, positive("s", "sampling period L, also the delay time")]
    seed: Annotated[Scalar, from_zero("1", "seed of all random numbers", at_most=2.0**32 - 1.0, whole=True)]
    disturbance: DisturbanceConfig
    solver: SolverConfig
    status: StatusLimits

    @field_validator("joints")
    @classmethod
    def _check_joints(cls, joints: tuple[int, ...], info: ValidationInfo) -> tuple[int, ...]:
        last = Outline.known(info).joints
        if last is not None and joints != tuple(range(last - len(joints) + 1, last + 1)):
            refuse(f"must be the last joints of the manipulator in order, up to {last}, found {list(joints)}")
        return joints

    @field_validator("disturbance")
    @classmethod
    def _check_start(cls, disturbance: _T, info: ValidationInfo) -> _T:
        period: Scalar | None = info.data.get("sampling_period")
        if period is not None and isinstance(disturbance, StepDisturbance):
            start = disturbance.start
            if start.si > 0.0 and not is_multiple(start.si, period.si):
                refuse(
                    f"must be a multiple of the sampling period, {period}, found {start}", "start", "value"
                )
        return disturbance

    @field_validator("solver")
    @classmethod
    def _check_step(cls, solver: SolverConfig, info: ValidationInfo) -> SolverConfig:
        period, step = info.data.get("sampling_period"), solver.max_step
        steps = 1.0 if period is None else period.si / step.si
        if not is_multiple(steps, 1.0) or steps > MOST_STEPS * (1.0 + 1e-9):
            parts = f"{period}, into at most {MOST_STEPS:g} parts"
            refuse(f"must divide the sampling period, {parts}, found {step}", "max_step", "value")
        return solver


class CompareRun(Model):
    """One run of the comparison."""

    law: Annotated[str, Field(description="name of one of the laws")]
    payload: Annotated[Scalar, from_zero("kg", "point mass at the tool")]

    @field_validator("law")
    @classmethod
    def _check_law(cls, law: str, info: ValidationInfo) -> str:
        laws = Outline.known(info).laws
        if laws is not None and law not in laws:
            refuse(f"must be one of control.laws, {', '.join(map(str, laws))}, found {law!r}")
        return law


class CompareConfig(Experiment):
    """Controllers on the same reference, sections 5.3 and 5.4."""

    experiment: Literal["compare"]
    reference: ReferenceConfig
    control: Control
    runs: Annotated[dict[RunName, CompareRun], Field(min_length=1, description="runs by name")]

    @field_validator("reference")
    @classmethod
    def _check_reference(cls, reference: ReferenceConfig, info: ValidationInfo) -> ReferenceConfig:
        if wrong := _wrong_duration(reference, info):
            refuse(wrong)
        return reference


class PositionLoop(Model):
    """The stiff loop that makes motors follow their commands; the paper does not describe it."""

    stiffness: Annotated[Vector, per_moving_joint("N m rad-1", "stiffness at the winch", above=0.0)]
    damping: Annotated[Vector, per_moving_joint("N m s rad-1", "damping at the winch", at_least=0.0)]


class DecoupleRun(Model):
    """One run of the decoupling experiment."""

    drives: Literal["joints", "motors"]
    """whether the reference is of joints, mapped by S_inv, or of the motors themselves"""
    reference: ReferenceConfig
    payload: Annotated[Scalar, from_zero("kg", "point mass at the tool")]


class DecoupleConfig(Experiment):
    """Motors follow a command and joints follow the motors, section 5.2."""

    experiment: Literal["decouple"]
    position_loop: PositionLoop
    runs: Annotated[dict[RunName, DecoupleRun], Field(min_length=1, description="runs by name")]

    @field_validator("runs")
    @classmethod
    def _check_references(cls, runs: dict[str, DecoupleRun], info: ValidationInfo) -> dict[str, DecoupleRun]:
        wrong = {name: _wrong_duration(run.reference, info) for name, run in runs.items()}
        refuse_all(((name, "reference"), words) for name, words in wrong.items() if words)
        return runs


def _wrong_duration(reference: ReferenceConfig, info: ValidationInfo) -> str | None:
    """What is wrong with a duration that is not a whole number of samples, or too many."""
    period, duration = info.data.get("sampling_period"), reference.duration
    if period is None or duration is None:
        return None
    if duration > MOST_SAMPLES * period.si:
        return f"lasts {duration:g} s; a run has at most {MOST_SAMPLES:g} samples"
    if not is_multiple(duration, period.si):
        return f"lasts {duration:.9g} s, which must be a whole multiple of the sampling period, {period}"
    return None
