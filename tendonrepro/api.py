"""The commands as functions, for scripts and notebooks; see docs/python.md."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.configuration.load import ExperimentName, LoadedConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.records import TraceFile
from tendonrepro.results.store import TRACES, replaced, stored_traces
from tendonrepro.results.study import Outcome

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Changes = Mapping[str, Any]
"""New values by dotted key, such as ``{"control.gains.lam": 6}``."""


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
        self, command: str, outcome: Outcome, manifest: dict[str, Any], file: TraceFile | None = None
    ) -> None:
        self.command = command
        self.data = dict(outcome.data)
        self.manifest = manifest
        self._outcome = outcome
        self._file = file

    def __iter__(self) -> Iterator[str]:
        return iter(self._file.runs if self._file else ())

    def __len__(self) -> int:
        return len(self._file.runs) if self._file else 0

    def __bool__(self) -> bool:
        return True

    def __getitem__(self, run: str) -> xr.Dataset:
        """Return a run with the dimensions time and joint; units stand in the attributes.

        Raises
        ------
        KeyError
            When there is no such run.
        """
        from tendonrepro.results.traces import dataset_of

        if self._file is None or run not in self._file.runs:
            raise KeyError(run)
        return dataset_of(self._file.runs[run])

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Every table by name, with all digits."""
        import pandas as pd

        return {name: pd.DataFrame(list(table.rows)) for name, table in self._outcome.tables.items()}

    @property
    def figures(self) -> list[str]:
        """Names that `plot` takes."""
        if self._file is None:
            return list(self._outcome.figures)
        from tendonrepro.results.figures.catalogue import available

        return available(self._file)

    def plot(self, name: str | int) -> Figure:
        """Draw one of `figures`, by its name or its number in the paper.

        Raises
        ------
        TendonreproError
            When there is no such figure, or the runs do not hold what it shows.
        """
        if self._file is not None:
            from tendonrepro.results.figures.catalogue import draw

            return draw(name, self._file).figure
        if name not in self.figures:
            message = f"{self.command} draws no figure {name}"
            raise UsageError(message, hint=f"figures: {', '.join(self.figures) or 'none'}")
        return self._outcome.figures[str(name)]().figure

    def save(self, folder: str | Path, *, force: bool = False) -> Path:
        """Write everything into a folder, as the command line does, and return it.

        Raises
        ------
        UsageError
            When the folder holds anything else and `force` is not given.
        """
        target = Path(folder)
        with replaced(target, self._digest, command=self.command, force=force) as result:
            self._outcome.save(result, self.command)
            if self._file is not None:
                from tendonrepro.results.figures.catalogue import available, redrawn
                from tendonrepro.results.traces import write_traces

                write_traces(result.path / TRACES, self._file)
                for name in available(self._file):
                    redrawn(self._file, result.path / "figures", name)
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
        shown = [name for name, table in self._outcome.tables.items() if table.terminal != ()]
        return "".join(f"<h4>{name}</h4>{tables[name].to_html(index=False)}" for name in shown)


def _overrides(changes: Changes | None) -> list[str]:
    def plain(value: Any) -> Any:
        return value.tolist() if hasattr(value, "tolist") else value

    return [f"{key}={json.dumps(plain(value))}" for key, value in (changes or {}).items()]


def compare(
    config: str | Path | None = None,
    *,
    set: Changes | None = None,
    seed: int | None = None,
    controllers: Sequence[int] | None = None,
) -> Result:
    """Run Controllers 1 to 3 and the payload run: Figures 13 to 16, Tables 2 and 3.

    Parameters
    ----------
    config : str or Path, optional
        A file, or the name of a shipped configuration.
    set : mapping, optional
        New values by dotted key.
    seed : int, optional
    controllers : sequence of int, optional
        Numbers of the controllers to run; all if not given.

    Raises
    ------
    TendonreproError
        As on the command line.
    """
    loaded = _loaded("compare", config, set, seed, controllers)
    return _experiment(loaded)


def decouple(
    config: str | Path | None = None, *, set: Changes | None = None, seed: int | None = None
) -> Result:
    """Run the decoupling experiment: Figures 6 and 9 to 12, Table 1. Parameters are those of `compare`."""
    return _experiment(_loaded("decouple", config, set, seed))


def statics(
    config: str | Path | None = None, *, set: Changes | None = None, seed: int | None = None
) -> Result:
    """Survey the tension of every tendon over the working half-plane. Parameters are those of `compare`."""
    from tendonrepro.experiments.statics.command import study_statics

    loaded, started = _loaded("decouple", config, set, seed), time.perf_counter()
    return _studied("statics", loaded, study_statics(loaded), started)


def open(folder: str | Path) -> Result:
    """Read the stored result of `compare` or `decouple`, or a trace file of them.

    Raises
    ------
    DataMissingError
        When there is none, or it is damaged.
    """
    from tendonrepro.experiments.report import outcome_of

    file = stored_traces(Path(folder))
    manifest = json.loads(file.manifest_json)
    if not isinstance(manifest.get("config"), dict):
        raise DataMissingError("was measured, and no command made it", where=str(folder))
    growing = manifest.get("growing_hz", {})
    return Result(file.experiment, outcome_of(file, growing), manifest, file)


def _loaded(
    experiment: ExperimentName,
    source: str | Path | None,
    changes: Changes | None,
    seed: int | None,
    controllers: Sequence[int] | None = None,
) -> LoadedConfig:
    return load_config(source, experiment, overrides=_overrides(changes), seed=seed, controllers=controllers)


def _experiment(loaded: LoadedConfig) -> Result:
    """Simulate every run in this process: it needs no main guard, and a notebook has none."""
    from tendonrepro.experiments.linear import growing
    from tendonrepro.experiments.loops import all_loops
    from tendonrepro.experiments.report import outcome_of
    from tendonrepro.experiments.run import simulate_run, trace_file

    started = time.perf_counter()
    with Talk().bar("simulating", len(names := list(all_loops(loaded, None)))) as progress:
        traces = []
        for name in names:
            traces.append(simulate_run(loaded, None, name))
            progress(1)
    growing_hz = growing(loaded)
    manifest = make_manifest(loaded, time.perf_counter() - started) | {"growing_hz": growing_hz}
    file = trace_file(loaded, traces, manifest)
    return Result(loaded.config.experiment, outcome_of(file, growing_hz), manifest, file)


def _studied(command: str, loaded: LoadedConfig, outcome: Outcome, started: float) -> Result:
    manifest = make_manifest(loaded, time.perf_counter() - started, command) | dict(outcome.manifest)
    return Result(command, outcome, manifest)
