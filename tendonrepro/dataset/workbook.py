"""Sheets of workbooks as tables."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from tendonrepro.dataset.cells import add_column, with_point
from tendonrepro.dataset.columns import Columns, Tables
from tendonrepro.dataset.headers import first_numbers, names_of

_MOST_HEAD = 2000
"""Rows above the numbers that are looked through."""


def read_workbook(path: Path) -> Tables:
    """Read the sheets that hold numbers."""
    sheets = pd.read_excel(path, sheet_name=None, header=None, engine="calamine")
    read = {str(name): _sheet(sheet) for name, sheet in sheets.items()}
    filled = {name: columns for name, columns in read.items() if columns}
    empty = [name for name in read if name not in filled]
    left_out = [f"sheet {name!r}: no table of numbers" for name in empty if not sheets[name].empty]
    # A single sheet under the name that a program gave it has none.
    default = re.compile(r"(sheet|tabelle|工作表|feuil)\s*\d*", re.IGNORECASE)
    is_default = len(filled) == 1 and default.fullmatch(next(iter(filled)))
    return Tables({"": next(iter(filled.values()))} if is_default else filled, left_out)


def _sheet(sheet: pd.DataFrame) -> Columns:
    sheet = sheet.dropna(how="all").reset_index(drop=True)
    columns = Columns()
    head = sheet.iloc[:_MOST_HEAD].map(_written)
    tail = sheet.iloc[-60:].map(_written)
    rows: list[list[str]] = head.to_numpy().tolist()
    first = first_numbers(rows, tail.to_numpy().tolist())
    if first is None:
        return columns
    names = names_of(rows[:first], sheet.shape[1])
    body = sheet.iloc[first:]
    for place, name in enumerate(names):
        add_column(columns, name, body.iloc[:, place], first + 1)
    return columns


def _written(cell: Any) -> str:
    """A cell as a text would have it; times and dates count as numbers."""
    if pd.isna(cell):
        return ""
    if hasattr(cell, "total_seconds") or hasattr(cell, "isoformat"):
        return "0"
    return with_point(str(cell).strip())
