"""What a measurement beside print and model shows: JSON, tables, terminal and pictures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from tendonrepro.configuration.published import COMPARED, METRICS, published, row_of
from tendonrepro.console import count_of
from tendonrepro.dataset.windows import PrintedTables, Tried
from tendonrepro.files import Json
from tendonrepro.results.figures.catalogue import FIGURES, caption_of, drawings, runs_of
from tendonrepro.results.figures.style import REFERENCE, Drawing, Sheet, Stroke, journal_style, paler
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.results.tables import Table, TableRows
from tendonrepro.studies.result import Result
from tendonrepro.validation.validated import Validation
from tendonrepro.verdicts.measurement import JUDGED
from tendonrepro.verdicts.rules import Ruling

_ROWS: Mapping[str, Mapping[str, str]] = {
    "table2": {run: row_of(run) for run in CONTROLLERS},
    "table3": {load: row_of(run) for load, run in LOADS.items()},
}
"""Rows of each table, and how the ids of their measured numbers begin."""
_WHAT = ("measured", "printed", "agree")
OTHER_ARM = "The arm is not the paper's, so nothing is judged by the paper's numbers and claims."

_TERMINAL = {
    "motion": ("run", "joints", "period_s", "begin_s", "spacing_s", "deviation_deg", "brought_to_rest"),
    "starts": ("run", "joint", "begin_s", "error_deg"),
    "residuals": (
        *("run", "joint", "measured_mae_deg", "simulated_mae_deg", "mae_ratio", "q_rms_deg", "lag_s"),
        *("measured_calculated_mae_deg", "simulated_calculated_mae_deg", "e_rms_low_deg", "e_rms_high_deg"),
    ),
    "controllers": ("run", "joint", "answer", "surface", "readings", "weights", "advice"),
}
"""Columns of each table that the terminal shows, where a row has them."""

_LABEL = "Thin, dashed: simulated"
_DASHES = (4.0, 1.6)
_WIDE, _THIN = 1.6, 0.5
"""Width of a measured and of a simulated curve, pt: where they lie on each other both can be seen."""
_PALE = 0.55
"""Share of white in the colour of a measured curve."""


def validation_result(validation: Validation, path: Path) -> Result:
    """Show what the measurement at a path says of paper and model."""
    measurement, rulings = validation.measurement, validation.rulings
    file, known = measurement.file, measurement.file.manifest
    windows = measurement.tables.as_dict() if validation.of_paper else None
    motion = measurement.reference.as_dict() if measurement.reference else None
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
        "windows": windows,
        "reference": motion,
        "starts": validation.starts,
        "claims": claims_data(rulings),
        "numbers": {
            name: {"verdict": ruling.verdict, "ours": ruling.ours}
            for name, ruling in rulings.items()
            if name not in JUDGED
        },
        "residuals": {"rows": validation.residuals, "status": status},
        "diverged": diverged,
        "controllers": validation.controllers,
        "missing": validation.missing,
    }
    told = [{name: row.get(name) for name in _TERMINAL["controllers"]} for row in validation.controllers]
    doubts = (f"check {doubt}" for doubt in known.get("doubts", []))
    guesses = count_of(len(known.get("guesses", [])), "guess", "guesses")
    parts: list[Table | str] = [
        "\n".join([f"{path}, resting on {guesses}", *doubts]),
        *(measured_tables(measurement.tables, str(path)) if windows else ()),
        str(windows["remark"]) if windows else OTHER_ARM,
        *_shown("motion", "The desired motion, sampled to run again.", [motion] if motion else []),
        *_shown("starts", "Desired less measured angle where motions begin.", validation.starts),
        *([claims_table(rulings)] if windows else ()),
        *_shown("residuals", "Measured less simulated.", validation.residuals),
        *_shown("controllers", "Controllers of the runs, as recover finds.", told),
        *(f"Missing: {what}" for what in validation.missing),
    ]
    figures = {name: partial(draw_overlay, name, file, validation.models) for name in overlays(file)}
    return Result(data, parts, figures, {"experiment": "validate"}, diverged=diverged)


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


def table_data(tried: Tried) -> Json:
    """``table2`` and ``table3`` of ``validate --json``.

    Row -> ``measured``, ``printed``, ``agree``; each has ``mae_deg`` and ``rmse_deg``, lists over joints 2
    and 3.
    """
    data: Json = {table: {} for table in _ROWS}
    for table, rows in data.items():
        for row in size_rows(tried, table):
            cells = rows.setdefault(row["row"], {what: {} for what in _WHAT})
            for metric, what in product(METRICS, _WHAT):
                cells[what].setdefault(f"{metric}_deg", []).append(row[f"{metric}_{what}"])
    return data


def measured_tables(tables: PrintedTables, origin: str) -> Iterator[Table]:
    """Tables 2 and 3 over the window that decides, and all numbers of all windows."""
    for table in _ROWS:
        if rows := [*size_rows(tables.deciding, table)]:
            over = f"averaged over: {tables.deciding.name} ({origin})."
            yield Table(table, f"Table {table[-1]} as measured, degrees, {over}", rows)
    windows = [
        {"window": tried.window, "offset_removed": tried.offset_removed, "id": name, "measured_deg": size}
        | {"printed_deg": published().number(name), "agrees": name in tried.agree}
        for tried in tables.tried
        for name, size in tried.sizes.items()
    ]
    yield Table("windows", "Every number by every way of averaging.", windows, terminal=(), suffixes=["csv"])


def claims_table(rulings: Mapping[str, Ruling]) -> Table:
    """Verdicts with their window, statements that fail, and what is missing."""
    rows = []
    for name in JUDGED:
        verdict, evidence = rulings[name].verdict, rulings[name].evidence
        failing = sum(not statement["holds"] for statement in evidence.get("statements", ()))
        row: dict[str, object] = {"claim": name, "where": published().entries[name].where, "verdict": verdict}
        # A remark of C4 says that s was computed and not recorded.
        row |= {key: evidence.get(key) or None for key in ("window", "missing", "remarks")}
        rows.append(row | {"statements that fail": failing or None})
    return Table("claims", "Claims judged on the measurement.", rows)


def _shown(name: str, caption: str, rows: TableRows) -> Iterator[Table]:
    """A table, if it has rows; the terminal shows those of its columns that a row has."""
    if rows:
        columns: Sequence[str] = _TERMINAL.get(name, ())
        yield Table(name, caption, rows, terminal=[key for key in columns if any(key in row for row in rows)])


def overlays(measured: TraceFile) -> list[str]:
    """Figures that a measured file can show; none measured Figure 6."""
    return [name for name in drawings(measured) if name != "fig06"]


def draw_overlay(name: str, measured: TraceFile, models: Mapping[str, Trace]) -> Drawing:
    """Draw one of `overlays`: measured wide and pale, simulated thin and dashed above.

    `models` are simulations on the measured axes, by run. What was not measured is not drawn.
    """
    spec = FIGURES[name]
    traces = spec.traces(measured)
    joints = {joint for trace in traces for joint in trace.joint}
    simulated = {trace.name: models[trace.name].of_joints(joints) for trace in traces if trace.name in models}
    file = replace(measured, runs=simulated)
    drawn = spec.traces(file)
    with journal_style():
        sheet = spec.draw(measured, traces)
        for line in sheet.lines.values():
            line.set_linestyle("-")
            line.set_zorder(1.5 if line.get_linewidth() < REFERENCE.width else 1.2)
        if drawn:
            _lay_over(sheet, spec.draw(file, drawn))
        origin = "Measured, and simulated on the measured motion" if drawn else "Measured"
        return sheet.finish(name, caption_of(name, measured, sheet, _made(traces, drawn)), origin)


def _made(measured: list[Trace], simulated: list[Trace]) -> str:
    """What was measured and simulated, in words of a caption."""
    told = f"Measured, {runs_of(measured)}"
    laid_over = f"on it simulated, thin and dashed: {runs_of(simulated)}"
    return f"{told}, wide and pale; {laid_over}" if simulated else f"{told}; no simulation"


def _lay_over(sheet: Sheet, over: Sheet) -> None:
    """Add the curves of simulated runs, without the motion that they follow."""
    # Letters count panels, and a measurement may have joints that the model has not.
    letters = {place: letter for letter, place in sheet.places.items()}
    measured = dict(sheet.lines)
    for (there, name), line in over.lines.items():
        letter = letters.get(over.places[there], "")
        if (letter, name) not in measured or "desired" in name.lower():
            continue
        below = measured[letter, name]
        colour = str(below.get_color())
        below.set(color=paler(colour, _PALE), linewidth=_WIDE)
        x, y = (np.asarray(values, float) for values in line.get_data())
        stroke, diverged = Stroke(colour, _DASHES, _THIN), (there, name) in over.diverged
        sheet.curve(letter, f"{name} simulated", x, y, stroke, label=_LABEL, diverged=diverged)
        sheet.lines[letter, f"{name} simulated"].set_zorder(2.0)
