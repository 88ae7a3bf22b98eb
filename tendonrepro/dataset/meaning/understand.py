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
from tendonrepro.dataset.meaning.angle_units import (
    HALF_TURN,
    by_joint,
    find_surface_units,
    find_units,
    in_radians,
    joint_of,
    largest,
)
from tendonrepro.dataset.meaning.columns import SHORTEST, Column, Group, columns_of
from tendonrepro.dataset.meaning.coupled import find_motors
from tendonrepro.dataset.meaning.evidence import (
    SAME_COURSE,
    counted_in,
    differences_of,
    distance,
    is_label,
    roughness,
    same_curve,
)
from tendonrepro.dataset.meaning.joints import count_as_paper, place_joints
from tendonrepro.dataset.meaning.long_form import cut_long_tables
from tendonrepro.dataset.meaning.panels import find_panels
from tendonrepro.dataset.meaning.times import find_times, share_times
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.dataset.readers.units import FACTORS

MOST_COMPARED = 24
"""Largest number of columns of one table that are compared with each other."""
_ROUGHER, _MUCH_ROUGHER = 1.5, 3.0
"""How much rougher a measured angle is than the desired one at least, and what is to prove something."""


# Numbers near the largest there are mean nothing, but a file may hold them.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
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
    columns = cut_long_tables(columns_of(sources))
    long = [column for column in columns if len(column.values) >= SHORTEST]
    groups: dict[Group, list[Column]] = defaultdict(list)
    files: dict[str, list[Column]] = defaultdict(list)
    for column in long:
        groups[column.group].append(column)
        files[column.source.name].append(column)
    for group in groups.values():
        find_times(group)
        _find_labels(group)
    for file in files.values():
        share_times(file)
    find_panels(long)
    for group in groups.values():
        _find_differences(group)
        _find_pairs(group)
        _find_encoders(group)
    for file in files.values():
        find_units(file)
    for group in groups.values():
        place_joints(group)
    count_as_paper(files)
    for group in groups.values():
        _find_calculated(group)
        _check_errors(group)
        find_motors(group, S_inv)
    find_surface_units(long)
    for column in long:
        _doubt(column)
    return columns


def _find_labels(group: Sequence[Column]) -> None:
    """Recognise columns that say which run or joint a row is of."""
    clocks = [column for column in group if column.quantity == "time"]
    labels = []
    restarts = any((np.diff(clock.values[np.isfinite(clock.values)]) < 0.0).any() for clock in clocks)
    for column in group:
        named = column.own.joint is not None or column.own.quantity not in {None, "measured"} or column.unit
        if not named and column.quantity in {None, "measured"} and is_label(column.values):
            column.call("other", "a few whole numbers, which tell rows apart")
            column.joint = None
            labels.append(column)
    if restarts and labels:
        names = ", ".join(repr(column.label) for column in labels)
        labels[0].doubts.append(
            f"this is a table in long form, take the rows of a run with `where` on {names}"
        )


def _open(group: Sequence[Column]) -> list[Column]:
    """Columns that could still be angles."""
    found = [column for column in group if column.quantity in {None, "desired", "measured", "error"}]
    for column in found[MOST_COMPARED:]:
        limit = (
            f"of a table only {MOST_COMPARED} columns are compared, the others are told by their names alone"
        )
        column.doubts += [] if limit in column.doubts or column.quantity else [limit]
    return found[:MOST_COMPARED]


def _find_differences(group: Sequence[Column]) -> None:
    """Recognise an error by the two columns whose difference it is."""
    angles = _open(group)
    if all(column.own.quantity for column in angles):
        return
    values = {place: column.values for place, column in enumerate(angles)}
    for place, column in enumerate(angles):
        if column.own.quantity not in {None, "error"}:
            continue
        found = differences_of(column.values, {other: values[other] for other in values if other != place})
        # Of three columns any is a difference of the others; the error is the one that is small.
        pairs = [pair for pair in found if largest(column.values) <= 0.5 * largest(values[pair[0]])]
        if not pairs:
            continue
        minuend, subtrahend = (angles[other] for other in pairs[0])
        names = f"{minuend.address} less {subtrahend.address}"
        if column.quantity is None:
            column.call("error", f"it is {names}")
        # Some take the error the other way; only an encoder has steps.
        turned = counted_in(minuend.values) is not None and counted_in(subtrahend.values) is None
        desired, measured = (subtrahend, minuend) if turned else (minuend, subtrahend)
        if desired.quantity is None:
            desired.call("desired", f"{column.address} is {names}")
        if measured.quantity is None:
            measured.call("measured", f"{column.address} is {names}")
    _find_copies(angles)


