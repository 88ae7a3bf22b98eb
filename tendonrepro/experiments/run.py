"""The paper's experiments: ready to run, simulated, as traces, tables and notes; as studies; drawn again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, Config, ConfigSource, LoadedConfig, load_config
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.configuration.overrides import Overrides
from tendonrepro.configuration.strict_model import Model
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError, did_you_mean
from tendonrepro.experiments.loops import all_loops, growing, run_status, run_views
from tendonrepro.experiments.rig import plant_record
from tendonrepro.experiments.user_law import UserLaw, runs_of, with_user_laws
from tendonrepro.files import Json, refuse_file
from tendonrepro.parallel import Start, counted, workers
from tendonrepro.physics.linear_loop import SampledLoop, sampled_loop, stroke
from tendonrepro.results import paper, store, summary
from tendonrepro.results.figures import DRAWN, FORMATS
from tendonrepro.results.paper_tables import made_tables, table_data
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces
from tendonrepro.simulation.loop import Loop, TimeDelayController
from tendonrepro.simulation.resolution import COMPILED_STEPPER
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Study

PRECISE = 1e-6
"""Tolerance of the compiled stepper where a single comparison is asked for."""

SolverName: TypeAlias = Literal["scipy", "compiled"]


CLOSEST = "closest"
"""Name of the shipped configuration that was fitted to Tables 2 and 3."""


class Prepared(NamedTuple):
    """An experiment that is ready to run: configuration, a user's laws, and the loop of every run by name."""

    loaded: LoadedConfig
    laws: Sequence[UserLaw]
    loops: Mapping[str, Loop]
    solver: SolverName = "scipy"


def prepared(loaded: LoadedConfig, laws: Sequence[UserLaw] = (), solver: SolverName = "scipy") -> Prepared:
    """Build the loops of an experiment, whose digest then covers the stepper and a user's laws.

    Raises
    ------
    UsageError
        If the solver cannot run a user's law.
    """
    if solver == "compiled":
        if laws:
            message = "only the paper's own control laws run on lanes"
            raise UsageError(message, where="--law", hint="use the SciPy stepper, --solver scipy")
        digest = hashlib.sha256(f"{loaded.sha256} compiled".encode()).hexdigest()
        loaded = replace(loaded, sha256=digest, overrides=(*loaded.overrides, "solver=compiled"))
    loaded = with_user_laws(loaded, laws)
    return Prepared(loaded, laws, all_loops(loaded, laws), solver)


def results_of(experiments: Sequence[Prepared], talk: Talk, start: Start = map) -> Iterator[Result]:
    """Simulate experiments together, and yield the result of each."""
    for experiment, traces in zip(experiments, begin_all(experiments, talk, start), strict=True):
        for trace in traces:
            talk.detail(f"{trace.name}: {trace.status}, {count_of(len(trace.time), 'sample')}")
        manifest: Json = {"growing_hz": growing(experiment.loops)}
        if experiment.solver == "compiled":
            manifest["solver"] = {"name": COMPILED_STEPPER, "tolerance": PRECISE}
        yield experiment_result(trace_file(experiment.loaded, traces, manifest))


def begin_all(experiments: Sequence[Prepared], talk: Talk, start: Start = map) -> Iterator[list[Trace]]:
    """Simulate, by what `workers` yields; yield the traces of one experiment after the other."""
    if experiments[0].solver == "compiled":
        yield from (_simulate_together(each.loaded, each.loops, talk) for each in experiments)
        return
    # Copies of this process need not import it once more.
    from tendonrepro.simulation import stepper

    del stepper
    # Loops are built where they run: a user's law need not survive the way to another process.
    runs = [(each.loaded, each.laws, name) for each in experiments for name in each.loops]
    # Before the bar, whose thread forbids such copies.
    begun = start(simulate_run, runs)
    with talk.bar(f"simulating {count_of(len(runs), 'run')}", len(runs)) as progress:
        traces = iter(list(counted(begun, progress)))
    for experiment in experiments:
        yield [next(traces) for _ in experiment.loops]


