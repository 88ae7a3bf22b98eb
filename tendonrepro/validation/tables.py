"""Tables 2 and 3 as measured, each number beside the printed one, and rows of plain values as files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tendonrepro.config.published import COMPARED, Published
from tendonrepro.dataset.motion.windows import PrintedTables, Tried
from tendonrepro.files import write_atomically
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.typeset import NOTHING, Sheet, latex, markdown

_ROWS: Mapping[str, Mapping[str, str]] = {
    "table2": {name: f"table2.{name}" for name in CONTROLLERS},
    "table3": {"no_load": "table2.controller_1", "with_load": "table3.with_load"},
}
"""Rows of each table, and how the ids of their measured numbers begin."""
_METRICS = ("mae", "rmse")
_COLUMNS = {"row": ("Run", ""), "joint": ("Joint", "")} | {
    f"{metric}_{what}": (heading, ".3f")
    for metric in _METRICS
    for what, heading in {
        "measured": f"{metric.upper()} measured (deg)",
        "printed": "printed",
        "agree": "agree",
    }.items()
}


def table_data(tried: Tried | None, paper: Published) -> dict[str, Any]:
    """``table2`` and ``table3`` of ``validate --json``, by the way of averaging that decides.

    Row -> ``measured``, ``printed``, ``agree``, each with ``mae_deg`` and ``rmse_deg``, lists over joints 2
    and 3; rows that were not measured are left out.
    """
    if tried is None:
        return {table: {} for table in _ROWS}
    return {
        table: {
            row: _row(tried, paper, start)
            for row, start in rows.items()
            if any(name.startswith(start) for name in tried.sizes)
        }
        for table, rows in _ROWS.items()
    }


def _row(tried: Tried, paper: Published, start: str) -> dict[str, Any]:
    sizes, agree = tried.sizes, tried.agree
    found: dict[str, dict[str, list[Any]]] = {"measured": {}, "printed": {}, "agree": {}}
    for metric in _METRICS:
        names = [f"{start}.{metric}.joint_{joint}" for joint in COMPARED]
        found["measured"][f"{metric}_deg"] = [sizes.get(name) for name in names]
        found["printed"][f"{metric}_deg"] = [paper.number(name) for name in names]
        found["agree"][f"{metric}_deg"] = [name in agree if name in sizes else None for name in names]
    return found


def write_measured_tables(data: Mapping[str, Any], window: str, origin: str, folder: Path) -> list[Path]:
    """Write what `table_data` gives as csv, Markdown and LaTeX; the caption names the window and the file."""
    paths: list[Path] = []
    for table, rows in data.items():
        if rows:
            lines = [
                {"row": row, "joint": joint}
                | {
                    f"{metric}_{what}": found[what][f"{metric}_deg"][place]
                    for metric in _METRICS
                    for what in ("measured", "printed", "agree")
                }
                for row, found in rows.items()
                for place, joint in enumerate(COMPARED)
            ]
            caption = f"Table {table[-1]} as measured, averaged over: {window} ({origin})."
            paths += write_rows(lines, folder, table, caption, _COLUMNS, ("csv", "md", "tex"))
    return paths


def window_rows(tables: PrintedTables, paper: Published) -> list[dict[str, Any]]:
    """Every number under every way of averaging, for a csv file."""
    return [
        {
            "window": one.window,
            "offset_removed": one.offset_removed,
            "id": identifier,
            "measured_deg": size,
            "printed_deg": paper.number(identifier),
            "agrees": identifier in one.agree,
        }
        for one in tables.tried
        for identifier, size in one.sizes.items()
    ]


def write_rows(
    rows: Sequence[Mapping[str, Any]],
    folder: Path,
    stem: str,
    caption: str,
    columns: Mapping[str, tuple[str, str]] | None = None,
    suffixes: Sequence[str] = ("csv", "md"),
) -> list[Path]:
    """Write rows as csv with all digits, and rounded for reading as Markdown and LaTeX.

    `columns` are heading and format of floats by name; if not given, every key of any row.
    """
    held = columns or {name: (name.replace("_", " "), ".4g") for row in rows for name in row}
    numeric = [
        any(isinstance(row.get(name), int | float) and not isinstance(row[name], bool) for row in rows)
        for name in held
    ]
    cells = [[_cell(row.get(name), form) for name, (_, form) in held.items()] for row in rows]
    sheet = Sheet(caption, [heading for heading, _ in held.values()], numeric, cells)
    text = io.StringIO()
    writer = csv.DictWriter(text, held, lineterminator="\n")
    writer.writeheader()
    writer.writerows(dict(row) for row in rows)
    texts = {"csv": text.getvalue(), "md": markdown(sheet), "tex": latex(sheet, stem)}
    for suffix in suffixes:
        write_atomically(folder / f"{stem}.{suffix}", texts[suffix])
    return [folder / f"{stem}.{suffix}" for suffix in suffixes]


def _cell(value: Any, form: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return NOTHING
    return f"{value:{form}}" if isinstance(value, float) else str(value)
