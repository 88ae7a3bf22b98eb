"""Tables in texts: separator, decimal mark, encoding and header are found; pandas reads the numbers."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd

from tendonrepro.dataset import tables
from tendonrepro.dataset.tables import Columns, Unreadable

_COMMENTS = ("#", "%", "//")
_HEAD = 2**20
"""Characters at the beginning that tell how a file is written."""
_SAMPLED = 60
"""Last lines of them that tell the separator."""
_MOST_BREAKS = 8
"""Lines over which a quoted name may go."""
_OPENS = re.compile(r'(?:^|[\t;,|])\s*"')
"""Quote before a cell, where those that close again are taken off."""
_CHUNK = 2**20
_WAYS = [(separator, comma) for comma in (False, True) for separator in ("\t", ";", ",", "|", None)]
"""Separators, None for blanks, and whether decimals have a comma."""


@dataclass(frozen=True)
class Layout:
    """How a text is written: `separator`, None for blanks, `comma` for decimals; `skipped` lines come first.

    `names` are those of its columns; `is_damaged` says that some bytes are not of the encoding; `angle_unit`,
    if any, is that of angles and rates by a setting above the table.
    """

    encoding: str
    is_damaged: bool
    separator: str | None
    comma: bool
    skipped: int
    names: list[str]
    angle_unit: str


def read_text_table(path: Path) -> Columns:
    """Read a table, by whatever separator, decimal mark and encoding.

    Raises
    ------
    Unreadable
        If there is no table of numbers.
    """
    layout = layout_of(path)
    columns = Columns()
    columns.angle_unit = layout.angle_unit
    if layout.is_damaged:
        columns.notes.append("bytes that are no UTF-8 were replaced")
    frame, too_long = _read(path, layout)
    if too_long:
        columns.notes.append(f"{too_long} lines with more cells than columns left out")
    words = [k for k in range(len(layout.names)) if frame[k].dtype.kind not in "biuf"]
    if words:
        # Cells that are no plain numbers are read once more, as they are written.
        frame[words] = texts = _read(path, layout, usecols=words, dtype=str)[0].map(_content)
        no_number = _rows_without_numbers(frame, texts)
        columns.notes += _note_on(texts[no_number])
        frame = frame[~no_number]
    for k, name in enumerate(layout.names):
        tables.add_column(columns, name, frame[k])
    return columns


def layout_of(path: Path) -> Layout:
    """How a text is written.

    Raises
    ------
    Unreadable
        If there is no table of numbers.
    """
    encoding, is_damaged = _encoding_of(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = stream.read(_HEAD).split("\n")
        # What is cut off in mid-line tells nothing.
        lines = lines[:-1] if stream.read(1) else lines
    last = [line for line in lines[-2 * _SAMPLED :] if line.strip() and not line.startswith(_COMMENTS)]
    separator, comma = _spelling(last[-_SAMPLED:])
    # Excel names the separator in a line of its own.
    is_hint = re.compile("sep=", re.IGNORECASE).match
    written = {place: line for place, line in _whole(lines) if line.strip() and not is_hint(line)}
    filled = [place for place, line in written.items() if not line.startswith(_COMMENTS)]
    rows = [split(written[place], separator) for place in filled]
    first = tables.first_numbers(rows, [split(line, separator) for line in last[-_SAMPLED:]])
    if first is None:
        raise Unreadable("a text without a table of numbers")
    above = [line for place, line in written.items() if place < filled[first]]
    head = [split(line.lstrip("#%/"), separator) for line in above]
    width = max(map(len, rows[first : first + 1000]))
    names = tables.names_of(head, width)
    return Layout(encoding, is_damaged, separator, comma, filled[first], names, tables.angle_unit_of(above))


def _whole(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Lines and their places; what breaks off between quotes goes on in the next line."""
    place = 0
    while place < len(lines):
        end = place + 1
        if _OPENS.search(re.sub('"[^"]*"', "", lines[place])):
            closing = (k for k in range(end, min(end + _MOST_BREAKS, len(lines))) if lines[k].count('"') % 2)
            end = next(closing, place) + 1
        yield place, " ".join(line.strip() for line in lines[place:end]) if end > place + 1 else lines[place]
        place = end


