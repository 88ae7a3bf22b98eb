"""What ``tendonrepro inspect`` does: show columns, and write a mapping to edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.dataset.arrays import Source
from tendonrepro.dataset.guess import guess_mapping
from tendonrepro.dataset.read import read_files
from tendonrepro.files import write_atomically
from tendonrepro.results.store import refuse_existing
from tendonrepro.results.tables import Table


def run_inspect(paths: Sequence[Path], mapping: Path | None, *, force: bool) -> dict[str, Any]:
    """List what files, folders and archives hold, and write a mapping if one is named.

    Raises
    ------
    UsageError
        If the mapping file is there already.
    DataMissingError
        If a path is missing.
    """
    if mapping is not None:
        refuse_existing(mapping, force=force, option="--mapping")
    sources, unread = read_files(paths)
    guessed = guess_mapping(sources, f"Measured data from {paths[0].resolve().name}")
    if mapping is not None:
        write_atomically(mapping, guessed["suggestion"])
    return {
        "schema_version": 2,
        "tables": [{"name": source.name, "columns": _columns(source)} for source in sources],
        "unread": unread,
        **guessed,
        "mapping": None if mapping is None else str(mapping),
    }


def _columns(source: Source) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for name, values in source.columns.items():
        row: dict[str, Any] = {"column": name, "samples": len(values)}
        if values.dtype.kind == "f" and np.isfinite(values).any():
            step = float(np.nanmedian(np.diff(values))) if len(values) > 1 else np.nan
            row |= {"from": float(np.nanmin(values)), "to": float(np.nanmax(values)), "median_step": step}
        rows.append(row)
    return rows


def inspect_text(found: Mapping[str, Any]) -> str:
    """What a terminal shows."""
    parts = [Table("", table["name"], table["columns"]).text() for table in found["tables"]]
    parts += [f"{file}: not read, {reason}" for file, reason in found["unread"].items()]
    wrote = f"wrote {found['mapping']}: check every line that says CHECK"
    return "\n".join([*parts, wrote if found["mapping"] else found["suggestion"].rstrip()])