def _find_copies(angles: Sequence[Column]) -> None:
    """Recognise the desired angle of a joint that is sent along the same course as another."""
    for column in [column for column in angles if column.quantity is None]:
        for other in angles:
            same = other.quantity == "desired" and np.array_equal(column.values, other.values, equal_nan=True)
            if same and largest(column.values) > 0.0:
                column.call("desired", f"it is equal to {other.address}")
                break


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
        if not (counted[rough] or roughness(rough.values) > _ROUGHER * roughness(smooth.values)):
            continue
        reason = f"{a.address} and {b.address} follow each other, and it is the"
        smooth.call("desired", f"{reason} smoother one")
        rough.call("measured", f"{reason} rougher one")


def _find_encoders(group: Sequence[Column]) -> None:
    """Take two or three unnamed columns with an encoder's steps for the measured angles of the joints."""
    counted = [c for c in _open(group) if c.quantity is None and counted_in(c.values) is not None]
    different = [
        column
        for place, column in enumerate(counted)
        if not any(same_curve(column.values, other.values) for other in counted[:place])
    ]
    if any(column.quantity == "measured" for column in group) or len(different) not in {2, 3}:
        return
    for column in different:
        column.call("measured", "it has an encoder's steps")
        column.doubts.append(
            "columns without names have an encoder's steps, so they are taken for measured angles"
        )


def _check_errors(group: Sequence[Column]) -> None:
    """Mend unit and sign of errors by the angles beside them."""
    angles = by_joint(column for column in reversed(group) if column.quantity in {"desired", "measured"})
    for error in (column for column in group if column.quantity == "error"):
        of = {other.quantity: in_radians(other) for other in angles.get(joint_of(error), ())}
        if "measured" in of and "desired" in of:
            _fit_error(error, of["desired"] - of["measured"])
        elif "measured" in of:
            e, q = in_radians(error), of["measured"]
            # Without the desired angle, only the right sign leaves a computed motion.
            if _MUCH_ROUGHER * roughness(q - e) < roughness(q + e):
                error.doubts.append("measured angle less error is smooth, their sum is not: `sign: -1`?")


def _fit_error(error: Column, difference: Array) -> None:
    """Give an error the unit and the sign that make it the difference of two angles, rad."""
    units = [unit for unit in ("deg", "rad") if unit == error.unit or not error.stated]
    tries = [
        (distance(difference, sign * error.values * FACTORS["angle"][unit]), unit, sign)
        for unit in units
        for sign in (1.0, -1.0)
    ]
    rest, unit, sign = min(tries, default=(np.inf, "", 1.0))
    if rest > SAME_COURSE:
        return
    if unit != error.unit:
        error.unit = unit
        error.because.append(f"{unit}: then it is the difference of desired and measured angle")
    if sign < 0.0:
        error.scale = -1.0
        error.because.append("it is measured less desired, so it is turned")


def _find_calculated(group: Sequence[Column]) -> None:
    """Take the smooth one of two unnamed angles for the calculated one where all joints move."""
    guessed = [column for column in group if column.quantity == "desired" and not column.own.quantity]
    errors = any(column.quantity == "error" for column in group)
    if (
        errors
        or {column.joint for column in guessed} != {1, 2, 3}
        or any(column.controller for column in guessed)
    ):
        return
    for column in guessed:
        column.call("calculated", "all three joints move, as in the decoupling experiment")
        column.doubts.append("beside the measured angles of all joints stand others: calculated or desired?")


def _doubt(column: Column) -> None:
    """Take the meaning from what turns further than a joint can."""
    if column.quantity in {"measured", "desired"} and not column.own.of_motor:
        turn = largest(column.values) * FACTORS["angle"].get(column.unit or "rad", 1.0)
        if turn > HALF_TURN:
            column.because.append(
                f"but no joint turns by {np.rad2deg(turn):.4g} deg, so it is something else"
            )
            column.quantity = None
