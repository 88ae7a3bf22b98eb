"""Columns of cells as numbers: decimal commas, thousands, durations, dates; what is no number is counted."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd

from tendonrepro.dataset.columns import FEWEST, Columns

NUMBER = re.compile(r"[-+−]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?|nan|inf", re.IGNORECASE)
_EXPONENT = r"(?:[eEdD][-+]?\d+)?"
_POINT = re.compile(rf"[-+]?(?:[1-9]\d{{0,2}}(?:,\d{{3}})+|\d+)?(?:\.\d*)?{_EXPONENT}")
_COMMA = re.compile(rf"[-+]?(?:[1-9]\d{{0,2}}(?:\.\d{{3}})+|\d+)?(?:,\d*)?{_EXPONENT}")
_DURATION = re.compile(r"-?\d+:\d\d(:\d\d(\.\d+)?)?")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*")
_GAPS = {"nan", "na", "n/a", "null", "none", "-", "--", "inf", "-inf"}
_MOST_FAILING = 0.5
"""Share of cells that are no numbers from which a column is one of words."""


def is_number(cell: str) -> bool:
    """Whether a cell is a number with a decimal point.

    >>> is_number("-1.5e-3")
    True
    """
    return bool(NUMBER.fullmatch(cell))


def with_point(cell: str) -> str:
    """A number with a decimal comma, alone or behind thousands, by a point."""
    return re.sub(r"^([-+]?)(\d+|\d{1,3}(?:\.\d{3})+),(\d+)", _pointed, cell)


def _pointed(match: re.Match[str]) -> str:
    return f"{match[1]}{match[2].replace('.', '')}.{match[3]}"


def add_column(columns: Columns, name: str, column: pd.Series, first_row: int = 1) -> None:
    """Add a column of cells, numbers in float64 or words, to a table, with a note of what is no number.

    Of an empty column nothing is kept. ``first_row`` is the number of the first row, for notes.
    """
    if column.dtype.kind in "biuf":
        values = column.to_numpy(np.float64)
        if np.isfinite(values).sum() >= FEWEST:
            columns.add(name, values)
        elif np.isfinite(values).any():
            columns.notes.append(f"column {name!r} left out: {int(np.isfinite(values).sum())} numbers alone")
        return
    known = column[column.notna()]
    cells = known.map(lambda cell: str(cell).strip())
    cells = cells[cells != ""]
    if cells.empty:
        return
    times = _seconds(known[known.index.isin(cells.index)], cells)
    if times is not None:
        _add_filled(columns, name if "(" in name else f"{name} (s)", column, times)
        return
    text = cells.str.replace("−", "-", regex=False)
    numbers = pd.to_numeric(text, errors="coerce").astype(float)
    is_gap = text.str.casefold().isin(_GAPS)
    marked = text[numbers.isna() & ~is_gap & text.str.contains(r"\d", regex=True)]
    mark = _decimal_mark(marked, text[numbers.notna()])
    if mark is None:
        columns.notes.append(
            f"column {name!r}: unclear in {len(marked)} cells whether a comma is decimal or between "
            f"thousands, as {marked.iloc[0]!r}: write them without commas"
        )
    elif not marked.empty:
        numbers = numbers.fillna(_by_mark(marked, mark).reindex(numbers.index))
    failing = numbers.isna() & ~is_gap
    if failing.mean() >= _MOST_FAILING:
        words = column.map(lambda cell: "" if pd.isna(cell) else str(cell).strip())
        columns.add(name, words.to_numpy(object).astype(str))
        return
    thousands = marked[marked.str.contains(",", regex=False) & ~failing[marked.index]]
    if mark == "." and len(thousands):
        columns.notes.append(
            f"column {name!r}: {len(thousands)} numbers have a comma between thousands, "
            f"as {thousands.iloc[0]!r}"
        )
    if failing.any():
        place = int(np.argmax(column.index == failing.idxmax())) + first_row
        example = str(cells[failing].iloc[0])[:40]
        columns.notes.append(
            f"column {name!r}: {int(failing.sum())} of {len(column)} cells are no numbers and left as gaps, "
            f"the first {example!r} in row {place}"
        )
    if numbers.notna().sum() >= FEWEST:
        _add_filled(columns, name, column, numbers)
    else:
        columns.notes.append(f"column {name!r} left out: {int(numbers.notna().sum())} numbers alone")


def _add_filled(columns: Columns, name: str, column: pd.Series, numbers: pd.Series) -> None:
    columns.add(name, numbers.reindex(column.index).to_numpy(np.float64))


def _decimal_mark(marked: pd.Series, plain: pd.Series) -> str | None:
    """Point or comma: what makes most cells numbers, else that of the `plain` ones; None if unclear."""
    by_point, by_comma = (
        sum(pattern.fullmatch(cell) is not None for cell in marked) for pattern in (_POINT, _COMMA)
    )
    if by_point != by_comma:
        return "." if by_point > by_comma else ","
    has_points = bool(plain.str.contains(".", regex=False).any())
    return "." if has_points or not by_point else None


def _by_mark(marked: pd.Series, mark: str) -> pd.Series:
    """Numbers with a decimal mark and the other one between thousands; exponents may be Fortran's."""
    pattern, between = (_POINT, ",") if mark == "." else (_COMMA, ".")
    cells = marked[[pattern.fullmatch(cell) is not None for cell in marked]]
    bare = cells.str.replace(between, "", regex=False).str.replace(",", ".", regex=False)
    return pd.to_numeric(bare.str.replace(r"[dD]", "e", regex=True), errors="coerce").astype(float)


def _seconds(known: pd.Series, cells: pd.Series) -> pd.Series | None:
    """Durations, times of day, or dates since the first, in s; None of other cells."""
    first = known.iloc[0]
    if hasattr(first, "total_seconds"):
        return known.map(lambda cell: cell.total_seconds() if hasattr(cell, "total_seconds") else np.nan)
    if hasattr(first, "isoformat") and hasattr(first, "hour") and not hasattr(first, "year"):
        return _of_durations(cells)
    if hasattr(first, "year") or _DATE.fullmatch(cells.iloc[0]):
        dates = pd.to_datetime(cells, errors="coerce", format="ISO8601")
        return (dates - dates.dropna().iloc[0]).dt.total_seconds() if dates.notna().any() else None
    return _of_durations(cells) if _DURATION.fullmatch(cells.iloc[0]) else None


def _of_durations(cells: pd.Series) -> pd.Series:
    # A time of two parts is minutes and seconds.
    full = cells.map(lambda cell: f"00:{cell}" if cell.count(":") == 1 else cell)
    seconds: pd.Series = pd.to_timedelta(full, errors="coerce").dt.total_seconds()
    return seconds
