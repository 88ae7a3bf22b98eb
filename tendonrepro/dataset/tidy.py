"""Tables of another shape: a row for each joint, and times in two columns."""

from __future__ import annotations

import re

import numpy as np

from tendonrepro.dataset.columns import Column, Columns
from tendonrepro.dataset.words import meaning_of

BY_JOINT = "by joint"
"""Name of the table in which every joint of another has columns of its own."""
_MOST_JOINTS = 8
_NANOSECONDS = re.compile(r"(.*?)[ ._]*n(?:ano)?secs?", re.IGNORECASE)


def with_one_time(columns: Columns) -> Columns:
    """The table with one column of times in place of ROS's seconds and nanoseconds."""
    pairs: dict[str, tuple[str, str]] = {}
    for name in columns:
        if match := _NANOSECONDS.fullmatch(name):
            seconds = re.compile(rf"{re.escape(match[1])}[ ._]*secs?", re.IGNORECASE)
            pairs |= {other: (name, match[1]) for other in columns if seconds.fullmatch(other)}
    if not pairs:
        return columns
    merged = Columns()
    merged.notes, merged.angle_unit = columns.notes, columns.angle_unit
    parts = {nanoseconds for nanoseconds, _ in pairs.values()}
    for name, values in columns.items():
        if name in pairs:
            nanoseconds, said = pairs[name]
            merged.add(f"{said} time".strip(), values + 1e-9 * columns[nanoseconds], "s")
        elif name not in parts:
            merged.add(name, values)
    return merged


def by_joint(columns: Columns) -> Columns | None:
    """A table with columns for each joint, of one with a row for each; None of other tables."""
    names = [name for name in columns if meaning_of(name).says == {"joint"} and not meaning_of(name).unit]
    times = [name for name in columns if meaning_of(name).says == {"time"}]
    if len(names) != 1 or not times:
        return None
    numbers = columns[names[0]]
    joints = _joints(numbers)
    if not 2 <= len(joints) <= _MOST_JOINTS:
        return None
    rows = {joint: numbers == joint for joint in joints}
    most = max(int(taken.sum()) for taken in rows.values())
    wide = Columns()
    wide.angle_unit = columns.angle_unit
    clocks: list[Column] = []
    for joint, taken in rows.items():
        said = joint if isinstance(joint, str) else f"joint {joint:g}"
        for name, values in columns.items():
            column = _lengthened(values[taken], most)
            if name == times[0]:
                if any(np.array_equal(column, clock, equal_nan=True) for clock in clocks):
                    continue
                clocks.append(column)
            if name not in (names[0], *times[1:]) and values.dtype.kind == "f":
                wide.add(name if name == times[0] else f"{said} {name}", column)
    return wide


def _joints(numbers: Column) -> list[str | float]:
    """Different words or whole numbers of a column, in order; none if it has others."""
    if numbers.dtype.kind == "f" and not np.array_equal(numbers, np.round(numbers)):
        return []
    return list(dict.fromkeys(numbers.tolist()))


def _lengthened(values: Column, rows: int) -> Column:
    """Values with gaps behind them."""
    if values.dtype.kind != "f":
        return values
    return np.concatenate([values, np.full(rows - len(values), np.nan)])
