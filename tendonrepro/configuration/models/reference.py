"""Reference motions, told apart by their ``kind``, and the samples of a file that holds one."""

from __future__ import annotations

import math
import re
from abc import abstractmethod
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, StrictInt

from tendonrepro.arrays import Array
from tendonrepro.configuration.quantity import Moving, Physical, Scalar, nonneg, positive, whole, wrong_sizes
from tendonrepro.configuration.strict_model import Mistakes, Model
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.errors import ConfigError
from tendonrepro.physics import trajectory
from tendonrepro.physics.trajectory import Shape, trapezoid_times

Amplitude: TypeAlias = Annotated[Moving, Physical("rad", "largest angle of each joint")]
Duration: TypeAlias = Annotated[Scalar, positive("s", "duration")]
Hold: TypeAlias = Annotated[Scalar, nonneg("s", "pause after each stroke")]
Turn: TypeAlias = Annotated[tuple[StrictInt, ...], Field(min_length=1)]


class Periodic(Model):
    """A motion made of equal periods."""

    periods: Annotated[Scalar, whole("number of repetitions", at_least=1.0)]
    amplitude: Amplitude

    @property
    @abstractmethod
    def cycle(self) -> float:
        """Of one turn, s."""

    @abstractmethod
    def shape(self, i: int) -> Shape:
        """What joint i, from 0 among the moving ones, does in one turn."""

    @property
    def duration(self) -> float:
        """Of the whole motion, s."""
        return self.cycle * self.periods.si


class InTurns(Periodic):
    """A motion in which the joints may take turns; a period is then all turns once."""

    turns: Annotated[tuple[Turn, ...] | None, Field(min_length=1)] = None
    """joints that move in each turn; absent: all at once"""

    @property
    def duration(self) -> float:
        """Of the whole motion, s."""
        return self.cycle * self.periods.si * len(self.turns or ((),))


class RaisedCosine(InTurns):
    """``amplitude (1 - cos(2π t/period)) / 2``."""

    kind: Literal["raised_cosine"]
    period: Duration

    @property
    def cycle(self) -> float:
        """Of one turn, s."""
        return self.period.si

    def shape(self, i: int) -> Shape:
        """What joint i does in one turn."""
        return trajectory.raised_cosine(self.amplitude.si[i], self.period.si)


class Strokes(InTurns):
    """Up, hold, down, hold by strokes that all last as long.

    Minimum-jerk strokes, or ramps: straight lines with steps of velocity and no acceleration.
    """

    kind: Literal["minimum_jerk", "ramp"]
    rise: Duration
    hold: Hold

    @property
    def cycle(self) -> float:
        """Of one turn, s."""
        return 2.0 * (self.rise.si + self.hold.si)

    def shape(self, i: int) -> Shape:
        """What joint i does in one turn."""
        stroke = trajectory.ramp if self.kind == "ramp" else trajectory.minimum_jerk
        return stroke(self.amplitude.si[i], self.rise.si, self.hold.si)


class Trapezoidal(InTurns):
    """Up, hold, down, hold with bounded velocity and acceleration; the longest stroke sets the pace."""

    kind: Literal["trapezoidal"]
    velocity: Annotated[Scalar, positive("rad s-1", "largest velocity")]
    acceleration: Annotated[Scalar, positive("rad s-2", "acceleration of the ramps")]
    hold: Hold

    @property
    def cycle(self) -> float:
        """Of one turn, s."""
        longest = float(abs(self.amplitude.si).max())
        _, rise = trapezoid_times(longest, self.velocity.si, self.acceleration.si)
        return 2.0 * (rise + self.hold.si)

    def shape(self, i: int) -> Shape:
        """What joint i does in one turn."""
        amplitude, limits = self.amplitude.si[i], (self.velocity.si, self.acceleration.si)
        # A shorter stroke waits for the longest one, so that all joints turn back together.
        hold = self.cycle / 2.0 - trapezoid_times(amplitude, *limits)[1]
        return trajectory.trapezoidal(amplitude, *limits, hold)


