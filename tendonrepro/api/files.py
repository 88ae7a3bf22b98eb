"""The commands around files, as functions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tendonrepro.console import Talk

RECORD = "19467931"
"""Number of the paper's record."""


def fetch(record: str = RECORD, out: str | Path = "data/zenodo", *, force: bool = False) -> dict[str, Any]:
    """Download a record and verify it; a second call needs no network."""
    from tendonrepro.dataset.fetch import run_fetch

    return run_fetch(record, Path(out), None, force, False, Talk())


def inspect(*paths: str | Path, mapping: str | Path | None = None, force: bool = False) -> dict[str, Any]:
    """Tell what is in files; with `mapping`, write a mapping file to edit."""
    from tendonrepro.dataset.command import run_inspect

    target = None if mapping is None else Path(mapping)
    return run_inspect([*map(Path, paths)], target, force=force)


def ingest(
    *paths: str | Path,
    mapping: str | Path = "data/mapping.yaml",
    out: str | Path = "data/measured.h5",
    confirm: bool = False,
    force: bool = False,
) -> dict[str, Any]:
    """Convert measured data to a trace file; `confirm` says that the mapping is right."""
    from tendonrepro.dataset.command import run_ingest

    files = [*map(Path, paths)]
    return run_ingest(
        files, Path(mapping), Path(out), force=force, dry_run=False, talk=Talk(), confirm=confirm
    )


def figures(out: str | Path = "reports", names: Sequence[str] = (), *, force: bool = False) -> list[Path]:
    """Draw figures again from stored traces, all or those named."""
    from tendonrepro.experiments.command import redraw

    return redraw(Path(out), list(names) or None, force=force)


def tables(out: str | Path = "reports", *, force: bool = False) -> list[Path]:
    """Write tables again from stored traces."""
    from tendonrepro.experiments.command import rewrite_tables

    return rewrite_tables(Path(out), force=force)


def export(
    file: str | Path, form: str = "csv", out: str | Path | None = None, *, force: bool = False
) -> Path:
    """Write stored traces as ``csv``, ``parquet`` or ``mat``."""
    from tendonrepro.results.export import export_traces

    return export_traces(Path(file), form, None if out is None else Path(out), force=force)


def animate(
    file: str | Path,
    out: str | Path | None = None,
    *,
    run: str | None = None,
    speed: float = 1.0,
    force: bool = False,
) -> list[str]:
    """Film the arm, its tendons coloured by tension, and return the files."""
    from tendonrepro.results.figures.animation import animate as make

    target = None if out is None else Path(out)
    found = make(Path(file), Talk(), run=run, speed=speed, out=target, force=force)
    return list(found["files"])


def diff(first: str | Path, second: str | Path) -> dict[str, Any]:
    """Tell what differs between two results; ``same`` is True where nothing does."""
    from tendonrepro.results.difference import difference

    return difference(Path(first), Path(second))


def report(results: str | Path = "reports", out: str | Path | None = None, *, force: bool = False) -> Path:
    """Write one HTML file of all that was run."""
    from tendonrepro.reporting.command import run_report

    found = run_report(Path(results), None if out is None else Path(out), force=force)
    return Path(found["path"])
