"""Names and units that stand above the columns of a table."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from tendonrepro.dataset.readers.units import plain_unit

_OTHER_UNITS = frozenset(
    {
        "n",
        "mn",
        "kn",
        "m",
        "mm",
        "cm",
        "v",
        "mv",
        "a",
        "ma",
        "w",
        "hz",
        "khz",
        "kg",
        "g",
        "%",
        "-",
        "1",
        "°c",
        "℃",
    }
    | {
        "°/s²",
        "rad/s²",
        "m/s",
        "m/s^2",
        "m/s2",
        "count",
        "counts",
        "ticks",
        "lsb",
        "pulses",
        "牛",
        "伏",
        "安",
    }
)
_BRACKETED = re.compile(r"^(?P<name>.*?)\s*[(\[（【{](?P<unit>[^()\[\]（）【】{}]{1,16})[)\]）】}]\s*$")
_AFTER_MARK = re.compile(r"^(?P<name>.*\S)(?:\s*/\s*|\s*,\s+|\s+in\s+)(?P<unit>\S{1,12})$")
_AFTER_LINE = re.compile(r"^(?P<name>.+?)_(?P<unit>deg_s2|deg_s|rad_s2|rad_s|[A-Za-z]{2,4})$")
_SHORT_NAME = re.compile(r"[A-Z]{1,2}\((?:[XYZLM]|[xy]Er±)\)")
_TIMES = frozenset({"t", "time", "zeit", "temps", "tiempo", "时间"})
_LONGEST_NAME = 100
_ROWS = {
    "long name": "names", "name": "names", "长名称": "names",
    "units": "units", "unit": "units", "单位": "units",
    "comments": "comments", "comment": "comments", "注释": "comments",
    "f(x)": "", "f(x)=": "", "sparklines": "", "sampling interval": "",
}  # fmt: skip
"""What Origin writes in front of the rows above the numbers; what is in the others is of no use here."""


@dataclass(frozen=True)
class Heading:
    """What stands above one column.

    Parameters
    ----------
    name : str
        As written, what spans several columns before it and a ``/``; empty for a column without a name.
    label : str
        Without the unit, with what spans it before it and a comment behind it.
    unit : str or None
        As written.
    """

    name: str = ""
    label: str = ""
    unit: str | None = None


def is_unit(text: str) -> bool:
    """Whether a cell holds a unit and nothing else, in brackets or not."""
    inner = text.strip(" ()[]（）【】{}")
    return plain_unit(inner) is not None or inner.lower() in _OTHER_UNITS


def split_unit(name: str) -> tuple[str, str | None]:
    """Separate a column's name from its unit.

    Parameters
    ----------
    name : str
        Such as ``q2 (deg)``, ``Zeit / s`` or ``q2_deg``.

    Returns
    -------
    label : str
    unit : str or None

    Examples
    --------
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
    """Find names and units of columns in the rows above their numbers.

    Parameters
    ----------
    rows : sequence of sequences of str
        Cells above the first row of numbers.
    width : int
        Number of columns.

    Returns
    -------
    headings : list of Heading
        One a column.
    used : list of int
        Which of the rows they came from; the others are words about the table.
    """
    told = _told_in_front(rows)
    if told:
        return _as_told(rows, told, width), sorted(told | dict.fromkeys(_letters(rows)))
    left = [number for number, cells in enumerate(rows) if any(cell.strip() for cell in cells)]
    used: list[int] = []
    comments = _comments(rows, left, width)
    if comments:
        used.append(left.pop())
    units: Sequence[str] = ()
    if len(left) > 1 and _is_units_row(rows[left[-1]], width) and _fits(rows[left[-2]], width):
        units = rows[left[-1]]
        used.append(left.pop())
    names: Sequence[str] = ()
    if left and _fits(rows[left[-1]], width):
        names = rows[left[-1]]
        used.append(left.pop())
    if names and not units and left and _are_units_above(rows[left[-1]], names, width):
        units = rows[left[-1]]
        used.append(left.pop())
    spans: Sequence[str] = ()
    if names and left and _spans(rows[left[-1]], names, width):
        spans = _filled_on(rows[left[-1]], width)
        used.append(left.pop())
    cells = [(_cell(names, column), _cell(units, column), _cell(comments, column)) for column in range(width)]
    return [_heading(_span(spans, column), *own) for column, own in enumerate(cells)], used


def _told_in_front(rows: Sequence[Sequence[str]]) -> dict[int, str]:
    """What each row is where its first cell tells; empty unless one of them is that of the names."""
    first = {number: cells[0].strip().lower() for number, cells in enumerate(rows) if cells}
    told = {number: _ROWS[cell] for number, cell in first.items() if cell in _ROWS}
    return told if len(told) > 1 and "names" in told.values() else {}


