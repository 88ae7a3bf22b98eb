"""Commands around the paper's data set: fetch, inspect, ingest, validate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tendonrepro.cli.options import Config, DryRun, Force, Json, Quiet, Seed, Set, Verbose, show

data_app = typer.Typer(rich_markup_mode=None)

Paths = Annotated[list[Path], typer.Argument(help="Files, folders or archives.")]
Mapping = Annotated[Path, typer.Option("--mapping", help="Mapping file: which column is which variable.")]


@data_app.command(epilog="Example: tendonrepro fetch --out data/zenodo")
def fetch(
    record: Annotated[str, typer.Argument(help="Number, DOI or address of the record.")] = "19467931",
    out: Annotated[Path, typer.Option("--out", help="Folder for the files.")] = Path("data/zenodo"),
    base_url: Annotated[
        str | None,
        typer.Option("--base-url", help="Another server [default: $TENDONREPRO_ZENODO_URL, else Zenodo]."),
    ] = None,
    from_dir: Annotated[
        Path | None, typer.Option("--from-dir", help="Take files downloaded by hand from this folder.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List the record, download nothing.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Replace altered files, or another record's.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Download the paper's data set and verify it; a second run needs no network."""
    from tendonrepro.console import Talk
    from tendonrepro.dataset.repository.fetch import fetch_text, run_fetch

    talk = Talk(quiet=quiet, verbose=verbose)
    found = run_fetch(record, out, base_url, from_dir, force, dry_run, talk)
    show(found if as_json else fetch_text(found), as_json=as_json, quiet=quiet)


@data_app.command(epilog="Example: tendonrepro inspect data/zenodo --suggest")
def inspect(
    paths: Paths,
    suggest: Annotated[bool, typer.Option("--suggest", help="Write a mapping file to edit.")] = False,
    mapping: Mapping = Path("data/mapping.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite the mapping file.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """What is in files, whatever their format, and what it seems to mean."""
    from tendonrepro.console import Talk
    from tendonrepro.dataset.inspection import inspect_text, run_inspect

    talk = Talk(quiet=quiet, verbose=verbose)
    found = run_inspect(paths, mapping if suggest else None, force=force, talk=talk)
    show(found if as_json else inspect_text(found), as_json=as_json, quiet=quiet)


@data_app.command(epilog="Example: tendonrepro ingest data/zenodo --mapping data/mapping.yaml")
def ingest(
    paths: Paths,
    mapping: Mapping = Path("data/mapping.yaml"),
    out: Annotated[Path, typer.Option("--out", help="Trace file to write.")] = Path("data/measured.h5"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check everything, write nothing.")] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Overwrite a file of another mapping or other data.")
    ] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Convert measured data to the layout of simulated traces."""
    from tendonrepro.console import Talk
    from tendonrepro.dataset.ingest import ingest_text, run_ingest

    talk = Talk(quiet=quiet, verbose=verbose)
    found = run_ingest(paths, mapping, out, force=force, dry_run=dry_run, talk=talk)
    show(found if as_json else ingest_text(found), as_json=as_json, quiet=quiet)


@data_app.command(epilog="Example: tendonrepro validate data/measured.h5")
def validate(
    measured: Annotated[Path, typer.Argument(help="Trace file that ingest has written.")] = Path(
        "data/measured.h5"
    ),
    config: Config = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Results folder [default: reports/validate].")
    ] = None,
    overrides: Set = None,
    seed: Seed = None,
    dry_run: DryRun = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compare measured data with what the paper prints and with the model."""
    from tendonrepro.console import Talk
    from tendonrepro.validation.command import model_diverged, run_validate
    from tendonrepro.validation.report import validate_text

    talk = Talk(quiet=quiet, verbose=verbose)
    found = run_validate(measured, config, out, overrides or (), seed, force, dry_run, talk)
    show(found if as_json else validate_text(found), as_json=as_json, quiet=quiet)
    return 5 if model_diverged(found) else 0
