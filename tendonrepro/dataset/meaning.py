"""A guess at what each column of a data set is, with the reasons.

Names speak first. Numbers then settle what names leave open: which column is time, which is the difference of
two others, which follows which, degrees or radians, motor or joint through the coupling. A guess is never
certain, so every one carries its reasons into the mapping, where a user confirms or mends it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.columns import Column, columns_of
from tendonrepro.dataset.evidence import (
    COUPLED,
    SAME_COURSE,
    counted_in,
    difference_of,
    distance,
    roughness,
    sampling_step,
)
from tendonrepro.dataset.signals import Source
from tendonrepro.dataset.units import FACTORS

MOST_COMPARED = 24
"""Largest number of columns of one table that are compared with each other."""
HALF_TURN = 3.3
"""No joint of the arm turns further, rad."""
_ANGLES = ("desired", "measured", "error", "motor", "calculated")
# What their units have behind that of the angles; nothing for torques.
_OTHERS = {"rate": "/s", "surface": "/s", "acceleration": "/s^2", "torque": "", "estimate": ""}
_REDUCER = 100.0
# A tracking error of some tenths of a degree, in either unit.
_SMALL_RAD = 0.02


def understand(sources: Iterable[Source], S_inv: Array) -> list[Column]:
    """Guess what every column is.

    Parameters
    ----------
    sources : iterable of Source
    S_inv : Array
        Inverse coupling of all joints, (3, 3).

    Returns
    -------
    list of Column
        All columns, those that could not be understood without a quantity.
    """
    columns = columns_of(sources)
    groups: dict[tuple[str, str, int], list[Column]] = defaultdict(list)
    for column in columns:
        groups[column.group].append(column)
    for group in groups.values():
        _find_time(group)
        _find_differences(group)
        _find_pairs(group)
    for source in {id(column.source): column.source for column in columns}.values():
        _find_units([column for column in columns if column.source is source])
    for group in groups.values():
        _find_joints(group)
        _find_motors(group, S_inv)
    return columns


def _find_time(group: Sequence[Column]) -> None:
    """Name the time axis of a group, and hand it to the others."""
    steps = {column: sampling_step(column.values) for column in group}
    named = [column for column in group if column.quantity == "time"]
    unnamed = [column for column in group if column.own.quantity is None and steps[column]]
    for column in named:
        if steps[column] is None:
            column.because.append("although it does not increase evenly")
    chosen = next(iter([column for column in named if steps[column]] or named or unnamed[:1]), None)
    if chosen is None:
        return
    if chosen.quantity != "time":
        chosen.call("time", f"it increases evenly, by {steps[chosen]:g}")
    if chosen.unit not in FACTORS["time"]:
        chosen.unit = _time_unit(steps[chosen])
        chosen.because.append(f"taken to be in {chosen.unit}")
    for column in group:
        if column is not chosen and column.signal.time is None:
            column.time = chosen.address


def _time_unit(step: float | None) -> str:
    """Seconds, unless a step of a whole second or more shows milliseconds of a fast loop."""
    return "ms" if step is not None and step >= 1.0 else "s"


def _open(group: Iterable[Column]) -> list[Column]:
    """Columns that could still be angles."""
    return [column for column in group if column.quantity in {None, "desired", "measured", "error"}][
        :MOST_COMPARED
    ]


def _find_differences(group: Sequence[Column]) -> None:
    """Recognise an error by the two columns whose difference it is."""
    angles = _open(group)
    if all(column.own.quantity for column in angles):
        return
    values = {str(place): column.values for place, column in enumerate(angles)}
    for place, column in enumerate(angles):
        if column.own.quantity not in {None, "error"}:
            continue
        others = {name: array for name, array in values.items() if name != str(place)}
        found = difference_of(column.values, others)
        # Of three columns any is a difference of the others; the error is the one that is small.
        if found is None or np.nanmax(np.abs(column.values)) > 0.5 * np.nanmax(np.abs(values[found[0]])):
            continue
        minuend, subtrahend = (angles[int(name)] for name in found)
        names = f"{minuend.signal.path} less {subtrahend.signal.path}"
        if column.quantity is None:
            column.call("error", f"it is {names}")
        for other, quantity in ((minuend, "desired"), (subtrahend, "measured")):
            if other.quantity is None:
                other.call(quantity, f"{column.signal.path} is {names}")  # type: ignore[arg-type]


def _find_pairs(group: Sequence[Column]) -> None:
    """Take two unnamed columns that follow each other for a desired angle and a measured one."""
    unnamed = [column for column in _open(group) if column.quantity is None]
    counted = {column: counted_in(column.values) is not None for column in unnamed}
    for a, b in combinations(unnamed, 2):
        # Two joints may be sent along the same course, and two encoders may follow it.
        if a.quantity or b.quantity or (counted[a] and counted[b]):
            continue
        if not 0.0 < distance(a.values, b.values) <= SAME_COURSE:
            continue
        smooth, rough = sorted((a, b), key=lambda column: roughness(column.values))
        reason = f"{a.signal.path} and {b.signal.path} follow each other, and it is the"
        smooth.call("desired", f"{reason} smoother one")
        rough.call("measured", f"{reason} rougher one")


def _find_units(columns: Sequence[Column]) -> None:
    """Settle degrees or radians for the angles of one file."""
    angles = [column for column in columns if column.quantity in _ANGLES]
    for column in angles:
        if column.unit is None and (unit := counted_in(column.values)):
            column.unit = unit
            column.because.append(f"its steps are one encoder count in {unit}")
    told = {column.unit for column in angles if column.unit in {"deg", "rad"}}
    shared, reason = (
        _shared_unit(angles) if len(told) != 1 else (told.pop(), "as the other angles of its file")
    )
    for column in angles:
        if column.unit is None:
            column.unit = shared
            column.because.append(f"{shared}: {reason}")
    for column in columns:
        if column.unit is None and column.quantity in {
            "rate",
            "acceleration",
            "surface",
            "torque",
            "estimate",
        }:
            power = {"rate": "/s", "surface": "/s", "acceleration": "/s^2"}.get(column.quantity)
            column.unit = f"{shared}{power}" if power else "N m"
            column.because.append(f"{column.unit}: no unit is given")


def _shared_unit(angles: Sequence[Column]) -> tuple[str, str]:
    """Degrees or radians by the size of the angles, else of the errors."""
    sizes = [float(np.nanmax(np.abs(c.values))) for c in angles if c.quantity in {"desired", "measured"}]
    if sizes:
        largest = max(sizes)
        if largest > HALF_TURN:
            return "deg", f"an angle reaches {largest:.3g}, and no joint turns by more than half a turn"
        return "rad", f"the largest angle is {largest:.3g}; in degrees there would hardly be a motion"
    errors = [float(np.nanmean(np.abs(c.values))) for c in angles if c.quantity == "error"]
    if errors and max(errors) > _SMALL_RAD:
        return "deg", f"a mean error of {max(errors):.2g} would be more than a degree in rad"
    return "rad", "nothing says otherwise; look at it"


def _find_joints(group: Sequence[Column]) -> None:
    """Number columns without a joint in their name by their order: two are joints 2 and 3, three are all."""
    kinds: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in group:
        if column.quantity not in {None, "time"}:
            of = (column.quantity, column.own.of_motor, column.own.desired, column.controller)
            kinds[of].append(column)
    for alike in kinds.values():
        unnumbered = [column for column in alike if column.joint is None]
        same = len(alike) > 1 and len({column.joint for column in alike}) == 1
        if len(alike) not in {2, 3} or not (len(unnumbered) == len(alike) or same):
            continue
        first = 4 - len(alike)
        for joint, column in enumerate(alike, start=first):
            column.joint = joint
            column.because.append(f"joint {joint} by its place among {len(alike)} like it")


def _find_motors(group: Sequence[Column], S_inv: Array) -> None:
    """Recognise motor angles, at the winch or before the reducer, by the coupling with the joints."""
    joints = {c.joint: c for c in group if c.quantity == "measured" and c.joint and not c.own.of_motor}
    joints = {joint: column for joint, column in joints.items() if joint in {1, 2, 3}}
    if not joints:
        return
    q = np.zeros((len(next(iter(joints.values())).values), 3))
    for joint, column in joints.items():
        q[:, joint - 1] = _radians(column)
    expected = q @ S_inv.T
    for column in group:
        if column.quantity == "motor" or (column.quantity is None and len(joints) > 1):
            column.unit = column.unit or next(iter(joints.values())).unit
            _match_motor(column, expected)


def _match_motor(column: Column, expected: Array) -> None:
    motors = [column.joint - 1] if column.quantity == "motor" and column.joint else [0, 1, 2]
    tries = [
        (distance(expected[:, motor], sign * _radians(column) / ratio), motor, sign, ratio)
        for motor in motors
        for sign in (1.0, -1.0)
        for ratio in (1.0, _REDUCER)
    ]
    rest, motor, sign, ratio = min(tries)
    if rest > COUPLED:
        return
    where = "before the reducer" if ratio == _REDUCER else "at the winch"
    column.quantity, column.joint, column.scale = "motor", motor + 1, sign / ratio
    column.because.append(f"it is motor {motor + 1} {where}: S_inv times the joint angles, to {rest:.1%}")


def _radians(column: Column) -> Array:
    return column.values * FACTORS["angle"].get(column.unit or "rad", 1.0)