def _as_told(rows: Sequence[Sequence[str]], told: dict[int, str], width: int) -> list[Heading]:
    """Headings where the first column says which row is which; what stands there names no numbers."""
    by_role = {role: ["", *rows[number][1:]] for number, role in told.items()}
    names, units, comments = (by_role.get(role, []) for role in ("names", "units", "comments"))
    cells = [(_cell(names, column), _cell(units, column), _cell(comments, column)) for column in range(width)]
    return [_heading(_Span(), *own) for own in cells]


def _letters(rows: Sequence[Sequence[str]]) -> list[int]:
    """Rows of Origin's own short names, such as ``A(X)``."""
    return [
        number
        for number, cells in enumerate(rows)
        if any(cells) and all(_SHORT_NAME.fullmatch(cell.strip()) for cell in cells if cell.strip())
    ]


def _comments(rows: Sequence[Sequence[str]], left: Sequence[int], width: int) -> Sequence[str]:
    """Row below the one of units that tells more about each column, as Origin writes it."""
    if len(left) < 3 or not _is_units_row(rows[left[-2]], width) or _is_units_row(rows[left[-1]], width):
        return ()
    both = _fits(rows[left[-3]], width) and _is_row(rows[left[-1]], width)
    return rows[left[-1]] if both else ()


def _cell(cells: Sequence[str], column: int) -> str:
    return " ".join(cells[column].split())[:_LONGEST_NAME] if column < len(cells) else ""


def _fits(cells: Sequence[str], width: int) -> bool:
    """Whether a row can be the names of so many columns: about as many, and short."""
    return _is_row(cells, width) and 2 * sum(bool(cell.strip()) for cell in cells) >= width


def _is_row(cells: Sequence[str], width: int) -> bool:
    """Whether a row can be about so many columns."""
    filled = [column for column, cell in enumerate(cells) if cell.strip()]
    short = all(len(cell) <= _LONGEST_NAME for cell in cells)
    return short and bool(filled) and filled[-1] <= width


def _is_units_row(cells: Sequence[str], width: int) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and len(cells) <= width + 1 and all(is_unit(cell) for cell in filled)


def _are_units_above(cells: Sequence[str], names: Sequence[str], width: int) -> bool:
    """Whether a row holds the units of the names below it; a single one may be the letter of a panel."""
    several = sum(bool(cell.strip()) for cell in cells) > 1
    return several and _is_units_row(cells, width) and _fits(cells, width) and not _is_units_row(names, width)


def _spans(cells: Sequence[str], names: Sequence[str], width: int) -> bool:
    """Whether a row names groups of columns.

    Then names repeat in it or below it, or an empty cell stands before the last name; a setting such as
    ``Operator, Yan`` has neither. A single name that starts at the first column, or stands alone further to
    the right than behind the time, is the table's title.
    """
    filled = [column for column, cell in enumerate(cells) if cell.strip()]
    if not filled or not 0 < filled[-1] < width:
        return False
    if len({cells[column].strip() for column in filled}) == 1 and (
        filled[0] == 0 or filled[0] == filled[-1] > 1
    ):
        return False
    return _repeats(cells) or _repeats(names) or len(filled) <= filled[-1]


def _repeats(cells: Sequence[str]) -> bool:
    return any(count > 1 for count in Counter(cell.strip() for cell in cells if cell.strip()).values())


def _filled_on(cells: Sequence[str], width: int) -> list[str]:
    """Each name repeated over the empty cells to its right, unless the row repeats names already."""
    given = [_cell(cells, column) for column in range(width)]
    if any(cell and cell == following for cell, following in pairwise(given)):
        return given
    filled: list[str] = []
    for own in given:
        filled.append(own or (filled[-1] if filled else ""))
    return filled


class _Span(NamedTuple):
    """Name over a column: whether it starts there, and whether it ends there."""

    name: str = ""
    first: bool = True
    last: bool = True


def _span(spans: Sequence[str], column: int) -> _Span:
    if not spans:
        return _Span()
    name = spans[column]
    first = column == 0 or spans[column - 1] != name
    return _Span(name, first, column + 1 == len(spans) or spans[column + 1] != name)


def _heading(span: _Span, name: str, unit: str, comment: str) -> Heading:
    if span.name and span.first and span.last and is_unit(name) and not name.isdigit():
        # A name of its own in the row of group names, with its unit in the row of names.
        name, unit, span = span.name, unit or name, _Span()
    name = name or comment or (span.name if span.first else "")
    label, inner = split_unit(name)
    words = [span.name if span.name != name else "", label, comment if comment != name else ""]
    path = f"{span.name}/{name}" if span.name and name not in {"", span.name} else name
    return Heading(path, " ".join(filter(None, words)), unit.strip(" ()[]（）【】") or inner)
