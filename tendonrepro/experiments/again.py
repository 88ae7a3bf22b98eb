"""Figures and tables made again from stored traces, without simulation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tendonrepro.errors import DataMissingError
from tendonrepro.files import refuse_file
from tendonrepro.parallel import workers
from tendonrepro.results.figures import DRAWN, FORMATS
from tendonrepro.results.paper_tables import made_tables
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import MANIFEST, read_manifest, replaced
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.studies.result import figure_formats


def redraw(
    out: Path, figures: Sequence[str] = (), *, formats: Sequence[str] = DRAWN, force: bool = False
) -> list[Path]:
    """Draw figures and write tables from stored traces again, and return the files.

    Parameters
    ----------
    out : Path
        Results folder, or the one above several.
    figures : sequence of str
        Names, or the paper's numbers, of the only ones to make; all, and the tables, if none is given.
    formats : sequence of str
        Those to draw, or none; files of others stay as they are.
    force : bool
        Keep a user's own files, and make changed ones again.
    """
    from tendonrepro.results.figures.catalogue import drawings, name_of
    from tendonrepro.results.figures.style import save_drawn

    files = _stored(out)
    every = {name for file in files.values() for name in drawings(file)}
    asked = [name_of(figure) for figure in figures] if figures else every
    for name in asked:
        if name not in every:
            message = f"no stored traces hold what {name} shows"
            hint = f"figures that can be drawn: {', '.join(sorted(every)) or 'none'}"
            raise DataMissingError(message, where=str(out), hint=hint)

    def make(file: TraceFile, folder: Path) -> list[Path]:
        begun = [
            (draw, folder / "figures", formats) for name, draw in drawings(file).items() if name in asked
        ]
        drawn = [path for paths in start(save_drawn, begun if formats else []) for path in paths]
        tables = [] if figures else made_tables(file)
        return drawn + [path for table in tables for path in table.write(folder / "tables")]

    written: list[Path] = []
    with workers(len(asked)) as start:
        for folder, file in files.items():
            # Measured traces lie in a folder without a manifest.
            if not (folder / MANIFEST).exists():
                written += make(file, folder)
                continue
            sha256, command = file.config_sha256, file.experiment
            with replaced(folder, sha256, command=command, force=force, update=True) as result:
                result.manifest = read_manifest(folder)
                made = make(file, result.path)
                drawn = {*result.manifest.get("figure_formats", ()), *(path.suffix[1:] for path in made)}
                result.manifest |= figure_formats([name for name in FORMATS if name in drawn])
            written += [folder / path.relative_to(result.path) for path in made]
    return written


def _stored(out: Path) -> dict[Path, TraceFile]:
    """Traces in a folder, or in those directly below it."""
    refuse_file(out)
    paths = [*out.glob(TRACES)] or sorted(out.glob(f"[!.]*/{TRACES}"))
    if not paths:
        message = f"holds no {TRACES}, and no folder in it does"
        hint = "run tendonrepro reproduce, or name another --out"
        if (out / MANIFEST).exists():
            hint = "figures and tables of this result are made by its command alone: run that again"
        raise DataMissingError(message, where=str(out), hint=hint)
    return {path.parent: read_traces(path.parent) for path in paths}
