"""A draw in a comparison: how its numbers are put there, and how they are read off."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from functools import reduce
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models import readings
from tendonrepro.configuration.models.box import FAST_PERIOD, PER_JOINT, SHARED, WORDS, Draw, Joint, word_of
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.reference import ReferenceConfig
from tendonrepro.configuration.published import COMPARED
from tendonrepro.configuration.quantity import UNITS, to_si
from tendonrepro.configuration.strict_yaml import Node, Tree, entry
from tendonrepro.physics.trajectory import trapezoid_times

GRID = 0.01
"""Times of a motion are multiples of this, s, so that every sampling period divides them."""

UNEQUAL = 2.0 / 3.0
"""Amplitude of joint 2 over that of joint 3 in the motion ``unequal``."""

_NOISE_BAND, _NOISE_SINES = (0.5, 20.0), 8
"""Band of the disturbance ``noise``, Hz, and the number of sines that make it."""


_MOTIONS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "minimum_jerk": ("minimum_jerk", ("rise", "hold")),
    "ramp": ("ramp", ("rise", "hold")),
    "trapezoidal": ("trapezoidal", ("velocity", "acceleration", "hold")),
    "raised_cosine": ("raised_cosine", ("period",)),
    "unequal": ("raised_cosine", ("period",)),
    "sine": ("sine", ("period",)),
    "fast_sine": ("sine", ("period",)),
}
"""Kind and times of each motion that a draw may have."""

_UNITS = {"velocity": "rad s-1", "acceleration": "rad s-2"}


def drawn_comparison(base: Tree, draw: Draw, shortest_run: float) -> CompareConfig:
    """Validated comparison of one draw of every row of the box, every axis of readings as printed.

    Periods are repeated, at least twice, until the motion lasts `shortest_run`, s.
    """
    tree = _copied(base)
    _put_arm(tree["manipulator"], draw)
    # Links 2 and 3 start in line with link 1: the workspace of the box rests on it.
    tree["posture"] = _drawn([draw["posture"], 0.0, 0.0], "rad", "posture")
    tree["control"]["filter_cutoff"] = _drawn(draw["filter_cutoff"], "Hz", "filter_cutoff")
    tree["control"]["reference_lag"] = _drawn(draw["reference_lag"], "s", "reference_lag")
    tree["reference"] = _reference(draw, shortest_run)
    tree["disturbance"] = _disturbance(draw)
    always = np.array([value for row, value in draw.items() if row not in readings.UNDER_READINGS])
    seed = zlib.crc32(always.tobytes())
    tree["seed"] = _drawn(seed, "1", "its checksum, so that each has its own noise")
    return readings.as_printed(CompareConfig.model_validate(tree))


def scaled_comparison(base: Tree, factors: Draw, source: str) -> Tree:
    """Plain values of a comparison whose arm's values are multiplied by factors, by row; the others stay.

    A row of each joint ends in its number. Centres of mass and inertias move with what they are shares of.
    What is off stays off.
    """
    tree = _copied(base)
    arm = tree["manipulator"]
    count = len(arm["links"]["length"]["value"])
    joints = [
        Joint(factors.get(f"link_length_{i + 1}", 1.0), factors.get(f"link_mass_{i + 1}", 1.0))
        for i in range(count)
    ]
    for name, row in PER_JOINT.items():
        quantity = entry(arm, row.key.split("."))
        each = [row.put(factors.get(f"{name}_{i + 1}", 1.0), joint) for i, joint in enumerate(joints)]
        quantity |= {"value": (np.array(quantity["value"]) * each).tolist(), "source": source}
    for name, row in SHARED.items():
        if name in factors:
            quantity = entry(arm, row.key.split("."))
            quantity |= {"value": (np.array(quantity["value"]) * factors[name]).tolist(), "source": source}
    return tree


def _copied(tree: Mapping[str, Node]) -> Tree:
    """Copy of sections, whose values themselves are shared."""
    return {key: _copied(value) if isinstance(value, Mapping) else value for key, value in tree.items()}


def _drawn(value: object, unit: str, row: str) -> Tree:
    return {"value": value, "unit": unit, "source": readings.of_row(row)}


def idle_rows(draw: Draw) -> set[str]:
    """Rows of the box that do nothing in a draw, because what they are of is off."""
    idle = {name for name, row in SHARED.items() if not row.acts(draw)}
    kind = word_of(draw, "disturbance")
    idle |= {"disturbance_torque"} if kind == "none" else set()
    idle |= {"disturbance_frequency"} if kind != "sine" else set()
    return idle | ({"clearance"} if word_of(draw, "clearance_at") == "none" else set())


def _put_arm(arm: Tree, draw: Draw) -> None:
    """Fill in the manipulator of the paper's arm; joint 1 is held, so its entries do not matter."""

    def put(key: str, value: object, row: str) -> None:
        quantity = entry(arm, key.split("."))
        alike = isinstance(quantity["value"], list) and not isinstance(value, list)
        value = [value] * len(quantity["value"]) if alike else value
        quantity |= _drawn(value, UNITS[quantity["unit"]].si, row)

    reduction, diameter = arm["winches"]["reduction"]["value"], arm["routing"]["pulley_diameter"]
    joints = [
        Joint(
            draw[f"link_length_{joint}"],
            draw[f"link_mass_{joint}"],
            to_si(diameter["value"][joint - 1][joint - 1], diameter["unit"]) / 2.0,
            reduction=reduction,
            reducer=draw["reducer_inertia"],
        )
        for joint in COMPARED
    ]
    for name, row in PER_JOINT.items():
        two, three = (row.put(draw[f"{name}_{i}"], of) for i, of in zip(COMPARED, joints, strict=True))
        put(row.key, [two, two, three], name + row.about)
    for name, row in SHARED.items():
        value = row.put(draw[name], joints[-1]) if row.acts(draw) else row.off
        put(row.key, value, name + row.about)
    for side in ("link", "winch"):
        stribeck = f"{side}_stribeck_velocity"
        put(f"friction.{side}.smoothing_velocity", draw[stribeck] / 2.0, f"half of {stribeck}")
    at = word_of(draw, "clearance_at")
    two, three = (draw["clearance"] * (at in joint) for joint in (("both",), ("both", "distal")))
    put("tendons.clearance", [two, two, three], "clearance and clearance_at")
    put("tendons.damping_factor", 1.0, "which has the damping itself")
    arm["tensioner"]["side"] = readings.AXES["tensioner"].printed