class Sine(Periodic):
    """``offset + amplitude sin(2π t/period)``, blended in from rest."""

    kind: Literal["sine"]
    offset: Annotated[Moving, Physical("rad", "centre of the sine of each joint")]
    period: Duration
    blend: Annotated[Scalar, positive("s", "duration of the start from rest, part of the motion")]

    @property
    def cycle(self) -> float:
        """Of one period, s."""
        return self.period.si

    def shape(self, i: int) -> Shape:
        """What joint i does in the whole motion."""
        amplitude, offset = self.amplitude.si[i], self.offset.si[i]
        return trajectory.smooth_sine(amplitude, offset, self.period.si, self.blend.si)

    def _mistakes(self) -> Mistakes:
        if self.blend.si > self.duration:
            yield ("blend", "value"), f"must end within the motion, which lasts {self.duration:g} s"


class Sampled(Model):
    """A trajectory from a CSV file, columns ``time_s`` and ``q<joint>_deg``."""

    kind: Literal["sampled"]
    file: Annotated[str, Field(min_length=1, description="path, relative to the configuration's folder")]
    interpolation: Literal["quintic", "linear"] = "quintic"
    """a smooth spline, or straight lines with steps of velocity and no acceleration"""


Single: TypeAlias = Annotated[RaisedCosine | Strokes | Trapezoidal | Sine, Field(discriminator="kind")]


class PerJoint(Model):
    """A motion of its own for each moving joint, all equally long."""

    kind: Literal["per_joint"]
    references: Annotated[tuple[Single, ...], Field(min_length=1)]
    """one motion per moving joint, its vectors with one entry"""

    def _mistakes(self) -> Mistakes:
        for i, reference in enumerate(self.references):
            for at, words in wrong_sizes(reference, {"moving": 1}):
                yield ("references", i, *at), words
            if isinstance(reference, InTurns) and reference.turns:
                yield ("references", i, "turns"), "one joint cannot take turns; leave this out"
            if not math.isclose(reference.duration, self.duration):
                first = f"the first one {self.duration:g} s; make them equal"
                yield ("references", i), f"lasts {reference.duration:g} s, {first}"

    @property
    def duration(self) -> float:
        """Of the whole motion, s."""
        return self.references[0].duration


ReferenceConfig: TypeAlias = Annotated[
    RaisedCosine | Strokes | Trapezoidal | Sine | Sampled | PerJoint, Field(discriminator="kind")
]

FEWEST = 6
"""Fewest rows of a sampled motion: a quintic spline with its ends at rest passes through them."""


def read_samples(path: Path, interpolation: str = "quintic") -> tuple[Array, dict[int, Array]]:
    """Read columns ``time_s`` and ``q<joint>_deg``.

    Returns
    -------
    time : array (N,)
        s.
    angles : dict of array (N,)
        By the paper's joint number, rad.
    """
    header, *rest = read_text(path).splitlines() or [""]
    names = [name.strip() for name in header.split(",")]
    joints = [int(name[1]) for name in names if re.fullmatch("q[1-9]_deg", name)]
    if not joints or names != ["time_s", *(f"q{joint}_deg" for joint in dict.fromkeys(joints))]:
        message = f"the first line must be time_s,q2_deg,q3_deg or the like, found {header[:80]!r}"
        raise ConfigError(message, where=f"{path}:1")
    lines = [line for line, text in enumerate(rest, 2) if text.partition("#")[0].strip()]
    fewest = 2 if interpolation == "linear" else FEWEST
    if len(lines) < fewest:
        raise ConfigError(f"needs at least {fewest} rows of numbers, found {len(lines)}", where=str(path))
    try:
        table = np.loadtxt(rest, delimiter=",", ndmin=2)
        time, *angles = table.T
        if len(angles) != len(joints):
            raise ValueError(f"{table.shape[1]} in each row")
        by_joint = {joint: np.deg2rad(angle) for joint, angle in zip(joints, angles, strict=True)}
    except ValueError as error:
        message = f"rows must hold {len(names)} numbers with commas between: {error}"
        raise ConfigError(message, where=str(path)) from None
    wrong = ~np.isfinite(table).all(axis=1) | (np.diff(time, prepend=-np.inf) <= 0.0)
    if wrong.any():
        message = "numbers must be finite, and time must increase from row to row"
        raise ConfigError(message, where=f"{path}:{lines[np.argmax(wrong)]}")
    return time, by_joint
