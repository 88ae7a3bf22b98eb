"""Tables of numbers in texts and workbooks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tendonrepro.dataset.arrays import FEWEST, Columns, Unreadable
from tendonrepro.dataset.words import plain_unit

_COMMENT = ("#", "%", "//")
_NUMBER = re.compile(r"[-+−]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|nan|inf", re.IGNORECASE)
_MOST_HEAD = 60
"""Lines above the numbers that are looked through."""


def read_text_table(path: Path) -> dict[str, Columns]:
    """Read a table, by whatever separator, decimal mark and encoding.

    Raises
    ------
    Unreadable
        If there is no table of numbers.
    """
    lines = [line for line in decoded(path.read_bytes()).splitlines() if line.strip()]
    lines = [line for line in lines if not line.casefold().startswith("sep=")]
    separator, comma = _spelling([line for line in lines[-_MOST_HEAD:] if not line.startswith(_COMMENT)])
    told = [k for k, line in enumerate(lines) if not line.startswith(_COMMENT)]
    first = _first_numbers([_cells(lines[k], separator, comma=comma) for k in told[:_MOST_HEAD]])
    if first is None:
        raise Unreadable("a text without a table of numbers")
    cells = [_cells(lines[k], separator, comma=comma) for k in told[first:]]
    width = max(map(len, cells))
    head = [_cells(line.lstrip("#%/"), separator, comma=False) for line in lines[: told[first]]]
    return {"": _columns(head, pd.DataFrame([row + [""] * (width - len(row)) for row in cells]))}


def decoded(content: bytes) -> str:
    """Text of bytes: Unicode, Chinese where that makes common words, else Western.

    >>> decoded("Winkel [°]".encode("cp1252"))
    'Winkel [°]'
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("gb18030" if _is_chinese(content) else "cp1252", errors="replace")


def _is_chinese(content: bytes) -> bool:
    """Whether most bytes beyond ASCII are pairs of GB 2312's common characters."""
    beyond = sum(byte >= 0x80 for byte in content)
    common = re.findall(rb"[\xa1-\xa3\xb0-\xd7][\xa1-\xfe]", content)
    words = re.findall(rb"(?:[\xb0-\xd7][\xa1-\xfe]){2,}", content)
    return bool(words) and 2 * len(common) > 0.5 * beyond


def _spelling(lines: Sequence[str]) -> tuple[str | None, bool]:
    """Separator, None for blanks, and decimal comma: what makes most numbers."""

    def numbers(spelling: tuple[str | None, bool]) -> int:
        cells = [_cells(line, spelling[0], comma=spelling[1]) for line in lines]
        return sum(1 if _is_number(cell) else -1 for row in cells for cell in row if cell)

    ways: list[tuple[str | None, bool]] = [(separator, False) for separator in ("\t", ";", ",", "|", None)]
    ways += [(separator, True) for separator in ("\t", ";", None)]
    return max(ways, key=numbers)


def _cells(line: str, separator: str | None, *, comma: bool) -> list[str]:
    text = line.replace("−", "-")
    if separator is None:
        # Names with blanks stand further apart than their words.
        wide = re.split(r"\s{2,}|\t", text.strip())
        parts = wide if len(wide) > 1 and not _is_number(wide[0].split()[0]) else text.split()
    else:
        parts = text.split(separator)
    cells = [part.strip().strip('"').strip() for part in parts]
    return [re.sub(r"^([-+]?\d+),(\d+)", r"\1.\2", cell) for cell in cells] if comma else cells


def _is_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell))


def _first_numbers(rows: Sequence[Sequence[str]]) -> int | None:
    """First of three rows of one width with numbers."""
    for place, row in enumerate(rows):
        block = rows[place : place + 3]
        share = sum(map(_is_number, row)) / max(len([cell for cell in row if cell]), 1)
        numbers = all(any(map(_is_number, one)) for one in block)
        if share >= 0.5 and numbers and len(block) > 1 and len({len(one) for one in block}) == 1:
            return place
    return None


def read_workbook(path: Path) -> dict[str, Columns]:
    """Read the sheets that hold numbers."""
    sheets = pd.read_excel(path, sheet_name=None, header=None, engine="calamine")
    found = {str(name): columns for name, sheet in sheets.items() if (columns := _sheet(sheet))}
    # A single sheet under the name that a program gave it has none.
    default = re.compile(r"(sheet|tabelle|工作表|feuil)\s*\d*", re.IGNORECASE)
    is_default = len(found) == 1 and default.fullmatch(next(iter(found)))
    return {"": next(iter(found.values()))} if is_default else found


def _sheet(sheet: pd.DataFrame) -> Columns:
    sheet = sheet.dropna(how="all").reset_index(drop=True)
    head = sheet.iloc[:_MOST_HEAD].map(lambda cell: "" if pd.isna(cell) else str(cell).strip())
    rows: list[list[str]] = head.to_numpy().tolist()
    first = _first_numbers(rows)
    return _columns(rows[:first], sheet.iloc[first:]) if first is not None else Columns()


def _columns(head: Sequence[Sequence[str]], table: pd.DataFrame) -> Columns:
    names = _names([list(row) for row in head], table.shape[1])
    found = Columns()
    for place, name in enumerate(names):
        values = _values(table.iloc[:, place])
        if values is not None and (values.dtype.kind != "f" or np.isfinite(values).sum() >= FEWEST):
            found.add(name, values)
    return found


def _names(head: list[list[str]], width: int) -> list[str]:
    """Last row of words, with a group above and a unit below."""
    head = [*head]
    units = head.pop() if head and _are_units(head[-1]) else []
    names = head.pop() if head else []
    groups = _groups(head[-1]) if head and len(head[-1]) == width else []
    cells = zip_longest(range(1, width + 1), groups, names[:width], units[:width], fillvalue="")
    return [
        (f"{group} {name}".strip() or f"column {place}") + (f" ({unit.strip('()[]')})" if unit else "")
        for place, group, name, unit in cells
    ]


def _are_units(row: Sequence[str]) -> bool:
    held = [cell for cell in row if cell.strip("()[]-")]
    return bool(held) and all(plain_unit(cell) for cell in held) and not all(cell in "st" for cell in held)


def _groups(row: Sequence[str]) -> list[str]:
    """Group of every column: an empty cell belongs to the name before it.

    A title stands alone at the left, and numbers are settings; these name no groups.
    """
    filled = [cell for cell in row if cell]
    if any(map(_is_number, filled)) or not filled or (len(filled) == 1 and row[0]):
        return [""] * len(row)
    return pd.Series(row).replace("", None).ffill().fillna("").tolist()


def _values(column: pd.Series) -> NDArray[Any] | None:
    """Numbers, else words; None of an empty column."""
    text = column.astype(str).str.strip()
    held = text[column.notna() & (text != "")]
    numbers = np.asarray(pd.to_numeric(column, errors="coerce"), np.float64)
    is_numbers = np.isfinite(numbers).sum() > 0.5 * len(held)
    return None if held.empty else numbers if is_numbers else text.to_numpy()
