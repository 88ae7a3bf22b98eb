"""What ``tendonrepro ingest`` does: from files and a mapping to a trace file of measured runs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import coupling_of, published, table_1
from tendonrepro.console import Talk
from tendonrepro.dataset.mapping import confirmed, parse_mapping, read_mapping
from tendonrepro.dataset.measured_file import origin
from tendonrepro.dataset.read import read_files
from tendonrepro.dataset.runs import Assembly
from tendonrepro.dataset.source import Source
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import to_json, write_atomically
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.manifest import environment
from tendonrepro.results.records import DECOUPLING_RUNS, PlantRecord, PlantValue, Trace, TraceFile
from tendonrepro.results.summary import sizes_deg
from tendonrepro.results.traces import read_traces, write_traces

SCHEMA_VERSION = 1
_PRINTED = "printed: Table 1, signs of section 3.3"
_PAYLOAD = "hardware.payload"


def run_ingest(
    paths: Sequence[Path],
    mapping: Path,
    out: Path,
    *,
    force: bool,
    dry_run: bool,
    talk: Talk,
    confirm: bool = False,
) -> dict[str, Any]:
    """Convert measured files, folders and archives to a trace file.

    Parameters
    ----------
    paths : sequence of Path
    mapping : Path
        Which column is which variable.
    out : Path
        Trace file to write.
    force : bool
        Overwrite one made by another mapping or from other data.
    dry_run : bool
        Write nothing.
    talk : Talk
    confirm : bool
        Take every guess in the mapping for right, and delete its mark.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    ConfigError
        If the mapping is wrong or does not fit the files.
    UsageError
        If `out` holds something else.
    DataMissingError
        If a path is missing.
    """
    payload = published().number(_PAYLOAD)
    loaded = read_mapping(mapping, payload)
    if confirm:
        loaded = parse_mapping(confirmed(loaded.text), str(mapping), payload)
    sources, unread = read_files(paths, talk)
    S, S_inv = coupling_of(table_1(published()))
    assembly = Assembly(sources, unread, loaded, S, _judge)
    runs = assembly.runs()
    notes = [*assembly.notes, *(f"{file} was not read: {reason}" for file, reason in unread.items())]
    for doubt in assembly.doubts:
        talk.note(f"check {doubt}")
    told = {"guesses": loaded.guesses, "notes": notes, "doubts": assembly.doubts}
    digest = hashlib.sha256(loaded.text.encode()).hexdigest()
    manifest = _manifest(mapping, digest, assembly.used()) | told
    file = TraceFile(
        experiment=_experiment(runs),
        source="measured",
        title=loaded.title,
        runs=runs,
        plant=_coupling_record(S, S_inv),
        config_yaml=loaded.text,
        config_sha256=digest,
        manifest_json=to_json(manifest),
        created=manifest["created"],
        tendonrepro_version=__version__,
    )
    if not force:
        _refuse_others(out, file, manifest)
    if not dry_run:
        write_traces(out, file)
        if confirm:
            write_atomically(mapping, loaded.text)
    head = {"schema_version": SCHEMA_VERSION, "out": str(out), "dry_run": dry_run, "title": file.title}
    described = {name: _described(trace) for name, trace in runs.items()}
    return head | {"runs": described} | told | {"inputs": manifest["inputs"]}


def _judge(time: Array, e: Array) -> tuple[str, float]:
    """Status by the limits of the shipped comparison."""
    limits = load_config(None, "compare").config.status
    return status_of(
        time, e, limits.divergence_limit.si, limits.ringing_frequency.si, limits.ringing_share.si
    )


def _experiment(runs: Mapping[str, Trace]) -> Literal["compare", "decouple", "both"]:
    of_decoupling = {name in DECOUPLING_RUNS for name in runs}
    return "both" if len(of_decoupling) > 1 else "decouple" if True in of_decoupling else "compare"


def _coupling_record(S: Array, S_inv: Array) -> PlantRecord:
    """What the paper prints of the plant: the coupling, and nothing else."""
    coupling = PlantValue(S, "1", _PRINTED, "coupling matrix, q = S q_motor")
    return PlantRecord(
        {"S": coupling, "S_inv": PlantValue(S_inv, "1", _PRINTED, "inverse coupling matrix")}, {}
    )


def _manifest(mapping: Path, digest: str, sources: Sequence[Source]) -> dict[str, Any]:
    files = {source.name.partition(":")[0]: source for source in sources}
    return {
        "schema_version": SCHEMA_VERSION,
        "tendonrepro_version": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "mapping": {"origin": str(mapping), "sha256": digest},
        "inputs": [{"name": name, "size": one.size, "md5": one.md5} for name, one in files.items()],
        "environment": environment(),
    }


def _refuse_others(out: Path, file: TraceFile, manifest: Mapping[str, Any]) -> None:
    """Refuse to overwrite anything but an earlier result of the same mapping and data."""
    if not out.exists():
        return
    hint = "choose another --out, or say --force to overwrite it"
    try:
        before = read_traces(out)
    except DataMissingError:
        message = "is something else than a trace file of this version"
        raise UsageError(message, where=str(out), hint=hint) from None
    if before.source != "measured":
        raise UsageError("holds simulated traces", where=str(out), hint=hint)
    if (before.config_sha256, origin(before)["inputs"]) != (file.config_sha256, manifest["inputs"]):
        raise UsageError("was made by another mapping or from other data", where=str(out), hint=hint)


def _described(trace: Trace) -> dict[str, Any]:
    found: dict[str, Any] = {
        "joints": list(trace.joint),
        "samples": len(trace.time),
        "step_s": float(np.median(np.diff(trace.time))),
        "duration_s": float(trace.time[-1]),
        "payload_mass_kg": trace.attributes["payload_mass"],
        "status": trace.status,
        "status_joints": list(trace.attributes.get("status_joints", ())),
        "variables": list(trace.variables),
    }
    if "e" in trace:
        found |= {f"{key}_deg": value.tolist() for key, value in sizes_deg(trace["e"]).items()}
    return found


def ingest_text(found: Mapping[str, Any]) -> str:
    """What a terminal shows of an ingestion."""
    lines = [found["title"]]
    for name, run in found["runs"].items():
        joints = ", ".join(map(str, run["joints"]))
        step = f"every {run['step_s'] * 1e3:g} ms"
        lines.append(f"  {name}: joints {joints}, {run['samples']} samples {step}, {run['status']}")
        lines.append(f"    {', '.join(run['variables'])}")
        if "mae_deg" in run:
            sizes = (
                f"{key.upper()} {' / '.join(f'{value:.3f}' for value in run[f'{key}_deg'])}"
                for key in ("mae", "rmse")
            )
            lines.append(f"    error in deg: {', '.join(sizes)}")
    lines += [f"  note: {note}" for note in found["notes"]]
    if found["guesses"]:
        lines.append(f"  {len(found['guesses'])} guesses: check the mapping, then say --confirm")
    lines.append(f"would write {found['out']}" if found["dry_run"] else f"wrote {found['out']}")
    return "\n".join(lines)
