"""The commands around the paper's data set, and anyone's measured data."""

from pathlib import Path
from typing import Annotated, TypeAlias

from tendonrepro.files import Json
from tendonrepro.studies.command import DATA, Example, command
from tendonrepro.studies.study import ARGUMENT, MEASURED_FILE, TALK, Answer, Overwrite, Telling, Word

__all__ = ["fetch", "ingest", "inspect"]

Mapping: TypeAlias = Annotated[Path | str, Word(help="Mapping file: which column is which variable.")]
Measured: TypeAlias = Annotated[Path | str, Word(help="Files, folders or archives.")]
MAPPING = Path("data/mapping.yaml")


@command(DATA, Example(out="data/zenodo"))
def fetch(
    record: Annotated[str, ARGUMENT] = "19467931",
    out: Path | str = Path("data/zenodo"),
    *,
    base_url: str | None = None,
    dry_run: bool = False,
    force: bool = False,
    talk: Telling = TALK,
) -> Answer[Json]:
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

    Returns
    -------
    dict
        The record, and its files with their digests.
    """
    from tendonrepro.dataset.fetch import fetch_text, run_fetch

    lock = run_fetch(record, Path(out), base_url, force, dry_run, talk)
    return Answer(lock, fetch_text(lock), lock)


@command(DATA, Example("data/zenodo", suggest=True))
def inspect(
    *paths: Measured, suggest: bool = False, mapping: Path | str | None = None, force: bool = False
) -> Answer[Json]:
    """What is in files of any format, and what it seems to mean.

    Parameters
    ----------
    suggest
        Write a mapping file to edit.
    mapping
        Mapping file to write [default: where one is suggested data/mapping.yaml].
    force
        Overwrite the mapping file.

    Returns
    -------
    dict
        Files, their columns, and what these seem to mean.
    """
    from tendonrepro.dataset.ingestion import inspect_text, run_inspect

    written = Path(mapping or MAPPING) if suggest or mapping is not None else None
    contents = run_inspect([*map(Path, paths)], written, force=force)
    return Answer(contents, inspect_text(contents), contents)


@command(DATA, Example("data/zenodo", mapping="data/mapping.yaml"))
def ingest(
    *paths: Measured,
    mapping: Mapping = MAPPING,
    out: Path | str = MEASURED_FILE,
    confirm: bool = False,
    dry_run: bool = False,
    force: Overwrite = False,
    talk: Telling = TALK,
) -> Answer[Json]:
    """Convert measured data to the layout of simulated traces.

    Parameters
    ----------
    out
        Trace file to write.
    confirm
        The mapping is right: delete every CHECK in it.
    dry_run
        Check everything, write nothing.

    Returns
    -------
    dict
        Runs that were read.
    """
    from tendonrepro.dataset.ingestion import ingest_text, run_ingest

    files = [*map(Path, paths)]
    runs = run_ingest(
        files, Path(mapping), Path(out), force=force, dry_run=dry_run, talk=talk, confirm=confirm
    )
    return Answer(runs, ingest_text(runs), runs)
