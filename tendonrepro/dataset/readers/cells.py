"""A rectangle of cells, from a text or a sheet, as tables of numbers with headings."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.heading import headings
from tendonrepro.dataset.readers.signals import BELOW, WORDS, Found, is_full, note_rest, seconds

MOST_TABLES = 100
"""Tables of one text or sheet that are read; a log that restarts more often is rare."""
_MOST_WORDS = 40
"""Rows of words about one table that are noted."""
_FEWEST_ROWS = 3
"""Fewer rows of numbers beside a longer table are settings, such as a sampling rate."""
_MISSING = {
    "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "nan(ind)", "-nan(ind)", "1.#qnan", "1.#ind",
    "-1.#ind", "--", "---", "#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!",
}  # fmt: skip
_EXPONENT = r"(?:[ed][+-]?\d{1,4})?"
_NUMBERS = {
    ".": re.compile(rf"[+-]?(?:(?:\d+\.?\d*|\.\d+){_EXPONENT}|inf(?:inity)?)"),
    ",": re.compile(rf"[+-]?(?:(?:\d+(?:,\d+)?|,\d+){_EXPONENT}|inf(?:inity)?)"),
}
_DATE = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}"
_STAMP = re.compile(rf"{_DATE}(?:[ T]+\d.*)?|\d{{1,2}}:\d{{2}}:\d{{2}}.*")
"""A date with the year first, perhaps with a clock time, or a clock time alone."""
_LONGEST = 60
_NO_RESULT = "if formulas fill it, open the file in its program and save it again with their results"
_MOST_DIFFERENT = 20

Cells: TypeAlias = NDArray[Any] | Sequence[Any]


class Mark(Enum):
    """What a row of cells is."""

    BLANK = "blank"
    COMMENT = "comment"
    WORDS = "words"
    NUMBERS = "numbers"


@dataclass
class Rows:
    """Rows of numbers that belong together, by their positions.

    `head` holds the rows right above them, `above` the words further up, down from the block before, and
    `note` is of all their columns.
    """

    head: list[int] = field(default_factory=list)
    data: list[int] = field(default_factory=list)
    above: list[int] = field(default_factory=list)
    note: str = ""


def number(cell: Any, decimal: str = ".") -> float | None:
    """Number in a cell, NaN for the usual words for a missing value; None for what is no number."""
    if isinstance(cell, int | float):
        return float(cell)
    if not isinstance(cell, str) or len(cell) > _LONGEST:
        return None
    text = cell.strip(" \t\"'\u00a0\u3000").replace("−", "-").replace("∞", "inf").lower()
    if text in _MISSING:
        return math.nan
    if not _NUMBERS[decimal].fullmatch(text):
        return None
    return float(text.replace(",", ".").replace("d", "e"))


def is_stamp(cell: Any) -> bool:
    """Whether a cell is a date, a clock time or a duration, as an object or written out."""
    if isinstance(cell, datetime.timedelta):
        return True
    text = str(cell).strip()  # of a date or time it reads as people write them
    return len(text) <= _LONGEST and _STAMP.fullmatch(text) is not None


def _times(cells: Cells) -> tuple[Array, str] | None:
    """Dates as s from the first, other times as s, NaN for other cells, with a note; None for few times."""
    import pandas as pd

    stamps = pd.Series([str(cell).strip() if is_stamp(cell) else None for cell in cells], dtype=object)
    if 2 * stamps.count() < max(1, sum(map(_is_filled, cells))):
        return None
    if not stamps.str.match(_DATE).any():
        return seconds(pd.to_timedelta(stamps, errors="coerce").to_numpy())
    dates = pd.to_datetime(stamps, format="mixed", utc=True, errors="coerce")
    return seconds(dates.dt.tz_localize(None).to_numpy())


def _is_filled(cell: Any) -> bool:
    # Only NaN differs from itself.
    return cell is not None and cell == cell and bool(str(cell).strip())  # noqa: PLR0124


def mark_of(cells: Sequence[Any], decimal: str = ".") -> Mark:
    """Tell what a row is: numbers as soon as one cell is a number or a time."""
    filled = [cell for cell in cells if _is_filled(cell)]
    if any(number(cell, decimal) is not None or is_stamp(cell) for cell in filled):
        return Mark.NUMBERS
    return Mark.WORDS if filled else Mark.BLANK


def blocks_of(marks: Iterable[Mark]) -> list[Rows]:
    """Group rows into blocks with enough rows of numbers to be a table.

    A blank row or one of words ends a block; comments within it do not.
    """
    blocks = [Rows()]
    for row, mark in enumerate(marks):
        current = blocks[-1]
        if mark is Mark.NUMBERS:
            current.data.append(row)
        elif mark is Mark.COMMENT:
            if not current.data:
                current.head.append(row)
        elif current.data:
            blocks.append(Rows([row] if mark is Mark.WORDS else []))
        elif mark is Mark.WORDS:
            current.head.append(row)
    fewest = max(1, min(_FEWEST_ROWS, max(len(block.data) for block in blocks)))
    tables: list[Rows] = []
    words: list[int] = []
    for block in blocks:
        if len(block.data) >= fewest:
            block.above, words = words, []
            tables.append(block)
        else:
            words += block.head + block.data
    if blocks[-1].head and len(tables) > 1 and blocks[-1] is not tables[-1]:
        for block in tables:
            block.note = BELOW
    return tables


def settle_head(block: Rows, cells_at: Callable[[int], Sequence[Any]], decimal: str = ".") -> None:
    """Move the first row of numbers to the head if it names the columns, as in ``t, 1, 2, 3``."""
    named = block.head and sum(_is_filled(cell) for cell in cells_at(block.head[-1])) > 1
    if named or len(block.data) < 3:
        return
    for top, *below in zip(*map(cells_at, block.data[:3]), strict=False):
        word = isinstance(top, str) and mark_of([top], decimal) is Mark.WORDS
        if word and all(mark_of([cell], decimal) is Mark.NUMBERS for cell in below):
            block.head.append(block.data.pop(0))
            return


def add_table(
    found: Found,
    block: Rows,
    head: Sequence[Sequence[str]],
    columns: Sequence[Cells],
    words_at: Callable[[int], tuple[str, Sequence[str]]],
    *,
    prefix: str,
    decimal: str = ".",
    note: str = "",
) -> None:
    """Add the columns of a block as signals, with the words above it as texts.

    `head` has the cells of the block's head; `words_at` tells where a row stands and its words. Paths begin
    with the `prefix`, which ends with a ``/``, or is empty for the only table of a text.
    """
    names, unused = headings(head, len(columns))
    rows = [*block.above, *(block.head[position] for position in unused)]
    for row in rows[:_MOST_WORDS]:
        place, words = words_at(row)
        words = [word.strip() for word in words if word.strip()]
        if len(words) == 1 and f"{prefix}title" not in found.texts:
            place = "title"
        found.text(prefix + place, ", ".join(words))
    group = prefix.removesuffix("/") or "table"
    for position, (heading, cells) in enumerate(zip(names, columns, strict=True)):
        if is_full(found):
            note_rest(found, len(columns) - position, "columns")
            break
        path = prefix + (heading.name or f"column {position + 1}")
        read = _numbers(cells, decimal)
        if read is None:
            _add_words(found, path, cells, heading.label, group)
        elif not np.isnan(read[0]).all():
            values, how, unit = read
            text = "; ".join(filter(None, [how, note, block.note]))
            found.add(path, values, label=heading.label, unit=unit or heading.unit, group=group, note=text)
        elif heading.name:
            found.skip(path, "no number in it", _NO_RESULT)


def _numbers(cells: Cells, decimal: str) -> tuple[NDArray[Any], str, str | None] | None:
    """Values, what was done to get them, and their unit if that is settled; None for words."""
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "biuf":
        return cells, "", None
    values = [number(cell, decimal) for cell in cells]
    odd = [cell for cell, value in zip(cells, values, strict=True) if value is None and _is_filled(cell)]
    if len(odd) > len(values) - values.count(None):
        times = _times(cells)
        return (*times, "s") if times else None
    some = ", ".join(sorted({repr(str(cell)[:20]) for cell in odd})[:3])
    how = f"{len(odd)} cells are no numbers ({some}) and became NaN: meant so?" if odd else ""
    return np.array([math.nan if value is None else value for value in values]), how, None


def _add_words(found: Found, path: str, cells: Cells, label: str, group: str) -> None:
    """Take a column of words: one describes the table, a few may say which run a row belongs to."""
    words = [str(cell).strip() if _is_filled(cell) else "" for cell in cells]
    different = [word for word in dict.fromkeys(words) if word]
    if 1 < len(different) <= _MOST_DIFFERENT:
        numbers = {word: place for place, word in enumerate(different, start=1)}
        meaning = ", ".join(f"{place} is {word[:20]!r}" for word, place in numbers.items())
        values = np.array([numbers.get(word, 0) for word in words])
        found.add(path, values, label=label, group=group, note=f"words as numbers: {meaning}")
        return
    found.skip(path, f"{sum(map(bool, words))} {WORDS}, {len(different)} different")
    if len(different) == 1:
        found.text(path, different[0])
