"""What a measurement beside print and model shows: JSON, tables, terminal and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeAlias

from tendonrepro.configuration.published import COMPARED, METRICS, published, row_of
from tendonrepro.console import count_of
from tendonrepro.dataset.windows import PrintedTables, Tried
from tendonrepro.files import Json
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.results.tables import Table, TableRows
from tendonrepro.studies.result import Result
from tendonrepro.validation.validated import Validation
from tendonrepro.verdicts.measurement import JUDGED, Measurement
from tendonrepro.verdicts.rules import Ruling

_ROWS: Mapping[str, Mapping[str, str]] = {
    "table2": {run: row_of(run) for run in CONTROLLERS},
    "table3": {load: row_of(run) for load, run in LOADS.items()},
}
"""Rows of each table, and how the ids of their measured numbers begin."""
_WHAT = ("measured", "printed", "agree")
OTHER_ARM = "The arm is not the paper's, so nothing is judged by the paper's numbers and claims."
RARE = 0.01
"""Chance below which a window that gives some of the printed numbers is told of."""

_MOTION = ("run", "joints", "period_s", "begin_s", "spacing_s", "deviation_deg", "brought_to_rest")
_RESIDUALS = ("run", "joint", "measured_mae_deg", "simulated_mae_deg", "mae_ratio", "q_rms_deg", "lag_s")
_STARTS = ("run", "joint", "begin_s", "error_deg")
_READ_OFF = ("e_rms_deg", "e_rms_low_deg", "e_rms_high_deg")
_CONTROLLERS = ("run", "joint", "answer", "surface", "readings", "weights", "advice")
"""Columns that the terminal shows."""


def validation_result(validation: Validation, path: Path) -> Result:
    """Show what the measurement at a path says of paper and model."""
    from tendonrepro.validation.figures import draw_overlay, overlays

    measurement, rulings = validation.measurement, validation.rulings
    file, known = measurement.file, measurement.file.manifest
    closest = closest_window(measurement.tables)
    windows = measurement.tables.as_dict() if validation.of_paper else None
    motion = measurement.reference.as_dict() if measurement.reference else None
    told = [{name: row.get(name) for name in _CONTROLLERS} for row in validation.controllers]
    status = {name: model.status for name, model in validation.models.items()}
    diverged = "diverged" in status.values()
    data = {
        "schema_version": 1,
        "of_paper": validation.of_paper,
        "measured": str(path),
        "runs": list(file.runs),
        "experiment": file.experiment,
        "sources": known.get("inputs", []),
        "guesses": known.get("guesses", []),
        "doubts": known.get("doubts", []),
        "window": measurement.tables.window,
        **table_data(measurement.tables.deciding),
        "best": {"window": closest.name, **table_data(closest)} if closest else None,
        "windows": windows,
        "reference": motion,
        "starts": validation.starts,
        "claims": claims_data(rulings),
        "numbers": {
            name: {"verdict": ruling.verdict, "ours": ruling.ours}
            for name, ruling in rulings.items()
            if name not in JUDGED
        },
        "residuals": {"rows": validation.residuals, "coupling": validation.coupling, "status": status},
        "diverged": diverged,
        "controllers": validation.controllers,
        "missing": validation.missing,
    }
    figures = {name: partial(draw_overlay, name, file, validation.models) for name in overlays(file)}
    columns = _columns_of(validation.residuals)
    parts: list[Table | str] = [
        _about(path, known),
        *(measured_tables(measurement, str(path)) if windows else ()),
        str(windows["remark"]) if windows else OTHER_ARM,
        *shown("motion", "The desired motion, sampled to run again.", [motion] if motion else [], _MOTION),
        *shown("starts", "Desired less measured angle where motions begin.", validation.starts, _STARTS),
        *([claims_table(rulings)] if windows else ()),
        *shown("residuals", "Measured less simulated.", validation.residuals, columns),
        *shown("coupling", "Angles through the coupling.", validation.coupling, ()),
        *shown("controllers", "Controllers of the runs, as recover finds.", told, _CONTROLLERS),
        *(f"Missing: {what}" for what in validation.missing),
    ]
    return Result(data, parts, figures, {"experiment": "validate"}, diverged=diverged)


def _about(path: Path, known: Json) -> str:
    """How many guesses a measurement rests on, and what of it is to be checked."""
    guesses = count_of(len(known.get("guesses", [])), "guess", "guesses")
    doubts = (f"check {doubt}" for doubt in known.get("doubts", []))
    return "\n".join([f"{path}, resting on {guesses}", *doubts])


def _columns_of(residuals: TableRows) -> Sequence[str]:
    """Columns of residuals that the terminal shows; of curves read off a figure others."""
    is_read_off = any("reading_error_deg" in row for row in residuals)
    return (*_RESIDUALS[:4], *_READ_OFF) if is_read_off else _RESIDUALS


def claims_data(rulings: Mapping[str, Ruling]) -> list[dict[str, object]]:
    """``claims`` of ``validate --json``."""
    return [
        {
            "id": name,
            "where": published().entries[name].where,
            "rule": published().judgements[name].rule,
            "kind": "measured",
            "verdict": rulings[name].verdict,
            "evidence": rulings[name].evidence,
        }
        for name in JUDGED
        if name in rulings
    ]


TableData: TypeAlias = dict[str, dict[str, dict[str, dict[str, list[object]]]]]
"""Lists over joints by table, row, what (``measured``, ``printed``, ``agree``) and metric (``mae_deg``)."""


def size_rows(tried: Tried, table: str) -> Iterator[dict[str, object]]:
    """Measured errors beside those of ``table2`` or ``table3``, of runs that were measured."""
    for row, start in _ROWS[table].items():
        for joint in COMPARED if any(name.startswith(start) for name in tried.sizes) else ():
            sizes: dict[str, object] = {"row": row, "joint": joint}
            for metric in METRICS:
                name = f"{start}.{metric}.joint_{joint}"
                size = tried.sizes.get(name)
                sizes |= {f"{metric}_measured": size, f"{metric}_printed": published().number(name)}
                sizes[f"{metric}_agree"] = None if size is None else name in tried.agree
            yield sizes


def table_data(tried: Tried) -> TableData:
    """``table2`` and ``table3`` of ``validate --json``.

    Row -> ``measured``, ``printed``, ``agree``; each has ``mae_deg`` and ``rmse_deg``, lists over joints 2
    and 3.
    """
    data: TableData = {table: {} for table in _ROWS}
    for table, rows in data.items():
        for row in size_rows(tried, table):
            cells = rows.setdefault(str(row["row"]), {what: {} for what in _WHAT})
            for metric, what in product(METRICS, _WHAT):
                cells[what].setdefault(f"{metric}_deg", []).append(row[f"{metric}_{what}"])
    return data


def closest_window(tables: PrintedTables) -> Tried | None:
    """Window closest to the print, unless it is so by accident or decides."""
    return None if tables.best is tables.deciding or tables.chance > RARE else tables.best


def measured_tables(measurement: Measurement, origin: str) -> Iterator[Table]:
    """Tables 2 and 3 over the window that decides, and all numbers of all windows."""
    window = measurement.tables.deciding
    for table in _ROWS:
        if rows := [*size_rows(window, table)]:
            caption = f"Table {table[-1]} as measured, degrees, averaged over: {window.name} ({origin})."
            yield Table(table, caption, rows)
    windows = [
        {"window": tried.window, "offset_removed": tried.offset_removed, "id": name, "measured_deg": size}
        | {"printed_deg": published().number(name), "agrees": name in tried.agree}
        for tried in measurement.tables.tried
        for name, size in tried.sizes.items()
    ]
    yield Table("windows", "Every number by every way of averaging.", windows, terminal=(), suffixes=["csv"])


def claims_table(rulings: Mapping[str, Ruling]) -> Table:
    """Verdicts with their window, statements that fail, and what is missing."""
    rows = []
    for name in JUDGED:
        evidence = rulings[name].evidence
        failing = sum(not statement["holds"] for statement in evidence.get("statements", ()))
        row: dict[str, object] = {
            "claim": name,
            "where": published().entries[name].where,
            "verdict": rulings[name].verdict,
        }
        # A remark of C4 says that s was computed and not recorded.
        row |= {key: evidence.get(key) or None for key in ("window", "missing", "remarks")}
        rows.append(row | {"statements that fail": failing or None})
    return Table("claims", "Claims judged on the measurement.", rows)


def shown(name: str, caption: str, rows: TableRows, columns: Sequence[str]) -> Iterator[Table]:
    """A table, if it has rows; the terminal shows those `columns` that a row has, and no table without."""
    if rows:
        known = tuple(column for column in columns if any(column in row for row in rows))
        yield Table(name, caption, rows, terminal=known)
