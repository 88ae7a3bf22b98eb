"""Tables 2 and 3 as measured, each number beside the printed one and whether they agree."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tendonrepro.config.published import COMPARED, Published
from tendonrepro.dataset.motion.windows import PrintedTables, Tried
from tendonrepro.files import write_atomically
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.typeset import NOTHING, Sheet, latex, markdown
from tendonrepro.validation.row_files import csv_of

_ROWS: Mapping[str, Mapping[str, str]] = {
    "table2": {name: f"table2.{name}" for name in CONTROLLERS},
    "table3": {"no_load": "table2.controller_1", "with_load": "table3.with_load"},
}
"""Rows of each table, and how the ids of their measured numbers begin."""
_METRICS = ("mae", "rmse")


def table_data(tried: Tried | None, paper: Published) -> dict[str, Any]:
    """Data of ``validate --json`` for Tables 2 and 3.

    Parameters
    ----------
    tried : Tried or None
        The way of averaging that decides.
    paper : Published

    Returns
    -------
    dict
        ``table2``, ``table3``: row -> ``measured``, ``printed``, ``agree``, each with ``mae_deg`` and
        ``rmse_deg``, lists over joints 2 and 3; rows that were not measured are left out.
    """
    if tried is None:
        return {table: {} for table in _ROWS}
    return {
        table: {row: _row(tried, paper, start) for row, start in rows.items() if _has(tried, start)}
        for table, rows in _ROWS.items()
    }


def _has(tried: Tried, start: str) -> bool:
    return any(name.startswith(start) for name in tried.sizes)


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
    """Write ``table2`` and ``table3`` as csv, Markdown and LaTeX.

    Parameters
    ----------
    data : Mapping
        Of `table_data`.
    window : str
        What was averaged over.
    origin : str
        Of the measurement, for the caption.
    folder : Path

    Returns
    -------
    list of Path
    """
    paths: list[Path] = []
    for table, rows in data.items():
        if not rows:
            continue
        flat = [line for row, found in rows.items() for line in _lines(row, found)]
        caption = f"Table {table[-1]} as measured, averaged over: {window} ({origin})."
        sheet = _sheet(flat, caption)
        texts = {"csv": csv_of(flat), "md": markdown(sheet), "tex": latex(sheet, table)}
        for suffix, text in texts.items():
            paths.append(folder / f"{table}.{suffix}")
            write_atomically(paths[-1], text)
    return paths


def _lines(row: str, found: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {"row": row, "joint": joint}
        | {
            f"{metric}_{what}": found[what][f"{metric}_deg"][place]
            for metric in _METRICS
            for what in ("measured", "printed", "agree")
        }
        for place, joint in enumerate(COMPARED)
    ]


def _sheet(flat: list[dict[str, Any]], caption: str) -> Sheet:
    headings = ["Run", "Joint"]
    for metric in _METRICS:
        headings += [f"{metric.upper()} measured (deg)", "printed", "agree"]
    rows = [[_cell(value) for value in line.values()] for line in flat]
    return Sheet(caption, headings, [heading not in ("Run", "agree") for heading in headings], rows)


def _cell(value: Any) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


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
