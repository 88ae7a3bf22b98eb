"""A study: from a configuration to numbers, and from these to files and terminal."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.request import FORMATS, Request
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.files import to_json
from tendonrepro.results.store import MANIFEST, NewResult, make_manifest, refuse_others, replaced
from tendonrepro.results.tables import Table

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing


@dataclass(frozen=True)
class Outcome:
    """What a study found.

    `data` are numbers by the keys of ``--json``; `parts` stand in the terminal, tables are written, too;
    `manifest` is what only this study's manifest says.
    """

    data: Mapping[str, Any]
    parts: Sequence[Table | str] = ()
    figures: Mapping[str, Callable[[], Drawing]] = field(default_factory=dict)
    manifest: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tables(self) -> dict[str, Table]:
        """The tables by name."""
        return {part.name: part for part in self.parts if isinstance(part, Table)}

    def text(self) -> str:
        """What the terminal shows."""
        shown = [part for part in self.parts if isinstance(part, str) or part.terminal != ()]
        return "\n\n".join(part if isinstance(part, str) else part.text() for part in shown)

    def write_tables(self, folder: Path) -> None:
        """Write the tables into a results folder."""
        for table in self.tables.values():
            table.write(folder / "tables")

    def save(self, result: NewResult, name: str, formats: Sequence[str] = FORMATS) -> None:
        """Write numbers as ``<name>.json``, tables, and figures in these formats into a result."""
        result.write(f"{name}.json", to_json(dict(self.data)))
        self.write_tables(result.path)
        if self.figures and formats:
            from tendonrepro.results.figures.style import save_drawing

            for draw in self.figures.values():
                save_drawing(draw(), result.path / "figures", formats)


def run_study(
    name: str,
    loaded: LoadedConfig,
    request: Request,
    study: Callable[[Path], Outcome],
    talk: Talk,
    keep: str = "",
) -> dict[str, Any]:
    """Carry out a study, put its results into their folder, and return what ``--json`` prints.

    Parameters
    ----------
    name : str
        Of the command.
    study : callable
        Finds the numbers, given the folder in which the result is made; not called in a dry run.
    keep : str
        Folder in the unfinished result for what an interruption must not lose.
    """
    folder = request.folder(name)
    for sentence in loaded.unread:
        talk.note(sentence)
    if request.dry_run:
        return planned(name, loaded, folder, request, talk)
    with replaced(folder, loaded.sha256, command=name, force=request.force, keep=keep, talk=talk) as result:
        outcome = study(result.path)
        outcome.save(result, name, request.formats)
        if keep:
            shutil.rmtree(result.path / keep)
        made = make_manifest(loaded, result.seconds, name) | figure_formats(request.formats)
        result.manifest = made | dict(outcome.manifest)
    text = f"{outcome.text()}\n\nResults are in {folder}"
    return {**outcome.data, "text": text, "out": str(folder), "manifest": str(folder / MANIFEST)}


def figure_formats(formats: Sequence[str]) -> dict[str, list[str]]:
    """What a manifest says of figures: their formats, none where none were drawn."""
    return {"figure_formats": list(formats)}


def planned(name: str, loaded: LoadedConfig, folder: Path, request: Request, talk: Talk) -> dict[str, Any]:
    """What ``--json`` prints of a dry run."""
    foretell(folder, loaded.sha256, name, request, talk)
    text = f"{loaded.origin} is valid (sha256 {loaded.sha256[:12]})\nwould write to {folder}"
    plan = {"dry_run": True, "config_sha256": loaded.sha256, "out": str(folder), "text": text}
    return {"schema_version": 1, "command": name, **plan}


def foretell(folder: Path, digest: str, command: str, request: Request, talk: Talk) -> None:
    """Say what would be refused; a dry run goes on."""
    try:
        refuse_others(folder, digest, command=command, force=request.force)
    except TendonreproError as error:
        talk.note(f"a run would be refused: {error}")
