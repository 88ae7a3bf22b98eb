"""A guess at what each column of a data set is, with the reasons.

Names and stored units speak first, then the five signs of `evidence`. A guess is never certain, so every one
carries its reasons into the mapping, where a user confirms or mends it; what nothing tells is asked there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.angle_units import HALF_TURN, find_units
from tendonrepro.dataset.meaning.columns import SHORTEST, Column, Group, columns_of
from tendonrepro.dataset.meaning.evidence import counted_in, distance, is_label, largest, roughness
from tendonrepro.dataset.meaning.joints import count_as_paper, find_motors, place_joints
from tendonrepro.dataset.meaning.panels import find_panels
from tendonrepro.dataset.meaning.times import find_times, share_times
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.dataset.readers.units import FACTORS

SAME_COURSE = 0.1
"""Largest RMS difference of two signals that follow each other, as a share of the range."""
_MOST_COMPARED = 24  # columns of one table that are compared with each other
_ROUGHER = 1.5  # how much rougher a measured angle is than the desired one at least
_PAIRED = (
    "columns without names follow each other, so they are taken for desired and measured angle: `variable`"
)


# Numbers near the largest there are mean nothing, but a file may hold them.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def understand(sources: Iterable[Source], S_inv: Array) -> list[Column]:
    """Guess what every column is; those that could not be understood stay without a quantity.

    `S_inv` is the inverse coupling of all joints, (3, 3).
    """
    columns = columns_of(sources)
    long = [column for column in columns if len(column.values) >= SHORTEST]
    tables: dict[Group, list[Column]] = defaultdict(list)
    groups: dict[Group, list[Column]] = defaultdict(list)
    files: dict[str, list[Column]] = defaultdict(list)
    for column in long:
        tables[column.table].append(column)
        groups[column.group].append(column)
        files[column.source.name].append(column)
    for table in tables.values():
        find_times(table)
    for group in groups.values():
        _find_labels(group)
    for file in files.values():
        share_times(file)
    find_panels(long)
    for group in groups.values():
        _refuse_still(group)
        _find_pairs(group)
    for file in files.values():
        find_units(file)
    for group in groups.values():
        place_joints(group)
    count_as_paper(groups.values())
    for group in groups.values():
        find_motors(group, S_inv)
    for column in long:
        _doubt(column)
    return columns


def _find_labels(group: Sequence[Column]) -> None:
    """Recognise columns that say which run or joint a row is of, and ask for the rows of a run."""
    labels = []
    for column in group:
        named = column.own.joint is not None or column.own.quantity not in {None, "measured"} or column.unit
        if not named and column.quantity in {None, "measured"} and is_label(column.values):
            column.call("other", "a few whole numbers, which tell rows apart")
            column.joint = None
            labels.append(column)
    clocks = [column.values for column in group if column.quantity == "time"]
    if labels and any((np.diff(clock[np.isfinite(clock)]) <= 0.0).any() for clock in clocks):
        names = ", ".join(repr(column.label) for column in labels)
        labels[0].doubts.append(
            f"this is a table in long form, take the rows of a run with `where` on {names}"
        )


def _refuse_still(group: Sequence[Column]) -> None:
    """Guess nothing of columns alike that all stand still, unless a unit or a word with a joint tells.

    A held joint stands beside others that move; constants of another kind, such as obstacles, do not.
    """
    kinds: dict[str | None, list[Column]] = defaultdict(list)
    for column in group:
        kinds[column.quantity].append(column)
    for quantity, alike in kinds.items():
        if quantity in {None, "time", "index", "other"} or not all(column.still for column in alike):
            continue
        for column in alike:
            named = column.own.quantity and not column.own.letter and column.own.joint is not None
            if not (named or column.unit):
                column.quantity = None
                column.because.append("but it stands still, and neither a name nor a unit tells what it is")


def _find_pairs(group: Sequence[Column]) -> None:
    """Take two unnamed columns that follow each other for a desired angle and a measured one.

    Much follows something; so either an encoder's steps must show in one of them, or the table must hold
    nothing but such pairs.
    """
    unnamed = [column for column in group if column.quantity is None][:_MOST_COMPARED]
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
        for column in (smooth, rough):
            column.doubts.append(_PAIRED)


def _doubt(column: Column) -> None:
    """Take the meaning from what turns further than a joint can."""
    if column.quantity in {"measured", "desired"} and not column.own.of_motor:
        turn = largest(column.values) * FACTORS["angle"].get(column.unit or "rad", 1.0)
        if turn > HALF_TURN:
            reason = f"but no joint turns by {np.rad2deg(turn):.4g} deg, so it is something else"
            column.because.append(reason)
            column.quantity = None