def _disturbance(draw: Draw) -> Tree:
    disturbance: Tree = {"kind": word_of(draw, "disturbance")}
    if disturbance["kind"] != "none":
        torque = [draw["disturbance_torque"]] * len(COMPARED)
        disturbance["torque"] = _drawn(torque, "N m", "disturbance_torque")
    if disturbance["kind"] == "sine":
        frequency = draw["disturbance_frequency"]
        disturbance["frequency"] = _drawn(frequency, "Hz", "disturbance_frequency")
    elif disturbance["kind"] == "noise":
        disturbance["band"] = _drawn(list(_NOISE_BAND), "Hz", "disturbance, whose band is fixed")
        told = "disturbance, whose number of sines is fixed"
        disturbance["components"] = _drawn(_NOISE_SINES, "1", told)
    return disturbance


def _reference(draw: Draw, shortest_run: float) -> Tree:
    """Motion of both joints, by equal angles except in ``unequal``."""
    name = word_of(draw, "motion")
    kind, rows = _MOTIONS[name]
    times = {row: draw[row] if row in _UNITS else _on_grid(draw[row]) for row in rows}
    if name == "trapezoidal":
        _, rise = trapezoid_times(draw["amplitude"], times["velocity"], times["acceleration"])
        half = _on_grid(rise + draw["hold"] + GRID / 2.0)  # never shorter than the stroke
        times["hold"], cycle = half - rise, 2.0 * half
    elif "period" in times:
        cycle = times["period"] = FAST_PERIOD if name == "fast_sine" else times["period"]
    else:
        cycle = 2.0 * (times["rise"] + times["hold"])
    size = 0.5 if kind == "sine" else 1.0  # a sine swings about the middle of the same range
    share = UNEQUAL if name == "unequal" else 1.0
    amplitude = _drawn([size * share * draw["amplitude"], size * draw["amplitude"]], "rad", "amplitude")
    shape = {row: _drawn(value, _UNITS.get(row, "s"), row) for row, value in times.items()}
    if kind == "sine":
        shape |= {"blend": _drawn(cycle / 2.0, "s", "half the period"), "offset": amplitude}
    periods = max(2.0, float(np.ceil(shortest_run / cycle)))
    told = _drawn(periods, "1", "as many as the shortest run asks for")
    return {"kind": kind, **shape, "amplitude": amplitude, "periods": told}


def _on_grid(time: float) -> float:
    return round(time / GRID) * GRID


