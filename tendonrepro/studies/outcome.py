"""What a study found: numbers, tables and figures, from which files and terminal follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.files import Json, to_json
from tendonrepro.parallel import Start
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import NewResult
from tendonrepro.results.tables import Table

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing


@dataclass(frozen=True)
class Outcome:
    """What a study found.

    Attributes
    ----------
    data : mapping
        Numbers by the keys of ``--json``.
    parts : sequence
        Stand in the terminal; tables are written, too.
    figures : mapping
        How to draw each, by name; of traces the figures follow without being named.
    manifest : mapping
        What only this study's manifest says.
    traces : TraceFile, optional
        Runs of an experiment.
    files : mapping
        Texts of further files, by name.
    beside : mapping
        What ``--json`` says of this call alone; it is not stored.
    diverged : bool
        Whether a run diverged.
    fails_check : bool
        Whether a check that the user asked for fails.
    """

    data: Mapping[str, object]
    parts: Sequence[Table | str] = ()
    figures: Mapping[str, Callable[[], Drawing]] = field(default_factory=dict)
    manifest: Json = field(default_factory=dict)
    traces: TraceFile | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, object] = field(default_factory=dict)
    diverged: bool = False
    fails_check: bool = False

    @property
    def tables(self) -> dict[str, Table]:
        """The tables by name."""
        return {part.name: part for part in self.parts if isinstance(part, Table)}

    def text(self) -> str:
        """What the terminal shows."""
        shown = [part for part in self.parts if isinstance(part, str) or part.terminal != ()]
        return "\n\n".join(part if isinstance(part, str) else part.text() for part in shown)

    @property
    def drawings(self) -> Mapping[str, Callable[[], Drawing]]:
        """How each figure is drawn; of traces all that they allow."""
        if self.traces is None:
            return self.figures
        from tendonrepro.results.figures.catalogue import available, draw

        return {name: partial(draw, name, self.traces) for name in available(self.traces)}

    def stamped(self, manifest: Json) -> Outcome:
        """Return it with what made it also in its traces."""
        return self if self.traces is None else replace(self, traces=replace(self.traces, manifest=manifest))

    def write(self, result: NewResult, name: str | None) -> None:
        """Write all but the figures into a result: numbers as ``<name>.json``, if there is a name."""
        if name is not None:
            result.write(f"{name}.json", to_json(dict(self.data)))
        for file, text in self.files.items():
            result.write(file, text)
        if self.traces is not None:
            from tendonrepro.results.traces import TRACES, write_traces

            write_traces(result.path / TRACES, self.traces)
        for table in self.tables.values():
            table.write(result.path / table.folder)


def begin_drawing(
    outcomes: Sequence[tuple[Outcome, Path]], formats: Sequence[str], start: Start = map
) -> Iterator[None]:
    """Begin to draw the figures of outcomes into results folders; who runs through the iterator waits.

    Figures of traces are drawn by what `start` starts, the others in this process.
    """
    if not formats or not any(outcome.traces or outcome.figures for outcome, _ in outcomes):
        return iter(())
    from tendonrepro.results.figures import catalogue, style

    of_traces = [
        (outcome.traces, folder / "figures", name)
        for outcome, folder in outcomes
        if outcome.traces
        for name in catalogue.available(outcome.traces)
    ]
    # Later figures first, for they have more panels.
    begun = catalogue.begin_drawing(of_traces[::-1], formats, start)

    def drawn() -> Iterator[None]:
        for outcome, folder in outcomes:
            for draw in outcome.figures.values():
                style.save_drawing(draw(), folder / "figures", formats)
                yield
        for _ in begun:
            yield

    return drawn()


def figure_formats(formats: Sequence[str]) -> dict[str, list[str]]:
    """What a manifest says of figures: their formats, none where none were drawn."""
    return {"figure_formats": list(formats)}
