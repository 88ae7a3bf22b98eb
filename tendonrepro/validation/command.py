"""What ``tendonrepro validate`` does: a measurement against the print and against the model."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.published import Published, published
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import origin, read_measured
from tendonrepro.evidence.recover import controllers_of
from tendonrepro.files import sha256_of, to_json
from tendonrepro.parallel import each
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import MANIFEST, read_manifest, replaced
from tendonrepro.results.study import foretell
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import write_traces
from tendonrepro.validation.report import table_data, window_rows, write_measured_tables
from tendonrepro.validation.rerun import (
    Work,
    rerun_compare,
    rerun_decouple,
    together,
)
from tendonrepro.validation.residuals import comparison_rows, coupling_rows
from tendonrepro.verdicts.from_measurement import JUDGED, judge_measured
from tendonrepro.verdicts.measured import Measured, measured_of

SCHEMA_VERSION = 1
RESULTS, SIMULATED = "validation.json", "simulated.h5"

RARE = 0.01
"""Chance below which a window that gives some of the printed numbers is shown."""
EXPECTED = (*CONTROLLERS, LOADS["with_load"], "decouple")
"""Runs that a complete measurement holds."""


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
        What ``--json`` prints.

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
    head = {"schema_version": SCHEMA_VERSION, "measured": str(measured), "out": str(folder)}
    if request.dry_run:
        foretell(folder, digest, "validate", request, talk)
        return head | {
            "dry_run": True,
            "runs": list(file.runs),
            "config": base.origin,
            "config_sha256": digest,
        }
    with replaced(folder, digest, command="validate", force=request.force) as result:
        data = head | _validated(file, measured.name, base, Work(result.path), talk)
        data["manifest"] = str(folder / MANIFEST)
        result.write(RESULTS, to_json(data))
        result.manifest = make_manifest(base, result.seconds, "validate") | {"experiment": "validate"}
    return data | {"files": [str(folder / name) for name in read_manifest(folder)["outputs"]]}


def model_diverged(found: Mapping[str, Any]) -> bool:
    """Whether a run of the model on the measured motion diverged; `found` is of :func:`run_validate`."""
    return "diverged" in found.get("residuals", {}).get("status", {}).values()


def _validated(file: TraceFile, name: str, base: LoadedConfig, work: Work, talk: Talk) -> dict[str, Any]:
    paper = published()
    talk.detail("trying averaging windows, recovering the reference, judging the claims")
    measured = measured_of(file, paper)
    found = judge_measured(measured, paper)
    work.missing += [f"the run {run}" for run in EXPECTED if run not in file.runs]
    tables = _tables(measured, paper, name, work)
    if measured.compare.runs:
        rerun_compare(measured, measured.reference, name, base, work, talk)
    decouple = file.part("decouple").runs.get("decouple")
    if decouple is not None:
        rerun_decouple(decouple, name, base, work, talk)
    residuals = _residuals(file, work)
    _draw(file, work)
    known = origin(file)
    return {
        "experiment": file.experiment,
        "runs": list(file.runs),
        "sources": known["inputs"],
        "guesses": known["guesses"],
        "doubts": known["doubts"],
        "window": measured.tables.deciding.name if measured.tables.deciding else None,
        **tables,
        "windows": measured.tables.as_dict(),
        "reference": None if measured.reference is None else measured.reference.as_dict(),
        "claims": [
            {"id": identifier, "where": paper.entries[identifier].where}
            | {"rule": paper.judgements[identifier].rule, "kind": "measured"}
            | {"verdict": found[identifier].decision.verdict, "evidence": found[identifier].evidence}
            for identifier in JUDGED
        ],
        "numbers": {
            identifier: {"verdict": one.decision.verdict, "ours": one.ours}
            for identifier, one in found.items()
            if identifier not in JUDGED
        },
        "residuals": residuals,
        "controllers": controllers_of(measured.compare, talk),
        "missing": work.missing,
    }


def _tables(measured: Measured, paper: Published, name: str, work: Work) -> dict[str, Any]:
    """Tables over the deciding window, and over the one closest to the print where that is no accident."""
    deciding, best = measured.tables.deciding, measured.tables.best
    data = table_data(deciding, paper)
    if deciding is None or best is None:
        return data | {"best": None}
    write_measured_tables(data, deciding.name, name, work.folder / "tables")
    Table("windows", "", window_rows(measured.tables, paper), suffixes=["csv"]).write(work.folder)
    if best is deciding or measured.tables.chance > RARE:
        return data | {"best": None}
    closest = table_data(best, paper)
    write_measured_tables(closest, best.name, name, work.folder / "tables" / "best")
    return data | {"best": {"window": best.name, **closest}}


def _residuals(file: TraceFile, work: Work) -> dict[str, Any]:
    simulated = work.runs(file)
    rows = [row for name, trace in simulated.items() for row in comparison_rows(file.runs[name], trace)]
    decouple = file.part("decouple").runs.get("decouple")
    coupling = [] if decouple is None else list(coupling_rows(decouple, file.plant))
    for stem, caption, found in (
        ("residuals", "Measured less simulated on the measured motion.", rows),
        ("coupling", "Measured joint and motor angles through the coupling matrices.", coupling),
    ):
        if found:
            Table(stem, caption, found, suffixes=["csv", "md"]).write(work.folder)
    traces = together(work.simulated)
    if traces is not None:
        write_traces(work.folder / SIMULATED, traces)
    return {
        "rows": rows,
        "coupling": coupling,
        "status": {name: one.status for name, one in simulated.items()},
    }


def _draw(file: TraceFile, work: Work) -> None:
    from tendonrepro.validation.figures import available_overlays, saved_overlay

    each(partial(saved_overlay, file, work.runs(file), work.folder / "figures"), available_overlays(file))
