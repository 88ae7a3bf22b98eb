"""The two experiments, and the checks that span their sections."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, StrictInt

from tendonrepro.configuration import quantity
from tendonrepro.configuration.models.control import Control
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.reference import InTurns, PerJoint, ReferenceConfig, Sampled
from tendonrepro.configuration.quantity import Joints, Moving, Physical, Scalar, Vector, nonneg, positive
from tendonrepro.configuration.strict_model import Identifier, Mistakes, Model, SchemaVersion
from tendonrepro.configuration.strict_yaml import Key

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
    torque: Annotated[Moving, Physical("N m", "torque on each joint")]
    start: Annotated[Scalar, nonneg("s", "time of the step")]


class SineDisturbance(Model):
    """A sine that is zero at the start."""

    kind: Literal["sine"]
    torque: Annotated[Moving, Physical("N m", "amplitude on each joint")]
    frequency: Annotated[Scalar, positive("Hz", "frequency")]


class NoiseDisturbance(Model):
    """Band-limited noise drawn from the seed."""

    kind: Literal["noise"]
    torque: Annotated[Moving, nonneg("N m", "RMS torque on each joint")]
    band: Annotated[Vector, nonneg("Hz", "lowest and highest frequency")]
    components: Annotated[Scalar, Physical("1", "number of sines", at_least=1.0, at_most=100.0, whole=True)]


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


class Experiment(Model):
    """What both experiments state."""

    schema_version: SchemaVersion
    title: Annotated[str, Field(min_length=1, description="title of figures and files")]
    manipulator: Manipulator
    joints: Annotated[tuple[StrictInt, ...], Field(min_length=1)]
    """moving joints: the last ones, in order"""
    posture: Annotated[Joints, Physical("rad", "joint angles at which the encoders read zero")]
    sampling_period: Annotated[
        Scalar, positive("s", "sampling period L, also the delay time", usual=(1e-5, 0.2))
    ]
    seed: Annotated[Scalar, nonneg("1", "seed of all random numbers", at_most=2.0**32 - 1.0, whole=True)]
    disturbance: DisturbanceConfig
    solver: SolverConfig
    status: StatusLimits


class CompareRun(Model):
    """One run of the comparison."""

    law: Annotated[str, Field(description="name of one of the laws")]
    payload: Annotated[Scalar, nonneg("kg", "point mass at the tool", usual=(1e-3, 1e3))]
    start_offset: Annotated[Moving, Physical("rad", "joint angles less the reference at t = 0")] | None = None
    friction_scale: (
        Annotated[Scalar, positive("1", "factor on dry and viscous friction of links and winches")] | None
    ) = None

    @property
    def friction_factor(self) -> float:
        """Of `friction_scale`, 1 without one."""
        return self.friction_scale.si if self.friction_scale else 1.0


class CompareConfig(Experiment):
    """Controllers on the same reference, sections 5.3 and 5.4."""

    experiment: Literal["compare"]
    reference: ReferenceConfig
    control: Control
    runs: Annotated[dict[Identifier, CompareRun], Field(min_length=1, description="runs by name")]
    errors_from: (
        Annotated[Scalar, nonneg("s", "start of each run that errors in tables leave out")] | None
    ) = None

    def _mistakes(self) -> Mistakes:
        yield from _misfits(self)
        laws, reference = self.control.laws, self.reference
        for name, run in self.runs.items():
            if run.law not in laws:
                yield ("runs", name, "law"), f"must be one of {', '.join(laws)}, found {run.law!r}"
            if run.start_offset is not None:
                key = ("runs", name, "start_offset", "value")
                yield from _beyond_range(self, key, run.start_offset)
        if not isinstance(reference, Sampled) and errors_from(self) >= reference.duration:
            yield ("errors_from", "value"), f"must be before the end of the motion, {reference.duration:g} s"


class PositionLoop(Model):
    """The stiff loop that makes motors follow commands; the paper does not describe it."""

    stiffness: Annotated[Moving, positive("N m rad-1", "stiffness at the winch")]
    damping: Annotated[Moving, nonneg("N m s rad-1", "damping at the winch")]


class DecoupleRun(Model):
    """One run of the decoupling experiment."""

    drives: Literal["joints", "motors"]
    """whether the reference is of joints, mapped by S_inv, or of the motors themselves"""
    reference: ReferenceConfig
    payload: Annotated[Scalar, nonneg("kg", "point mass at the tool")]


class DecoupleConfig(Experiment):
    """Motors follow a command and joints follow the motors, section 5.2."""

    experiment: Literal["decouple"]
    position_loop: PositionLoop
    runs: Annotated[dict[Identifier, DecoupleRun], Field(min_length=1, description="runs by name")]

    def _mistakes(self) -> Mistakes:
        return _misfits(self)


Config: TypeAlias = CompareConfig | DecoupleConfig


def errors_from(config: Config) -> float:
    """Seconds at the start of each run that errors in tables leave out."""
    held = config.errors_from if isinstance(config, CompareConfig) else None
    return held.si if held else 0.0


def references_of(config: Config) -> dict[tuple[str, ...], ReferenceConfig]:
    """Reference motions by the path of their keys."""
    if isinstance(config, CompareConfig):
        return {("reference",): config.reference}
    return {("runs", name, "reference"): run.reference for name, run in config.runs.items()}


def _misfits(config: Config) -> Mistakes:
    """Mistakes across sections."""
    last, moving = config.manipulator.joints, config.joints
    yield from quantity.wrong_sizes(config, {"joints": last, "moving": len(moving)})
    if moving != tuple(range(last - len(moving) + 1, last + 1)):
        yield ("joints",), f"must be the last joints in order, up to {last}, found {list(moving)}"
    period, step = config.sampling_period, config.solver.max_step
    steps = period.si / step.si
    if not is_multiple(steps, 1.0) or steps > MOST_STEPS * (1.0 + 1e-9):
        parts = f"{period}, into at most {MOST_STEPS:g} parts, so set it too"
        yield (
            ("solver", "max_step", "value"),
            f"must divide the sampling period, {parts}, found {step}",
        )
    match config.disturbance:
        case StepDisturbance(start=start) if start.si > 0.0 and not is_multiple(start.si, period.si):
            message = f"must be a multiple of the sampling period, {period}, found {start}"
            yield ("disturbance", "start", "value"), message
        case NoiseDisturbance(band=band) if len(band.value) != 2 or band.value[0] >= band.value[1]:
            message = f"must be two frequencies, the lower one first, found {list(band.value)}"
            yield ("disturbance", "band", "value"), message
    for path, reference in references_of(config).items():
        for at, message in _unfit(reference, moving, period):
            yield (*path, *at), message
    if "plant" in config.runs:
        yield ("runs", "plant"), "is the name of something else among the results; choose another"


def _beyond_range(config: CompareConfig, key: Key, offset: Vector) -> Mistakes:
    """Links work between hanging and upright, at the start too."""
    if len(offset.si) == len(config.joints) and len(config.posture.si) == config.manipulator.joints:
        links = np.degrees(np.cumsum(config.posture.si)[-len(offset.si) :] + np.cumsum(offset.si))
        for joint, angle in zip(config.joints, links, strict=True):
            if not 0.0 < angle < 180.0:
                start = f"would start link {joint} at {angle:.4g} deg from hanging"
                yield key, f"{start}; links must stay between 0 and 180 deg"
                return


def _unfit(reference: ReferenceConfig, joints: tuple[int, ...], period: Scalar) -> Mistakes:
    """Mistakes of a reference for moving joints and sampling period."""
    if isinstance(reference, PerJoint) and len(reference.references) != len(joints):
        message = f"must have one motion per moving joint, {len(joints)}, found {len(reference.references)}"
        yield ("references",), message
    for i, turn in enumerate(reference.turns or () if isinstance(reference, InTurns) else ()):
        if not set(turn) <= set(joints):
            yield ("turns", i), f"must name joints that move, {list(joints)}, found {list(turn)}"
    duration = 0.0 if isinstance(reference, Sampled) else reference.duration
    if duration and duration > MOST_SAMPLES * period.si:
        yield (), f"lasts {duration:g} s; a run has at most {MOST_SAMPLES:g} samples"
    elif duration and not is_multiple(duration, period.si):
        yield (), f"lasts {duration:.9g} s, which must be a multiple of the sampling period, {period}"


def is_multiple(duration: float, step: float) -> bool:
    """Whether a duration is a whole number, from one, of steps, within 1e-9 relative."""
    count = duration / step
    return round(count) >= 1 and abs(count - round(count)) <= 1e-9 * count