def values_of(config: CompareConfig, nominal: Draw) -> dict[str, float]:
    """Number of every row that a comparison has: the inverse of `drawn_comparison`.

    A row that the comparison does not have keeps its nominal: the size of an effect that is off, the times
    of another kind of motion. Of rotor and reducer a comparison has the sum alone, which is shared out as the
    nominals are. Where the comparison cannot be a draw, as with a sampled motion, rows stay nominal too.
    """
    values = dict([*_of_arm(config.manipulator), *_of_runs(config), *_of_motion(config.reference)])
    motor, rows = values["rotor_inertia"], ("rotor_inertia", "reducer_inertia")
    values |= {row: motor * nominal[row] / sum(nominal[name] for name in rows) for row in rows}
    return {row: float(values.get(row, value)) for row, value in nominal.items()}


def _place(row: str, word: str) -> tuple[str, float]:
    return row, float(WORDS[row].index(word))


def held_values(arm: Manipulator, key: str) -> Array:
    """Values of a key below the manipulator, SI, (joints,) or (1,)."""
    quantity: Any = reduce(getattr, key.split("."), arm)
    return np.atleast_1d(quantity.si)


def _of_arm(arm: Manipulator) -> Iterator[tuple[str, float]]:
    for joint in COMPARED:
        i = joint - 1
        of = Joint(
            arm.links.length.si[i],
            arm.links.mass.si[i],
            arm.routing.pulley_diameter.si[i, i] / 2.0,
            arm.tendons.damping_factor.si,
            arm.winches.reduction.si,
        )
        yield from (
            (f"{name}_{joint}", row.get(held_values(arm, row.key)[i], of)) for name, row in PER_JOINT.items()
        )
    # What all joints share is that of the last one.
    numbers = {name: row.get(float(held_values(arm, row.key)[-1]), of) for name, row in SHARED.items()}
    # Of friction one number above zero lets its side act, with all that is said of it.
    acting = {(row.switch, row.word) for name, row in SHARED.items() if numbers[name] != row.off}
    yield from (
        (name, numbers[name])
        for name, row in SHARED.items()
        if not row.switch or (row.switch, row.word) in acting
    )
    for switch in {row.switch for row in SHARED.values() if row.switch}:
        words = [word for of, word in acting if of == switch]
        yield _place(switch, "both" if len(words) > 1 else words[0] if words else WORDS[switch][0])
    two, three = arm.tendons.clearance.si[1:]
    yield _place("clearance_at", "both" if two > 0.0 else "distal" if three > 0.0 else "none")
    if slack := max(two, three):
        yield "clearance", slack
    yield "encoder_count", arm.encoders.joint.resolution.si
    yield "output_delay", arm.actuator.output_delay.si


def _of_runs(config: CompareConfig) -> Iterator[tuple[str, float]]:
    control, disturbance = config.control, config.disturbance
    yield "posture", config.posture.si[0]
    if control.readings.error_rate in readings.ERROR_RATES:
        yield _place("error_rate", control.readings.error_rate)
    for row in ("filter_cutoff", "reference_lag"):
        if quantity := getattr(control, row):
            yield row, quantity.si
    if disturbance.kind in WORDS["disturbance"]:
        yield _place("disturbance", disturbance.kind)
        if disturbance.kind in ("sine", "noise"):
            yield "disturbance_torque", disturbance.torque.si[-1]
        if disturbance.kind == "sine":
            yield "disturbance_frequency", disturbance.frequency.si
    # Runs start on their reference, with equal friction, unless the comparison says otherwise.
    for (name, joint), row in readings.OFFSETS.items():
        offset = config.runs[name].start_offset
        yield row, 0.0 if offset is None else offset.si[joint - 2]
    for name, row in readings.FRICTIONS.items():
        yield row, config.runs[name].friction_factor


def _of_motion(reference: ReferenceConfig) -> Iterator[tuple[str, float]]:
    """Kind and sizes of a motion; nothing of one that no draw has."""
    motion: Any = reference
    name = motion.kind
    if name not in _MOTIONS:
        return
    two, three = motion.amplitude.si
    if name == "raised_cosine" and np.isclose(two, UNEQUAL * three):
        name = "unequal"
    if name == "sine" and motion.period.si == FAST_PERIOD:
        name = "fast_sine"
    yield _place("motion", name)
    yield "amplitude", three * (2.0 if motion.kind == "sine" else 1.0)
    for row in _MOTIONS[name][1]:
        # A draw's strokes end on the grid, rounded upwards; these do already.
        early = GRID / 2.0 if (name, row) == ("trapezoidal", "hold") else 0.0
        yield row, getattr(motion, row).si - early
