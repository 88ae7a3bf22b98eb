"""What ``tendonrepro validate`` does: a measurement against the print and against the model."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from tendonrepro.claim_measured import JUDGED, Measured, judge_measured, measured_of
from tendonrepro.claim_rules import Judged
from tendonrepro.config import LoadedConfig, load_config
from tendonrepro.dataset.measured_file import origin, read_measured
from tendonrepro.dataset.reference_config import runnable
from tendonrepro.dataset.reference_motion import Reference, zero_of
from tendonrepro.dataset.rerun import (
    COMPARE,
    DECOUPLE,
    aligned,
    departure,
    rerun,
    together,
    write_compare,
    write_decouple,
)
from tendonrepro.dataset.residuals import comparison_rows, coupling_rows
from tendonrepro.dataset.row_files import csv_of, markdown_of
from tendonrepro.dataset.validate_tables import table_data, window_rows, write_measured_tables
from tendonrepro.errors import TendonreproError
from tendonrepro.files import sha256_of, write_atomically
from tendonrepro.manifest import make_manifest, to_json, with_outputs
from tendonrepro.parallel import each
from tendonrepro.published import COMPARED, Published, published
from tendonrepro.records import Trace, TraceFile
from tendonrepro.results import MANIFEST, claimed, clear, refuse_others
from tendonrepro.summary import CONTROLLERS, LOADS
from tendonrepro.talk import Talk
from tendonrepro.traces import write_traces

SCHEMA_VERSION = 1
FOLDER = Path("reports") / "validate"
RESULTS, SIMULATED = "validation.json", "simulated.h5"

RARE = 0.01
"""Chance below which a window that gives some of the printed numbers is shown."""
EXPECTED = (*CONTROLLERS, LOADS["with_load"], "decouple")
"""Runs that a complete measurement holds."""


@dataclass
class _Work:
    """Files written so far, simulated runs and when each begins, and what could not be done."""

    folder: Path
    files: list[Path] = field(default_factory=list)
    simulated: list[TraceFile] = field(default_factory=list)
    zeros: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    def write(self, name: str, text: str) -> None:
        """Write a text file of the result."""
        write_atomically(self.folder / name, text)
        self.files.append(self.folder / name)

    def runs(self, measured: TraceFile) -> dict[str, Trace]:
        """Simulated runs by name, on the measured axes."""
        return {
            name: aligned(trace, measured.runs[name], self.zeros[name])
            for file in self.simulated
            for name, trace in file.runs.items()
        }


def run_validate(
    measured: Path,
    config: str | None,
    out: Path | None,
    overrides: Sequence[str],
    seed: int | None,
    force: bool,
    dry_run: bool,
    talk: Talk,
) -> dict[str, Any]:
    """Compare a measured trace file with the print and with the model, and write all of it.

    Parameters
    ----------
    measured : Path
        Trace file that ingest has written.
    config : str or None
        Configuration of the model, but for its reference; None is the shipped one.
    out : Path or None
        Results folder; None is ``reports/validate``.
    overrides : sequence of str
        ``dotted.key=VALUE`` for the configuration; those of the manipulator hold for both experiments.
    seed : int or None
    force : bool
        Overwrite other results.
    dry_run : bool
        Check everything, write nothing.
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
    folder = out or FOLDER
    file = read_measured(measured)
    kind: Literal["compare", "decouple"] = "compare" if file.part("compare").runs else "decouple"
    base = load_config(config, kind, overrides=overrides, seed=seed)
    digest = hashlib.sha256(f"{base.sha256} {sha256_of(measured)}".encode()).hexdigest()
    base = replace(base, sha256=digest, inputs=(*base.inputs, measured))
    head = {"schema_version": SCHEMA_VERSION, "measured": str(measured), "out": str(folder)}
    if dry_run:
        if not force:
            refuse_others(folder, digest)
        return head | {
            "dry_run": True,
            "runs": list(file.runs),
            "config": base.origin,
            "config_sha256": digest,
        }
    with claimed(folder, digest, force=force):
        started = time.perf_counter()
        clear(folder)
        work = _Work(folder)
        data = head | _validated(file, measured.name, base, work, talk)
        data["files"] = [str(one) for one in (*work.files, folder / RESULTS)]
        data["manifest"] = str(folder / MANIFEST)
        work.write(RESULTS, to_json(data))
        manifest = make_manifest(base, time.perf_counter() - started) | {"experiment": "validate"}
        write_atomically(folder / MANIFEST, to_json(with_outputs(manifest, folder, work.files)))
    talk.detail(f"{len(work.files)} files in {time.perf_counter() - started:.1f} s")
    return data


def model_diverged(found: Mapping[str, Any]) -> bool:
    """Whether a run of the model on the measured motion diverged; `found` is of :func:`run_validate`."""
    return "diverged" in found.get("residuals", {}).get("status", {}).values()


def _validated(file: TraceFile, name: str, base: LoadedConfig, work: _Work, talk: Talk) -> dict[str, Any]:
    paper = published()
    talk.detail("trying averaging windows, recovering the reference, judging the claims")
    measured = measured_of(file, paper)
    found = judge_measured(measured, paper)
    work.missing += [f"the run {run}" for run in EXPECTED if run not in file.runs]
    tables = _tables(measured, paper, name, work)
    reference = measured.reference
    if reference is not None:
        reference = runnable(reference, base.config.sampling_period.si)
    if measured.compare.runs:
        _rerun_compare(measured, reference, name, base, work, talk)
    decouple = file.part("decouple").runs.get("decouple")
    if decouple is not None:
        _rerun_decouple(decouple, name, base, work, talk)
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
        "reference": _motion(measured.reference, reference),
        "claims": [_verdict(paper, identifier, found[identifier]) for identifier in JUDGED],
        "numbers": {
            identifier: {"verdict": one.decision.verdict, "ours": one.ours}
            for identifier, one in found.items()
            if identifier not in JUDGED
        },
        "residuals": residuals,
        "missing": work.missing,
    }


