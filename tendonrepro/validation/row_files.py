"""Rows of plain values as csv and as a Markdown table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from tendonrepro.results.typeset import NOTHING, Sheet, markdown


def csv_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """All digits; a column for every key of any row."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(dict(row) for row in rows)
    return text.getvalue()


def markdown_of(caption: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Rounded for reading."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[_cell(row.get(name)) for name in names] for row in rows]
    numeric = [any(isinstance(row.get(name), int | float) for row in rows) for name in names]
    return markdown(Sheet(caption, [name.replace("_", " ") for name in names], numeric, cells))


def _cell(value: Any) -> str:
    if value is None:
        return NOTHING
    return f"{value:.4g}" if isinstance(value, float) else str(value)
