"""The rows of the box: what is unknown about the plant and its motion, each between bounds with a source.

A configuration gives the bounds; the fields of `BoxConfig` say what each unknown is, in which unit, and what
its bounds may be at most.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema

from tendonrepro.configuration.fields.model import Model, Number, Problems, describe, refuse
from tendonrepro.configuration.fields.quantity import UNITS, Source, to_si
from tendonrepro.configuration.fields.strict_yaml import Key
from tendonrepro.configuration.models.readings import ERROR_RATES

SWITCH = ("off", "on")
FRICTION_SIDES = ("none", "link", "winch", "both")
CLEARANCES = ("none", "both", "distal")
DISTURBANCES = ("none", "sine", "noise")
MOTIONS = ("minimum_jerk", "raised_cosine", "trapezoidal", "sine", "unequal", "fast_sine")

Confidence: TypeAlias = Literal["high", "medium", "low"]


class _Known(Model):
    """What every row says of itself."""

    confidence: Confidence
    source: Source


class BoxRange(_Known):
    """An unknown number between two bounds."""

    low: Number
    nominal: Number
    high: Number
    scale: Literal["linear", "log"]
    unit: str

    def numbers(self) -> Iterator[tuple[Key, float]]:
        """Every number with its place."""
        yield from ((("low",), self.low), (("high",), self.high))

    @property
    def lowest(self) -> float:
        """The lower bound, SI."""
        return float(to_si(self.low, self.unit))

    @property
    def highest(self) -> float:
        """The upper bound, SI."""
        return float(to_si(self.high, self.unit))

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        with Problems() as problems:
            if self.low >= self.high:
                problems.add(("low",), f"must be below high, {self.high:g}, found {self.low:g}")
            elif not self.low <= self.nominal <= self.high:
                problems.add(
                    ("nominal",), f"must be from {self.low:g} to {self.high:g}, found {self.nominal:g}"
                )
            if self.scale == "log" and self.low <= 0.0:
                problems.add(("low",), f"must be above 0 on a log scale, found {self.low:g}")
        return self


class _OneOf(_Known):
    """An unknown that is one of a few things."""

    choices: tuple[Any, ...]
    nominal: Any

    @model_validator(mode="after")
    def _check_choices(self) -> Self:
        with Problems() as problems:
            if self.nominal not in self.choices:
                known = ", ".join(map(str, self.choices))
                problems.add(("nominal",), f"must be one of the choices, {known}, found {self.nominal}")
            if len(set(self.choices)) < len(self.choices):
                problems.add(("choices",), "must not name a choice twice")
        return self


class Choice(_OneOf):
    """An unknown number that is one of a few."""

    choices: Annotated[tuple[Number, ...], Field(min_length=1)]
    nominal: Number
    unit: str

    def numbers(self) -> Iterator[tuple[Key, float]]:
        """Every number with its place."""
        yield from ((("choices", i), value) for i, value in enumerate(self.choices))


class Words(_OneOf):
    """An unknown that is one of a few named kinds."""

    choices: Annotated[tuple[str, ...], Field(min_length=1)]
    nominal: str


BoxRow: TypeAlias = BoxRange | Choice | Words


@dataclass(frozen=True)
class _Checked(ABC):
    """Metadata that has a row checked after it is read."""

    about: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return handler.generate_schema(
            Annotated[source, AfterValidator(self._check), Field(description=self.about)]
        )

    @abstractmethod
    def _check(self, row: Any) -> BoxRow:
        """Give back the row, or raise its mistakes."""


@dataclass(frozen=True)
class In(_Checked):
    """SI unit of a row, and the bounds of what may be drawn, in that unit and included."""

    unit: str
    bottom: float = 0.0
    top: float = math.inf

    def _check(self, row: BoxRange | Choice) -> BoxRange | Choice:
        units = [name for name, unit in UNITS.items() if unit.si == self.unit]
        if row.unit not in units:
            refuse(f"must be {' or '.join(units)}, found {describe(row.unit)}", "unit")
        most = "" if self.top == math.inf else f" and at most {self.top:.6g}"
        allowed = f"at least {self.bottom:.6g}{most} {self.unit}"
        with Problems() as problems:
            for at, value in row.numbers():
                # The last digits of a conversion must not decide.
                if not self.bottom * (1.0 - 1e-12) <= to_si(value, row.unit) <= self.top * (1.0 + 1e-12):
                    problems.add(at, f"must be {allowed}, found {value:g} {row.unit}")
        return row


@dataclass(frozen=True)
class Among(_Checked):
    """The words that a row may choose from; a draw holds the place of a word here, from 0."""

    words: tuple[str, ...]

    def _check(self, row: Words) -> Words:
        with Problems() as problems:
            for i, word in enumerate(row.choices):
                if word not in self.words:
                    problems.add(("choices", i), f"must be one of {', '.join(self.words)}, found {word!r}")
        return row


_EPS = 1e-9  # stands for "above zero"
_DEGREE = math.pi / 180.0


class BoxConfig(Model):
    """The box, one field per unknown; joint 1 is held in `compare`, so nothing of it is here."""

    link_length_2: Annotated[BoxRange, In("length of link 2", "m", _EPS)]
    link_length_3: Annotated[BoxRange, In("length of link 3, to the tool", "m", _EPS)]
    link_mass_2: Annotated[BoxRange, In("mass of link 2", "kg", _EPS)]
    link_mass_3: Annotated[BoxRange, In("mass of link 3", "kg", _EPS)]
    link_com_2: Annotated[BoxRange, In("centre of mass of link 2 over its length", "1", 0.0, 1.0)]
    link_com_3: Annotated[BoxRange, In("centre of mass of link 3 over its length", "1", 0.0, 1.0)]
    link_inertia_2: Annotated[BoxRange, In("central inertia of link 2 over m l²", "1", _EPS, 1.0)]
    link_inertia_3: Annotated[BoxRange, In("central inertia of link 3 over m l²", "1", _EPS, 1.0)]
    rotor_inertia: Annotated[BoxRange, In("inertia of a rotor", "kg m2", 0.0)]
    reducer_inertia: Annotated[BoxRange, In("inertia of wave generator and coupling", "kg m2", 0.0)]
    drum_inertia: Annotated[BoxRange, In("inertia of a drum", "kg m2", 0.0)]
    winch_viscous: Annotated[BoxRange, In("viscous damping D_m at a winch", "N m s rad-1")]
    tendon_stiffness_2: Annotated[BoxRange, In("stiffness of tendon 2 at joint 2", "N m rad-1", _EPS)]
    tendon_stiffness_3: Annotated[BoxRange, In("stiffness of tendon 3 at joint 3", "N m rad-1", _EPS)]
    tendon_damping_2: Annotated[BoxRange, In("damping of tendon 2 at joint 2", "N m s rad-1")]
    tendon_damping_3: Annotated[BoxRange, In("damping of tendon 3 at joint 3", "N m s rad-1")]
    clearance_at: Annotated[Words, Among("joints whose tendons have clearance", CLEARANCES)]
    clearance: Annotated[BoxRange, In("slack that a tendon takes up before it pulls", "m")]
    friction_sides: Annotated[Words, Among("sides on which dry friction acts", FRICTION_SIDES)]
    link_coulomb: Annotated[BoxRange, In("Coulomb friction of a joint", "N m")]
    link_viscous: Annotated[BoxRange, In("viscous friction of a joint", "N m s rad-1")]
    link_static_ratio: Annotated[BoxRange, In("static over Coulomb friction, joint", "1", 1.0)]
    link_stribeck_velocity: Annotated[BoxRange, In("Stribeck velocity, joint", "rad s-1", _EPS)]
    winch_coulomb: Annotated[BoxRange, In("Coulomb friction at a winch", "N m")]
    winch_static_ratio: Annotated[BoxRange, In("static over Coulomb friction, winch", "1", 1.0)]
    winch_stribeck_velocity: Annotated[BoxRange, In("Stribeck velocity, winch", "rad s-1", _EPS)]
    pulley_loss_acts: Annotated[Words, Among("whether guide pulleys lose tension", SWITCH)]
    pulley_loss: Annotated[BoxRange, In("share of the tension lost at a guide pulley", "1", 0.0, 0.999)]
    reducer_loss_acts: Annotated[Words, Among("whether the reducer loses torque", SWITCH)]
    reducer_efficiency: Annotated[BoxRange, In("efficiency of the reducer", "1", _EPS, 1.0)]
    tensioner_force: Annotated[BoxRange, In("force of tendon 4", "N")]
    transmission_error_acts: Annotated[Words, Among("whether the reducer has angle errors", SWITCH)]
    transmission_error: Annotated[BoxRange, In("peak-to-peak angle error at the winch", "rad")]
    torque_limit: Annotated[BoxRange, In("saturation at the winch", "N m", _EPS)]
    torque_resolution_acts: Annotated[Words, Among("whether torque comes in steps", SWITCH)]
    torque_resolution: Annotated[BoxRange, In("step of the torque at the winch", "N m")]
    torque_noise_acts: Annotated[Words, Among("whether torque is noisy", SWITCH)]
    torque_noise: Annotated[BoxRange, In("RMS noise of the torque at the winch", "N m")]
    encoder_count: Annotated[Choice, In("angle of one count of the joint encoders", "rad")]
    output_delay: Annotated[Choice, In("delay of the command in samples", "1", 0.0, 100.0)]
    error_rate: Annotated[Words, Among("how the error's rate is obtained", ERROR_RATES)]
    filter_cutoff: Annotated[BoxRange, In("cutoff of the low-pass error rate", "Hz", _EPS)]
    disturbance: Annotated[Words, Among("kind of the disturbance", DISTURBANCES)]
    disturbance_torque: Annotated[BoxRange, In("amplitude of the sine, RMS of the noise", "N m")]
    disturbance_frequency: Annotated[BoxRange, In("frequency of the sine", "Hz", _EPS)]
    posture: Annotated[BoxRange, In("joint 1 from hanging", "rad", 1.0 * _DEGREE, 179.0 * _DEGREE)]
    motion: Annotated[Words, Among("kind of the reference motion", MOTIONS)]
    amplitude: Annotated[BoxRange, In("largest angle of the reference, a joint", "rad", _EPS, 89.0 * _DEGREE)]
    period: Annotated[BoxRange, In("period of raised cosine and sine", "s", 0.02)]
    rise: Annotated[BoxRange, In("duration of a minimum-jerk stroke", "s", 0.02)]
    hold: Annotated[BoxRange, In("pause after a stroke", "s", 0.0)]
    velocity: Annotated[BoxRange, In("largest velocity, trapezoidal", "rad s-1", _EPS)]
    acceleration: Annotated[BoxRange, In("acceleration of the ramps, trapezoidal", "rad s-2", _EPS)]

    @model_validator(mode="after")
    def _check_workspace(self) -> Self:
        """Links stay between 0 and 180 degrees from hanging in every draw: link 3 reaches posture + 2 A."""
        reached = self.posture.highest + 2.0 * self.amplitude.highest
        if reached >= math.pi:
            message = (
                f"must keep link 3 below 180 deg from hanging, it would reach {reached / _DEGREE:.6g} deg"
            )
            refuse(message, "amplitude", "high")
        return self

    def items(self) -> Iterator[tuple[str, BoxRow]]:
        """Every row by its name, in order."""
        for name in type(self).model_fields:
            yield name, getattr(self, name)


def rule_of(name: str) -> In | Among:
    """What a row's field asks: unit and bounds, or its words."""
    (rule,) = (item for item in BoxConfig.model_fields[name].metadata if isinstance(item, In | Among))
    return rule
