"""A guess at what each column of a data set is, with the reasons.

Names speak first. Numbers then settle what names leave open: which column is time, which is the difference of
two others, which follows which, degrees or radians, motor or joint through the coupling. A guess is never
certain, so every one carries its reasons into the mapping, where a user confirms or mends it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.columns import SHORTEST, Column, Group, columns_of
from tendonrepro.dataset.coupled import find_motors
from tendonrepro.dataset.evidence import (
    SAME_COURSE,
    counted_in,
    difference_of,
    distance,
    roughness,
    sampling_step,
)
from tendonrepro.dataset.signals import Source
from tendonrepro.dataset.units import FACTORS
from tendonrepro.dataset.words import Quantity

MOST_COMPARED = 24
"""Largest number of columns of one table that are compared with each other."""
HALF_TURN = 3.3
"""No joint of the arm turns further, rad."""
WINCH_TURN = 7.0
"""Nor does a winch, which turns up to 77/37 times as far, rad."""

PANELS: Mapping[int, Mapping[str | None, tuple[Quantity | None, int | None]]] = {
    9: {None: ("motor", None)},
    10: {None: (None, 1)},
    11: {None: (None, 2)},
    12: {None: (None, 3)},
    14: {"a": ("measured", 2), "b": ("measured", 3), "c": ("error", 2), "d": ("error", 3)},
    15: {
        "a": ("surface", 2), "b": ("surface", 3), "c": ("estimate", 2), "d": ("estimate", 3),
        "e": ("torque", 2), "f": ("torque", 3),
    },
    16: {"a": ("measured", 2), "b": ("measured", 3)},
}  # fmt: skip
"""What the paper's figures show, panel by panel; None stands for a figure without panels."""

_ANGLES = ("desired", "measured", "error", "motor", "calculated")
# What their units have behind that of the angles; nothing for torques.
_OTHERS = {"rate": "/s", "surface": "/s", "acceleration": "/s^2", "torque": "", "estimate": ""}
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
    long = [column for column in columns if len(column.values) >= SHORTEST]
    groups: dict[Group, list[Column]] = defaultdict(list)
    files: dict[str, list[Column]] = defaultdict(list)
    for column in long:
        groups[column.group].append(column)
        files[column.source.name].append(column)
    for group in groups.values():
        _find_time(group)
    for file in files.values():
        _share_time(file)
    for column in long:
        _find_panel(column)
    for group in groups.values():
        _find_differences(group)
        _find_pairs(group)
    for file in files.values():
        _find_units(file)
    for group in groups.values():
        _find_joints(group)
        find_motors(group, S_inv)
    for column in long:
        _doubt(column)
    return columns


def _find_time(group: Sequence[Column]) -> None:
    """Name the time axis of a group, and hand it to the others."""
    steps = {column: sampling_step(column.values) for column in group}
    for column in group:
        if column.quantity == "index" or (column.own.quantity is None and _counts(column.values)):
            column.call("index", "it counts samples")
    named = [column for column in group if column.quantity == "time"]
    unnamed = [column for column in group if column.quantity is None and steps[column]]
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


def _counts(values: Array) -> bool:
    """Whether numbers are 0, 1, 2 or 1, 2, 3 and so on."""
    return bool(values[0] in {0.0, 1.0} and (np.diff(values) == 1.0).all())


def _time_unit(step: float | None) -> str:
    """Seconds, unless a step of a whole second or more shows milliseconds of a fast loop."""
    return "ms" if step is not None and step >= 1.0 else "s"


def _share_time(file: Sequence[Column]) -> None:
    """Give columns without a time the only time axis of the file that has as many samples."""
    axes: dict[int, list[Column]] = defaultdict(list)
    for column in file:
        if column.quantity == "time":
            axes[len(column.values)].append(column)
    for column in file:
        fitting = axes[len(column.values)]
        timeless = column.time is None and column.signal.time is None and column not in fitting
        if timeless and len(fitting) == 1:
            column.time = fitting[0].address


def _find_panel(column: Column) -> None:
    """Fill in what the paper's figure shows where the file names figure and panel."""
    if column.figure is None or column.quantity in {"time", "index"}:
        return
    figure, panel = column.figure
    quantity, joint = PANELS.get(figure, {}).get(panel, (None, None))
    if column.quantity is None and quantity is not None:
        column.call(quantity, f"Figure {figure}{panel or ''} shows it")
    if column.joint is None and joint is not None:
        column.joint = joint
        column.because.append(f"Figure {figure}{panel or ''} is of joint {joint}")


