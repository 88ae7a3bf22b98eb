"""From configurations to results on disk."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from tendonrepro.configuration.command import checked
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import ExperimentName, LoadedConfig, shipped_folder
from tendonrepro.configuration.request import FORMATS, Request
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.experiments.loops import all_loops, growing
from tendonrepro.experiments.run import PRECISE, Prepared, begin_all, outcome_of, prepared, trace_file
from tendonrepro.experiments.user_law import laws_of
from tendonrepro.files import refuse_file
from tendonrepro.parallel import Start, interrupts_blocked, workers
from tendonrepro.results.paper_tables import made_tables
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.store import MANIFEST, NewResult, make_manifest, read_manifest, replaced
from tendonrepro.results.study import figure_formats, planned
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces, write_traces
from tendonrepro.simulation.resolution import COMPILED_STEPPER

CLOSEST = "closest"
"""Name of the shipped configuration that was fitted to Tables 2 and 3."""


@dataclass(frozen=True)
class Order:
    """One of the paper's experiments as a user wants it; `laws` are ``FILE:NAME``."""

    experiment: ExperimentName
    request: Request = field(default_factory=Request)
    laws: Sequence[str] = ()
    solver: Literal["scipy", "compiled"] = "scipy"

    @property
    def name(self) -> str:
        """What its results are called."""
        return CLOSEST if self.request.config == CLOSEST else self.experiment

    @property
    def folder(self) -> Path:
        """Results folder."""
        return self.request.folder(self.experiment)


def run_experiments(orders: Sequence[Order], talk: Talk) -> dict[str, dict[str, Any]]:
    """Simulate experiments and write traces, figures, tables and manifest of each.

    Everything is checked before the first run. The orders share one stepper; all or none are a dry run.

    Returns
    -------
    dict
        What ``--json`` prints of each order, by its name, and ``text``.
    """
    asked = [_load(order, talk) for order in orders]
    if orders[0].request.dry_run:
        return {order.name: _plan(order, one, talk) for order, one in zip(orders, asked, strict=True)}
    with ExitStack() as stack:
        results = [
            stack.enter_context(
                replaced(
                    order.folder,
                    one.loaded.sha256,
                    command=order.experiment,
                    force=order.request.force,
                    talk=talk,
                )
            )
            for order, one in zip(orders, asked, strict=True)
        ]
        start = stack.enter_context(workers())
        simulated = begin_all(asked, talk, orders[0].solver, start)
        formats = orders[0].request.formats
        if formats:
            # Other processes simulate meanwhile. Interrupted, loading matplotlib makes Python crash.
            with interrupts_blocked():
                import tendonrepro.results.figures.catalogue  # noqa: F401 (loaded early)

        made = [
            (order, _recorded(order, one, traces, result, talk), result)
            for order, one, traces, result in zip(orders, asked, simulated, results, strict=True)
        ]
        drawn = _begin_drawing([(file, result.path) for _, file, result in made], formats, start)
        # This process writes the rest meanwhile.
        found = {order.name: _written(order, file, result) for order, file, result in made}
        list(drawn)
    return found


def _begin_drawing(
    files: Sequence[tuple[TraceFile, Path]], formats: Sequence[str], start: Start
) -> Iterable[list[Path]]:
    """Begin to draw all that traces allow into their folders; yield the paths of each figure."""
    if not formats:
        return ()
    from tendonrepro.results.figures.catalogue import available, begin_drawing

    figures = [(file, path / "figures", name) for file, path in files for name in available(file)]
    # Later figures first, for they have more panels.
    return begin_drawing(figures[::-1], formats, start)


def _recorded(
    order: Order, experiment: Prepared, traces: Sequence[Trace], result: NewResult, talk: Talk
) -> TraceFile:
    loaded = experiment.loaded
    for trace in traces:
        talk.detail(f"{trace.name}: {trace.status}, {count_of(len(trace.time), 'sample')}")
    result.manifest = make_manifest(loaded, result.seconds) | {"growing_hz": growing(experiment.loops)}
    result.manifest |= figure_formats(order.request.formats)
    if order.solver == "compiled":
        result.manifest["solver"] = {"name": COMPILED_STEPPER, "tolerance": PRECISE}
    return trace_file(loaded, traces, result.manifest)


def _written(order: Order, file: TraceFile, result: NewResult) -> dict[str, Any]:
    """Write traces and tables; return what is printed."""
    write_traces(result.path / TRACES, file)
    outcome = outcome_of(file)
    outcome.write_tables(result.path)
    text = f"{outcome.text()}\n\nFigures, tables and traces are in {order.folder}"
    return {**outcome.data, "text": text, "out": str(order.folder), "manifest": str(order.folder / MANIFEST)}


def diverged(found: dict[str, Any]) -> bool:
    """Whether a run diverged."""
    return "diverged" in found.get("status", {}).values()


def paper_orders(configs: Path | None, request: Request) -> list[Order]:
    """Orders for both experiments of the paper, and for the comparison fitted to its tables.

    `configs` is a folder with ``decouple.yaml`` and ``compare.yaml``. The fitted plant runs only as it is
    shipped. The request's folder is the one above theirs.
    """
    names: tuple[ExperimentName, ...] = ("decouple", "compare")
    above = request.out or Path("reports")
    files = {name: None if configs is None else str(configs / f"{name}.yaml") for name in names}
    orders = [Order(name, replace(request, config=files[name], out=above / name)) for name in names]
    if configs is None and not request.overrides and request.seed is None:
        orders.append(Order("compare", replace(request, config=CLOSEST, out=above / CLOSEST)))
    return orders


