"""Reference motions of a configuration, told apart by their ``kind``."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import replace
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import (
    Field,
    StrictInt,
    TypeAdapter,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from tendonrepro.configuration.fields.model import Model, Outline, refuse
from tendonrepro.configuration.fields.quantity import (
    Physical,
    Scalar,
    Vector,
    from_zero,
    per_moving_joint,
    positive,
)
from tendonrepro.physics.trajectory import trapezoid_times

Amplitude: TypeAlias = Annotated[Vector, per_moving_joint("rad", "largest angle of each joint")]
Duration: TypeAlias = Annotated[Scalar, positive("s", "duration")]
Hold: TypeAlias = Annotated[Scalar, from_zero("s", "pause after each stroke")]
TurnOrder: TypeAlias = Annotated[
    tuple[Annotated[tuple[StrictInt, ...], Field(min_length=1)], ...] | None,
    Field(min_length=1, description="joints that move in each turn; absent: all at once"),
]


class Periodic(Model):
    """A motion made of equal periods."""

    periods: Annotated[Scalar, Physical("1", "number of repetitions", at_least=1.0, whole=True)]

    @property
    @abstractmethod
    def cycle(self) -> float:
        """Duration of one turn of one period, s."""

    @property
    def duration(self) -> float:
        """Duration of the whole motion, s."""
        return self.cycle * self.periods.si


class InTurns(Periodic):
    """A periodic motion in which the joints may take turns; a period is then all turns once."""

    turns: TurnOrder = None

    @property
    def duration(self) -> float:
        """Duration of the whole motion, s."""
        return self.cycle * self.periods.si * len(self.turns or ((),))

    @field_validator("turns")
    @classmethod
    def _check_turns(cls, turns: TurnOrder, info: ValidationInfo) -> TurnOrder:
        moving = Outline.known(info).moving
        for i, turn in enumerate(turns or ()):
            if len(set(turn)) < len(turn):
                refuse(f"names a joint twice, {list(turn)}", i)
            if moving is not None and not all(joint in moving for joint in turn):
                refuse(f"must name joints of this motion that move, found {list(turn)}", i)
        return turns


class RaisedCosine(InTurns):
    """``amplitude (1 - cos(2π t/period)) / 2``."""

    kind: Literal["raised_cosine"]
    amplitude: Amplitude
    period: Duration

    @property
    def cycle(self) -> float:
        """Duration of one turn of one period, s."""
        return self.period.si


class MinimumJerk(InTurns):
    """Up, hold, down, hold by minimum-jerk strokes."""

    kind: Literal["minimum_jerk"]
    amplitude: Amplitude
    rise: Duration
    hold: Hold

    @property
    def cycle(self) -> float:
        """Duration of one turn of one period, s."""
        return 2.0 * (self.rise.si + self.hold.si)


class Trapezoidal(InTurns):
    """Up, hold, down, hold with bounded velocity and acceleration; the longest stroke sets the pace."""

    kind: Literal["trapezoidal"]
    amplitude: Amplitude
    velocity: Annotated[Scalar, positive("rad s-1", "largest velocity")]
    acceleration: Annotated[Scalar, positive("rad s-2", "acceleration of the ramps")]
    hold: Hold

    @property
    def cycle(self) -> float:
        """Duration of one turn of one period, s."""
        longest = float(abs(self.amplitude.si).max())
        _, rise = trapezoid_times(longest, self.velocity.si, self.acceleration.si)
        return 2.0 * (rise + self.hold.si)


class Sine(Periodic):
    """``offset + amplitude sin(2π t/period)``, blended in from rest."""

    kind: Literal["sine"]
    amplitude: Amplitude
    offset: Annotated[Vector, per_moving_joint("rad", "centre of the sine of each joint")]
    period: Duration
    blend: Annotated[Scalar, positive("s", "duration of the start from rest, part of the motion")]

    @property
    def cycle(self) -> float:
        """Duration of one period, s."""
        return self.period.si

    @model_validator(mode="after")
    def _check_blend(self) -> Self:
        if self.blend.si > self.duration:
            refuse(f"must end within the motion, which lasts {self.duration:g} s", "blend", "value")
        return self


class Sampled(Model):
    """A trajectory from a CSV file with the columns ``time_s`` and ``q<joint>_deg``."""

    kind: Literal["sampled"]
    file: Annotated[str, Field(min_length=1, description="path, relative to the configuration's folder")]

    @property
    def duration(self) -> None:
        """Unknown until the file is read."""


Single: TypeAlias = Annotated[RaisedCosine | MinimumJerk | Trapezoidal | Sine, Field(discriminator="kind")]
_SINGLES: TypeAdapter[tuple[Any, ...]] = TypeAdapter(tuple[Single, ...])


def _validate_singles(raw: object, _: ValidatorFunctionWrapHandler, info: ValidationInfo) -> tuple[Any, ...]:
    return _SINGLES.validate_python(raw, context=replace(Outline.known(info), moving=(None,)))


class PerJoint(Model):
    """A motion of its own for each moving joint, all of the same duration."""

    kind: Literal["per_joint"]
    references: Annotated[
        tuple[Single, ...],
        WrapValidator(_validate_singles),
        Field(min_length=1, description="one motion per moving joint, its vectors with one entry"),
    ]

    @model_validator(mode="after")
    def _check_joints(self, info: ValidationInfo) -> Self:
        moving, found = Outline.known(info).moving, len(self.references)
        if moving is not None and len(moving) != found:
            refuse(f"must have one motion per moving joint, {len(moving)}, found {found}", "references")
        for i, reference in enumerate(self.references):
            if not math.isclose(reference.duration, self.duration):
                first = f"the first one {self.duration:g} s; make them equal"
                refuse(f"lasts {reference.duration:g} s, {first}", "references", i)
        return self

    @property
    def duration(self) -> float:
        """Duration of the whole motion, s."""
        return self.references[0].duration


ReferenceConfig: TypeAlias = Annotated[
    RaisedCosine | MinimumJerk | Trapezoidal | Sine | Sampled | PerJoint, Field(discriminator="kind")
]