def _encoding_of(path: Path) -> tuple[str, bool]:
    """Encoding of a file, by the first stretch beyond ASCII, and whether some bytes do not fit it."""
    with path.open("rb") as stream:
        chunks = iter(lambda: stream.read(_CHUNK), b"")
        first = next(chunks, b"")
        if first.startswith((b"\xff\xfe", b"\xfe\xff")):
            return "utf-16", False
        return encoding_of_bytes(
            next((chunk for chunk in chain([first], chunks) if not chunk.isascii()), b"")
        )


def encoding_of_bytes(content: bytes) -> tuple[str, bool]:
    """UTF-8, though with a few bad bytes; Chinese where that makes common words; else Western.

    >>> encoding_of_bytes("Winkel [°]".encode("cp1252"))
    ('cp1252', False)
    """
    text = content.decode("utf-8", errors="replace")
    bad = text.rstrip("�").count("�")
    beyond = sum(character > "\x7f" for character in text)
    if bad == 0 or 10 * bad <= beyond:
        return "utf-8-sig", bad > 0
    return ("gb18030" if _is_chinese(content) else "cp1252"), False


def _is_chinese(content: bytes) -> bool:
    """Whether most bytes beyond ASCII are pairs of GB 2312's common characters."""
    beyond = sum(byte >= 0x80 for byte in content)
    common = re.findall(rb"[\xa1-\xa3\xb0-\xd7][\xa1-\xfe]", content)
    words = re.findall(rb"(?:[\xb0-\xd7][\xa1-\xfe]){2,}", content)
    return bool(words) and 2 * len(common) > 0.5 * beyond


def _spelling(lines: Sequence[str]) -> tuple[str | None, bool]:
    """Separator, None for blanks, and decimal comma: what makes most numbers."""

    def numbers(way: tuple[str | None, bool]) -> int:
        separator, comma = way
        mark, other = (",", ".") if comma else (".", ",")
        cells = [cell for line in lines for cell in split(line, separator) if cell]
        # A number with the other mark alone may have it between thousands, and does not tell.
        return sum(
            1 if tables.is_number(cell) and (mark in cell or other not in cell) else -1 for cell in cells
        )

    return max(_WAYS, key=numbers)


def split(line: str, separator: str | None) -> list[str]:
    """Cells of a line."""
    text = line.replace("−", "-")
    if separator is None:
        # Names with blanks stand further apart than their words.
        wide = re.split(r"\s{2,}|\t", text.strip())
        parts = wide if len(wide) > 1 and not tables.is_number(wide[0].split()[0]) else text.split()
    else:
        parts = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    return [_content(part) for part in parts]


def _content(cell: str | float) -> str:
    """A cell as text, without quotes around it."""
    return "" if pd.isna(cell) else str(cell).strip().strip('"').strip()


def _rows_without_numbers(frame: pd.DataFrame, texts: pd.DataFrame) -> pd.Series:
    """Rows in which no cell is a number; `texts` are the columns that hold words."""
    no_number = frame[frame.columns.difference(texts.columns)].isna().all(axis=1)
    rest = texts[no_number]
    no_number[rest.index] = ~rest.map(lambda cell: bool(re.match(r"[-+−]?[.,]?\d", cell))).any(axis=1)
    return no_number


def _note_on(rows: pd.DataFrame) -> list[str]:
    """What is left out with rows of words; nothing of blank remarks."""
    words = [cell for cell in rows.to_numpy().ravel() if cell.strip("#%/ ")]
    return [f"{len(rows)} rows without a number left out, the first {words[0][:40]!r}"] if words else []


def _read(path: Path, layout: Layout, **chosen: Any) -> tuple[pd.DataFrame, int]:
    """Cells below the header, and how many lines have too many."""
    with (
        path.open(encoding=layout.encoding, errors="replace") as stream,
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        # pandas would count lines of the head by its quotes, which may not close.
        for _ in range(layout.skipped):
            next(stream)
        frame = pd.read_csv(
            stream,
            sep=r"\s+" if layout.separator is None else layout.separator,
            decimal="," if layout.comma else ".",
            header=None,
            names=range(len(layout.names)),
            index_col=False,
            skipinitialspace=True,
            on_bad_lines="warn",
            **chosen,
        )
    told = [str(warning.message) for warning in caught if warning.category is pd.errors.ParserWarning]
    return frame, "".join(told).count("Skipping line")
