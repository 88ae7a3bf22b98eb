"""Tables of numbers in workbooks: xlsx, xlsb, xls and ods."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.dataset.readers.cells import (
    MOST_TABLES,
    add_table,
    blocks_of,
    mark_of,
    settle_head,
)
from tendonrepro.dataset.readers.signals import Allowance, Found, Unreadable, is_full

if TYPE_CHECKING:
    from python_calamine import CalamineWorkbook

_MOST_CELLS = 20_000_000
"""Of one sheet; each takes some 100 bytes while it is read."""
_BROKEN = "open it in Excel or LibreOffice, which can repair it, and save it again"


def read_workbook(path: Path, kind: str, left: Allowance | None = None) -> Found:
    """Read every table of numbers on every sheet of a workbook; `kind` is the file's true type for the user.

    One signal a column. The group is the sheet, with rows such as ``Sheet1!2:9`` where it has several tables
    below each other; those side by side are one.
    """
    # Through pandas a sheet comes from its first cell on, however far off its numbers are.
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
        rows = sheet.to_python(skip_empty_area=True)
        first = (sheet.start or (0, 0))[0] + 1
    except Exception as error:  # calamine raises errors of several families, by what is broken
        found.skip(name, f"a broken sheet ({error})", _BROKEN)
        return

    def words_at(row: int) -> tuple[str, list[str]]:
        return f"row {first + row}", list(map(_text, rows[row]))

    blocks = blocks_of(map(mark_of, rows))
    for block in blocks[:MOST_TABLES]:
        settle_head(block, rows.__getitem__)
        place = f"{name}!{first + block.data[0]}:{first + block.data[-1]}"
        own = zip(*(rows[row] for row in (*block.head, *block.data)), strict=True)
        used = [column for column, cells in enumerate(own) if any(cell not in ("", None) for cell in cells)]
        head = [[_text(rows[row][column]) for column in used] for row in block.head]
        columns = [[rows[row][column] for row in block.data] for column in used]
        prefix = f"{name if len(blocks) == 1 else place}/"
        add_table(found, block, head, columns, words_at, prefix=prefix, note=note)
    if len(blocks) > MOST_TABLES:
        found.skip(name, f"{len(blocks) - MOST_TABLES} more tables left out", "split the sheet")
    if not blocks:
        found.skip(name, "a sheet without numbers")


def _text(cell: Any) -> str:
    return str(int(cell)) if isinstance(cell, float) and cell.is_integer() else str(cell)
