"""What ``tendonrepro validate`` does: a measurement against the print and against the model."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.published import COMPARED, Published, published
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import read_measured
from tendonrepro.dataset.windows import Tried
from tendonrepro.evidence.recover import controllers_of
from tendonrepro.files import sha256_of
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import MANIFEST, replaced
from tendonrepro.results.study import Outcome, foretell
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.results.tables import Table, TableRows
from tendonrepro.validation.rerun import Reruns
from tendonrepro.validation.residuals import comparison_rows, coupling_rows
from tendonrepro.verdicts.from_measurement import JUDGED, judge_measured
from tendonrepro.verdicts.measured import Measured, measured_of

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

EXPECTED = (*CONTROLLERS, LOADS["with_load"], "decouple")
"""Runs that a complete measurement holds."""

_MOTION = ("run", "joints", "period_s", "begin_s", "spacing_s", "deviation_deg", "brought_to_rest")
_RESIDUALS = ("run", "joint", "measured_mae_deg", "simulated_mae_deg", "mae_ratio", "q_rms_deg", "lag_s")
_CONTROLLERS = ("run", "joint", "answer", "surface", "readings", "weights", "advice")
"""Columns that the terminal shows."""


def run_validate(measured: Path, request: Request, talk: Talk) -> dict[str, Any]:
    """Compare a measured trace file with the print and with the model, and write all of it.

    Parameters
    ----------
    measured : Path
        Trace file that ingest has written.
    request : Request
        Its configuration is the model's, but for the reference; changes of the manipulator hold for both
        experiments.
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints, and ``text``.

    Raises
    ------
    DataMissingError
        If there is no measured file.
    UsageError
        If it is simulated, or the folder holds other results.
    """
    folder = request.folder("validate")
    file = read_measured(measured)
    kind: Literal["compare", "decouple"] = "compare" if file.part("compare").runs else "decouple"
    base = request.load(kind)
    digest = hashlib.sha256(f"{base.sha256} {sha256_of(measured)}".encode()).hexdigest()
    base = replace(base, sha256=digest, inputs=(*base.inputs, measured))
    head = {"schema_version": 1, "measured": str(measured), "out": str(folder), "runs": list(file.runs)}
    if request.dry_run:
        foretell(folder, digest, "validate", request, talk)
        text = f"would validate {measured} (runs {', '.join(file.runs)}) and write to {folder}"
        return head | {"dry_run": True, "config": base.origin, "config_sha256": digest, "text": text}
    with replaced(folder, digest, command="validate", force=request.force) as result:
        outcome = _study(file, head, base, result.path, talk)
        outcome.save(result, "validation")
        result.manifest = make_manifest(base, result.seconds, "validate") | {"experiment": "validate"}
    text = f"{outcome.text()}\n\nTables, figures, reference and traces are in {folder}"
    return {**outcome.data, "text": text, "manifest": str(folder / MANIFEST)}


def _study(file: TraceFile, head: Mapping[str, Any], base: LoadedConfig, folder: Path, talk: Talk) -> Outcome:
    """Compare a measurement with print and model; reruns are written into the folder."""
    from tendonrepro.validation.figures import draw_overlay, overlays

    paper, known = published(), json.loads(file.manifest_json)
    talk.detail("trying averaging windows, recovering the reference, judging the claims")
    measured = measured_of(file, paper)
    tables, reference, closest = measured.tables, measured.reference, closest_window(measured)
    judged = judge_measured(measured, paper)
    claims: list[dict[str, Any]] = [
        {
            "id": name,
            "where": paper.entries[name].where,
            "rule": paper.judgements[name].rule,
            "kind": "measured",
            "verdict": judged[name].decision.verdict,
            "evidence": judged[name].evidence,
        }
        for name in JUDGED
    ]
    reruns = Reruns(measured, base, Path(head["measured"]).name, folder, talk)
    reruns.carry_out()
    models = reruns.runs
    rows = [row for name, model in models.items() for row in comparison_rows(file.runs[name], model)]
    decouple = file.part("decouple").runs.get("decouple")
    coupling = [] if decouple is None else list(coupling_rows(decouple, file.plant))
    data = {
        **head,
        "experiment": file.experiment,
        "sources": known.get("inputs", []),
        "guesses": known.get("guesses", []),
        "doubts": known.get("doubts", []),
        "window": tables.window,
        **table_data(tables.deciding, paper),
        "best": {"window": closest.name, **table_data(closest, paper)} if closest else None,
        "windows": tables.as_dict(),
        "reference": None if reference is None else reference.as_dict(),
        "claims": claims,
        "numbers": {
            name: {"verdict": one.decision.verdict, "ours": one.ours}
            for name, one in judged.items()
            if name not in JUDGED
        },
        "residuals": {
            "rows": rows,
            "coupling": coupling,
            "status": {name: model.status for name, model in models.items()},
        },
        "diverged": any(model.status == "diverged" for model in models.values()),
        "controllers": controllers_of(measured.compare, talk),
        "missing": [f"the run {run}" for run in EXPECTED if run not in file.runs] + reruns.missing,
    }
    figures = {name: partial(draw_overlay, name, file, models) for name in overlays(file)}
    return Outcome(data, [*_parts(data, measured, paper)], figures)


def _parts(data: Mapping[str, Any], measured: Measured, paper: Published) -> Iterator[Table | str]:
    """What the terminal shows, and tables."""
    doubts = (f"check {doubt}" for doubt in data["doubts"])
    yield "\n".join([f"{data['measured']}, resting on {len(data['guesses'])} guesses", *doubts])
    yield from measured_tables(measured, paper, data["measured"])
    yield f"{data['windows']['remark']}"
    motion = [data["reference"]] if data["reference"] else []
    yield from shown("motion", "The desired motion, sampled to run again.", motion, _MOTION)
    yield claims_table(data["claims"])
    residuals = data["residuals"]
    yield from shown("residuals", "Measured less simulated on its motion.", residuals["rows"], _RESIDUALS)
    yield from shown("coupling", "Measured angles through the coupling.", residuals["coupling"], ())
    controllers = [{name: row.get(name) for name in _CONTROLLERS} for row in data["controllers"]]
    yield from shown("controllers", "Controllers of the runs, as recover finds.", controllers, _CONTROLLERS)
    yield from (f"Missing: {what}" for what in data["missing"])


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
