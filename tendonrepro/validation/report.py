"""Tables of a validation: measured errors beside the print, verdicts, residuals, controllers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.dataset.windows import Tried
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table, TableRows
from tendonrepro.verdicts.measured import Measured

_ROWS: Mapping[str, Mapping[str, str]] = {
    "table2": {name: f"table2.{name}" for name in CONTROLLERS},
    "table3": {"no_load": "table2.controller_1", "with_load": "table3.with_load"},
}
"""Rows of each table, and how the ids of their measured numbers begin."""
_METRICS = ("mae", "rmse")
_HEADINGS = {"measured": "{} measured (deg)", "printed": "printed", "agree": "agree"}
_COLUMNS = {"row": ("Run", ""), "joint": ("Joint", "")} | {
    f"{metric}_{what}": (heading.format(metric.upper()), ".3f")
    for metric in _METRICS
    for what, heading in _HEADINGS.items()
}
RARE = 0.01
"""Chance below which a window that gives some of the printed numbers is shown."""


def size_rows(tried: Tried, paper: Published, table: str) -> Iterator[dict[str, Any]]:
    """Measured errors beside those of ``table2`` or ``table3``; runs that were not measured are left out."""
    sizes, agree = tried.sizes, tried.agree
    for row, start in _ROWS[table].items():
        for joint in COMPARED if any(name.startswith(start) for name in sizes) else ():
            found: dict[str, Any] = {"row": row, "joint": joint}
            for metric in _METRICS:
                name = f"{start}.{metric}.joint_{joint}"
                found |= {f"{metric}_measured": sizes.get(name), f"{metric}_printed": paper.number(name)}
                found[f"{metric}_agree"] = name in agree if name in sizes else None
            yield found


def table_data(tried: Tried, paper: Published) -> dict[str, Any]:
    """``table2`` and ``table3`` of ``validate --json``.

    Row -> ``measured``, ``printed``, ``agree``, each with ``mae_deg`` and ``rmse_deg``, lists over joints 2
    and 3.
    """
    data: dict[str, Any] = {table: {} for table in _ROWS}
    for table, rows in data.items():
        for row in size_rows(tried, paper, table):
            held = rows.setdefault(row["row"], {what: {} for what in _HEADINGS})
            for metric in _METRICS:
                for what in _HEADINGS:
                    held[what].setdefault(f"{metric}_deg", []).append(row[f"{metric}_{what}"])
    return data


def closest_window(measured: Measured) -> Tried | None:
    """Window closest to the print, where that is no accident and not the one that decides."""
    tables = measured.tables
    return None if tables.best is tables.deciding or tables.chance > RARE else tables.best


def measured_tables(measured: Measured, paper: Published, origin: str) -> Iterator[Table]:
    """Tables 2 and 3 over the window that decides and the closest one, and every number of every window."""
    closest = closest_window(measured)
    ways = {"": measured.tables.deciding} | ({"best_": closest} if closest else {})
    for prefix, tried in ways.items():
        for table in _ROWS:
            if rows := [*size_rows(tried, paper, table)]:
                caption = f"Table {table[-1]} as measured, averaged over: {tried.name} ({origin})."
                yield Table(f"{prefix}{table}", caption, rows, _COLUMNS)
    rows = [
        {
            "window": one.window,
            "offset_removed": one.offset_removed,
            "id": identifier,
            "measured_deg": size,
            "printed_deg": paper.number(identifier),
            "agrees": identifier in one.agree,
        }
        for one in measured.tables.tried
        for identifier, size in one.sizes.items()
    ]
    yield Table("windows", "Every number by every way of averaging.", rows, terminal=(), suffixes=["csv"])


def claims_table(claims: Sequence[Mapping[str, Any]]) -> Table:
    """Verdicts with the window they rest on, how many statements fail, and what is missing."""
    rows = []
    for claim in claims:
        evidence = claim["evidence"]
        statements = evidence.get("statements", ())
        failing = sum(not statement["holds"] for statement in statements)
        row = {"claim": claim["id"], "where": claim["where"], "verdict": claim["verdict"]}
        row |= {"window": evidence.get("window"), "missing": evidence.get("missing")}
        row |= {"failing": f"{failing} of {len(statements)}" if failing else None}
        # C4 says here that s was computed and not recorded.
        rows.append(row | {"remarks": evidence.get("remarks") or None})
    return Table("claims", "Claims judged on the measurement.", rows)


def shown(name: str, caption: str, rows: TableRows, columns: Sequence[str]) -> Iterator[Table]:
    """Yield a table, if it has rows, of which the terminal shows some columns, if any row has them."""
    if rows:
        yield Table(name, caption, rows, terminal=[one for one in columns if any(one in row for row in rows)])
