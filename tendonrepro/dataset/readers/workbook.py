"""Tables of numbers in workbooks: xlsx, xlsb, xls and ods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.dataset.readers.cells import (
    MOST_TABLES,
    Rows,
    add_table,
    blocks_of,
    mark_of,
    settle_head,
    words_of,
)
from tendonrepro.dataset.readers.signals import Allowance, Found, Unreadable, is_full

if TYPE_CHECKING:
    from python_calamine import CalamineWorkbook

_MOST_CELLS = 20_000_000
"""Of one sheet; each takes some 100 bytes while it is read."""
_MOST_MERGED = 1000
_BROKEN = "open it in Excel or LibreOffice, which can repair it, and save it again"


def read_workbook(path: Path, kind: str, left: Allowance | None = None) -> Found:
    """Read every table of numbers on every sheet of a workbook; `kind` is the file's true type for the user.

    One signal a column. The group is the sheet, with cells such as ``Sheet1!D2:F9`` where it has several
    tables.
    """
    # Through pandas a sheet comes from its first cell on, however far off its numbers are, and without its
    # merged cells.
    from python_calamine import CalamineWorkbook, PasswordError

    found = Found(kind, left or Allowance())
    try:
        book = CalamineWorkbook.from_path(path)
    except PasswordError as error:
        raise Unreadable("encrypted", "ask its authors for the password, save it without one") from error
    except Exception as error:
        raise Unreadable(f"a broken workbook ({error})", _BROKEN) from error
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


def _read_sheet(found: Found, book: CalamineWorkbook, name: str, note: str) -> None:
    try:
        sheet = book.get_sheet_by_name(name)
        count = sheet.height * sheet.width
        if count > _MOST_CELLS:
            found.skip(name, f"{count} cells are too many", "save the sheet as CSV")
            return
        grid = _Grid(name, sheet.to_python(skip_empty_area=True), *(sheet.start or (0, 0)))
        merged = sheet.merged_cell_ranges or []
    except Exception as error:  # calamine raises errors of several families, by what is broken
        found.skip(name, f"a broken sheet ({error})", _BROKEN)
        return
    ranges = grid.column_ranges()
    grid.fill(merged[:_MOST_MERGED])
    tables: list[tuple[slice, Rows]] = []
    for columns in ranges:
        blocks = blocks_of(mark_of(row[columns]) for row in grid.rows)
        tables += [(columns, block) for block in blocks]
    for columns, block in tables[:MOST_TABLES]:
        _add_table(found, grid, columns, block, note, alone=len(tables) == 1)
    if len(tables) > MOST_TABLES:
        found.skip(name, f"{len(tables) - MOST_TABLES} more tables left out", "split the sheet")
    if not tables:
        found.skip(name, "a sheet without numbers")


def _add_table(found: Found, grid: _Grid, columns: slice, block: Rows, note: str, *, alone: bool) -> None:
    settle_head(block, lambda row: grid.rows[row][columns])
    group = grid.name if alone else f"{grid.name}!{grid.where(block, columns)}"
    head = [[_text(cell) for cell in grid.rows[row][columns]] for row in block.head]
    cells = list(zip(*(grid.rows[row][columns] for row in block.data), strict=True))
    add_table(found, block, head, cells, partial(grid.words_at, columns), prefix=f"{group}/", note=note)


@dataclass(frozen=True)
class _Grid:
    """Cells of a sheet, and the place of the first of them, from 0."""

    name: str
    rows: list[list[Any]]
    first_row: int
    first_column: int

    def column_ranges(self) -> list[slice]:
        """Runs of columns between empty ones: tables that stand side by side."""
        used = [any(cell not in ("", None) for cell in column) for column in zip(*self.rows, strict=True)]
        runs = [list(run) for is_used, run in groupby(range(len(used)), used.__getitem__) if is_used]
        return [slice(run[0], run[-1] + 1) for run in runs]

    def fill(self, merged: Sequence[tuple[tuple[int, int], tuple[int, int]]]) -> None:
        """Repeat the text of merged cells over the empty ones they cover in its row."""
        for (top, left), (_, right) in merged:
            row, column = top - self.first_row, left - self.first_column
            if 0 <= row < len(self.rows) and 0 <= column < len(self.rows[row]):
                cells, text = self.rows[row], self.rows[row][column]
                for place in range(column, min(right - self.first_column + 1, len(cells))):
                    if isinstance(text, str) and cells[place] == "":
                        cells[place] = text

    def words_at(self, columns: slice, row: int) -> tuple[str, list[str]]:
        """Where a row stands in the sheet, and its words."""
        return f"row {self.first_row + row + 1}", words_of(map(_text, self.rows[row][columns]))

    def where(self, block: Rows, columns: slice) -> str:
        """Columns and rows of a table as a spreadsheet names them."""
        left, right = (_letters(self.first_column + column) for column in (columns.start, columns.stop - 1))
        top, bottom = (self.first_row + row + 1 for row in (block.data[0], block.data[-1]))
        return f"{left}{top}:{right}{bottom}"


def _text(cell: Any) -> str:
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell)


def _letters(column: int) -> str:
    """Name of a column by its number from 0: A to Z, AA and so on."""
    return (_letters(column // 26 - 1) if column > 25 else "") + chr(ord("A") + column % 26)
