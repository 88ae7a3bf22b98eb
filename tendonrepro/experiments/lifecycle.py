"""How the paper's experiments run: several at once, by shared workers, from orders to results on disk."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from tendonrepro.console import Talk, count_of
from tendonrepro.experiments.loops import growing
from tendonrepro.experiments.orders import CLOSEST, Order
from tendonrepro.experiments.run import PRECISE, Prepared, begin_all, outcome_of, trace_file
from tendonrepro.parallel import Start, interrupts_blocked, workers
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.store import MANIFEST, NewResult, make_manifest, replaced
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, write_traces
from tendonrepro.simulation.resolution import COMPILED_STEPPER
from tendonrepro.studies.lifecycle import DIVERGED, planned
from tendonrepro.studies.outcome import figure_formats
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Answer


class Made(NamedTuple):
    """What an order left: ``--json`` of it, and its result for Python."""

    data: dict[str, Any]
    result: Result

    @property
    def diverged(self) -> bool:
        """Whether a run diverged."""
        return "diverged" in self.data["status"].values()


def carry_out(name: str, order: Order, talk: Talk, *, dry_run: bool = False) -> Answer[Result | None]:
    """Run one experiment, and put its results into their folder."""
    del name
    if dry_run:
        plan = plan_of(order, order.prepared(talk), talk)
        return Answer(plan, plan["text"], None)
    made = run_experiments([order], talk)[order.name]
    return Answer(made.data, made.data["text"], made.result, DIVERGED if made.diverged else 0)


def result_of(name: str, order: Order) -> Result:
    """Simulate in this process, which needs no main guard, unless a folder is named; a notebook has none."""
    if order.options["out"] is not None:
        return run_experiments([order], Talk())[order.name].result
    started = time.perf_counter()
    experiment = order.prepared(Talk(quiet=True))
    (traces,) = begin_all([experiment], Talk(), order.solver)
    manifest = _manifest(order, experiment, time.perf_counter() - started)
    file = trace_file(experiment.loaded, traces, manifest)
    return Result(name, outcome_of(file), manifest, file)


def run_experiments(orders: Sequence[Order], talk: Talk) -> dict[str, Made]:
    """Simulate experiments and write traces, figures, tables and manifest of each; what is made by name.

    Everything is checked before the first run. The orders share one stepper.
    """
    experiments = [order.prepared(talk) for order in orders]
    with ExitStack() as stack:
        results = [
            stack.enter_context(
                replaced(
                    order.out,
                    experiment.loaded.sha256,
                    command=order.experiment,
                    force=order.options["force"],
                    talk=talk,
                )
            )
            for order, experiment in zip(orders, experiments, strict=True)
        ]
        start = stack.enter_context(workers())
        simulated = begin_all(experiments, talk, orders[0].solver, start)
        formats = orders[0].formats
        if formats:
            # Other processes simulate meanwhile. Interrupted, loading matplotlib makes Python crash.
            with interrupts_blocked():
                import tendonrepro.results.figures.catalogue  # noqa: F401 (loaded early)

        recorded = [
            (order, _recorded(order, experiment, traces, result, talk), result)
            for order, experiment, traces, result in zip(orders, experiments, simulated, results, strict=True)
        ]
        drawn = _begin_drawing([(file, result.path) for _, file, result in recorded], formats, start)
        # This process writes the rest meanwhile.
        made = {order.name: _written(order, file, result) for order, file, result in recorded}
        list(drawn)
    return made


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


def _manifest(order: Order, experiment: Prepared, seconds: float) -> dict[str, Any]:
    manifest = make_manifest(experiment.loaded, seconds) | {"growing_hz": growing(experiment.loops)}
    if order.solver == "compiled":
        manifest["solver"] = {"name": COMPILED_STEPPER, "tolerance": PRECISE}
    return manifest


def _recorded(
    order: Order, experiment: Prepared, traces: Sequence[Trace], result: NewResult, talk: Talk
) -> TraceFile:
    for trace in traces:
        talk.detail(f"{trace.name}: {trace.status}, {count_of(len(trace.time), 'sample')}")
    result.manifest = _manifest(order, experiment, result.seconds) | figure_formats(order.formats)
    return trace_file(experiment.loaded, traces, result.manifest)


def _written(order: Order, file: TraceFile, result: NewResult) -> Made:
    """Write traces and tables."""
    write_traces(result.path / TRACES, file)
    outcome = outcome_of(file)
    outcome.write_tables(result.path)
    text = f"{outcome.text()}\n\nFigures, tables and traces are in {order.out}"
    data = {**outcome.data, "text": text, "out": str(order.out), "manifest": str(order.out / MANIFEST)}
    return Made(data, Result(file.experiment, outcome, result.manifest, file))


def plan_of(order: Order, experiment: Prepared, talk: Talk) -> dict[str, Any]:
    """What ``--json`` prints of a dry run."""
    loaded = experiment.loaded
    samples = {name: loop.reference.time.size for name, loop in experiment.loops.items()}
    plan = planned(order.experiment, loaded, order.out, talk, force=order.options["force"])
    return {**plan, "experiment": order.experiment, "config": loaded.origin, "samples": samples}


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
