"""Tables of numbers in workbooks: xlsx, xlsb, xls and ods."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tendonrepro.dataset.bounds import is_full
from tendonrepro.dataset.cells import (
    MOST_TABLES,
    Block,
    Cells,
    add_columns,
    block_headings,
    blocks_of,
    mark_of,
    settle_head,
)
from tendonrepro.dataset.heading import Heading
from tendonrepro.dataset.signals import Found
from tendonrepro.dataset.unreadable import Unreadable

if TYPE_CHECKING:
    from python_calamine import CalamineSheet

MOST_CELLS = 20_000_000
"""Of one sheet; each takes some 100 bytes while it is read."""
_MOST_WORDS = 20
_MOST_TEXTS = 500
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
    corner = sheet.start or (0, 0)
    tables = [
        _Table(rows, block, columns, corner)
        for columns in _column_ranges(rows)
        for block in _blocks(found, name, rows, columns, corner[0])
    ]
    names: list[Heading] = []
    for table in tables[:MOST_TABLES]:
        group = name if len(tables) == 1 else f"{name}!{table.where()}"
        names = table.add_to(found, group, names, note)
    if len(tables) > MOST_TABLES:
        found.skip(name, f"{len(tables) - MOST_TABLES} more tables left out", "split the sheet")
    if not tables:
        found.skip(name, "a sheet without numbers")


def _rows(sheet: CalamineSheet) -> list[list[Any]]:
    cells = sheet.height * sheet.width
    if cells > MOST_CELLS:
        reason = f"{cells} cells are too many"
        raise Unreadable(reason, "save the sheet as CSV")
    return sheet.to_python(skip_empty_area=True)


def _column_ranges(rows: Sequence[Sequence[Any]]) -> list[range]:
    """Runs of columns between empty ones: tables that stand side by side."""
    width = max((len(row) for row in rows), default=0)
    used = np.zeros(width, bool)
    for row in rows:
        used[: len(row)] |= [cell is not None and cell != "" for cell in row]
    runs = [list(run) for is_used, run in groupby(range(width), key=lambda column: used[column]) if is_used]
    return [range(run[0], run[-1] + 1) for run in runs]


def _blocks(
    found: Found, name: str, rows: Sequence[Sequence[Any]], columns: range, first_row: int
) -> list[Block]:
    """Tables within a run of columns; what is none is noted."""
    cells = slice(columns.start, columns.stop)
    blocks, words = blocks_of([mark_of(row[cells]) for row in rows])
    lonely = words if blocks else range(len(rows))
    for row in lonely[:_MOST_WORDS]:
        _note_row(found, name, rows[row][cells], first_row + row)
    return blocks


def _note_row(found: Found, name: str, cells: Sequence[Any], row: int) -> None:
    if len(found.texts) < _MOST_TEXTS:
        found.text(f"{name}/row {row + 1}", ", ".join(str(cell) for cell in cells if cell not in {None, ""}))


class _Table:
    """Rows and columns of a sheet that are one table."""

    def __init__(
        self, rows: Sequence[Sequence[Any]], block: Block, columns: range, corner: tuple[int, int]
    ) -> None:
        self.rows, self.block, self.columns, self.corner = rows, block, columns, corner
        settle_head(block, self._cells)

    def _cells(self, row: int) -> Sequence[Any]:
        return self.rows[row][self.columns.start : self.columns.stop]

    def where(self) -> str:
        """Columns and rows as a spreadsheet names them."""
        first_row, first_column = self.corner
        left, right = (_letters(first_column + column) for column in (self.columns[0], self.columns[-1]))
        return f"{left}{first_row + self.block.data[0] + 1}:{right}{first_row + self.block.data[-1] + 1}"

    def add_to(self, found: Found, group: str, before: Sequence[Heading], note: str) -> list[Heading]:
        """Add its columns as signals; returns its headings."""
        width = len(self.columns)
        head = [[_text(cell) for cell in self._cells(row)] for row in self.block.head]
        names, used, inherited = block_headings(head, width, before)
        for number, row in enumerate(self.block.head):
            if number not in used:
                _note_row(found, group, self._cells(row), self.corner[0] + row)
        columns = [self._column(column) for column in self.columns]
        notes = "; ".join(text for text in (note, inherited) if text)
        add_columns(found, names, columns, group=group, prefix=f"{group}/", note=notes)
        return names

    def _column(self, column: int) -> Cells:
        cells = [self.rows[row][column] if column < len(self.rows[row]) else "" for row in self.block.data]
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
