"""What ``data inspect`` and ``data ingest`` do: from files to a mapping, and by it to measured runs."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.published import COMPARED, coupling_of, published, table_1
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.console import Talk, count_of
from tendonrepro.dataset import motion, windows
from tendonrepro.dataset.guess import guess_mapping
from tendonrepro.dataset.mapping import confirmed, parse_mapping
from tendonrepro.dataset.read import read_files
from tendonrepro.dataset.runs import runs_of
from tendonrepro.dataset.tables import Columns
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json, refuse_existing, write_atomically
from tendonrepro.results import paper, records, store, summary, traces
from tendonrepro.results.tables import Table

_PRINTED = "printed: Table 1, signs of section 3.3"


def run_inspect(paths: Sequence[Path], mapping: Path | None, *, force: bool) -> Json:
    """List what files, folders and archives hold, and write a mapping if one is named.

    Returns
    -------
    dict
        ``tables``, each with its ``name`` and of its ``columns`` how many samples, from where to where, in
        which steps; by file what was ``unread`` or ``left_out``, and why; and what was guessed.

    Raises
    ------
    UsageError
        If the mapping file is there already.
    DataMissingError
        If a path is missing.
    """
    if mapping is not None:
        refuse_existing(mapping, force=force, option="--mapping", inputs=paths)
    contents = read_files(paths)
    guessed = guess_mapping(contents.tables, f"Measured data from {paths[0].resolve().name}")
    if mapping is not None:
        write_atomically(mapping, guessed.text)
    return {
        "schema_version": 2,
        "tables": [{"name": table.name, "columns": [*_columns(table)]} for table in contents.tables],
        "unread": contents.unread,
        "left_out": contents.left_out,
        "suggestion": guessed.text,
        "runs": guessed.runs,
        "left": guessed.left,
        "mapping": None if mapping is None else str(mapping),
    }


def _columns(table: Columns) -> Iterator[dict[str, object]]:
    for name, values in table.items():
        row: dict[str, object] = {"column": name, "samples": len(values)}
        if values.dtype.kind == "f" and np.isfinite(values).any():
            steps = np.diff(values)
            step = np.median(steps[np.isfinite(steps)]) if np.isfinite(steps).any() else np.nan
            row |= {"from": float(np.nanmin(values)), "to": float(np.nanmax(values))}
            row["median_step"] = float(step)
        yield row


def inspect_text(inspected: Json) -> str:
    """What a terminal shows."""
    parts = [Table("", table["name"], table["columns"]).text() for table in inspected["tables"]]
    parts += [f"{file}: {line}" for file, lines in inspected["left_out"].items() for line in lines]
    parts += [f"{file}: not read, {reason}" for file, reason in inspected["unread"].items()]
    wanted = "CHECK or FILL IN" if "# FILL IN" in inspected["suggestion"] else "CHECK"
    wrote = f"wrote {inspected['mapping']}: look at every line that says {wanted}"
    return "\n".join([*parts, wrote if inspected["mapping"] else inspected["suggestion"].rstrip()])


def run_ingest(
    paths: Sequence[Path],
    mapping: Path,
    out: Path,
    *,
    force: bool,
    dry_run: bool,
    talk: Talk,
    confirm: bool = False,
) -> Json:
    """Convert measured files, folders and archives to a trace file `out`.

    `confirm` takes every guess in the mapping for right, and deletes its mark.

    Returns
    -------
    dict
        ``runs``, each with joints, samples and errors; ``guesses`` that nobody confirmed; ``notes`` on what
        was done to numbers; ``doubts``, what looks wrong; and ``inputs``, the files.

    Raises
    ------
    ConfigError
        If the mapping is wrong or does not fit the files.
    UsageError
        If `out` is there already.
    DataMissingError
        If a path is missing.
    """
    if not dry_run:
        refuse_existing(out, force=force, inputs=[mapping, *paths])
    text = read_text(mapping, "tendonrepro data inspect FILES --suggest writes one")
    text = confirmed(text) if confirm else text
    loaded = parse_mapping(text, str(mapping))
    contents = read_files(paths)
    inputs = {table.file["name"]: table.file for table in contents.tables}
    runs, notes, doubts = runs_of(contents, loaded)
    # The runs hold what is needed; the columns of a long log take as much again.
    del contents
    for doubt in doubts:
        talk.note(f"check {doubt}")
    made = {"guesses": loaded.guesses, "notes": notes, "doubts": doubts, "inputs": list(inputs.values())}
    digest = hashlib.sha256(text.encode()).hexdigest()
    manifest = {
        "schema_version": 1,
        "tendonrepro_version": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "mapping": {"origin": str(mapping), "sha256": digest},
        "environment": store.environment(),
        **made,
    }
    file = records.TraceFile(
        experiment=_experiment(runs),
        source="measured",
        title=loaded.title,
        runs=runs,
        plant=_plant_record(runs),
        config_yaml=text,
        config_sha256=digest,
        manifest=manifest,
    )
    file = paper.with_what_they_are(file)
    if not dry_run:
        traces.write_traces(out, file)
        if confirm:
            write_atomically(mapping, text)
    starts = _starts(file)
    described = {name: _described(trace, starts.get(name, 0.0)) for name, trace in runs.items()}
    head = {"schema_version": 1, "out": str(out), "dry_run": dry_run, "title": file.title}
    return {**head, "runs": described, **made}


def _plant_record(runs: Mapping[str, records.Trace]) -> records.PlantRecord:
    """All that is known of a measured plant: the printed coupling, unless it has more joints."""
    S, S_inv = coupling_of(table_1(published()))
    joints = max(joint for trace in runs.values() for joint in trace.joint)
    if joints > len(S):
        return records.PlantRecord({}, {"arm": f"one with {joints} joints"})
    coupling = {
        "S": records.PlantValue(S, "1", _PRINTED, "coupling matrix, q = S q_motor"),
        "S_inv": records.PlantValue(S_inv, "1", _PRINTED, "inverse coupling matrix"),
    }
    return records.PlantRecord(coupling, {})


def _starts(file: records.TraceFile) -> dict[str, float]:
    """When the motion of each run of the comparison begins, s, as `validate` finds it; else nothing."""
    others = [motion.joints_with_motion(trace) for trace in file.part("compare").runs.values()]
    for joints in filter(None, (COMPARED, max(others, key=len, default=()))):
        with suppress(DataMissingError):
            return motion.starts_of(file, motion.beginning(file, joints))
    return {}


def _experiment(runs: Mapping[str, records.Trace]) -> Literal["compare", "decouple", "both"]:
    of_decoupling = {name in records.DECOUPLING_RUNS for name in runs}
    return "both" if len(of_decoupling) > 1 else "decouple" if True in of_decoupling else "compare"


def _described(trace: records.Trace, start: float) -> dict[str, object]:
    described: dict[str, object] = {
        "joints": list(trace.joint),
        "samples": len(trace.time),
        "step_s": records.median_step(trace.time),
        "duration_s": float(trace.time[-1]),
        "payload_mass_kg": trace.attributes["payload_mass"],
        "status": trace.status,
        "status_joints": list(trace.attributes.get("status_joints", ())),
        "variables": list(trace.variables),
    }
    if "e" in trace:
        moving = windows.spans(trace.time, windows.Timing(start, 0.0))["whole"]
        described["errors_from_s"] = float(trace.time[moving][0])
        sizes = summary.sizes_deg(trace["e"][moving])
        described |= {key: value.tolist() for key, value in sizes.items()}
    return described


def ingest_text(made: Json) -> str:
    """What a terminal shows."""
    rows = [{"run": name} | run for name, run in made["runs"].items()]
    names = ("run", "joints", "samples", "step_s", "status", "errors_from_s", "mae_deg", "rmse_deg")
    lines = [Table("runs", made["title"], rows, {name: (name, ".3f") for name in names}).text()]
    lines += [f"  note: {note}" for note in made["notes"]]
    if made["guesses"]:
        lines.append(
            f"  {count_of(len(made['guesses']), 'guess', 'guesses')}: check the mapping, then say --confirm"
        )
    lines.append(f"would write {made['out']}" if made["dry_run"] else f"wrote {made['out']}")
    return "\n".join(lines)