def simulate_run(run: tuple[LoadedConfig, Sequence[UserLaw], str]) -> Trace:
    """Simulate one run, by its name."""
    # Where nothing is run, whoever imports this needs no compiler.
    from tendonrepro.simulation.stepper import simulate

    loaded, laws, name = run
    loop = all_loops(loaded, laws)[name]
    variables = simulate(loop)
    if name not in loaded.config.runs:
        # What a user's law does not have, it returned at no sample.
        absent = {key for key in ("s", "H_hat", "epsilon") if np.isnan(variables[key]).all()}
        variables = {key: variables[key] for key in variables if key not in absent}
    return _trace(loaded, name, loop, variables, laws)


def _simulate_together(loaded: LoadedConfig, loops: Mapping[str, Loop], talk: Talk) -> list[Trace]:
    """Simulate by the stepper of ensembles, which refuses a plant too fast for it."""
    from tendonrepro.simulation.batch import simulate_batch

    with talk.bar(f"simulating {count_of(len(loops), 'run')}", len(loops)) as progress:
        batch = simulate_batch([*loops.values()], progress=progress, record=True, tolerance=PRECISE)
    traces = []
    for (name, loop), variables in zip(loops.items(), batch.traces or (), strict=True):
        if variables is None:
            message = f"the plant of {name} is too fast for the compiled stepper"
            raise TendonreproError(message, hint="use --solver scipy")
        traces.append(_trace(loaded, name, loop, variables))
    return traces


def _trace(
    loaded: LoadedConfig, name: str, loop: Loop, variables: dict[str, Array], laws: Sequence[UserLaw] = ()
) -> Trace:
    status, status_time = run_status(loop, variables)
    attributes = _law(loaded.config, name, loop, laws)
    attributes |= {"reference_period": loop.reference.period, "status": status, "status_time": status_time}
    return Trace(name, variables.pop("time"), loaded.config.joints, variables, attributes)


def _law(config: Config, name: str, loop: Loop, laws: Sequence[UserLaw]) -> dict[str, object]:
    """What a trace stores of its law and payload."""
    if not isinstance(config, CompareConfig):
        run = config.runs[name]
        gains = {"law": "motor_position_loop", "gains": _vectors(config.position_loop), "readings": {}}
        return gains | {"drives": run.drives, "payload_mass": run.payload.si}
    own = {run: (law, plant) for law in laws for run, plant in runs_of(law, config).items()}
    law, plant = own.get(name, (None, name))
    chosen = config.runs[plant]
    attributes = {
        "law": f"{summary.USER_LAW}{law.name}" if law else chosen.law,
        "gains": _vectors(config.control.gains),
        "readings": config.control.readings.model_dump(),
        "payload_mass": chosen.payload.si,
        "start_offset": loop.start_angles.tolist(),
        "friction_scale": chosen.friction_factor,
        "reference_lag": loop.reference_lag,
        "errors_from": errors_from(config),
    }
    if isinstance(loop.controller, TimeDelayController):
        newer, older = loop.controller.law.weights
        attributes |= {"estimator_weight_newer": newer.tolist(), "estimator_weight_older": older.tolist()}
    return attributes


def _vectors(section: Model) -> dict[str, list[float]]:
    return {name: vector.si.tolist() for name, vector in section if vector is not None}


def trace_file(loaded: LoadedConfig, traces: Sequence[Trace], manifest: Json) -> TraceFile:
    """Runs with what they were made with; the manifest is without outputs, and may be incomplete."""
    file = TraceFile(
        experiment=loaded.config.experiment,
        source="simulated",
        title=loaded.config.title,
        runs={trace.name: trace for trace in traces},
        plant=plant_record(loaded.config),
        config_yaml=loaded.yaml_text,
        config_sha256=loaded.sha256,
        manifest=manifest,
    )
    return paper.with_what_they_are(file, loaded.tree)


def experiment_result(file: TraceFile) -> Result:
    """Numbers, tables and notes of an experiment."""
    joints = list(next(iter(file.runs.values())).joint)
    data = {"schema_version": 1, "experiment": file.experiment, "joints": joints, **table_data(file)}
    growing_hz: dict[str, float] = {}
    if file.experiment == "compare":
        growing_hz = file.manifest.get("growing_hz", {})
        data["growing_hz"] = growing_hz
    diverged = any(trace.status == "diverged" for trace in file.runs.values())
    parts: list[Table | str] = [*made_tables(file), *_notes(file, growing_hz)]
    linear = partial(_linear, file)
    return Result(data, parts, manifest=file.manifest, traces=file, diverged=diverged, linear=linear)


