"""A result that any command left in a folder."""

from __future__ import annotations

from pathlib import Path

from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json, read_json
from tendonrepro.results.store import MANIFEST, read_manifest
from tendonrepro.results.traces import TRACES


def result_manifest(folder: Path) -> Json:
    """Manifest of the result of any command.

    Raises
    ------
    DataMissingError
        When the folder holds none, or it is damaged.
    """
    if not (folder / MANIFEST).is_file():
        within = [path.parent.name for path in sorted(folder.glob(f"[!.]*/{MANIFEST}"))]
        message = f"holds no result: there is neither {MANIFEST} nor {TRACES}"
        hint = f"name one of the folders in it: {', '.join(within)}" if within else "run a command first"
        raise DataMissingError(message, where=str(folder), hint=hint)
    return read_manifest(folder)


def numbers_in(folder: Path, manifest: Json) -> Json:
    """Numbers of a result by the keys of ``--json``; none of an experiment, whose follow from its traces."""
    command = str(manifest.get("command", ""))
    # An ensemble calls its numbers a summary.
    numbers = [path for path in (folder / f"{command}.json", folder / "summary.json") if path.is_file()]
    data = read_json(numbers[0], "run its command again") if numbers else {}
    return _upgraded(data) if command == "ensemble" else data


def _upgraded(summary: Json) -> Json:
    """Numbers of an ensemble by the keys of today: version 1 had its first population twice."""
    if summary.get("schema_version") != 1:
        return summary
    (first, *_) = summary["populations"].values()
    return {key: value for key, value in summary.items() if key not in first} | {"schema_version": 2}


def table_files(folder: Path, manifest: Json, ending: str) -> list[Path]:
    """Files of the tables that a command wrote, ``.csv``, ``.md`` or ``.tex``; a user's own are none."""
    outputs = {Path(name) for name in manifest.get("outputs", {})}
    tables = [name for name in outputs if {name.with_suffix(".csv"), name.with_suffix(".md")} <= outputs]
    paths = (folder / name for name in tables if name.suffix == ending)
    return sorted(path for path in paths if path.is_file())
