"""Tables of named columns, as readers of files give them: cells become numbers, and rows of words names."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tendonrepro.dataset.words import FACTORS, is_known, is_other_unit, meaning_of, plain_unit, variable_of

Column: TypeAlias = NDArray[Any]
"""Values of a column, numbers or words."""

FEWEST = 8
"""Samples of a column that may be a signal."""
_SIGN, _EXPONENT = r"[-+−]?(?=[.,]?\d)", r"(?:[eEdD][-+]?\d+)?"
_POINT = re.compile(rf"{_SIGN}(?:[1-9]\d{{0,2}}(?:,\d{{3}})+|\d+)?(?:\.\d*)?{_EXPONENT}")
_COMMA = re.compile(rf"{_SIGN}(?:[1-9]\d{{0,2}}(?:\.\d{{3}})+|\d+)?(?:,\d*)?{_EXPONENT}")
"""Numbers with that decimal mark, the other one between thousands, and exponents, Fortran's too."""
_DURATION = re.compile(r"-?\d+:\d\d:\d\d(\.\d+)?")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")
_GAPS = {"nan", "na", "n/a", "null", "none", "-", "--", "inf", "-inf"}
_MOST_FAILING = 0.5
"""Share of cells that are no numbers from which a column is one of words."""
_MOST_UNIT = 6
"""Letters of a unit that is not known."""
BY_JOINT = "by joint"
"""Name of the table in which every joint of another has columns of its own."""
_MOST_JOINTS = 8
_NANOSECONDS = re.compile(r"(.*?)[ ._]*n(?:ano)?secs?", re.IGNORECASE)


class Unreadable(Exception):
    """A file without signals, or that cannot be read."""


class Columns(dict[str, Column]):
    """A table: columns of N rows by name, numbers or words; `notes` tell what was left out or read specially.

    `angle_unit` is that of angles and rates whose names say none, where the file states it. `name` is that of
    the mapping: the file, and after a colon the sheet or struct, which is all that readers of files write.
    `file` has ``name``, ``size`` in bytes and ``md5``. Without columns it tells what is in no table.
    """

    angle_unit = ""

    def __init__(
        self, columns: Mapping[str, Column] | None = None, name: str = "", notes: Iterable[str] = ()
    ) -> None:
        super().__init__(columns or {})
        self.name = name
        self.notes = [*notes]
        self.file: dict[str, str | int] = {}

    @property
    def last(self) -> str:
        """Its file, sheet or innermost struct."""
        file, _, inner = self.name.partition(":")
        return inner.rpartition(".")[2] or file.rpartition("/")[2]

    def named(self, names: Iterable[str]) -> dict[str, str]:
        """Columns by their names in a mapping, which may have that of the table before them."""
        named = {}
        for name in names:
            # A name with a line break stands in the table with a blank.
            plain = " ".join(name.split())
            place, _, column = plain.rpartition(":") if plain not in self else ("", "", plain)
            if column in self and place in ("", self.name, self.last):
                named[name] = column
        return named

    def add(self, name: str, values: Column, unit: str = "") -> None:
        """Add a column; a second of its name is numbered."""
        name = " ".join(name.split())
        full = f"{name} ({unit})" if unit and f"({unit})" not in name and f"[{unit}]" not in name else name
        self[free_name(self, full)] = values


