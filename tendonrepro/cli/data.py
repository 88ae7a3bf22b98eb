"""Commands around the paper's data set."""

from __future__ import annotations

from pathlib import Path

import typer

from tendonrepro.cli.options import Terminal, command
from tendonrepro.configuration.request import Request

data_app = typer.Typer(rich_help_panel="Your data, or the paper's", rich_markup_mode=None)


@command(data_app, "tendonrepro fetch --out data/zenodo")
def fetch(
    terminal: Terminal,
    record: str = "19467931",
    *,
    out: Path = Path("data/zenodo"),
    base_url: str | None = None,
    dry_run: bool = False,
    force: bool = False,
) -> None:
    """Download the paper's data set and verify it.

    A second run needs no network.

    Parameters
    ----------
    record
        Number, DOI or address of the record.
    out
        Folder for the files.
    base_url
        Another server [default: $TENDONREPRO_ZENODO_URL, else Zenodo].
    dry_run
        List the record, download nothing.
    force
        Replace altered files, or another record's.
    """
    from tendonrepro.dataset.fetch import fetch_text, run_fetch

    found = run_fetch(record, out, base_url, force, dry_run, terminal.talk)
    terminal.show(found, fetch_text(found))


@command(data_app, "tendonrepro inspect data/zenodo --suggest")
def inspect(
    terminal: Terminal,
    paths: list[Path],
    *,
    suggest: bool = False,
    mapping: Path = Path("data/mapping.yaml"),
    force: bool = False,
) -> None:
    """What is in files of any format, and what it seems to mean.

    Parameters
    ----------
    paths
        Files, folders or archives.
    suggest
        Write a mapping file to edit.
    force
        Overwrite the mapping file.
    """
    from tendonrepro.dataset.inspection import inspect_text, run_inspect

    found = run_inspect(paths, mapping if suggest else None, force=force)
    terminal.show(found, inspect_text(found))


@command(data_app, "tendonrepro ingest data/zenodo --mapping data/mapping.yaml")
def ingest(
    terminal: Terminal,
    paths: list[Path],
    *,
    mapping: Path = Path("data/mapping.yaml"),
    out: Path = Path("data/measured.h5"),
    confirm: bool = False,
    dry_run: bool = False,
    force: bool = False,
) -> None:
    """Convert measured data to the layout of simulated traces.

    Parameters
    ----------
    paths
        Files, folders or archives.
    out
        Trace file to write.
    confirm
        The mapping is right: delete every CHECK in it.
    dry_run
        Check everything, write nothing.
    """
    from tendonrepro.dataset.ingest import ingest_text, run_ingest

    found = run_ingest(paths, mapping, out, force=force, dry_run=dry_run, talk=terminal.talk, confirm=confirm)
    terminal.show(found, ingest_text(found))


@command(data_app, "tendonrepro validate data/measured.h5")
def validate(request: Request, terminal: Terminal, measured: Path = Path("data/measured.h5")) -> int:
    """Compare measured data with the paper and with the model.

    Parameters
    ----------
    measured
        Trace file written by ingest.
    """
    from tendonrepro.validation.command import run_validate

    return terminal.show(run_validate(measured, request, terminal.talk))