def summary_of(found: Mapping[str, Mapping[str, Any]]) -> str:
    """Mean errors as published, fitted and printed, where both comparisons were run."""
    if not {"compare", CLOSEST} <= found.keys() or "table2" not in found[CLOSEST]:
        return ""
    tables = {
        "as published, on our typical arm": found["compare"]["table2"],
        "fitted to the paper's tables": found[CLOSEST]["table2"],
        "paper": found[CLOSEST]["printed"]["table2"],
    }
    rows = [
        {"MAE of joint 2 / joint 3, degrees": name}
        | {run: " / ".join(f"{size:.3f}" for size in table[run]["mae_deg"]) for run in CONTROLLERS}
        for name, table in tables.items()
    ]
    return Table("summary", "The fit used the paper's tables, so its agreement proves nothing.", rows).text()


def _plan(order: Order, experiment: Prepared, talk: Talk) -> dict[str, Any]:
    loaded = experiment.loaded
    samples = {name: loop.reference.time.size for name, loop in experiment.loops.items()}
    plan = planned(order.experiment, loaded, order.folder, order.request, talk)
    return plan | {"experiment": order.experiment, "config": loaded.origin, "samples": samples}


def check(config: str, overrides: Sequence[str], talk: Talk) -> dict[str, Any]:
    """Kind, digest and runs of a configuration, checked as running it would."""
    held = checked(config, overrides)
    found = {"schema_version": 1, "config": config}
    if isinstance(held, LoadedEnsemble):
        return found | {"kind": "ensemble", "config_sha256": held.sha256}
    if not isinstance(held, LoadedConfig):
        return found | {"kind": "manipulator"}
    _remark(held, talk)
    runs = list(all_loops(held))
    return found | {"kind": held.config.experiment, "config_sha256": held.sha256, "runs": runs}


def _remark(loaded: LoadedConfig, talk: Talk) -> None:
    """Name the shipped file that completed a user's configuration, and keys that change nothing."""
    for sentence in loaded.unread:
        talk.note(sentence)
    for path in loaded.inputs:
        if path.parent == shipped_folder() != loaded.folder:
            talk.note(f"no {path.name} in {loaded.folder}, so the shipped one is taken: {path}")


def redraw(
    out: Path, figures: Sequence[str] | None, *, force: bool = False, formats: Sequence[str] = FORMATS
) -> list[Path]:
    """Draw figures from stored traces again, and return the files.

    Parameters
    ----------
    out : Path
        Results folder, or the one above several.
    figures : sequence of str, optional
        Names, or the paper's numbers; all if not given.
    force : bool
        Keep a user's own files, and make changed ones again.
    formats : sequence of str
        Those to write; files of others stay as they are.
    """
    from tendonrepro.results.figures.catalogue import available, begin_drawing, name_of

    files = _stored(out)
    every = {name for file in files.values() for name in available(file)}
    asked = [name_of(figure) for figure in figures] if figures else every
    for name in asked:
        if name not in every:
            message = f"no stored traces hold what {name} shows"
            hint = f"figures that can be drawn: {', '.join(sorted(every)) or 'none'}"
            raise DataMissingError(message, where=str(out), hint=hint)

    def make(file: TraceFile, path: Path) -> list[Path]:
        figures = [(file, path / "figures", name) for name in available(file) if name in asked]
        return [one for paths in begin_drawing(figures, formats, start) for one in paths]

    with workers(len(asked)) as start:
        return _make_again(files, make, force=force)


def rewrite_tables(out: Path, *, force: bool = False) -> list[Path]:
    """Make tables from stored traces again, as `redraw` does figures."""

    def make(file: TraceFile, path: Path) -> list[Path]:
        return [one for table in made_tables(file) for one in table.write(path / "tables")]

    return _make_again(_stored(out), make, force=force)


def _stored(out: Path) -> dict[Path, TraceFile]:
    """Traces in a folder, or in those directly below it."""
    refuse_file(out)
    paths = [*out.glob(TRACES)] or sorted(out.glob(f"[!.]*/{TRACES}"))
    if not paths:
        message = f"holds no {TRACES}, and no folder in it does"
        hint = "run tendonrepro reproduce, or name another --out"
        raise DataMissingError(message, where=str(out), hint=hint)
    return {path.parent: read_traces(path.parent) for path in paths}


def _make_again(
    files: Mapping[Path, TraceFile], make: Callable[[TraceFile, Path], list[Path]], *, force: bool
) -> list[Path]:
    """Make files of results again; measured traces lie in a folder without a manifest."""
    found: list[Path] = []
    for folder, file in files.items():
        if not (folder / MANIFEST).exists():
            found += make(file, folder)
            continue
        with replaced(
            folder, file.config_sha256, command=file.experiment, force=force, update=True
        ) as result:
            result.manifest = read_manifest(folder)
            made = make(file, result.path)
            suffixes = {path.suffix.removeprefix(".") for path in result.path.glob("figures/*")}
            result.manifest |= figure_formats([name for name in FORMATS if name in suffixes])
        found += [folder / path.relative_to(result.path) for path in made]
    return found


def _load(order: Order, talk: Talk) -> Prepared:
    """Configuration, laws and loops; the digest covers stepper and laws."""
    if order.solver == "compiled" and order.laws:
        message = "only the paper's own control laws run on lanes"
        raise UsageError(message, where="--law", hint="use the SciPy stepper, --solver scipy")
    loaded = order.request.load(order.experiment)
    _remark(loaded, talk)
    if order.solver == "compiled":
        digest = hashlib.sha256(f"{loaded.sha256} compiled".encode()).hexdigest()
        loaded = replace(loaded, sha256=digest, overrides=(*loaded.overrides, "solver=compiled"))
    return prepared(loaded, laws_of(order.laws))
