"""Tables of numbers in text files: csv, tsv, txt, dat, whatever their separator and encoding."""

from __future__ import annotations

import csv
import io
from bisect import bisect
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.cells import (
    MOST_TABLES,
    Block,
    Mark,
    add_columns,
    block_headings,
    blocks_of,
    mark_of,
    note_above,
    settle_head,
)
from tendonrepro.dataset.readers.charset import decoded
from tendonrepro.dataset.readers.heading import Heading
from tendonrepro.dataset.readers.signals import Found, Unreadable, is_full
from tendonrepro.dataset.readers.text_style import BLANKS, COMMENTS, Style, style_of

MOST_BYTES = 2**29
"""An hour of twenty columns at 1 kHz; a longer text takes minutes and gigabytes to read."""
MOST_COLUMNS = 2000
_COMMON_WIDTH = 0.1
_MOST_BLANK = 0.4
_MOST_WORDS = 40
_FIRST_LINES = 12
_LONGEST_LINE = 1000
# Enough to tell a text for people from a long log.
_FEW_ROWS = 200


def read_text_table(path: Path) -> Found:
    """Read every table of numbers in a text file.

    Parameters
    ----------
    path : Path
        Of any separator, decimal mark, encoding and line ends.

    Returns
    -------
    Found
        One signal a column. The group is ``table``, or ``block 1`` and so on where there are several.

    Raises
    ------
    Unreadable
        When the file is too large.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        reason = f"a text of {size / 2**20:.0f} MB"
        raise Unreadable(reason, f"split it into files of at most {MOST_BYTES // 2**20} MB")
    text, encoding = decoded(path.read_bytes())
    lines = _lines(text)
    style = style_of(lines)
    blocks, words = blocks_of([style.mark(line) for line in lines])
    if not blocks or _is_prose(lines, blocks, style):
        return _words_alone(lines, encoding)
    found = Found(f"text table ({style.name}, {encoding})")
    _add_blocks(found, lines, blocks, words, style)
    return found if found.signals else _words_alone(lines, encoding)


def _words_alone(lines: Sequence[str], encoding: str) -> Found:
    """What is kept of a text for people, such as one that tells what the files beside it hold."""
    found = Found(f"text ({encoding})")
    found.skip("", "a text without a table of numbers")
    found.text("text", "\n".join(line[:_LONGEST_LINE].rstrip() for line in lines[:_FIRST_LINES]))
    return found


def _is_prose(lines: Sequence[str], blocks: Sequence[Block], style: Style) -> bool:
    """Whether words outweigh the numbers in lines without a separator, as in a text for people."""
    if style.separator != BLANKS:
        return False
    rows = [row for block in blocks for row in block.data][:_FEW_ROWS]
    cells = [cell for row in rows for cell in style.split(lines[row][:_LONGEST_LINE])]
    return 2 * sum(mark_of([cell], style.decimal) is Mark.NUMBERS for cell in cells) < len(cells)


def _lines(text: str) -> list[str]:
    """Lines whatever their ends; blank ones go where every other line is one, as after a bad transfer."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip("\x1a \t"):
        lines.pop()
    blank = sum(not line.strip() for line in lines)
    return [line for line in lines if line.strip()] if blank > _MOST_BLANK * len(lines) else lines


def _note_words(found: Found, prefix: str, lines: Sequence[str], rows: Sequence[int], style: Style) -> None:
    """Note lines above a table, which may say what the numbers are."""
    filled = [row for row in rows if lines[row].strip()]
    for row in filled[:_MOST_WORDS]:
        line = _without_mark(lines[row][:_LONGEST_LINE])
        note_above(
            found, prefix, f"line {row + 1}", [line] if style.separator == BLANKS else style.split(line)
        )
    if len(filled) > _MOST_WORDS:
        found.skip("", f"{len(filled) - _MOST_WORDS} more lines of words")


def _add_blocks(
    found: Found, lines: Sequence[str], blocks: Sequence[Block], words: Sequence[int], style: Style
) -> None:
    """Add tables, each with the lines of words between it and the one before."""
    names: list[Heading] = []
    before = 0
    for position, block in enumerate(blocks):
        if is_full(found) or position == MOST_TABLES:
            lines_left = f"lines {block.data[0] + 1} to {blocks[-1].data[-1] + 1}"
            found.skip("", f"{len(blocks) - position} more tables, {lines_left}, left out", "split the file")
            return
        alone = len(blocks) == 1
        group = "table" if alone else f"block {position + 1}"
        prefix = "" if alone else f"{group}/"
        above = words[before : bisect(words, block.data[0])]
        before += len(above)
        _note_words(found, prefix, lines, above, style)
        names = _add_block(found, lines, block, style, names, group, prefix)
    for row in words[before : before + _MOST_WORDS]:
        found.text(f"line {row + 1}", lines[row])