def free_name(named: Container[str], name: str) -> str:
    """The name, numbered where another has it."""
    number, free = 1, name
    while free in named:
        number += 1
        free = f"{name} #{number}"
    return free


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma.

    >>> is_number("-1.5e-3"), is_number("1.234,5"), is_number("C1")
    (True, True, False)
    """
    return bool(_POINT.fullmatch(cell) or _COMMA.fullmatch(cell)) or cell.casefold() in ("nan", "inf")


def add_column(columns: Columns, name: str, column: pd.Series, first_row: int = 1) -> None:
    """Add a column of cells, numbers in float64 or words, to a table, with a note of what is no number.

    Of an empty column nothing is kept. ``first_row`` is the number of the first row, for notes.
    """
    numbers: pd.Series | None = column
    if column.dtype.kind not in "biuf":
        known = column[column.notna()]
        cells = known.map(lambda cell: str(cell).strip())
        cells = cells[cells != ""]
        if cells.empty:
            return
        numbers = _seconds(known[cells.index], cells)
        if numbers is not None:
            name = name if "(" in name else f"{name} (s)"
        else:
            numbers = _numbers(columns, name, column, cells, first_row)
    if numbers is None:
        columns.add(name, cells.reindex(column.index, fill_value="").to_numpy(object).astype(str))
        return
    values = numbers.reindex(column.index).to_numpy(np.float64)
    count = int(np.isfinite(values).sum())
    if count >= FEWEST:
        columns.add(name, values)
    elif count:
        columns.notes.append(f"column {name!r} left out: {count} numbers alone")


def _numbers(
    columns: Columns, name: str, column: pd.Series, cells: pd.Series, first_row: int
) -> pd.Series | None:
    """Numbers of cells, with notes on commas between thousands and on other cells; None of words."""
    text = cells.str.replace("−", "-", regex=False)
    numbers = pd.to_numeric(text, errors="coerce").astype(float)
    is_gap = text.str.casefold().isin(_GAPS)
    marked = text[numbers.isna() & ~is_gap & text.str.contains(r"\d", regex=True)]
    by_point, by_comma = _by_mark(marked, _POINT, ","), _by_mark(marked, _COMMA, ".")
    has_points = text[numbers.notna()].str.contains(".", regex=False).any()
    # What makes most cells numbers counts, else the mark of those that are plain numbers.
    is_point = len(by_point) > len(by_comma) or (len(by_point) == len(by_comma) and has_points)
    if len(by_point) == len(by_comma) > 0 and not has_points:
        said = "unclear whether a comma is decimal or between thousands: write them without commas"
        columns.notes.append(f"column {name!r}: {len(marked)} cells, as {marked.iloc[0]!r}, {said}")
    else:
        numbers = numbers.fillna((by_point if is_point else by_comma).reindex(numbers.index))
    failing = numbers.isna() & ~is_gap
    if failing.mean() >= _MOST_FAILING:
        return None
    thousands = marked[marked.str.contains(",", regex=False) & ~failing[marked.index]]
    if is_point and len(thousands):
        said = f"{len(thousands)} numbers have a comma between thousands, as {thousands.iloc[0]!r}"
        columns.notes.append(f"column {name!r}: {said}")
    if failing.any():
        place = int(np.argmax(column.index == failing.idxmax())) + first_row
        said = f"no numbers and left as gaps, the first {str(cells[failing].iloc[0])[:40]!r} in row {place}"
        columns.notes.append(f"column {name!r}: {int(failing.sum())} of {len(column)} cells are {said}")
    return numbers


def _by_mark(marked: pd.Series, pattern: re.Pattern[str], between: str) -> pd.Series:
    """Numbers of the cells that a pattern of numbers fits, which may have a mark between thousands."""
    cells = marked[[pattern.fullmatch(cell) is not None for cell in marked]]
    bare = cells.str.replace(between, "", regex=False).str.replace(",", ".", regex=False)
    return pd.to_numeric(bare.str.replace(r"[dD]", "e", regex=True), errors="coerce").astype(float)


def _seconds(known: pd.Series, cells: pd.Series) -> pd.Series | None:
    """Durations, or dates since the first, in s; None of other cells."""
    first = known.iloc[0]
    if hasattr(first, "total_seconds"):
        return known.map(lambda cell: cell.total_seconds() if hasattr(cell, "total_seconds") else np.nan)
    if _DURATION.fullmatch(cells.iloc[0]):
        since = pd.to_timedelta(cells, errors="coerce")
    elif hasattr(first, "year") or _DATE.fullmatch(cells.iloc[0]):
        dates = pd.to_datetime(cells, errors="coerce", format="ISO8601")
        since = dates - dates.bfill().iloc[0]
    else:
        return None
    seconds: pd.Series = since.dt.total_seconds()
    return seconds if seconds.notna().any() else None


def first_numbers(rows: Sequence[Sequence[str]], sample: Sequence[Sequence[str]]) -> int | None:
    """First row with numbers where most of the `sample` has some, and so in the two rows behind it."""
    columns = list(zip_longest(*sample, fillvalue=""))
    filled = [sum(map(bool, cells)) for cells in columns]
    counts = [sum(map(is_number, cells)) for cells in columns]
    width = len(columns)
    numbers = [k for k in range(width) if counts[k] > 0.5 * filled[k] and filled[k] > 0.2 * len(sample)]
    if not numbers:
        return None
    for place, row in enumerate(rows[:-1]):
        if _share(row, numbers, width) > 0.5 and all(
            _share(after, numbers, width) > 0.0 for after in rows[place + 1 : place + 3]
        ):
            return place
    return None


def _share(row: Sequence[str], places: Sequence[int], width: int) -> float:
    """Share of numbers in those places that are filled; 0 if the first holds a word, as of a setting.

    A row of fewer than `width` cells has to fill half of the places.
    """
    first = row[places[0]] if len(row) > places[0] else "absent"
    filled = [row[k] for k in places if k < len(row) and row[k]]
    is_short = len(row) < width and 2 * len(filled) < len(places)
    if (first and not is_number(first)) or is_short or not filled:
        return 0.0
    return sum(map(is_number, filled)) / len(filled)


def names_of(head: Sequence[Sequence[str]], width: int) -> list[str]:
    """Last row of words, with a group above and a unit below; else rows that are called names and units."""
    rows = [list(row) for row in head if any(row)]
    labelled = {row[0].casefold().strip(" :"): row for row in rows if row and len(row) == width}
    if {"name", "unit"} <= labelled.keys():
        # A scope's export: what a row is stands in it above the times.
        names, units = labelled["name"], labelled["unit"]
        rows = [
            ["time" if cell == names[0] else cell for cell in names],
            ["" if cell == units[0] else cell for cell in units],
        ]
    units = rows.pop() if rows and _are_units(rows[-1], rows[-2] if len(rows) > 1 else []) else []
    names = rows.pop() if rows else []
    if rows and _is_header(rows[-1]) and _told_by(rows[-1]) > _told_by(names):
        # Below a header a row of words holds commands, or values of another kind.
        names = rows.pop()
    groups = _groups(rows[-1], names) if rows and len(rows[-1]) == width else []
    if len(names) > 1 and names == ["X", "Y"] * (len(names) // 2) and any(groups):
        # WebPlotDigitizer's table of all curves: each under its name, over time.
        return [curve if name == "Y" else "time (s)" for curve, name in zip(groups, names, strict=True)]
    blank = [""] * width
    cells = zip_longest(groups or blank, names[:width], units[:width], fillvalue="")
    return [
        _name(place, " ".join(f"{group} {name}".split()), _bare(unit))
        for place, (group, name, unit) in enumerate(cells, start=1)
    ]


def _name(place: int, name: str, unit: str) -> str:
    if not name and plain_unit(unit) in FACTORS["time"]:
        name = "time"
    return (name or f"column {place}") + (f" ({unit})" if unit else "")


def _is_header(row: Sequence[str]) -> bool:
    """Whether every column has a name of its own."""
    return all(row) and len(set(row)) == len(row)


def _told_by(names: Sequence[str]) -> int:
    """How much names tell of columns: variables, joints, units."""
    meanings = [meaning_of(name) for name in names if name]
    return sum(3 - (variable_of(said.says), said.joint, said.unit).count(None) for said in meanings)


def _bare(unit: str) -> str:
    """A unit without brackets, or what they explain."""
    bare = unit.strip("()[] ")
    short = re.sub(r"\s*\(.*", "", bare)
    return short if plain_unit(bare) is None and plain_unit(short) else bare


def angle_unit_of(lines: Iterable[str]) -> str:
    """Unit of angles by a setting above a table, as OpenSim writes it, or an empty text."""
    settings = re.compile(r"^\W*in_?degrees\W+(yes|no|true|false)\b", re.IGNORECASE | re.MULTILINE)
    answers = settings.findall("\n".join(lines))
    return ("deg" if answers[-1].casefold() in ("yes", "true") else "rad") if answers else ""


def _are_units(row: Sequence[str], above: Sequence[str]) -> bool:
    """Whether a row has units: known ones alone, or with others under as many names."""
    cells = [_bare(cell) for cell in row if cell.strip("()[]- ")]
    known = [cell for cell in cells if plain_unit(cell)]
    if len(known) == len(cells):
        return bool(cells) and not all(cell in "st" for cell in cells)
    others = [cell for cell in cells if not plain_unit(cell)]
    has_names = sum(map(bool, above)) >= len(cells) - 1 > 0
    return bool(known) and has_names and all(map(_is_unknown_unit, others))


def _is_unknown_unit(cell: str) -> bool:
    """Whether a word may be a unit of no variable, as A, or one that is not known, as inc."""
    return is_other_unit(cell) or (cell.isalpha() and len(cell) <= _MOST_UNIT and not is_known(cell))


def _groups(row: Sequence[str], names: Sequence[str]) -> list[str]:
    """Group of every column: an empty cell belongs to the name before it.

    A title stands alone at the left, numbers are settings, and as many names as columns are a second header.
    """
    filled = [cell for cell in row if cell]
    is_second = _is_header(row) and any(names)
    if is_second or any(map(is_number, filled)) or not filled or (len(filled) == 1 and row[0]):
        return [""] * len(row)
    return pd.Series(row).replace("", None).ffill().fillna("").tolist()


def with_one_time(columns: Columns) -> None:
    """Put one column of times in place of ROS's seconds and nanoseconds."""
    for match in filter(None, map(_NANOSECONDS.fullmatch, [*columns])):
        stem = match[1]
        seconds = re.compile(rf"{re.escape(stem)}[ ._]*secs?", re.IGNORECASE)
        if name := next(filter(seconds.fullmatch, columns), None):
            below = 1e-9 * columns.pop(match[0])
            named = [
                (f"{stem} time (s)".strip(), values + below) if key == name else (key, values)
                for key, values in columns.items()
            ]
            columns.clear()
            columns.update(named)


