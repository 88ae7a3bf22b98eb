"""The values that a comparison has in the rows of the box: what a search leaves alone stays at these."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import FAST_PERIOD
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.box import WORDS
from tendonrepro.configuration.models.experiment import NoDisturbance, NoiseDisturbance, SineDisturbance
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.readings import ERROR_RATES, FRICTIONS, OFFSETS
from tendonrepro.configuration.models.reference import (
    MinimumJerk,
    PerJoint,
    RaisedCosine,
    Ramp,
    ReferenceConfig,
    Sampled,
    Sine,
    Trapezoidal,
)
from tendonrepro.monte_carlo.box import GRID, UNEQUAL, Box

_Values = Iterator[tuple[str, float]]
"""Rows and their values, SI; a word counts as its place in `WORDS`."""


def values_of(config: CompareConfig, box: Box) -> Array:
    """Values (P,) of the rows of a box, SI, that a comparison has: the inverse of `configured`.

    A row that the comparison does not have keeps its nominal: the size of an effect that is off, the times
    of another kind of motion. Of rotor and reducer a comparison has the sum alone, which is shared out as the
    nominals are. Where the comparison cannot be a draw, as with a sampled motion, rows stay nominal too.
    """
    nominal = box.named(box.nominal)
    values = {
        **dict(_links(config.manipulator)),
        **dict(_drive(config.manipulator, nominal)),
        **dict(_friction(config.manipulator)),
        **dict(_options(config.manipulator)),
        **dict(_disturbance(config)),
        **dict(_motion(config.reference)),
        **dict(_control(config)),
        **dict(_runs(config)),
    }
    return np.array([values.get(name, nominal[name]) for name in box.names], dtype=np.float64)


def _place(row: str, word: str) -> tuple[str, float]:
    return row, float(WORDS[row].index(word))


def _switch(row: str, acts: bool, value: float) -> _Values:
    """A switch, and the size of what it switches where it acts."""
    yield _place(f"{row}_acts", "on" if acts else "off")
    if acts:
        yield row, value


def _links(arm: Manipulator) -> _Values:
    links = arm.links
    length, mass, com, inertia = links.length.si, links.mass.si, links.com.si, links.inertia.si
    # Rows are of joints 2 and 3, entries of joints 1 to 3.
    for joint, i in ((2, 1), (3, 2)):
        yield f"link_length_{joint}", length[i]
        yield f"link_mass_{joint}", mass[i]
        yield f"link_com_{joint}", com[i] / length[i]
        yield f"link_inertia_{joint}", inertia[i] / (mass[i] * length[i] ** 2)


def _drive(arm: Manipulator, nominal: dict[str, float]) -> _Values:
    winches, tendons = arm.winches, arm.tendons
    motor = winches.reflected_inertia.si[2] / winches.reduction.si**2
    of_motor = ("rotor_inertia", "reducer_inertia")
    for row in of_motor:
        yield row, motor * nominal[row] / sum(nominal[name] for name in of_motor)
    yield "drum_inertia", winches.drum_inertia.si[2]
    yield "winch_viscous", winches.viscous.si[2]
    for joint, i in ((2, 1), (3, 2)):
        square = (arm.routing.pulley_diameter.si[i, i] / 2.0) ** 2
        yield f"tendon_stiffness_{joint}", tendons.axial_stiffness.si[i] * square
        yield f"tendon_damping_{joint}", tendons.damping_factor.si * tendons.axial_damping.si[i] * square
    two, three = tendons.clearance.si[1:]
    yield _place("clearance_at", "both" if two > 0.0 else "distal" if three > 0.0 else "none")
    if slack := max(two, three):
        yield "clearance", slack


def _friction(arm: Manipulator) -> _Values:
    friction = arm.friction
    on_links = friction.link.coulomb.si[2] > 0.0 or friction.link.viscous.si[2] > 0.0
    on_winches = friction.winch.coulomb.si[2] > 0.0
    sides = {(False, False): "none", (True, False): "link", (False, True): "winch", (True, True): "both"}
    yield _place("friction_sides", sides[on_links, on_winches])
    if on_links:
        yield "link_coulomb", friction.link.coulomb.si[2]
        yield "link_viscous", friction.link.viscous.si[2]
    if on_winches:
        yield "winch_coulomb", friction.winch.coulomb.si[2]
    for side, part in (("link", friction.link), ("winch", friction.winch)):
        yield f"{side}_static_ratio", part.static_ratio.si[2]
        yield f"{side}_stribeck_velocity", part.stribeck_velocity.si[2]
    yield from _switch("pulley_loss", friction.per_pulley.si > 0.0, friction.per_pulley.si)
    efficiency = friction.reducer_efficiency.si
    yield _place("reducer_loss_acts", "on" if efficiency < 1.0 else "off")
    if efficiency < 1.0:
        yield "reducer_efficiency", efficiency


def _options(arm: Manipulator) -> _Values:
    yield "tensioner_force", arm.tensioner.force.si
    error, actuator = arm.transmission_error.peak_to_peak.si, arm.actuator
    yield from _switch("transmission_error", error > 0.0, error)
    yield "torque_limit", actuator.torque_limit.si[2]
    for row in ("torque_resolution", "torque_noise"):
        size = getattr(actuator, row).si
        yield from _switch(row, size > 0.0, size)
    yield "encoder_count", arm.encoders.joint.resolution.si
    yield "output_delay", actuator.output_delay.si


def _disturbance(config: CompareConfig) -> _Values:
    disturbance = config.disturbance
    match disturbance:
        case NoDisturbance():
            yield _place("disturbance", "none")
        case SineDisturbance():
            yield _place("disturbance", "sine")
            yield "disturbance_torque", disturbance.torque.si[-1]
            yield "disturbance_frequency", disturbance.frequency.si
        case NoiseDisturbance():
            yield _place("disturbance", "noise")
            yield "disturbance_torque", disturbance.torque.si[-1]


def _motion(reference: ReferenceConfig) -> _Values:
    """Kind and sizes of a motion; nothing of one that no draw has."""
    kind: str = reference.kind
    match reference:
        case Sampled() | PerJoint():
            return
        case MinimumJerk() | Ramp():
            yield "rise", reference.rise.si
            yield "hold", reference.hold.si
        case Trapezoidal():
            yield "velocity", reference.velocity.si
            yield "acceleration", reference.acceleration.si
            # A draw's strokes end on the grid, rounded upwards; these do already.
            yield "hold", reference.hold.si - GRID / 2.0
        case RaisedCosine():
            yield "period", reference.period.si
            two, three = reference.amplitude.si
            kind = "unequal" if np.isclose(two, UNEQUAL * three) else kind
        case Sine():
            yield "period", reference.period.si
            kind = "fast_sine" if reference.period.si == FAST_PERIOD else kind
    yield _place("motion", kind)
    yield "amplitude", reference.amplitude.si[-1] * (2.0 if kind in ("sine", "fast_sine") else 1.0)


def _control(config: CompareConfig) -> _Values:
    control = config.control
    yield "posture", config.posture.si[0]
    if control.readings.error_rate in ERROR_RATES:
        yield _place("error_rate", control.readings.error_rate)
    for row in ("filter_cutoff", "reference_lag"):
        if quantity := getattr(control, row):
            yield row, quantity.si


def _runs(config: CompareConfig) -> _Values:
    """Runs start on their reference, with equal friction, unless the comparison says otherwise."""
    for (name, joint), row in OFFSETS.items():
        offset = config.runs[name].start_offset
        yield row, 0.0 if offset is None else offset.si[joint - 2]
    for name, row in FRICTIONS.items():
        scale = config.runs[name].friction_scale
        yield row, 1.0 if scale is None else scale.si


def box_at(box: Box, config: CompareConfig) -> Box:
    """Box whose rows keep what a comparison has, where they are not free."""
    return replace(box, nominal=values_of(config, box))