def _add_block(
    found: Found,
    lines: Sequence[str],
    block: Block,
    style: Style,
    before: list[Heading],
    group: str,
    prefix: str,
) -> list[Heading]:
    """Add one table; returns its headings."""
    settle_head(block, lambda row: style.split(lines[row]), style.decimal)
    data = [lines[row].strip(" \r\x1a") for row in block.data]
    width, ragged = _width(data, style)
    columns = _columns(data, style, width)
    while width > 1 and _is_empty(columns[-1]) and not _named(lines, block, style, width):
        width -= 1
        columns.pop()
    names, used, note = block_headings(_head_rows(lines, block, style, width), width, before)
    unused = [row for number, row in enumerate(block.head) if number not in used]
    _note_words(found, prefix, lines, unused, style)
    if ragged:
        where = f"lines {block.data[0] + 1} to {block.data[-1] + 1}"
        found.skip(where, f"{ragged} rows have another number of cells than {width}", "check these rows")
    notes = "; ".join(text for text in (note, style.doubt) if text)
    add_columns(found, names, columns, group=group, prefix=prefix, decimal=style.decimal, note=notes)
    return names


def _head_rows(lines: Sequence[str], block: Block, style: Style, width: int) -> list[list[str]]:
    """Cells of the rows above a table, without what marks them as comments."""
    rows = [_head_cells(_without_mark(lines[row]), style, width) for row in block.head]
    # A tab before the names alone is an indentation.
    return [cells[1:] if len(cells) == width + 1 and not cells[0].strip() else cells for cells in rows]


def _without_mark(line: str) -> str:
    """A line without what marks it as a comment; separators at its ends stand for empty cells and stay."""
    bare = line.strip(" \r\x1a")
    return bare.lstrip().lstrip("#%/ ") if bare.lstrip().startswith(COMMENTS) else bare


def _head_cells(line: str, style: Style, width: int) -> list[str]:
    """Cells of a row of names; names that hold blanks stand further apart than by one."""
    cells = style.split(line)
    if style.separator != BLANKS or len(cells) == width:
        return cells
    apart = [cell for cell in line.replace("\t", "  ").split("  ") if cell.strip()]
    by_comma = line.split(",")
    return next((row for row in (apart, by_comma) if len(row) == width), cells)


def _named(lines: Sequence[str], block: Block, style: Style, width: int) -> bool:
    """Whether some row above names the last of so many columns."""
    rows = _head_rows(lines, block, style, width)
    return any(len(cells) == width and cells[-1].strip() for cells in rows)


def _width(data: Sequence[str], style: Style) -> tuple[int, int]:
    """Number of columns, and of rows that have another one: the widest that is not rare."""
    counts = Counter(style.width(line) for line in data)
    common = [width for width, count in counts.items() if count >= _COMMON_WIDTH * len(data)]
    width = min(max(common or counts), MOST_COLUMNS)
    # A separator at the end of a row is no further cell.
    trailing = sum(
        style.width(line) == width + 1 and line.rstrip().endswith(style.separator) for line in data
    )
    return width, len(data) - counts[width] - trailing


def _columns(data: Sequence[str], style: Style, width: int) -> list[NDArray[Any]]:
    """Columns, of numbers where all cells are numbers, else of the texts."""
    import pandas as pd

    # One quotation mark left open would swallow every line up to the next.
    quoted = all(line.count('"') % 2 == 0 for line in data)
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(data)),
            sep=style.separator,
            header=None,
            names=list(range(width)),
            usecols=list(range(width)),
            index_col=False,
            decimal=style.decimal,
            quoting=csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE,
            skipinitialspace=True,
            skip_blank_lines=False,
            low_memory=False,
            engine="c",
            **_exact(pd.__version__),
        )
    except (ValueError, OverflowError, pd.errors.ParserError):
        return _split_columns(data, style, width)
    if len(table) != len(data):
        return _split_columns(data, style, width)
    return [_cells(table[column].to_numpy()) for column in range(width)]


def _exact(version: str) -> dict[str, Any]:
    """Make numbers exact in versions of pandas that otherwise are off by the last bit."""
    major, minor = (int(part) for part in version.split(".")[:2])
    return {"float_precision": "round_trip"} if (major, minor) < (3, 1) else {}


def _cells(values: NDArray[Any]) -> NDArray[Any]:
    return values if values.dtype.kind in "biuf" else values.astype(object)


def _split_columns(data: Sequence[str], style: Style, width: int) -> list[NDArray[Any]]:
    """Split line by line, for rows on which the fast parser gives up."""
    rows = [(style.split(line) + [""] * width)[:width] for line in data]
    return [np.array([row[column] for row in rows], object) for column in range(width)]


def _is_empty(cells: NDArray[Any]) -> bool:
    return bool(np.isnan(cells).all()) if cells.dtype.kind == "f" else False
