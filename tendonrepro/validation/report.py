"""What ``tendonrepro validate`` says on a terminal, and Tables 2 and 3 as measured beside the print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.console import columns
from tendonrepro.dataset.measured_file import resting_on
from tendonrepro.dataset.windows import PrintedTables, Tried
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import NOTHING, Table


def validate_text(found: Mapping[str, Any]) -> str:
    """Summary of a validation, as `command.run_validate` returns it."""
    if found.get("dry_run"):
        runs = ", ".join(found["runs"])
        return f"Would validate {found['measured']} (runs {runs}) and write into {found['out']}"
    inputs = len(found["sources"])
    of = f", made from {inputs} file" + "s" * (inputs != 1) if inputs else ""
    head = f"{found['measured']}{of}, {resting_on(len(found['guesses']))}: runs {', '.join(found['runs'])}"
    parts = ["\n".join([head, *(f"check {doubt}" for doubt in found["doubts"])])]
    parts += [*_tables(found), *_reference(found["reference"])]
    parts += [_claims(found["claims"]), *_residuals(found["residuals"]["rows"])]
    parts += _controllers(found["controllers"])
    if found["missing"]:
        parts.append("Missing: " + "; ".join(found["missing"]))
    parts.append(f"Tables, figures, reference and traces are in {found['out']}")
    return "\n\n".join(parts)


def _tables(found: Mapping[str, Any]) -> Iterator[str]:
    yield from _table(found, found["window"])
    if found["best"]:
        yield from _table(found["best"], f"{found['best']['window']}, the window closest to the print")
    yield f"Windows: {found['windows']['remark']}"


def _table(found: Mapping[str, Any], window: str) -> Iterator[str]:
    rows: list[Sequence[str]] = [("", "joint", "MAE", "printed", "", "RMSE", "printed", "")]
    for table, title in (("table2", ""), ("table3", "Table 3 ")):
        for line in _lines(found[table]):
            cells = [f"{title}{line['row']}", str(line["joint"])]
            for metric in _METRICS:
                ours, printed, agree = (line[f"{metric}_{what}"] for what in _HEADINGS)
                cells += [NOTHING if ours is None else f"{ours:.3f}", f"{printed:.3f}"]
                cells.append({True: "agrees", False: "differs", None: ""}[agree])
            rows.append(cells)
    if len(rows) > 1:
        yield f"Errors in deg, averaged over: {window}\n{columns(rows, left=True)}"


def _reference(reference: Mapping[str, Any] | None) -> Iterator[str]:
    if reference is None:
        return
    amplitude = ", ".join(f"{size:.4g}" for size in reference["amplitude_deg"])
    period = reference["period_s"]
    repeats = f"period {period:.5g} s" if period else "no repetition"
    start = ", ".join(f"{angle:z.4g}" for angle in reference["start_angle_deg"])
    rest = "; it ends in mid-motion, and is brought to rest" if reference["brought_to_rest"] else ""
    yield (
        f"Reference of {reference['run']}: samples every {reference['spacing_s']:.4g} s, "
        f"{reference['deviation_deg']:.2g} deg from the record at most; joints {reference['joints']} move "
        f"{amplitude} deg from {reference['begin_s']:.4g} s on, {repeats}; start angles {start} deg were "
        f"taken off{rest}"
    )


def _claims(claims: Sequence[Mapping[str, Any]]) -> str:
    rows = [("claim", "where", "on the measurement", "")]
    for claim in claims:
        evidence = claim["evidence"]
        why = f"missing: {evidence['missing']}" if "missing" in evidence else _failing(evidence)
        if "window" in evidence:
            why = f"over {evidence['window']}" + (f": {why}" if why else "")
        # C4 says here that s was computed and not recorded.
        why = "; ".join(filter(None, [why, *evidence.get("remarks", ())]))
        rows.append((claim["id"], claim["where"], claim["verdict"], why))
    return columns(rows, left=True)


def _failing(evidence: Mapping[str, Any]) -> str:
    statements = evidence.get("statements") or evidence.get("start_offset_removed", {}).get("statements", [])
    failed = sum(not statement["holds"] for statement in statements)
    percentages = evidence.get("percentages", {})
    apart = sum(verdict != "reproduced" for verdict in percentages.values())
    words = [f"{failed} of {len(statements)} statements fail"] * bool(failed)
    words += [f"{apart} of {len(percentages)} percentages differ"] * bool(apart)
    return ", ".join(words)


def _controllers(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    lines: list[Sequence[str]] = [("run", "joint", "answer", "surface", "readings", "weights", "")]
    for row in rows:
        cells = (row.get(name, NOTHING) for name in ("surface", "readings", "weights"))
        lines.append((row["run"], str(row["joint"]), row["answer"], *cells, row["advice"]))
    if rows:
        yield f"Which controller made the runs, by `tendonrepro recover`:\n{columns(lines, left=True)}"


def _residuals(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    heading = ("run", "joint", "MAE measured", "simulated", "ratio", "residual RMS", "of angle", "lag (ms)")
    lines: list[Sequence[str]] = [heading]
    for row in rows:
        lag = row.get("lag_s")
        names = ("measured_mae_deg", "simulated_mae_deg", "mae_ratio", "e_rms_deg", "q_rms_deg")
        cells = [*(row.get(name) for name in names), None if lag is None else 1e3 * lag]
        shown = [NOTHING if cell is None else f"{cell:z.3g}" for cell in cells]
        lines.append((row["run"], str(row["joint"]), *shown))
    if len(lines) > 1:
        yield f"The model on the measured motion, in deg, over what both cover:\n{columns(lines, left=True)}"


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
            caption = f"Table {table[-1]} as measured, averaged over: {window} ({origin})."
            paths += Table(table, caption, list(_lines(rows)), _COLUMNS).write(folder)
    return paths


def _lines(rows: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a table of `table_data` joint by joint, its numbers by the names of `_COLUMNS`."""
    for row, found in rows.items():
        for place, joint in enumerate(COMPARED):
            numbers = {
                f"{metric}_{what}": found[what][f"{metric}_deg"][place]
                for metric in _METRICS
                for what in _HEADINGS
            }
            yield {"row": row, "joint": joint} | numbers


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
