"""A rectangle of cells, from a text or a sheet, as tables of numbers with headings."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import chain, count, groupby
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.heading import Heading, headings
from tendonrepro.dataset.readers.signals import Found, is_full, note_rest
from tendonrepro.dataset.readers.stamps import is_stamp, seconds

MOST_TABLES = 100
"""Tables of one text or sheet that are read; a log that restarts more often is rare."""
FEWEST_ROWS = 3
"""Fewer rows of numbers beside a longer table are settings, such as a sampling rate."""
_MISSING = frozenset(
    {"nan", "-nan", "na", "n/a", "#n/a", "null", "none", "nan(ind)", "-nan(ind)", "1.#qnan", "1.#ind"}
    | {"-1.#ind", "--", "---", "#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"}
)
_POINT = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d{1,4})?")
_COMMA = re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eEdD][+-]?\d{1,4})?")
_INFINITE = re.compile(r"[+-]?(?:inf|infinity|∞)", re.IGNORECASE)
_GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?"),
}
_NO_RESULT = (
    "if formulas fill it, open the file in its program and save it again so that it holds their results"
)
_LONGEST_NUMBER = 60
_MOST_TEXTS = 20

Cells: TypeAlias = NDArray[Any] | Sequence[Any]


class Mark(Enum):
    """What a row of cells is."""

    BLANK = "blank"
    COMMENT = "comment"
    WORDS = "words"
    NUMBERS = "numbers"


@dataclass
class Block:
    """Rows of numbers that belong together, and the rows of words above them, by their positions."""

    head: list[int] = field(default_factory=list)
    data: list[int] = field(default_factory=list)


def number(cell: Any, decimal: str = ".", *, grouped: bool = False) -> float | None:
    """Number in a cell.

    Parameters
    ----------
    cell : object
        Text or number.
    decimal : str
        Decimal mark, point or comma.
    grouped : bool
        Whether the other mark may stand between thousands.

    Returns
    -------
    float or None
        NaN for the usual words for a missing value; None for what is no number.
    """
    if isinstance(cell, int | float):
        return _as_float(cell)
    if not isinstance(cell, str) or len(cell) > _LONGEST_NUMBER:
        return None
    text = cell.strip(" \t\"'\u00a0\u3000").replace("−", "-")
    value = None
    if (_POINT if decimal == "." else _COMMA).fullmatch(text):
        value = text.replace(",", ".").lower().replace("d", "e")
    elif text.lower() in _MISSING:
        value = "nan"
    elif _INFINITE.fullmatch(text):
        value = text.replace("∞", "inf")
    elif grouped and _GROUPED[decimal].fullmatch(text):
        value = text.replace("." if decimal == "," else ",", "").replace(",", ".")
    return None if value is None else float(value)


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


def mark_of(cells: Sequence[Any], decimal: str = ".") -> Mark:
    """What a row is: numbers as soon as one cell is a number or a time."""
    filled = [cell for cell in cells if cell is not None and str(cell).strip()]
    if not filled:
        return Mark.BLANK
    if any(number(cell, decimal, grouped=True) is not None or is_stamp(cell) for cell in filled):
        return Mark.NUMBERS
    return Mark.WORDS


def blocks_of(marks: Iterable[Mark]) -> tuple[list[Block], list[int]]:
    """Group rows into blocks of numbers with the words above them.

    Parameters
    ----------
    marks : iterable of Mark
        One a row. A blank row or one of words ends a block; comments within it do not.

    Returns
    -------
    blocks : list of Block
        With enough rows of numbers to be a table.
    words : list of int
        Rows that belong to no block.
    """
    blocks = [Block()]
    for row, mark in enumerate(marks):
        current = blocks[-1]
        if mark is Mark.NUMBERS:
            current.data.append(row)
        elif mark is Mark.COMMENT:
            if not current.data:
                current.head.append(row)
        elif current.data:
            blocks.append(Block([row] if mark is Mark.WORDS else []))
        elif mark is Mark.WORDS:
            current.head.append(row)
    fewest = max(1, min(FEWEST_ROWS, max(len(block.data) for block in blocks)))
    tables = [block for block in blocks if len(block.data) >= fewest]
    words = [row for block in blocks if len(block.data) < fewest for row in block.head + block.data]
    return tables, words


def settle_head(block: Block, cells_at: Callable[[int], Sequence[Any]], decimal: str = ".") -> None:
    """Move the first row of numbers to the head if it names the columns, as in ``t, 1, 2, 3``.

    Parameters
    ----------
    block : Block
        Changed in place.
    cells_at : callable
        Cells of a row by its position.
    decimal : str
        Decimal mark.
    """
    named = block.head and sum(_is_filled(cell) for cell in cells_at(block.head[-1])) > 1
    if named or len(block.data) < 3:
        return
    first, second, third = (list(cells_at(row)) for row in block.data[:3])
    for top, below, lower in zip(first, second, third, strict=False):
        word = isinstance(top, str) and top.strip() and mark_of([top], decimal) is Mark.WORDS
        if word and mark_of([below], decimal) is mark_of([lower], decimal) is Mark.NUMBERS:
            block.head.append(block.data.pop(0))
            return


def block_headings(
    rows: Sequence[Sequence[str]], width: int, before: Sequence[Heading]
) -> tuple[list[Heading], list[int], str]:
    """Headings of a block; one without its own takes those of the block before if it is as wide.

    Returns
    -------
    headings : list of Heading
    used : list of int
        Which of the rows name columns.
    note : str
        Says so when they are those of the block before.
    """
    own, used = headings(rows, width)
    if not used and len(before) == width and any(heading.name for heading in before):
        return list(before), used, "headings of the table before"
    return own, used, ""


def note_above(found: Found, prefix: str, place: str, cells: Iterable[str]) -> None:
    """Note a row of words above a table: its title if it is a single text.

    Parameters
    ----------
    found : Found
    prefix : str
        Of the paths of its columns, with its ``/``.
    place : str
        Row or line in the file, the path of what is no title.
    cells : iterable of str
    """
    words = [word for word, _ in groupby(cell.strip() for cell in cells if cell.strip())]
    path = f"{prefix}{'title' if len(words) == 1 else place}"
    numbered = chain([path], (f"{path} {number}" for number in count(2)))
    found.text(next(name for name in numbered if name not in found.texts), ", ".join(words))


def add_columns(
    found: Found,
    names: Sequence[Heading],
    columns: Sequence[Cells],
    *,
    group: str,
    prefix: str = "",
    decimal: str = ".",
    note: str = "",
) -> None:
    """Add the columns of a table as signals; those of words are noted.

    Parameters
    ----------
    found : Found
    names : sequence of Heading
    columns : sequence of cells
        As many.
    group : str
        Of all its signals.
    prefix : str
        Of their paths, with its ``/``.
    decimal : str
        Decimal mark of numbers written out.
    note : str
        For every signal.
    """
    for position, (heading, cells) in enumerate(zip(names, columns, strict=True)):
        if is_full(found):
            note_rest(found, len(columns) - position, "columns")
            return
        path = prefix + (heading.name or f"column {position + 1}")
        if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
            values, how, unit = cells, "", heading.unit
        else:
            read = _numbers(cells, decimal)
            if read is None:
                _note_words(found, path, cells)
                continue
            values, how, unit = read[0], read[1], read[2] or heading.unit
        if np.isnan(values).all():
            if heading.name:
                found.skip(path, "no number in it", _NO_RESULT)
            continue
        notes = "; ".join(text for text in (how, note) if text)
        found.add(path, values, label=heading.label, unit=unit, group=group, note=notes)


def _numbers(cells: Cells, decimal: str) -> tuple[Array, str, str | None] | None:
    """Values, what was done to get them, and their unit if that is settled; None for words."""
    values = [number(cell, decimal, grouped=True) for cell in cells]
    odd = [cell for cell, value in zip(cells, values, strict=True) if value is None and _is_filled(cell)]
    numbers = sum(value is not None for value in values)
    if len(odd) <= numbers and numbers:
        found = np.array([np.nan if value is None else value for value in values])
        return found, _odd_cells(odd), None
    times = seconds(list(cells))
    return (*times, "s") if times else None


def _is_filled(cell: Any) -> bool:
    # Only NaN differs from itself.
    return cell is not None and cell == cell and bool(str(cell).strip())  # noqa: PLR0124


def _odd_cells(odd: Sequence[Any]) -> str:
    if not odd:
        return ""
    some = ", ".join(sorted({repr(str(cell)[:20]) for cell in odd})[:3])
    return f"{len(odd)} cells are no numbers ({some}) and became NaN"


def _note_words(found: Found, path: str, cells: Cells) -> None:
    """Note a column of words: a few different ones may say which run a row belongs to."""
    words = [str(cell) for cell in cells if _is_filled(cell)]
    if not words:
        if not path.rpartition("/")[2].startswith("column "):
            found.skip(path, "no number in it", _NO_RESULT)
        return
    different = list(dict.fromkeys(words))
    found.skip(path, f"{len(words)} cells of words, {len(different)} different")
    found.text(path, ", ".join(different[:_MOST_TEXTS]))
