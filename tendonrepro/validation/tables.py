"""Tables 2 and 3 as measured, each number beside the printed one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tendonrepro.config.published import COMPARED, Published
from tendonrepro.dataset.motion.windows import PrintedTables, Tried
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import write_table

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
            paths += write_table(lines, folder, table, caption, _COLUMNS, ("csv", "md", "tex"))
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
