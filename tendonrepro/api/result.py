"""What a command found."""

from __future__ import annotations

import html
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.errors import UsageError
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import replaced
from tendonrepro.results.study import Outcome
from tendonrepro.results.traces import TRACES, dataset_of, write_traces

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


class Result:
    """What a command found: numbers, tables, figures and, of an experiment, runs.

    Iterating gives the names of the runs, and ``result[name]`` one of them.

    Attributes
    ----------
    command : str
    data : dict
        The numbers that ``--json`` prints.
    manifest : dict
        What made it.
    """

    def __init__(
        self,
        command: str,
        outcome: Outcome,
        manifest: dict[str, Any],
        file: TraceFile | None = None,
        folder: Path | None = None,
    ) -> None:
        self.command = command
        self.data = dict(outcome.data)
        self.manifest = manifest
        self._outcome = outcome
        self._file = file
        self._folder = folder

    def __iter__(self) -> Iterator[str]:
        return iter(self._file.runs if self._file else ())

    def __len__(self) -> int:
        return len(self._file.runs) if self._file else 0

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, run: str) -> xr.Dataset:
        """Return a run with the dimensions time and joint; units stand in the attributes."""
        if self._file is None or run not in self._file.runs:
            raise KeyError(run)
        return dataset_of(self._file.runs[run])

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name, with all digits."""
        import pandas as pd

        if self._folder is not None:
            return {path.stem: pd.read_csv(path) for path in sorted(self._folder.rglob("*.csv"))}
        return {name: pd.DataFrame(list(table.rows)) for name, table in self._outcome.tables.items()}

    @property
    def figures(self) -> list[str]:
        """Names that `plot` takes."""
        if self._file is None:
            return list(self._outcome.figures)
        from tendonrepro.results.figures.catalogue import available

        return available(self._file)

    def plot(self, name: str | int) -> Figure:
        """Draw one of `figures`, by name or by its number in the paper.

        Raises
        ------
        TendonreproError
            When the runs do not hold what it shows.
        """
        if self._file is not None:
            from tendonrepro.results.figures.catalogue import draw

            return draw(name, self._file).figure
        if name not in self.figures:
            message = f"{self.command} draws no figure {name}"
            raise UsageError(message, hint=f"figures: {', '.join(self.figures) or 'none'}")
        return self._outcome.figures[str(name)]().figure

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write everything into a folder, and return it.

        Raises
        ------
        UsageError
            When the folder holds anything else, without `force`.
        """
        target = Path(folder)
        if self._folder is not None:
            if target.exists() and not force:
                raise UsageError("is there already", where=str(target), hint="force=True replaces it")
            shutil.copytree(self._folder, target, dirs_exist_ok=True)
            return target
        with replaced(target, self._digest, command=self.command, force=force) as result:
            self._outcome.save(result, self.command)
            if self._file is not None:
                from tendonrepro.results.figures.catalogue import available, begin_drawing

                write_traces(result.path / TRACES, self._file)
                folder, file = result.path / "figures", self._file
                list(begin_drawing((file, folder, name) for name in available(file)))
            result.manifest = self.manifest
        return target

    @property
    def _digest(self) -> str:
        return str(self.manifest["config"]["sha256"])

    def __repr__(self) -> str:
        runs = f", {len(self)} runs" if self._file else ""
        return f"<tendonrepro {self.command}{runs}, configuration {self._digest[:8]}>"

    def __str__(self) -> str:
        return self._outcome.text()

    def _repr_html_(self) -> str:
        tables = self.tables
        if self._folder is not None:
            return f"<pre>{html.escape(str(self))}</pre>"
        shown = [name for name, table in self._outcome.tables.items() if table.terminal != ()]
        return "".join(f"<h4>{name}</h4>{tables[name].to_html(index=False)}" for name in shown)