def by_joint(columns: Columns) -> Columns | None:
    """A table with columns for each joint, of one with a row for each; None of other tables."""
    names = [name for name in columns if meaning_of(name).says == {"joint"} and not meaning_of(name).unit]
    times = [name for name in columns if meaning_of(name).says == {"time"}]
    if len(names) != 1 or not times:
        return None
    of_row = columns[names[0]]
    is_whole = of_row.dtype.kind != "f" or np.array_equal(of_row, np.round(of_row))
    joints, counts = np.unique(of_row, return_counts=True)
    if not is_whole or not 2 <= len(joints) <= _MOST_JOINTS:
        return None
    wide = Columns(name=f"{columns.name}.{BY_JOINT}".strip("."))
    wide.angle_unit = columns.angle_unit
    clock = np.empty(0)
    for joint in dict.fromkeys(of_row.tolist()):
        rows = of_row == joint
        said = joint if isinstance(joint, str) else f"joint {joint:g}"
        for name, values in columns.items():
            if name in (names[0], *times[1:]) or values.dtype.kind != "f":
                continue
            # A joint with fewer rows has gaps behind them.
            column = np.full(counts.max(), np.nan)
            column[: rows.sum()] = values[rows]
            if name != times[0]:
                wide.add(f"{said} {name}", column)
            elif not np.array_equal(column, clock, equal_nan=True):
                clock = column
                wide.add(name, column)
    return wide