def _linear(file: TraceFile, run: str, at: str) -> SampledLoop:
    """A run's loop as it is linear at a posture of its motion; a UsageError where it has none."""
    config = None
    if file.source == "simulated" and file.experiment == "compare":
        config = load_config(ConfigSource(file.config_yaml, file.title, None), "compare").config
    if not isinstance(config, CompareConfig) or run not in config.runs:
        message = f"{run} has no controller of the package, so its loop is not known"
        raise UsageError(message, hint="loops are of the configured runs of compare")
    places = ("start", "middle", "far")
    if at not in places:
        raise UsageError(f"there is no posture {at!r}{did_you_mean(at, places)}", hint="start, middle or far")
    view = run_views(config)[run]
    q = stroke(file.runs[run].variables["q_d"])[places.index(at)]
    return sampled_loop(q, view.plant, view.law, view.delay)


def _notes(file: TraceFile, growing_hz: Mapping[str, float]) -> Iterator[str]:
    if under := paper.fitted_under(file):
        yield f"The plant was fitted to the published tables under {under}, so agreement proves nothing."
    for name, trace in file.runs.items():
        if sizes := summary.tension_sizes(file, trace):
            for tendon, seconds in zip(trace.joint, sizes["slack_s"], strict=True):
                if seconds:
                    yield f"Tendon {tendon} does not pull in {name} for {seconds:.3f} s."
    # A loop may grow so slowly that its run ends before the status tells.
    if runs := [f"{run} at {hz:.1f} Hz" for run, hz in growing_hz.items() if file.runs[run].status == "ok"]:
        loops = ", ".join(runs)
        yield f"Linearised without friction these loops grow: {loops}. See tendonrepro explain."


def experiment_study(experiment: Prepared, folder: Folder) -> Study:
    """One of the paper's experiments as a study of its own."""
    loaded = experiment.loaded
    samples = {name: loop.reference.time.size for name, loop in experiment.loops.items()}
    plan = {"experiment": loaded.config.experiment, "config": loaded.origin, "samples": samples}
    return Study(
        loaded,
        lambda site: next(results_of([experiment], site.talk, site.start)),
        folder,
        plan=plan,
        command=loaded.config.experiment,
    )


def paper_experiments(changes: Overrides | None, seed: int | None) -> dict[str, Prepared]:
    """Both experiments of the paper, and the comparison fitted to its tables, which runs only as shipped."""
    experiments = {
        "decouple": prepared(load_config(None, "decouple", overrides=changes, seed=seed)),
        "compare": prepared(load_config(None, "compare", overrides=changes, seed=seed)),
    }
    if not changes and seed is None:
        experiments[CLOSEST] = prepared(load_config(CLOSEST, "compare"))
    return experiments


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
            if not (folder / store.MANIFEST).exists():
                written += make(file, folder)
                continue
            sha256, command = file.config_sha256, file.experiment
            with store.replaced(folder, sha256, command=command, force=force, update=True) as result:
                result.manifest = store.read_manifest(folder)
                made = make(file, result.path)
                drawn = {*result.manifest.get("figure_formats", ()), *(path.suffix[1:] for path in made)}
                result.manifest |= {"figure_formats": [name for name in FORMATS if name in drawn]}
            written += [folder / path.relative_to(result.path) for path in made]
    return written


def _stored(out: Path) -> dict[Path, TraceFile]:
    """Traces in a folder, or in those directly below it."""
    refuse_file(out)
    paths = [*out.glob(TRACES)] or sorted(out.glob(f"[!.]*/{TRACES}"))
    if not paths:
        message = f"holds no {TRACES}, and no folder in it does"
        hint = "run tendonrepro reproduce, or name another --out"
        if (out / store.MANIFEST).exists():
            hint = "figures and tables of this result are made by its command alone: run that again"
        raise DataMissingError(message, where=str(out), hint=hint)
    return {path.parent: read_traces(path.parent) for path in paths}
