"""Names and units that stand above the columns of a table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tendonrepro.dataset.readers.units import plain_unit

_OTHER_UNITS = {
    "n", "mn", "kn", "m", "mm", "cm", "v", "mv", "a", "ma", "w", "hz", "khz", "kg", "g", "%", "-", "1",
    "°c", "℃", "°/s²", "rad/s²", "m/s", "m/s^2", "m/s2", "count", "counts", "ticks", "lsb", "pulses",
    "牛", "伏", "安",
}  # fmt: skip
_BRACKETED = re.compile(r"^(?P<name>.*?)\s*[(\[（【{](?P<unit>[^()\[\]（）【】{}]{1,16})[)\]）】}]\s*$")
_AFTER_MARK = re.compile(r"^(?P<name>.*\S)(?:\s*/\s*|\s*,\s+|\s+in\s+)(?P<unit>\S{1,12})$")
_AFTER_LINE = re.compile(r"^(?P<name>.+?)_(?P<unit>deg_s2|deg_s|rad_s2|rad_s|[A-Za-z]{2,4})$")
_BRACKETS = " ()[]（）【】{}"
_TIMES = frozenset({"t", "time", "zeit", "temps", "tiempo", "时间"})
_LONGEST_NAME = 100


@dataclass(frozen=True)
class Heading:
    """What stands above one column.

    `name` is as written, behind what spans several columns and a ``/``, and empty for a column without one.
    `label` is without the unit, between what spans it and a comment. `unit` is as written.
    """

    name: str = ""
    label: str = ""
    unit: str | None = None


def is_unit(text: str) -> bool:
    """Whether a cell holds a unit and nothing else, in brackets or not."""
    inner = text.strip(_BRACKETS)
    return plain_unit(inner) is not None or inner.lower() in _OTHER_UNITS


def split_unit(name: str) -> tuple[str, str | None]:
    """Separate a column's name, such as ``q2 (deg)``, ``Zeit / s`` or ``q2_deg``, from its unit.

    >>> split_unit("角度(°)"), split_unit("q2 (desired)"), split_unit("vel_rad_s")
    (('角度', '°'), ('q2 (desired)', None), ('vel', 'rad/s'))
    """
    bracketed = _BRACKETED.match(name)
    if bracketed and is_unit(bracketed["unit"]) and bracketed["unit"] != "1":
        return bracketed["name"] or name, bracketed["unit"].strip()
    marked = _AFTER_MARK.match(name)
    if marked and is_unit(marked["unit"]) and not marked["unit"].isdigit():
        return marked["name"], marked["unit"]
    lined = _AFTER_LINE.match(name)
    if lined and is_unit(lined["unit"].replace("_", "/")):
        return lined["name"], lined["unit"].replace("_", "/")
    label, _, last = name.rpartition("_")
    # A single letter is a unit only where it cannot be anything else: q_m may well be "measured".
    return (label, "s") if last == "s" and label.lower() in _TIMES else (name, None)


def headings(rows: Sequence[Sequence[str]], width: int) -> tuple[list[Heading], list[int]]:
    """Find names and units of so many columns in the rows above their numbers.

    Returns a heading for each column, and which rows are none of their names: words about the table.
    """
    filled = [number for number, cells in enumerate(rows) if any(cell.strip() for cell in cells)]
    left = [rows[number] for number in filled]
    comments = left.pop() if _are_comments(left, width) else ()
    units: Sequence[str] = ()
    if len(left) > 1 and _are_units(left[-1], width) and _are_names(left[-2], width):
        units = left.pop()
    names = left.pop() if left and _are_names(left[-1], width) else ()
    spans = [""] * width
    if names and left and _span_columns(left[-1], names, width):
        spans = _filled_on(left.pop(), width)
    cells = [[_cell(row, column) for row in (names, units, comments)] for column in range(width)]
    return [_heading(spans, column, *own) for column, own in enumerate(cells)], filled[: len(left)]


def _are_comments(rows: Sequence[Sequence[str]], width: int) -> bool:
    """Whether the last row, below names and units, tells more about each column, as Origin writes it."""
    if len(rows) < 3 or not _are_units(rows[-2], width) or _are_units(rows[-1], width):
        return False
    return _are_names(rows[-3], width) and _is_row(rows[-1], width)


def _cell(cells: Sequence[str], column: int) -> str:
    return " ".join(cells[column].split())[:_LONGEST_NAME] if column < len(cells) else ""


def _are_names(cells: Sequence[str], width: int) -> bool:
    """Whether a row can be the names of so many columns: about as many, and short."""
    return _is_row(cells, width) and 2 * sum(bool(cell.strip()) for cell in cells) >= width


def _is_row(cells: Sequence[str], width: int) -> bool:
    """Whether a row can be about so many columns."""
    filled = [column for column, cell in enumerate(cells) if cell.strip()]
    return bool(filled) and filled[-1] <= width and max(map(len, cells)) <= _LONGEST_NAME


def _are_units(cells: Sequence[str], width: int) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and len(cells) <= width + 1 and all(is_unit(cell) for cell in filled)


def _span_columns(cells: Sequence[str], names: Sequence[str], width: int) -> bool:
    """Whether a row names groups of columns.

    Then names repeat below it, or an empty cell stands before the last name; a setting such as
    ``Operator, Yan`` has neither. A single name is of groups only right behind the time, else a title.
    """
    filled = [column for column, cell in enumerate(cells) if cell.strip()]
    if len(filled) == 1:
        return filled[0] == 1 < width
    below = [name.strip() for name in names if name.strip()]
    return filled[-1] < width and (len(filled) <= filled[-1] or len(set(below)) < len(below))


def _filled_on(cells: Sequence[str], width: int) -> list[str]:
    """Each name repeated over the empty cells to its right."""
    filled = [_cell(cells, column) for column in range(width)]
    for column in range(1, width):
        filled[column] = filled[column] or filled[column - 1]
    return filled


def _heading(spans: list[str], column: int, name: str, unit: str, comment: str) -> Heading:
    """Heading of a column from what stands above it; `spans` has the names of groups, one a column."""
    span = spans[column]
    name = name or comment or (span if spans.index(spans[column]) == column else "")
    label, inner = split_unit(name)
    words = [span if span != name else "", label, comment if comment != name else ""]
    path = f"{span}/{name}" if span and name not in {"", span} else name
    return Heading(path, " ".join(filter(None, words)), unit.strip(_BRACKETS) or inner)
