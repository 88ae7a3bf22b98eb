"""Tables of numbers in text files: csv, tsv, txt, dat, whatever their separator and encoding."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from tendonrepro.dataset.readers.cells import (
    MOST_TABLES,
    Cells,
    Mark,
    Rows,
    add_table,
    blocks_of,
    is_stamp,
    mark_of,
    number,
    settle_head,
)
from tendonrepro.dataset.readers.filetype import decoded
from tendonrepro.dataset.readers.signals import MISFIT, Allowance, Found, Unreadable, is_full

_MOST_BYTES = 2**29
"""An hour of twenty columns at 1 kHz; a longer text takes minutes and gigabytes to read."""
_MOST_COLUMNS = 2000
_COMMON_WIDTH = 0.1
_FIRST_LINES = 12
_LONGEST_LINE = 1000
_SAMPLE = 200
_LONGEST_SAMPLE = 20000

_BLANKS = r"\s+"
_COMMENTS = ("#", "%", "//")
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "pipe", _BLANKS: "blanks"}
# Of two styles that fit equally well the earlier is taken.
_STYLES = [*((mark, ".") for mark in _NAMES), *((mark, ",") for mark in _NAMES if mark != ",")]
_SEPARATORS = ",;| \t"
_NO_DIGITS = f"+-.eE{_SEPARATORS}"


@dataclass(frozen=True)
class Style:
    """Separator of a text, one character or `_BLANKS`, and its decimal mark."""

    separator: str
    decimal: str

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        blanks = self.separator == _BLANKS
        if '"' in line:
            with suppress(csv.Error):
                mark = " " if blanks else self.separator
                cells = next(csv.reader([line], delimiter=mark, skipinitialspace=True))
                return [cell for cell in cells if cell] if blanks else cells
        return line.split(None if blanks else self.separator)

    def mark(self, line: str) -> Mark:
        """Tell what a line is."""
        bare = line.strip()
        if not bare.strip(_SEPARATORS):
            return Mark.BLANK
        if bare.startswith(_COMMENTS):
            return Mark.COMMENT
        # Splitting every line of a long log takes minutes; without letters it is numbers, or a ruled line.
        if not bare.strip(f"0123456789{_NO_DIGITS}"):
            return Mark.NUMBERS if bare.strip(_NO_DIGITS) else Mark.WORDS
        return mark_of(self.split(bare), self.decimal)


def read_text_table(path: Path, left: Allowance | None = None) -> Found:
    """Read every table of numbers in a text of any separator, decimal mark, encoding and line ends.

    One signal a column; the group is ``table``, or ``block 1`` and so on where there are several.
    """
    size = path.stat().st_size
    if size > _MOST_BYTES:
        reason = f"a text of {size / 2**20:.0f} MB"
        raise Unreadable(reason, f"split it into files of at most {_MOST_BYTES // 2**20} MB")
    text, encoding = decoded(path.read_bytes())
    lines = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a \t\n").split("\n")
    style = style_of(lines)
    blocks = blocks_of(style.mark(line) for line in lines)
    comma = ", decimal comma" if style.decimal == "," else ""
    found = Found(f"text table ({_NAMES[style.separator]}{comma}, {encoding})", left or Allowance())
    _add_blocks(found, lines, blocks, style)
    if found.signals:
        return found
    # A text for people, such as one that tells what the files beside it hold.
    found = Found(f"text ({encoding})")
    found.skip("", "a text without a table of numbers")
    found.text("text", "\n".join(line[:_LONGEST_LINE].rstrip() for line in lines[:_FIRST_LINES]))
    return found


def _add_blocks(found: Found, lines: Sequence[str], blocks: Sequence[Rows], style: Style) -> None:
    for position, block in enumerate(blocks):
        if is_full(found) or position == MOST_TABLES:
            place = f"lines {block.data[0] + 1} to {blocks[-1].data[-1] + 1}"
            found.skip("", f"{len(blocks) - position} more tables, {place}, left out", "split the file")
            return
        prefix = "" if len(blocks) == 1 else f"block {position + 1}/"
        _add_block(found, lines, block, style, prefix)


def _add_block(found: Found, lines: Sequence[str], block: Rows, style: Style, prefix: str) -> None:
    def words_at(row: int) -> tuple[str, list[str]]:
        line = _without_mark(lines[row][:_LONGEST_LINE])
        return f"line {row + 1}", [line] if style.separator == _BLANKS else style.split(line)

    settle_head(block, lambda row: style.split(lines[row]), style.decimal)
    data = [lines[row].strip(" \r\x1a") for row in block.data]
    width, ragged = _width(data, style)
    columns = _columns(data, style, width)
    head = [_head_cells(lines[row], style, width) for row in block.head]
    if ragged:
        where = f"lines {block.data[0] + 1} to {block.data[-1] + 1}"
        found.skip(where, f"{ragged} rows have another number of cells than {width}", "check these rows")
    # Rows that end with a separator have an empty cell more.
    filled = width - (width > 1 and all(cell != cell or cell == "" for cell in columns[-1]))  # noqa: PLR0124
    misfit = bool(head) and len(head[-1]) > 1 and len(head[-1]) not in {width, filled}
    note = MISFIT if misfit else ""
    add_table(found, block, head, columns, words_at, prefix=prefix, decimal=style.decimal, note=note)


def _without_mark(line: str) -> str:
    """Strip what marks a line as a comment; separators at its ends stand for empty cells and stay."""
    bare = line.strip(" \r\x1a")
    return bare.lstrip().lstrip("#%/ ") if bare.lstrip().startswith(_COMMENTS) else bare


def _head_cells(line: str, style: Style, width: int) -> list[str]:
    """Cells of a row above a table; names that hold blanks stand further apart than by one."""
    line = _without_mark(line)
    cells = style.split(line)
    if style.separator == _BLANKS and len(cells) != width:
        apart = [cell for cell in line.replace("\t", "  ").split("  ") if cell.strip()]
        return next((row for row in (apart, line.split(",")) if len(row) == width), cells)
    # A tab before the names alone is an indentation.
    return cells[1:] if len(cells) == width + 1 and not cells[0].strip() else cells


def _width(data: Sequence[str], style: Style) -> tuple[int, int]:
    """Number of columns, and of rows that have another one: the widest that is not rare."""
    counts = Counter(len(style.split(line)) for line in data)
    common = [width for width, count in counts.items() if count >= _COMMON_WIDTH * len(data)]
    width = min(max(common or counts), _MOST_COLUMNS)
    return width, len(data) - counts[width]


def _columns(data: Sequence[str], style: Style, width: int) -> list[Cells]:
    """Columns, of numbers where all cells are numbers, else of the texts."""
    import pandas as pd

    # One quotation mark left open would swallow every line up to the next.
    quoted = all(line.count('"') % 2 == 0 for line in data)
    # Earlier versions are off by the last bit unless told; later ones warn when told.
    version = [int(part) for part in pd.__version__.split(".")[:2]]
    exact: Any = {"float_precision": "round_trip"} if version < [3, 1] else {}
    with suppress(ValueError, OverflowError):
        table = pd.read_csv(
            # A stream of texts would take four bytes a letter.
            io.BytesIO("\n".join(data).encode()),
            sep=style.separator,
            header=None,
            names=range(width),
            usecols=range(width),
            index_col=False,
            decimal=style.decimal,
            quoting=csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE,
            skipinitialspace=True,
            low_memory=False,
            **exact,
        )
        if len(table) == len(data):
            columns = [table[column].to_numpy() for column in range(width)]
            return [cells if cells.dtype.kind in "biuf" else cells.astype(object) for cells in columns]
    # Rows on which the fast parser gives up.
    rows = [(style.split(line) + [""] * width)[:width] for line in data]
    return [list(column) for column in zip(*rows, strict=True)]


def style_of(lines: Sequence[str]) -> Style:
    """Find the style under which most cells of a text are numbers."""
    sample = _sample(lines)
    return max((Style(*pair) for pair in _STYLES), key=lambda style: _score(style, sample))


def _sample(lines: Sequence[str]) -> list[str]:
    """The first lines with content, and as many spread over the rest."""
    step = max(1, len(lines) // _SAMPLE)
    candidates = [*lines[: 2 * _SAMPLE], *lines[2 * _SAMPLE :: step]]
    filled = [line for line in candidates if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    return [line[:_LONGEST_SAMPLE] for line in filled]


def _score(style: Style, sample: Sequence[str]) -> float:
    """Numbers gained less cells spoilt, and the more the more rows are equally wide."""
    total, widths = 0.0, Counter[int]()
    for line in sample:
        cells = [cell for cell in style.split(line) if cell.strip()]
        read = sum(number(cell, style.decimal) is not None or is_stamp(cell) for cell in cells)
        # A date and the clock time a blank behind it are one cell.
        read -= sum(is_stamp(date) and is_stamp(clock) for date, clock in pairwise(cells))
        if read:
            widths[len(style.split(line.strip()))] += 1
            total += 2 * read - len(cells)
    return total * max(widths.values()) / widths.total() if widths else 0.0
