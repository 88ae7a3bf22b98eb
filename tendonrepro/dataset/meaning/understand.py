"""A guess at what each column of a data set is, with the reasons.

Names and stored units speak first. Of the numbers, four plain signs are taken for evidence, and no other:

1. Numbers that increase evenly are times; their unit is the one that makes the step that of a control loop,
   unless no motion could be so short.
2. A few whole numbers tell rows apart and are no motion.
3. Columns alike that all stand still are no motion either.
4. The size of angles tells degrees from radians.

A guess is never certain, so every one carries its reasons into the mapping, where a user confirms or mends
it; what nothing tells is asked there, with the line that settles it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.assignment import count_as_paper, place_joints
from tendonrepro.dataset.meaning.columns import SHORTEST, Column, columns_of
from tendonrepro.dataset.meaning.times import find_times, share_times
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.dataset.readers.units import FACTORS

_MOST_LABELS = 8
_HALF_TURN = 3.3  # no joint of the arm turns further, rad
_WINCH_TURN = 7.0  # nor does a winch, which turns up to 77/37 times as far, rad
_SMALL_RAD = 0.02  # a tracking error of some tenths of a degree, in either unit
_ANGLES = ("desired", "measured", "error", "motor", "calculated")
_KINDS = {
    "rate": "rate",
    "acceleration": "acceleration",
    "torque": "torque",
    "estimate": "torque",
} | dict.fromkeys(_ANGLES, "angle")
# What their units have behind that of the angles; nothing for torques.
_OTHERS = {"rate": "/s", "surface": "/s", "acceleration": "/s^2", "torque": "", "estimate": ""}

Key = TypeVar("Key")


# Numbers near the largest there are mean nothing, but a file may hold them.
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def understand(sources: Iterable[Source]) -> list[Column]:
    """Guess what every column is; those that could not be understood stay without a quantity."""
    columns = columns_of(sources)
    long = [column for column in columns if len(column.values) >= SHORTEST]
    groups = _sorted_by(long, lambda column: column.group)
    files = _sorted_by(long, lambda column: column.source.name)
    for group in groups:
        find_times(group)
        _find_feet(group)
        _find_labels(group)
        _refuse_still(group)
    for file in files:
        share_times(file)
        _find_units(file)
    for group in groups:
        place_joints(group)
    count_as_paper(groups)
    return columns


def _sorted_by(columns: Iterable[Column], key: Callable[[Column], Key]) -> list[list[Column]]:
    found: dict[Key, list[Column]] = defaultdict(list)
    for column in columns:
        found[key(column)].append(column)
    return list(found.values())


def _find_feet(group: Sequence[Column]) -> None:
    """Ask about rows that hold numbers but no time or index, as sums at the foot of a sheet do."""
    for clock in group:
        if clock.quantity in {"time", "index"}:
            missing = ~np.isfinite(clock.values)
            for column in group:
                of = column.time == clock.address or (clock.quantity == "index" and column.time is None)
                if of and np.isfinite(column.values[missing]).any():
                    column.doubts.append(
                        f"rows without a number under {clock.label!r} are taken for samples; "
                        "where they are sums or remarks, delete them in the file"
                    )


def _find_labels(group: Sequence[Column]) -> None:
    """Recognise columns that say which run or joint a row is of, and ask for the rows of a run."""
    labels = []
    for column in group:
        named = column.own.joint is not None or column.own.quantity not in {None, "measured"} or column.unit
        if not named and column.quantity in {None, "measured"} and _few_whole(column.values):
            labels.append(column)
            if is_label(column.values):
                column.call("other", "a few whole numbers, which tell rows apart")
                column.joint = None
    if labels:
        notes = (f" ({column.signal.note})" * bool(column.signal.note) for column in labels)
        names = ", ".join(f"{column.label!r}{note}" for column, note in zip(labels, notes, strict=True))
        labels[0].doubts.append(
            f"{names} may tell rows of several runs apart; `where` on it takes those of one"
        )


def _refuse_still(group: Sequence[Column]) -> None:
    """Guess nothing of columns alike that all stand still, unless a unit or a word with a joint tells.

    A held joint stands beside others that move; constants of another kind, such as obstacles, do not.
    """
    for alike in _sorted_by(group, lambda column: column.quantity):
        if alike[0].quantity in {*_ANGLES, *_OTHERS} and all(column.still for column in alike):
            for column in alike:
                named = column.own.quantity and not column.own.letter and column.own.joint is not None
                if not (named or column.unit):
                    column.quantity = None
                    column.because.append(
                        "but it stands still, and neither a name nor a unit tells what it is"
                    )


def is_label(values: Array) -> bool:
    """Whether numbers (N,) tell rows apart, as those of joints or trials do: few, whole, close together."""
    return _few_whole(values) and float(np.ptp(values)) < _MOST_LABELS


def _few_whole(values: Array) -> bool:
    """Whether numbers are several but few, and whole; a motion in steps may be so too."""
    if not np.isfinite(values).all() or (values != np.round(values)).any():
        return False
    return 1 < len(np.unique(values)) <= min(_MOST_LABELS, len(values) // SHORTEST)


def _find_units(columns: Sequence[Column]) -> None:
    """Settle the units of all columns of a file but its times."""
    angles = [column for column in columns if column.quantity in _ANGLES]
    for column in columns:
        # An arc minute is no minute, and a "second joint" no second.
        if column.unit and column.unit not in FACTORS.get(
            _KINDS.get(column.quantity or "", ""), {column.unit}
        ):
            column.because.append(f"but {column.unit} is no unit of it")
            column.unit = None
        if column.unit is None and column.signal.unit and column.quantity in _KINDS:
            what = f"no known unit of a {column.quantity}: `scale`, `variable`"
            column.doubts.append(f"{column.label!r}: {column.signal.unit!r} is {what}")
    told = {column.unit for column in angles if column.unit in {"deg", "rad"}}
    alike = "as the other angles of its file"
    shared, reason = (told.pop(), alike) if len(told) == 1 else _shared_unit(angles)
    for column in columns:
        if column.unit is None and column.quantity in _ANGLES:
            column.unit = shared
            column.because.append(f"{shared}: {reason}")
            column.doubts.append(f"angles or errors without a known unit are taken to be in {shared}: `unit`")
        elif column.unit is None and column.quantity in _OTHERS:
            power = _OTHERS[column.quantity]
            column.unit = f"{shared}{power}" if power else "N m"
            column.because.append(f"{column.unit}: no unit is given")
            column.doubts.append(f"no unit of a {column.quantity} is given, {column.unit} is taken: `unit`")


def _shared_unit(angles: Sequence[Column]) -> tuple[str, str]:
    """Degrees or radians by the size of the angles, else of the errors."""
    finite = [(column.quantity, np.abs(column.values[np.isfinite(column.values)])) for column in angles]
    for quantities, most, what in (
        ({"desired", "measured", "calculated"}, _HALF_TURN, "no joint turns by more than half a turn"),
        ({"motor"}, _WINCH_TURN, "no winch turns by more than a turn"),
    ):
        size = max((sizes.max() for of, sizes in finite if of in quantities and sizes.size), default=None)
        if size is not None and size > most:
            return "deg", f"an angle reaches {size:.3g}, and {what}"
        if size is not None:
            return "rad", f"the largest angle is {size:.3g}; in degrees there would hardly be a motion"
    error = max((sizes.mean() for of, sizes in finite if of == "error" and sizes.size), default=0.0)
    if error > _SMALL_RAD:
        return "deg", f"a mean error of {error:.2g} would be more than a degree in rad"
    return "rad", "nothing says otherwise; look at it"
