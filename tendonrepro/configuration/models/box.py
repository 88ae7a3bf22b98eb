"""The rows of the box: what is unknown about plant and motion, and where each number stands in an arm."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

from pydantic import Field

from tendonrepro.arrays import Numeric
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.readings import ERROR_RATES
from tendonrepro.configuration.quantity import Physical, nonneg, positive, to_si
from tendonrepro.configuration.strict_model import Mistakes, Model, Number, Provenance

_SWITCH = ("off", "on")
WORDS: Mapping[str, tuple[str, ...]] = {
    "clearance_at": ("none", "both", "distal"),
    "friction_sides": ("none", "link", "winch", "both"),
    "pulley_loss_acts": _SWITCH,
    "reducer_loss_acts": _SWITCH,
    "transmission_error_acts": _SWITCH,
    "torque_resolution_acts": _SWITCH,
    "torque_noise_acts": _SWITCH,
    "error_rate": ERROR_RATES,
    "disturbance": ("none", "sine", "noise"),
    "motion": ("minimum_jerk", "raised_cosine", "trapezoidal", "sine", "unequal", "fast_sine", "ramp"),
}
"""What rows of words may choose from; a draw holds the place of a word here, from 0."""

FAST_PERIOD = 3.33
"""Period of the motion ``fast_sine``, s: 0.3 Hz."""

Confidence: TypeAlias = Literal["high", "medium", "low"]


class _Known(Model):
    confidence: Confidence
    source: Provenance


class BoxRange(_Known):
    """An unknown number between two bounds."""

    low: Number
    nominal: Number
    high: Number
    scale: Literal["linear", "log"]
    unit: str

    @property
    def lowest(self) -> float:
        """SI."""
        return float(to_si(self.low, self.unit))

    @property
    def highest(self) -> float:
        """SI."""
        return float(to_si(self.high, self.unit))

    def _mistakes(self) -> Mistakes:
        if self.low >= self.high:
            yield ("low",), f"must be below high, {self.high:g}, found {self.low:g}"
        elif not self.low <= self.nominal <= self.high:
            yield ("nominal",), f"must be from {self.low:g} to {self.high:g}, found {self.nominal:g}"
        elif self.scale == "log" and self.low <= 0.0:
            yield ("low",), f"must be above 0 on a log scale, found {self.low:g}"


class _OneOf(_Known):
    choices: tuple[float | str, ...]
    nominal: float | str

    def _mistakes(self) -> Mistakes:
        if self.nominal not in self.choices:
            known = ", ".join(map(str, self.choices))
            yield ("nominal",), f"must be one of the choices, {known}, found {self.nominal}"


class Choice(_OneOf):
    """An unknown number, one of a few."""

    choices: Annotated[tuple[Number, ...], Field(min_length=1)]
    nominal: Number
    unit: str


class Words(_OneOf):
    """An unknown that has a few named kinds."""

    choices: Annotated[tuple[str, ...], Field(min_length=1)]
    nominal: str


BoxRow: TypeAlias = BoxRange | Choice | Words

Draw: TypeAlias = Mapping[str, float]
"""Numbers by row, SI; a word counts as its place in `WORDS`."""


def word_of(draw: Draw, row: str) -> str:
    """Word of a row in a draw."""
    return WORDS[row][int(draw[row])]


class Joint(NamedTuple):
    """What numbers of a joint are shares of, or go together with.

    Length, m, and mass, kg, of its link; radius where its tendon passes the joint, m; factor on the damping
    of tendons; reduction, and inertia of the reducer before it, kg m².
    """

    length: Numeric
    mass: Numeric
    radius: float = 1.0
    damping: float = 1.0
    reduction: float = 1.0
    reducer: float = 0.0


class Row(NamedTuple):
    """Where a number of the box stands in a manipulator.

    `put` gives the value of the `key` from the number, `get` the number from the value. `about` ends the
    words that say where the value is from. One with a `switch`, a row of words, acts where that says `word`
    or ``both``; else the value is `off`.
    """

    key: str
    put: Callable[[Any, Joint], Any] = lambda number, _: number
    get: Callable[[Any, Joint], Any] = lambda value, _: value
    about: str = ""
    switch: str = ""
    word: str = "on"
    off: float = 0.0

    def acts(self, draw: Draw) -> bool:
        """Whether a draw has what the number is of."""
        return not self.switch or word_of(draw, self.switch) in (self.word, "both")


class _OnArm(Physical):
    """A number of the box that is the value of a key of an arm as it stands, with its unit and limits."""

    def __init__(self, key: str, switch: str = "", word: str = "on", off: float = 0.0) -> None:
        self.row = Row(key, switch=switch, word=word, off=off)
        model: Any = Manipulator
        *sections, last = key.split(".")
        for name in sections:
            model = model.model_fields[name].annotation
        (rule,) = (item for item in model.model_fields[last].metadata if isinstance(item, Physical))
        vars(self).update(vars(rule))


_OFFSET = "joint angle less the reference at the start, run of {}, joint {}"
_FRICTION = "friction over that of the first run, run of {}"


class BoxConfig(Model):
    """The box, one field per unknown; joint 1 is held in `compare`, so nothing of it is here."""

    link_length_2: Annotated[BoxRange, positive("m", "length of link 2")]
    link_length_3: Annotated[BoxRange, positive("m", "length of link 3, to the tool")]
    link_mass_2: Annotated[BoxRange, positive("kg", "mass of link 2")]
    link_mass_3: Annotated[BoxRange, positive("kg", "mass of link 3")]
    link_com_2: Annotated[BoxRange, nonneg("1", "centre of mass of link 2 over its length", at_most=1.0)]
    link_com_3: Annotated[BoxRange, nonneg("1", "centre of mass of link 3 over its length", at_most=1.0)]
    link_inertia_2: Annotated[BoxRange, positive("1", "central inertia of link 2 over m l²", at_most=1.0)]
    link_inertia_3: Annotated[BoxRange, positive("1", "central inertia of link 3 over m l²", at_most=1.0)]
    rotor_inertia: Annotated[BoxRange, nonneg("kg m2", "inertia of a rotor")]
    reducer_inertia: Annotated[BoxRange, nonneg("kg m2", "inertia of wave generator and coupling")]
    drum_inertia: Annotated[BoxRange, _OnArm("winches.drum_inertia")]
    winch_viscous: Annotated[BoxRange, _OnArm("winches.viscous")]
    tendon_stiffness_2: Annotated[BoxRange, positive("N m rad-1", "stiffness of tendon 2 at joint 2")]
    tendon_stiffness_3: Annotated[BoxRange, positive("N m rad-1", "stiffness of tendon 3 at joint 3")]
    tendon_damping_2: Annotated[BoxRange, nonneg("N m s rad-1", "damping of tendon 2 at joint 2")]
    tendon_damping_3: Annotated[BoxRange, nonneg("N m s rad-1", "damping of tendon 3 at joint 3")]
    clearance_at: Annotated[Words, Field(description="joints whose tendons have clearance")]
    clearance: Annotated[BoxRange, nonneg("m", "slack that a tendon takes up before it pulls")]
    friction_sides: Annotated[Words, Field(description="sides on which dry friction acts")]
    link_coulomb: Annotated[BoxRange, _OnArm("friction.link.coulomb", "friction_sides", "link")]
    link_viscous: Annotated[BoxRange, _OnArm("friction.link.viscous", "friction_sides", "link")]
    link_static_ratio: Annotated[BoxRange, _OnArm("friction.link.static_ratio")]
    link_stribeck_velocity: Annotated[BoxRange, _OnArm("friction.link.stribeck_velocity")]
    winch_coulomb: Annotated[BoxRange, _OnArm("friction.winch.coulomb", "friction_sides", "winch")]
    winch_static_ratio: Annotated[BoxRange, _OnArm("friction.winch.static_ratio")]
    winch_stribeck_velocity: Annotated[BoxRange, _OnArm("friction.winch.stribeck_velocity")]
    pulley_loss_acts: Annotated[Words, Field(description="whether guide pulleys lose tension")]
    pulley_loss: Annotated[BoxRange, _OnArm("friction.per_pulley", "pulley_loss_acts")]
    reducer_loss_acts: Annotated[Words, Field(description="whether the reducer loses torque")]
    reducer_efficiency: Annotated[
        BoxRange, _OnArm("friction.reducer_efficiency", "reducer_loss_acts", off=1.0)
    ]
    tensioner_force: Annotated[BoxRange, _OnArm("tensioner.force")]
    transmission_error_acts: Annotated[Words, Field(description="whether the reducer has angle errors")]
    transmission_error: Annotated[
        BoxRange, _OnArm("transmission_error.peak_to_peak", "transmission_error_acts")
    ]
    torque_limit: Annotated[BoxRange, _OnArm("actuator.torque_limit")]
    torque_resolution_acts: Annotated[Words, Field(description="whether torque comes in steps")]
    torque_resolution: Annotated[BoxRange, _OnArm("actuator.torque_resolution", "torque_resolution_acts")]
    torque_noise_acts: Annotated[Words, Field(description="whether torque is noisy")]
    torque_noise: Annotated[BoxRange, _OnArm("actuator.torque_noise", "torque_noise_acts")]
    encoder_count: Annotated[Choice, nonneg("rad", "angle of one count of the joint encoders")]
    output_delay: Annotated[Choice, nonneg("1", "delay of the command in samples", at_most=100.0)]
    error_rate: Annotated[Words, Field(description="how the error's rate is obtained")]
    filter_cutoff: Annotated[BoxRange, positive("Hz", "cutoff of the low-pass error rate")]
    disturbance: Annotated[Words, Field(description="kind of the disturbance")]
    disturbance_torque: Annotated[BoxRange, nonneg("N m", "amplitude of the sine, RMS of the noise")]
    disturbance_frequency: Annotated[BoxRange, positive("Hz", "frequency of the sine")]
    posture: Annotated[BoxRange, Physical("rad", "joint 1 from hanging", above=0.0, below=math.pi)]
    motion: Annotated[Words, Field(description="kind of the reference motion")]
    amplitude: Annotated[BoxRange, positive("rad", "largest angle of the reference, a joint")]
    period: Annotated[BoxRange, Physical("s", "period of raised cosine and sine", at_least=0.02)]
    rise: Annotated[BoxRange, Physical("s", "duration of a minimum-jerk stroke", at_least=0.02)]
    hold: Annotated[BoxRange, nonneg("s", "pause after a stroke")]
    velocity: Annotated[BoxRange, positive("rad s-1", "largest velocity, trapezoidal")]
    acceleration: Annotated[BoxRange, positive("rad s-2", "acceleration of the ramps, trapezoidal")]
    reference_lag: Annotated[BoxRange, nonneg("s", "time constant of late rates of the reference")]
    offset_controller_1_joint_2: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 1", 2))]
    offset_controller_1_joint_3: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 1", 3))]
    offset_controller_2_joint_2: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 2", 2))]
    offset_controller_2_joint_3: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 2", 3))]
    offset_controller_3_joint_2: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 3", 2))]
    offset_controller_3_joint_3: Annotated[BoxRange, Physical("rad", _OFFSET.format("Controller 3", 3))]
    offset_controller_1_payload_joint_2: Annotated[BoxRange, Physical("rad", _OFFSET.format("payload", 2))]
    offset_controller_1_payload_joint_3: Annotated[BoxRange, Physical("rad", _OFFSET.format("payload", 3))]
    friction_controller_2: Annotated[BoxRange, positive("1", _FRICTION.format("Controller 2"))]
    friction_controller_3: Annotated[BoxRange, positive("1", _FRICTION.format("Controller 3"))]
    friction_controller_1_payload: Annotated[BoxRange, positive("1", _FRICTION.format("payload"))]

    def _mistakes(self) -> Mistakes:
        for name, known in WORDS.items():
            for i, word in enumerate(getattr(self, name).choices):
                if word not in known:
                    yield (name, "choices", i), f"must be one of {', '.join(known)}, found {word!r}"
        # Link 3 reaches posture + 2 amplitudes.
        reached = self.posture.highest + 2.0 * self.amplitude.highest
        if reached >= math.pi:
            reach = f"it would reach {math.degrees(reached):.6g} deg"
            yield ("amplitude", "high"), f"must keep link 3 below 180 deg from hanging, {reach}"


_OVER = " over the radius squared"
PER_JOINT: Mapping[str, Row] = {
    "link_length": Row("links.length"),
    "link_mass": Row("links.mass"),
    "link_com": Row("links.com", lambda x, of: x * of.length, lambda v, of: v / of.length, " of the length"),
    "link_inertia": Row(
        "links.inertia",
        lambda x, of: x * of.mass * of.length**2,
        lambda v, of: v / (of.mass * of.length**2),
        " of m l^2",
    ),
    "tendon_stiffness": Row(
        "tendons.axial_stiffness", lambda x, of: x / of.radius**2, lambda v, of: v * of.radius**2, _OVER
    ),
    "tendon_damping": Row(
        "tendons.axial_damping",
        lambda x, of: x / of.radius**2,
        lambda v, of: of.damping * v * of.radius**2,
        _OVER,
    ),
}
"""Rows that each joint has of its own, without its number; the box has them for joints 2 and 3."""

SHARED: Mapping[str, Row] = {
    "rotor_inertia": Row(
        "winches.reflected_inertia",
        lambda x, of: of.reduction**2 * (x + of.reducer),
        lambda v, of: v / of.reduction**2,
        " and reducer_inertia",
    ),
    **{
        name: item.row
        for name, field in BoxConfig.model_fields.items()
        for item in field.metadata
        if isinstance(item, _OnArm)
    },
}
"""Rows of an arm that all joints share."""
