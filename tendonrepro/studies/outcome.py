"""What a study found: numbers, tables and figures, from which files and terminal follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.files import to_json
from tendonrepro.results.formats import FORMATS
from tendonrepro.results.store import NewResult
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


def figure_formats(formats: Sequence[str]) -> dict[str, list[str]]:
    """What a manifest says of figures: their formats, none where none were drawn."""
    return {"figure_formats": list(formats)}