def _open(group: Iterable[Column]) -> list[Column]:
    """Columns that could still be angles."""
    found = [column for column in group if column.quantity in {None, "desired", "measured", "error"}]
    return found[:MOST_COMPARED]


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
        if found is None or _largest(column.values) > 0.5 * _largest(values[found[0]]):
            continue
        minuend, subtrahend = (angles[int(name)] for name in found)
        names = f"{minuend.address} less {subtrahend.address}"
        if column.quantity is None:
            column.call("error", f"it is {names}")
        for other, quantity in ((minuend, "desired"), (subtrahend, "measured")):
            if other.quantity is None:
                other.call(quantity, f"{column.address} is {names}")  # type: ignore[arg-type]


def _find_pairs(group: Sequence[Column]) -> None:
    """Take two unnamed columns that follow each other for a desired angle and a measured one.

    Much follows something; so either an encoder's steps must show in one of them, or the table must hold
    nothing but such pairs.
    """
    unnamed = [column for column in _open(group) if column.quantity is None]
    counted = {column: counted_in(column.values) is not None for column in unnamed}
    alone = len(unnamed) == len([column for column in group if column.quantity != "time"]) in {2, 4, 6}
    for a, b in combinations(unnamed, 2):
        # Two joints may be sent along the same course, and two encoders may follow it.
        if a.quantity or b.quantity or (counted[a] and counted[b]) or not (counted[a] or counted[b] or alone):
            continue
        if not 0.0 < distance(a.values, b.values) <= SAME_COURSE:
            continue
        smooth, rough = sorted((a, b), key=lambda column: (counted[column], roughness(column.values)))
        reason = f"{a.address} and {b.address} follow each other, and it is the"
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
    alike = "as the other angles of its file"
    shared, reason = (told.pop(), alike) if len(told) == 1 else _shared_unit(angles)
    for column in angles:
        if column.unit is None:
            column.unit = shared
            column.because.append(f"{shared}: {reason}")
    for column in columns:
        if column.unit is None and column.quantity in _OTHERS:
            power = _OTHERS[column.quantity]
            column.unit = f"{shared}{power}" if power else "N m"
            column.because.append(f"{column.unit}: no unit is given")


def _shared_unit(angles: Sequence[Column]) -> tuple[str, str]:
    """Degrees or radians by the size of the angles, else of the errors."""
    angles = [column for column in angles if np.isfinite(column.values).any()]
    for quantities, most, what in (
        ({"desired", "measured", "calculated"}, HALF_TURN, "no joint turns by more than half a turn"),
        ({"motor"}, WINCH_TURN, "no winch turns by more than a turn"),
    ):
        sizes = [_largest(column.values) for column in angles if column.quantity in quantities]
        if sizes and max(sizes) > most:
            return "deg", f"an angle reaches {max(sizes):.3g}, and {what}"
        if sizes:
            return "rad", f"the largest angle is {max(sizes):.3g}; in degrees there would hardly be a motion"
    errors = [float(np.abs(_finite(c.values)).mean()) for c in angles if c.quantity == "error"]
    if errors and max(errors) > _SMALL_RAD:
        return "deg", f"a mean error of {max(errors):.2g} would be more than a degree in rad"
    return "rad", "nothing says otherwise; look at it"


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def _largest(values: Array) -> float:
    return float(np.abs(_finite(values)).max(initial=0.0))


def _doubt(column: Column) -> None:
    """Take the meaning from what turns further than a joint can."""
    if column.quantity in {"measured", "desired"} and not column.own.of_motor:
        turn = _largest(column.values) * FACTORS["angle"].get(column.unit or "rad", 1.0)
        if turn > HALF_TURN:
            column.because.append(
                f"but no joint turns by {np.rad2deg(turn):.4g} deg, so it is something else"
            )
            column.quantity = None


def _find_joints(group: Sequence[Column]) -> None:
    """Number columns without a joint in their name by their order: two are joints 2 and 3, three are all."""
    kinds: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in group:
        if column.quantity not in {None, "time", "index", "other"}:
            of = (column.quantity, column.own.of_motor, column.own.desired)
            kinds[*of, column.controller, str(column.payload_mass)].append(column)
    for alike in kinds.values():
        # The columns of one matrix have one name, so a number in it is nobody's joint in particular.
        of_matrix = len(alike) > 1 and len({column.signal.path for column in alike}) == 1
        if len(alike) not in {2, 3} or not (of_matrix or all(column.joint is None for column in alike)):
            continue
        for joint, column in enumerate(alike, start=4 - len(alike)):
            column.joint = joint
            column.because.append(f"joint {joint} by its place among {len(alike)} like it")
