"""What a command found."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from tendonrepro.console import count_of
from tendonrepro.errors import UsageError
from tendonrepro.files import Json
from tendonrepro.results.formats import FORMATS, formats_of
from tendonrepro.results.on_disk import table_files
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.store import NewResult, read_manifest, replaced, take_over
from tendonrepro.results.traces import dataset_of
from tendonrepro.studies.outcome import Outcome, begin_drawing, figure_formats

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(eq=False, repr=False)
class Result:
    """What a command found: numbers, tables, figures and, of an experiment, runs.

    Iterating gives the names of the runs, and ``result[name]`` one of them.

    Attributes
    ----------
    command : str
    manifest : dict
        What made it.
    """

    command: str
    _outcome: Outcome
    manifest: Json
    _folder: Path | None = None

    @property
    def traces(self) -> TraceFile | None:
        """Runs of an experiment with what they were made with; None of other commands."""
        return self._outcome.traces

    @property
    def _runs(self) -> Mapping[str, Trace]:
        return self.traces.runs if self.traces else {}

    @cached_property
    def data(self) -> Json:
        """The numbers that ``--json`` prints."""
        return dict(self._outcome.data)

    def __iter__(self) -> Iterator[str]:
        return iter(self._runs)

    def __len__(self) -> int:
        return len(self._runs)

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, run: str) -> xr.Dataset:
        """Return a run with the dimensions time and joint; units stand in the attributes."""
        return dataset_of(self._runs[run])

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name, with all digits."""
        import pandas as pd

        if self._folder is not None:
            paths = table_files(self._folder, self.manifest, ".csv")
            # From 3.1 on that is the default, and to ask for it a warning.
            older = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
            exact: dict[str, Any] = {"float_precision": "round_trip"} if older else {}
            # A table without a row has no columns either.
            return {
                path.stem: pd.read_csv(path, **exact) if path.read_text("utf-8").strip() else pd.DataFrame()
                for path in paths
            }
        return {name: pd.DataFrame(list(table.rows)) for name, table in self._outcome.tables.items()}

    @property
    def figures(self) -> list[str]:
        """Names that `plot` takes."""
        return list(self._outcome.drawings)

    def plot(self, name: str | int) -> Figure:
        """Draw one of `figures`, by name or by its number in the paper.

        Raises
        ------
        UsageError
            When there is none, or the runs do not hold what it shows.
        """
        drawings = self._outcome.drawings
        stem = f"fig{int(name):02d}" if str(name).isdecimal() else str(name)
        if stem not in drawings:
            message = f"this result of {self.command} has no figure {name}"
            hint = f"figures: {', '.join(drawings) or 'none'}"
            if self._folder is not None and not drawings:
                hint = f"stored pictures of {self.command} are in {self._folder}, and are not drawn again"
            raise UsageError(message, hint=hint)
        return drawings[stem]().figure

    def save(
        self,
        folder: str | Path,
        *,
        formats: str | Sequence[str] | None = None,
        figures: bool = True,
        force: bool = False,
    ) -> Path:
        """Write everything into a folder, and return it.

        Parameters
        ----------
        formats : str or sequence of str, optional
            Of figures, ``png``, ``pdf`` or ``svg``; else PNG and PDF. Of a command that wrote its own folder
            those that it drew.
        figures : bool
            Whether to draw any.

        Raises
        ------
        UsageError
            When there is a file of that name, or, without `force`, a folder that holds anything else; for a
            format that is not there.
        """
        kinds = formats_of(formats, figures=figures)
        if self._folder is not None and kinds:
            kinds = self._drawn(kinds if formats is not None else ())
        target = Path(folder)
        with replaced(target, self.manifest["config"]["sha256"], command=self.command, force=force) as result:
            self._write(result, kinds)
            result.manifest = self.manifest | figure_formats(kinds)
        return target

    def _drawn(self, asked: Sequence[str]) -> tuple[str, ...]:
        """Formats that lie in the result's folder: those that are asked for, else all."""
        drawn = self.manifest.get("figure_formats", FORMATS)
        for name in asked:
            if name not in drawn:
                message = f"{self.command} drew its figures as {', '.join(drawn) or 'no files'}, not {name}"
                raise UsageError(message, where="formats", hint=f"say formats= to {self.command}")
        return tuple(asked or drawn)

    def _write(self, result: NewResult, formats: Sequence[str]) -> None:
        if self._folder is not None:
            # A caption belongs to its figure, in whatever format that is.
            figures = {*formats, "txt"} if formats else set()
            names = map(PurePosixPath, read_manifest(self._folder)["outputs"])
            kept = (n for n in names if n.parts[0] != "figures" or n.suffix.removeprefix(".") in figures)
            take_over(self._folder, result.path, map(str, kept))
            return
        self._outcome.write(result, self.command)
        for _ in begin_drawing([(self._outcome, result.path)], formats):
            pass

    def __repr__(self) -> str:
        runs = f", {count_of(len(self), 'run')}" if self._outcome.traces else ""
        return f"<tendonrepro {self.command}{runs}, configuration {self.manifest['config']['sha256'][:8]}>"

    def __str__(self) -> str:
        return self._outcome.text()

    def _repr_html_(self) -> str:
        if self._folder is not None:
            return f"<pre>{html.escape(str(self))}</pre>"
        tables = self.tables
        shown = [name for name, table in self._outcome.tables.items() if table.terminal != ()]
        return "".join(f"<h4>{name}</h4>{tables[name].to_html(index=False)}" for name in shown)
