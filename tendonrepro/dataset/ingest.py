"""What ``tendonrepro ingest`` does: from files and a mapping to a trace file of measured runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.config.load import load_config
from tendonrepro.config.published import coupling_of, published, table_1
from tendonrepro.console import Talk
from tendonrepro.dataset.mapping.assembly import Assembly, doubts_about
from tendonrepro.dataset.mapping.model import LoadedMapping, confirmed, load_mapping
from tendonrepro.dataset.meaning.words import printable
from tendonrepro.dataset.measured_file import origin
from tendonrepro.dataset.readers.guard import read_guarded
from tendonrepro.dataset.readers.read import files_below
from tendonrepro.dataset.readers.signals import Source
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import sha256_of, to_json, write_atomically
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.manifest import environment
from tendonrepro.results.records import DECOUPLING_RUNS, PlantRecord, PlantValue, Trace, TraceFile, of_joints
from tendonrepro.results.summary import sizes_deg
from tendonrepro.results.traces import read_traces, write_traces

SCHEMA_VERSION = 1
_PRINTED = "printed: Table 1, signs of section 3.3"


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
    """Convert measured files, folders and archives to the trace file `out`.

    `force` overwrites one made by another mapping or from other data; `dry_run` writes nothing; `confirm`
    deletes every `because` of the mapping first.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    ConfigError
        When the mapping is wrong or does not fit the files.
    UsageError
        When `out` holds something else and `force` is not given.
    DataMissingError
        When a path is missing.
    """
    loaded = load_mapping(mapping)
    if confirm:
        loaded = confirmed(loaded, mapping)
    # Of an archive the mapping may name a member: then it is read whole.
    wanted = loaded.mapping.files()
    files = [(path, name) for path, name in files_below(paths) if any(_may_hold(name, w) for w in wanted)]
    sources = read_guarded(files, talk)
    S, S_inv = coupling_of(table_1(published()))
    assembly = Assembly(sources, loaded.mapping, str(mapping), S, _judge)
    runs = assembly.runs()
    doubts = [f"{name}: {doubt}" for name, trace in runs.items() for doubt in doubts_about(trace)]
    doubts += assembly.doubts
    for doubt in doubts:
        talk.note(f"check {doubt}")
    told = {"guesses": list(loaded.mapping.guesses()), "notes": assembly.notes, "doubts": doubts}
    manifest = _manifest(mapping, loaded, assembly.used()) | told
    file = TraceFile(
        experiment=_experiment(runs),
        source="measured",
        title=loaded.mapping.title,
        runs=runs,
        plant=_coupling_record(S, S_inv),
        config_yaml=loaded.text,
        config_sha256=loaded.sha256,
        manifest_json=to_json(manifest),
        created=manifest["created"],
        tendonrepro_version=__version__,
    )
    if not force:
        _refuse_others(out, file, manifest)
    if not dry_run:
        write_traces(out, file)
        if confirm:
            write_atomically(mapping.resolve(), loaded.text)
    head = {"schema_version": SCHEMA_VERSION, "out": str(out), "dry_run": dry_run, "title": file.title}
    described = {name: _described(trace) for name, trace in runs.items()}
    return head | {"runs": described} | told | {"inputs": manifest["inputs"]}


def _may_hold(name: str, wanted: str) -> bool:
    """Whether a file is the wanted one or an archive around it, whatever folders were left out of a name."""
    parts = wanted.split("/")
    ways = ["/".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1)]
    return any(f"/{name}".endswith(f"/{way}") for way in ways)


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


def _manifest(path: Path, loaded: LoadedMapping, sources: Sequence[Source]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "tendonrepro_version": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "mapping": {"origin": str(path), "sha256": loaded.sha256, "file_sha256": sha256_of(path)},
        "inputs": [
            {"name": source.name, "kind": source.kind, "size": source.size, "md5": source.md5}
            for source in sources
        ],
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
        message = "holds simulated traces"
    elif before.config_sha256 != file.config_sha256:
        message = "was made by another mapping"
    elif origin(before)["inputs"] != manifest["inputs"]:
        message = "was made from other data"
    else:
        return
    raise UsageError(message, where=str(out), hint=hint)


def _described(trace: Trace) -> dict[str, Any]:
    steps = np.diff(trace.time)
    found: dict[str, Any] = {
        "joints": list(trace.joint),
        "samples": len(trace.time),
        "step_s": float(np.median(steps)) if steps.size else None,
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
    """What a terminal shows of an ingestion, `found` by `run_ingest`."""
    lines = [found["title"]]
    for name, run in found["runs"].items():
        joints = ", ".join(map(str, run["joints"]))
        step = "one sample" if run["step_s"] is None else f"every {run['step_s'] * 1e3:g} ms"
        status = of_joints(run["status"], run["status_joints"])
        lines.append(f"  {name}: joints {joints}, {run['samples']} samples {step}, {status}")
        lines.append(f"    {', '.join(run['variables'])}")
        if "mae_deg" in run:
            sizes = (
                f"{key.upper()} {' / '.join(f'{value:.3f}' for value in run[f'{key}_deg'])}"
                for key in ("mae", "rmse")
            )
            lines.append(f"    error in deg: {', '.join(sizes)}")
    lines += [f"  note: {note}" for note in found["notes"]]
    if found["guesses"]:
        lines.append(f"  {len(found['guesses'])} columns are guessed: check the mapping, then say --confirm")
    lines.append(f"would write {found['out']}" if found["dry_run"] else f"wrote {found['out']}")
    return "\n".join(map(printable, lines))
