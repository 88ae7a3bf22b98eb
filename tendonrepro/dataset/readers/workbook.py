"""Tables of numbers in workbooks: xlsx, xlsb, xls and ods."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tendonrepro.dataset.readers.cells import (
    MOST_TABLES,
    Block,
    Cells,
    add_columns,
    block_headings,
    blocks_of,
    mark_of,
    note_above,
    settle_head,
)
from tendonrepro.dataset.readers.heading import Heading
from tendonrepro.dataset.readers.signals import Found, Unreadable, is_full

if TYPE_CHECKING:
    from python_calamine import CalamineSheet

MOST_CELLS = 20_000_000
"""Of one sheet; each takes some 100 bytes while it is read."""
_MOST_WORDS = 20
_MOST_TEXTS = 500
_MOST_MERGED = 1000
_BROKEN = "open it in Excel or LibreOffice, which can repair it, and save it again"


def read_workbook(path: Path, kind: str) -> Found:
    """Read every table of numbers on every sheet of a workbook.

    Parameters
    ----------
    path : Path
    kind : str
        True type of the file, for the user.

    Returns
    -------
    Found
        One signal a column. The group is the sheet, or the sheet with columns and rows such as
        ``Sheet1!D:F`` where it has several tables.

    Raises
    ------
    Unreadable
        When it is encrypted or broken.
    """
    from python_calamine import CalamineWorkbook, PasswordError

    found = Found(kind)
    try:
        book = CalamineWorkbook.from_path(path)
    except PasswordError as error:
        reason = "encrypted"
        raise Unreadable(reason, "ask its authors for the password, save it without one") from error
    except Exception as error:
        reason = f"a broken workbook ({error})"
        raise Unreadable(reason, _BROKEN) from error
    with book:
        for sheet in book.sheets_metadata:
            if is_full(found):
                found.skip(sheet.name, "left out, there are too many signals", "split the file")
            elif "WorkSheet" not in str(sheet.typ):
                found.skip(sheet.name, "no sheet of cells but a chart, dialog or macro")
            else:
                hidden = "" if str(sheet.visible).endswith("Visible") else "on a hidden sheet"
                _read_sheet(found, book, sheet.name, hidden)
    return found


def _read_sheet(found: Found, book: Any, name: str, note: str) -> None:
    try:
        sheet = book.get_sheet_by_name(name)
        rows = _rows(sheet)
    except Unreadable as error:
        found.skip(name, error.reason, error.advice)
        return
    except Exception as error:  # calamine raises errors of several families, by what is broken
        found.skip(name, f"a broken sheet ({error})", _BROKEN)
        return
    grid = _Grid(rows, sheet.start or (0, 0), _merged(sheet, rows))
    tables = [table for columns in _column_ranges(rows) for table in _tables(found, name, grid, columns)]
    names: list[Heading] = []
    for table in tables[:MOST_TABLES]:
        group = name if len(tables) == 1 else f"{name}!{table.where()}"
        names = table.add_to(found, group, names, note)
    if len(tables) > MOST_TABLES:
        found.skip(name, f"{len(tables) - MOST_TABLES} more tables left out", "split the sheet")
    if not tables:
        found.skip(name, "a sheet without numbers")


@dataclass(frozen=True)
class _Grid:
    """Cells of a sheet, the place of the first from 0, and the rows with merged cells, filled."""

    rows: Sequence[Sequence[Any]]
    corner: tuple[int, int]
    merged: Mapping[int, Sequence[Any]]

    def shown(self, row: int, columns: range) -> Sequence[Any]:
        """Cells as a reader of the sheet sees them."""
        return self.merged.get(row, self.rows[row])[columns.start : columns.stop]

    def number(self, row: int) -> int:
        """Number of a row in the sheet."""
        return self.corner[0] + row + 1


def _rows(sheet: CalamineSheet) -> list[list[Any]]:
    cells = sheet.height * sheet.width
    if cells > MOST_CELLS:
        reason = f"{cells} cells are too many"
        raise Unreadable(reason, "save the sheet as CSV")
    return sheet.to_python(skip_empty_area=True)


def _merged(sheet: CalamineSheet, rows: Sequence[Sequence[Any]]) -> dict[int, list[Any]]:
    """Rows in which cells are merged, with their texts in every column they cover."""
    first_row, first_column = sheet.start or (0, 0)
    filled: dict[int, list[Any]] = {}
    for (top, left), (_, right) in (sheet.merged_cell_ranges or [])[:_MOST_MERGED]:
        row, column = top - first_row, left - first_column
        if not 0 <= row < len(rows) or not 0 <= column < len(rows[row]):
            continue
        text = rows[row][column]
        if isinstance(text, str) and text.strip():
            cells = filled.setdefault(row, list(rows[row]))
            covered = range(column, min(right - first_column + 1, len(cells)))
            for place in (place for place in covered if cells[place] in ("", None)):
                cells[place] = text
    return filled


def _column_ranges(rows: Sequence[Sequence[Any]]) -> list[range]:
    """Runs of columns between empty ones: tables that stand side by side."""
    width = max((len(row) for row in rows), default=0)
    used = np.zeros(width, bool)
    for row in rows:
        used[: len(row)] |= [cell is not None and cell != "" for cell in row]
    runs = [list(run) for is_used, run in groupby(range(width), key=lambda column: used[column]) if is_used]
    return [range(run[0], run[-1] + 1) for run in runs]


def _tables(found: Found, name: str, grid: _Grid, columns: range) -> list[_Table]:
    """Tables within a run of columns, with the words above them; what is none is noted."""
    blocks, words = blocks_of([mark_of(grid.shown(row, columns)) for row in range(len(grid.rows))])
    tables, before = [], 0
    for block in blocks:
        above = words[before : bisect(words, block.data[0])]
        before += len(above)
        tables.append(_Table(grid, block, columns, above[:_MOST_WORDS]))
    if tables:
        tables[-1].below = words[before : before + _MOST_WORDS]
    else:
        for row in range(min(len(grid.rows), _MOST_WORDS)):
            _note_row(found, name, grid, row, columns)
    return tables


def _note_row(found: Found, name: str, grid: _Grid, row: int, columns: range) -> None:
    cells = grid.rows[row][columns.start : columns.stop]
    if len(found.texts) < _MOST_TEXTS:
        found.text(f"{name}/row {grid.number(row)}", ", ".join(_text(cell) for cell in cells if _text(cell)))


class _Table:
    """Rows and columns of a sheet that are one table, and the words outside its head that belong to it."""

    def __init__(self, grid: _Grid, block: Block, columns: range, above: Sequence[int]) -> None:
        self.grid, self.block, self.columns, self.above = grid, block, columns, above
        self.below: Sequence[int] = ()
        settle_head(block, lambda row: grid.rows[row][columns.start : columns.stop])

    def where(self) -> str:
        """Columns and rows as a spreadsheet names them."""
        left, right = (_letters(self.grid.corner[1] + self.columns[end]) for end in (0, -1))
        first, last = (self.grid.number(self.block.data[end]) for end in (0, -1))
        return f"{left}{first}:{right}{last}"

    def add_to(self, found: Found, group: str, before: Sequence[Heading], note: str) -> list[Heading]:
        """Add its columns as signals; returns its headings."""
        names, used, inherited = block_headings(
            [self._shown(row) for row in self.block.head], len(self.columns), before
        )
        for row in (*self.above, *(row for n, row in enumerate(self.block.head) if n not in used)):
            if len(found.texts) < _MOST_TEXTS:
                note_above(found, f"{group}/", f"row {self.grid.number(row)}", self._shown(row))
        for row in self.below:
            _note_row(found, group, self.grid, row, self.columns)
        columns = [self._column(column) for column in self.columns]
        notes = "; ".join(text for text in (note, inherited) if text)
        add_columns(found, names, columns, group=group, prefix=f"{group}/", note=notes)
        return names

    def _shown(self, row: int) -> list[str]:
        return [_text(cell) for cell in self.grid.shown(row, self.columns)]

    def _column(self, column: int) -> Cells:
        rows = self.grid.rows
        cells = [rows[row][column] if column < len(rows[row]) else "" for row in self.block.data]
        if all(type(cell) is float or type(cell) is int for cell in cells):
            return np.array(cells, np.float64)
        return cells


def _text(cell: Any) -> str:
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return "" if cell is None else str(cell)


def _letters(column: int) -> str:
    """Name of a column by its number from 0: A to Z, AA and so on."""
    letters = ""
    column += 1
    while column:
        column, rest = divmod(column - 1, 26)
        letters = chr(ord("A") + rest) + letters
    return letters
