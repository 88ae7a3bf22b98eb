"""Commands around the paper's data set: fetch, inspect, ingest, validate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from tendonrepro.cli.options import Terminal, command
from tendonrepro.configuration.request import Request

data_app = typer.Typer(rich_help_panel="Your data, or the paper's", rich_markup_mode=None)

Paths = Annotated[list[Path], Argument(help="Files, folders or archives.")]
Mapping = Annotated[Path, Option("--mapping", help="Mapping file: which column is which variable.")]


@command(data_app, "tendonrepro fetch --out data/zenodo")
def fetch(
    terminal: Terminal,
    record: Annotated[str, Argument(help="Number, DOI or address of the record.")] = "19467931",
    out: Annotated[Path, Option("--out", help="Folder for the files.")] = Path("data/zenodo"),
    base_url: Annotated[
        str | None,
        Option("--base-url", help="Another server [default: $TENDONREPRO_ZENODO_URL, else Zenodo]."),
    ] = None,
    from_dir: Annotated[
        Path | None, Option("--from-dir", help="Take files downloaded by hand from this folder.")
    ] = None,
    dry_run: Annotated[bool, Option("--dry-run", help="List the record, download nothing.")] = False,
    force: Annotated[bool, Option("--force", help="Replace altered files, or another record's.")] = False,
) -> None:
    """Download the paper's data set and verify it.

    A second run needs no network.
    """
    from tendonrepro.dataset.fetch import fetch_text, run_fetch

    found = run_fetch(record, out, base_url, from_dir, force, dry_run, terminal.talk)
    terminal.show(found, fetch_text)


@command(data_app, "tendonrepro inspect data/zenodo --suggest")
def inspect(
    terminal: Terminal,
    paths: Paths,
    suggest: Annotated[bool, Option("--suggest", help="Write a mapping file to edit.")] = False,
    mapping: Mapping = Path("data/mapping.yaml"),
    force: Annotated[bool, Option("--force", help="Overwrite the mapping file.")] = False,
) -> None:
    """What is in files of any format, and what it seems to mean."""
    from tendonrepro.dataset.inspection import inspect_text, run_inspect

    found = run_inspect(paths, mapping if suggest else None, force=force, talk=terminal.talk)
    terminal.show(found, inspect_text)


@command(data_app, "tendonrepro ingest data/zenodo --mapping data/mapping.yaml")
def ingest(
    terminal: Terminal,
    paths: Paths,
    mapping: Mapping = Path("data/mapping.yaml"),
    out: Annotated[Path, Option("--out", help="Trace file to write.")] = Path("data/measured.h5"),
    confirm: Annotated[
        bool, Option("--confirm", help="The mapping is right: delete every CHECK in it.")
    ] = False,
    dry_run: Annotated[bool, Option("--dry-run", help="Check everything, write nothing.")] = False,
    force: Annotated[
        bool, Option("--force", help="Overwrite a file of another mapping or other data.")
    ] = False,
) -> None:
    """Convert measured data to the layout of simulated traces."""
    from tendonrepro.dataset.ingest import ingest_text, run_ingest

    found = run_ingest(paths, mapping, out, force=force, dry_run=dry_run, talk=terminal.talk, confirm=confirm)
    terminal.show(found, ingest_text)


@command(data_app, "tendonrepro validate data/measured.h5")
def validate(
    request: Request,
    terminal: Terminal,
    measured: Annotated[Path, Argument(help="Trace file that ingest has written.")] = Path(
        "data/measured.h5"
    ),
) -> int:
    """Compare measured data with the print and with the model."""
    from tendonrepro.validation.command import model_diverged, run_validate

    found = run_validate(measured, request, terminal.talk)
    terminal.show(found, found.pop("text"))
    return 5 if model_diverged(found) else 0