def _verdict(paper: Published, identifier: str, one: Judged) -> dict[str, Any]:
    rule = paper.judgements[identifier].rule
    head = {"id": identifier, "where": paper.entries[identifier].where, "rule": rule, "kind": "measured"}
    return head | {"verdict": one.decision.verdict, "evidence": one.evidence}


def _tables(measured: Measured, paper: Published, name: str, work: _Work) -> dict[str, Any]:
    deciding = measured.tables.deciding
    data = table_data(deciding, paper)
    if deciding is not None:
        work.files += write_measured_tables(data, deciding.name, name, work.folder / "tables")
        work.write("windows.csv", csv_of(window_rows(measured.tables, paper)))
    return data | {"best": _best(measured, paper, name, work)}


def _best(measured: Measured, paper: Published, name: str, work: _Work) -> dict[str, Any] | None:
    """Tables over the window closest to the print, where that is no accident and not what decides."""
    best = measured.tables.best
    if best is None or best is measured.tables.deciding or measured.tables.chance > RARE:
        return None
    data = table_data(best, paper)
    work.files += write_measured_tables(data, best.name, name, work.folder / "tables" / "best")
    return {"window": best.name, **data}


def _motion(found: Reference | None, written: Reference | None) -> dict[str, Any] | None:
    """What was recovered, as the configuration holds it; as found where that holds samples alone."""
    if found is None or written is None:
        return None
    if written.shape:
        return written.as_dict() | {"written_as": "shape"}
    return found.as_dict() | {"written_as": "samples"}


def _rerun_compare(
    measured: Measured,
    reference: Reference | None,
    name: str,
    base: LoadedConfig,
    work: _Work,
    talk: Talk,
) -> None:
    reason, runs = measured.unrecovered, measured.compare.runs
    if reference is not None and reference.record.joint != COMPARED:
        reason = "no run holds the desired angles q_d of both joints 2 and 3"
    if reference is None or reason:
        work.missing.append(f"a rerun of the comparison: {reason}")
        return
    apart = {run: math.degrees(departure(trace, reference)) for run, trace in runs.items()}
    work.missing += [
        f"residuals of {run}: its desired motion differs from that of {reference.run} by up to {size:.3g} deg"
        for run, size in apart.items()
        if size
    ]
    try:
        masses = {run: float(trace.attributes["payload_mass"]) for run, trace in runs.items()}
        work.files += write_compare(base, reference, masses, name, work.folder)
        simulated = rerun(work.folder / COMPARE, [run for run in runs if not apart[run]], talk)
    except TendonreproError as error:
        work.missing.append(f"a rerun of the comparison: {_with_hint(error)}")
        return
    if simulated.runs:
        work.simulated.append(simulated)
        work.zeros |= {run: zero_of(runs[run], reference) for run in simulated.runs}


def _with_hint(error: TendonreproError) -> str:
    return f"{error.message}; {error.hint}" if error.hint else error.message


def _rerun_decouple(trace: Trace, name: str, base: LoadedConfig, work: _Work, talk: Talk) -> None:
    if trace.joint != (1, 2, 3):
        work.missing.append("all of joints 1 to 3 in the run decouple: no rerun of it")
        return
    try:
        work.files += write_decouple(_decouple_config(base), trace, name, work.folder)
        work.simulated.append(rerun(work.folder / DECOUPLE, [trace.name], talk))
    except TendonreproError as error:
        work.missing.append(f"a rerun of the run decouple: {_with_hint(error)}")
        return
    work.zeros[trace.name] = float(trace.time[0])


def _decouple_config(base: LoadedConfig) -> LoadedConfig:
    """The configuration given, or the shipped one with what was set of the manipulator."""
    if base.config.experiment == "decouple":
        return base
    both = [text for text in base.overrides if text.startswith(("manipulator.", "seed="))]
    return load_config(None, "decouple", overrides=both)


def _residuals(file: TraceFile, work: _Work) -> dict[str, Any]:
    simulated = work.runs(file)
    rows = [row for name, trace in simulated.items() for row in comparison_rows(file.runs[name], trace)]
    decouple = file.part("decouple").runs.get("decouple")
    coupling = [] if decouple is None else list(coupling_rows(decouple, file.plant))
    for stem, caption, found in (
        ("residuals", "Measured less simulated on the measured motion.", rows),
        ("coupling", "Measured joint and motor angles through the coupling matrices.", coupling),
    ):
        if found:
            work.write(f"{stem}.csv", csv_of(found))
            work.write(f"{stem}.md", markdown_of(caption, found))
    traces = together(work.simulated)
    if traces is not None:
        write_traces(work.folder / SIMULATED, traces)
        work.files.append(work.folder / SIMULATED)
    return {
        "rows": rows,
        "coupling": coupling,
        "status": {name: one.status for name, one in simulated.items()},
    }


def _draw(file: TraceFile, work: _Work) -> None:
    from tendonrepro.figure_overlay import Pair, available_overlays, saved_overlay

    simulated = work.runs(file)
    pairs = {name: Pair(trace, simulated.get(name)) for name, trace in file.runs.items()}
    drawn = each(partial(saved_overlay, file, pairs, work.folder / "figures"), available_overlays(file))
    work.files += [path for paths in drawn for path in paths]
