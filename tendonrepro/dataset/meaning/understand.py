"""A guess at what each column of a data set is, with the reasons.

Names and stored units speak first, then the four signs of `evidence`. A guess is never certain, so every one
carries its reasons into the mapping, where a user confirms or mends it; what nothing tells is asked there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.angle_units import HALF_TURN, find_units
from tendonrepro.dataset.meaning.columns import SHORTEST, Column, Group, columns_of
from tendonrepro.dataset.meaning.evidence import is_label, largest
from tendonrepro.dataset.meaning.joints import count_as_paper, find_motors, place_joints
from tendonrepro.dataset.meaning.panels import find_panels
from tendonrepro.dataset.meaning.times import find_times, share_times
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.dataset.readers.units import FACTORS


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


def _doubt(column: Column) -> None:
    """Take the meaning from what turns further than a joint can."""
    if column.quantity in {"measured", "desired"} and not column.own.of_motor:
        turn = largest(column.values) * FACTORS["angle"].get(column.unit or "rad", 1.0)
        if turn > HALF_TURN:
            reason = f"but no joint turns by {np.rad2deg(turn):.4g} deg, so it is something else"
            column.because.append(reason)
            column.quantity = None
