"""What the page lets a reader move: keys of the configuration, each with a span for its slider."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.quantity import Quantity, Scalar, to_si

READING, CONTROLLER, MOTION, STARTS, ARM = (
    "How the paper is understood",
    "Controllers",
    "Motion",
    "Where each run starts",
    "Load and arm",
)
GROUPS = (CONTROLLER, STARTS, READING, MOTION, ARM)


class Knob(NamedTuple):
    """A key whose numbers can be moved.

    The slider goes from ``least`` to ``most`` in ``unit``, in steps, or by ratio where `step` is 0.
    """

    key: str
    label: str
    group: str
    unit: str
    least: float
    most: float
    step: float
    help: str = ""


GAINS = (
    Knob("control.gains.alpha", "α, weight of the older estimate", CONTROLLER, "1", 0.0, 1.0, 0.01,
        "Controller 1 alone has it. As published, errors of slow loads grow to 1 + α times. With the changed "
        "sign they shrink to 1 − α times."),
    Knob("control.gains.lam", "λ, reaching gain", CONTROLLER, "s-1", 1.0, 20.0, 0.1),
    Knob("control.gains.eta", "η, surface gain of Controllers 1 and 2", CONTROLLER, "1", 0.2, 4.0, 0.05),
    Knob("control.gains.b", "b, exponent of Controllers 1 and 2", CONTROLLER, "1", 0.5, 0.99, 0.01),
    Knob("control.gains.Delta", "Δ, where the surface changes", CONTROLLER, "rad", 0.001, 1.0, 0.0,
        "Near zero error the surface is a polynomial, beyond Δ a power."),
    Knob("control.gains.beta", "β, surface gain of Controller 3", CONTROLLER, "s-1", 0.5, 6.0, 0.05),
    Knob("control.gains.M_bar", "M̄, constant inertia", CONTROLLER, "kg m2", 0.001, 0.1, 0.0,
        "The error of a slow load is inversely proportional to it."),
    Knob("control.filter_cutoff", "Cutoff of the velocity filter", READING, "Hz", 10.0, 400.0, 0.0,
        "Used where the velocity is filtered."),
    Knob("control.reference_lag", "Lag of the reference's rates", READING, "ms", 0.0, 500.0, 5.0,
        "Used where they are late."),
    Knob("manipulator.encoders.joint.resolution", "Encoder step", READING, "deg", 0.0, 0.1, 0.001,
        "0 is an ideal encoder."),
)  # fmt: skip
STROKE = (
    Knob("reference.amplitude", "Stroke", MOTION, "deg", 5.0, 60.0, 0.5),
    Knob("reference.rise", "Duration of a stroke", MOTION, "s", 0.5, 5.0, 0.1),
    Knob("reference.hold", "Pause after a stroke", MOTION, "s", 0.0, 4.0, 0.1),
)
OSCILLATION = (
    Knob("reference.amplitude", "Amplitude", MOTION, "deg", 5.0, 60.0, 0.5),
    Knob("reference.period", "Period", MOTION, "s", 3.0, 20.0, 0.1),
)
SINE = (*OSCILLATION, Knob("reference.offset", "Centre", MOTION, "deg", -30.0, 30.0, 0.5))
PLANT = (
    Knob("manipulator.links.mass", "Mass of the link", ARM, "kg", 0.05, 2.0, 0.0),
    Knob("manipulator.links.length", "Length of the link", ARM, "m", 0.1, 0.5, 0.005,
        "The centre of mass stays where it is."),
    Knob("manipulator.tendons.axial_stiffness", "Stiffness of the tendon", ARM, "N m-1", 1e4, 3e6, 0.0),
    Knob("manipulator.tendons.damping_factor", "Factor on all tendons' damping", ARM, "1", 0.5, 20.0, 0.0),
    Knob("manipulator.friction.winch.coulomb", "Dry friction of the winch", ARM, "N m", 0.0, 3.0, 0.02),
    Knob("manipulator.winches.reflected_inertia", "Inertia at the winch", ARM, "kg m2", 0.01, 1.0, 0.0),
)  # fmt: skip


LATE = "late"
"""Reading whose lag a configuration may lack."""


@dataclass(frozen=True)
class Menu:
    """A reading whose values change numbers alone, and the words for its values."""

    name: str
    label: str
    words: Mapping[str, str]
    help: str = ""


MENUS = (
    Menu("weights", "Weights of the two estimates, Eq. (15)",
        {"interpolating": "1 − α and α, as published", "extrapolating": "1 + α and −α, a changed sign"}),
    Menu("Delta_unit", "Unit of Δ", {"rad": "radians", "deg": "degrees"}),
    Menu("reference_acceleration", "Acceleration of the reference, Eq. (18)",
        {"fed_forward": "fed forward, as published", "absent": "not fed forward", LATE: "late"},
        "Without it, the reference causes an error of its own, the same for all controllers."),
    Menu("error_rate", "Velocity",
        {"backward_difference": "difference of encoder values", "low_pass": "the same, low-pass filtered"}),
)  # fmt: skip
RUN = (
    Knob("start_offset", "Start of {}", STARTS, "deg", -3.0, 3.0, 0.05, "Joint angle less the reference."),
    Knob("payload", "Payload of {}", ARM, "kg", 0.0, 1.0, 0.01),
)
"""Knobs of single runs."""

LEFT_OUT = Knob(
    "errors_from",
    "Start left out of the errors",
    STARTS,
    "s",
    0.0,
    4.0,
    0.1,
    "The tables leave out the start of each run. At the published gains a fifth of a start offset is left "
    "after one second, and hardly anything after two.",
)
OF_MOTION = {
    "minimum_jerk": STROKE,
    "ramp": STROKE,
    "raised_cosine": OSCILLATION,
    "sine": SINE,
}
"""Knobs of the motion, by its kind."""


def knobs_of(config: CompareConfig) -> Iterator[Knob]:
    """The controls of a configuration, apart from those of single runs."""
    for knob in (*GAINS, *OF_MOTION.get(config.reference.kind, ()), *PLANT):
        if attrgetter(knob.key)(config) is not None:
            yield knob


def menus_of(config: CompareConfig) -> list[Menu]:
    """The readings that can be chosen; a value that needs another trace stays as configured."""
    control, menus = config.control, []
    lacking = {
        "error_rate": control.filter_cutoff is None,
        "Delta_unit": control.readings.gain_unit != "radian",
    }
    for menu in MENUS:
        if getattr(control.readings, menu.name) in menu.words and not lacking.get(menu.name):
            words = dict(menu.words)
            if control.reference_lag is None:
                words.pop(LATE, None)
            menus.append(replace(menu, words=words))
    return menus


def factor_to(unit: str, quantity: Quantity) -> float:
    """How many of a unit the unit of a quantity is."""
    return 1.0 if quantity.unit == unit else to_si(1.0, quantity.unit) / to_si(1.0, unit)


def entries_of(config: CompareConfig, key: str) -> list[tuple[int | None, str]]:
    """Entries of a key's quantity, None for a scalar, and the joint that each is of."""
    quantity = attrgetter(key)(config)
    if isinstance(quantity, Scalar):
        return [(None, "")]
    joints, every = config.joints, len(quantity.value)
    return [(every - len(joints) + k, f"joint {joint}") for k, joint in enumerate(joints)]


class Inputs(NamedTuple):
    """What can be moved, in the order of the inputs' array.

    ``numbers`` are dotted keys, with the entry where a key holds a vector; ``units`` are theirs, by key.
    ``readings`` have their values.
    """

    numbers: Sequence[tuple[str, int | None]]
    units: Mapping[str, str]
    readings: Mapping[str, Sequence[str]]


def inputs_of(config: CompareConfig) -> Inputs:
    """What the code of a configuration takes as inputs."""
    numbers = [(knob.key, entry) for knob in knobs_of(config) for entry, _ in entries_of(config, knob.key)]
    units = {knob.key: knob.unit for knob in knobs_of(config)}
    return Inputs(numbers, units, {menu.name: tuple(menu.words) for menu in menus_of(config)})
