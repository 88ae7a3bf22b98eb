"""What a study found: numbers, tables, figures and runs; files, terminal, JSON and Python are views of it."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tendonrepro.console import count_of
from tendonrepro.errors import UsageError, did_you_mean, no_such
from tendonrepro.files import Json, to_json
from tendonrepro.parallel import Start
from tendonrepro.results.figures import FORMATS, formats_of
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.store import NewResult, read_manifest, replaced, table_files, take_over
from tendonrepro.results.tables import Table

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from tendonrepro.physics.linear_loop import SampledLoop
    from tendonrepro.results.figures.style import Drawing


class _Frames(dict[str, "pd.DataFrame"]):
    """Tables by name, which says what there is in place of a wrong one."""

    def __missing__(self, name: str) -> pd.DataFrame:
        raise no_such("table", name, self)


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What a command found: numbers, tables, figures and, of an experiment, runs.

    Iterating gives the names of the runs, and ``result[name]`` one of them.

    Attributes
    ----------
    data : mapping
        The numbers that ``--json`` prints.
    parts : sequence
        Stand in the terminal; tables are written, too.
    drawings : mapping
        How to draw each figure, by name; of traces the figures follow without being named.
    manifest : mapping
        What made it; of a study that gives it, what this one alone knows.
    traces : TraceFile, optional
        Runs of an experiment with what they were made with; None of other commands.
    files : mapping
        Texts of further files, by name.
    beside : mapping
        What ``--json`` says of this call alone; it is not stored.
    diverged : bool
        Whether a run diverged.
    fails_check : bool
        Whether a check that the user asked for fails.
    command : str
        Its name.
    linear : callable, optional
        Gives the loop of a run, by its name and a posture; None of other commands than an experiment.
    folder : Path, optional
        Where its tables and files lie, if they are read from there.
    """

    data: Mapping[str, Any]
    parts: Sequence[Table | str] = ()
    drawings: Mapping[str, Callable[[], Drawing]] = field(default_factory=dict)
    manifest: Json = field(default_factory=dict)
    traces: TraceFile | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, object] = field(default_factory=dict)
    diverged: bool = False
    fails_check: bool = False
    command: str = ""
    linear: Callable[[str, str], SampledLoop] | None = None
    folder: Path | None = None

    @property
    def _runs(self) -> Mapping[str, Trace]:
        return self.traces.runs if self.traces else {}

    def __iter__(self) -> Iterator[str]:
        return iter(self._runs)

    def __len__(self) -> int:
        return len(self._runs)

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, run: str) -> xr.Dataset:
        """Return a run with the dimensions time and joint; units stand in the attributes."""
        from tendonrepro.results.traces import dataset_of

        return dataset_of(self._run(run))

    def _run(self, run: str) -> Trace:
        if run not in self._runs:
            raise no_such("run", run, self._runs)
        return self._runs[run]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self)

    def loop(self, run: str, at: Literal["start", "middle", "far"] = "start") -> SampledLoop:
        """Closed sampled loop of a run, linear about rest at a posture of its motion.

        ``control.ss(*result.loop("controller_1"))`` gives it to python-control. Its poles are those of
        `explain`, which shows the worst of the three postures.

        Parameters
        ----------
        at
            Start of the motion, halfway to its farthest sample, or that.

        Returns
        -------
        SampledLoop
            ``A``, ``B``, ``C``, ``D`` and the period ``dt``, s.

        Raises
        ------
        UsageError
            For a run that there is not, or that is not of the package's controllers.
        """
        if self.linear is None:
            message = f"{self.command} has no runs, so no loops"
            raise UsageError(message, hint="compare gives them")
        self._run(run)
        return self.linear(run, at)

    @property
    def _tables(self) -> list[Table]:
        return [part for part in self.parts if isinstance(part, Table)]

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by name, with all digits."""
        import pandas as pd

        if self.folder is None:
            return _Frames({table.name: pd.DataFrame(list(table.rows)) for table in self._tables})
        paths = table_files(self.folder, self.manifest, ".csv")
        # From 3.1 on that is the default, and to ask for it a warning.
        older = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
        exact: dict[str, Any] = {"float_precision": "round_trip"} if older else {}
        # A table without a row has no columns either.
        frames = {
            path.stem: pd.read_csv(path, **exact) if path.read_text("utf-8").strip() else pd.DataFrame()
            for path in paths
        }
        return _Frames(frames)

    @property
    def _drawings(self) -> Mapping[str, Callable[[], Drawing]]:
        if self.traces is None:
            return self.drawings
        # Only who asks for pictures loads what draws.
        from tendonrepro.results.figures.catalogue import drawings

        return drawings(self.traces)

    @property
    def figures(self) -> list[str]:
        """Names that `plot` takes."""
        return list(self._drawings)

    def plot(self, name: str | int) -> Figure:
        """Draw one of `figures`, by name or by its number in the paper.

        Raises
        ------
        UsageError
            When there is none, or the runs do not hold what it shows.
        """
        drawings = self._drawings
        stem = f"fig{int(name):02d}" if str(name).isdecimal() else str(name)
        if stem not in drawings:
            message = f"this result of {self.command} has no figure {name}{did_you_mean(stem, drawings)}"
            hint = f"figures: {', '.join(drawings) or 'none'}"
            if self.folder is not None and not drawings:
                hint = f"stored pictures of {self.command} are in {self.folder}, and are not drawn again"
            raise UsageError(message, hint=hint)
        return drawings[stem]().figure

    def stamped(self, command: str, manifest: Json) -> Result:
        """Return it with its command and what made it, also in its traces."""
        traces = self.traces and replace(self.traces, manifest=manifest)
        return replace(self, command=command, manifest=manifest, traces=traces)

    def write(self, place: NewResult, numbers: str) -> None:
        """Write all but the figures: traces, or the numbers as ``<numbers>.json``."""
        for file, text in self.files.items():
            place.write(file, text)
        if self.traces is None:
            place.write(f"{numbers}.json", to_json(dict(self.data)))
        else:
            from tendonrepro.results.traces import TRACES, write_traces

            write_traces(place.path / TRACES, self.traces)
        for table in self._tables:
            table.write(place.path / table.folder)

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
            Of figures, ``png``, ``pdf`` or ``svg``; else PNG and PDF. A result that lies in a folder keeps
            those that it has.
        figures : bool
            Whether to draw or keep any.

        Raises
        ------
        UsageError
            When there is a file of that name, or, without `force`, a folder that holds anything else; for a
            format that there is not, or of a result whose figures are drawn.
        """
        kinds = formats_of(formats, figures=figures)
        if self.folder is not None and formats is not None:
            message = f"figures of a stored {self.command} are not drawn again"
            raise UsageError(
                message, where="formats", hint=f"leave it out, or say formats= to {self.command}"
            )
        target = Path(folder)
        with replaced(target, self.manifest["config"]["sha256"], command=self.command, force=force) as place:
            if self.folder is None:
                self.write(place, self.command)
                for _ in begin_drawing([(self, place.path)], kinds):
                    pass
            else:
                kinds = tuple(self.manifest.get("figure_formats", FORMATS)) if figures else ()
                names = read_manifest(self.folder)["outputs"]
                take_over(
                    self.folder, place.path, (n for n in names if figures or not n.startswith("figures/"))
                )
            place.manifest = self.manifest | {"figure_formats": list(kinds)}
        return target

    def __repr__(self) -> str:
        runs = f", {count_of(len(self), 'run')}" if self.traces else ""
        return f"<tendonrepro {self.command}{runs}, configuration {self.manifest['config']['sha256'][:8]}>"

    def __str__(self) -> str:
        """What the terminal shows."""
        shown = [part for part in self.parts if isinstance(part, str) or part.terminal != ()]
        return "\n\n".join(part if isinstance(part, str) else part.text() for part in shown)

    def _repr_html_(self) -> str:
        if self.folder is not None:
            return f"<pre>{html.escape(str(self))}</pre>"
        import pandas as pd

        shown = [table.printed or table for table in self._tables if table.terminal != ()]
        frames = [(table.name, pd.DataFrame(list(table.rows))) for table in shown]
        return "".join(f"<h4>{name}</h4>{frame.to_html(index=False)}" for name, frame in frames)


def begin_drawing(
    results: Sequence[tuple[Result, Path]], formats: Sequence[str], start: Start = map
) -> Iterable[list[Path]]:
    """Begin to draw the figures of results into their folders; who runs through them waits.

    Figures of traces are drawn by what `start` starts, those of another study in this process.
    """
    if not formats:
        return ()
    figures = [
        (draw, folder / "figures", formats)
        for result, folder in results
        for draw in result._drawings.values()
    ]
    if not figures:
        return ()
    from tendonrepro.results.figures.style import save_drawn

    if any(result.traces is None for result, _ in results):
        return map(save_drawn, figures)
    # Later ones first, for they have more panels.
    return start(save_drawn, figures[::-1])
