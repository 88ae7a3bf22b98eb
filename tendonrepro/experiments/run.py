"""One experiment in memory: the runs of a configuration, simulated, as traces."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.config.load import CompareConfig, LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import build_loops, reference_period
from tendonrepro.experiments.plant_record import plant_record
from tendonrepro.experiments.user_law import UserLaw, add_user_law
from tendonrepro.files import to_json
from tendonrepro.parallel import advance, each
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.records import RESERVED, Trace, TraceFile
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.stepper import Loop, simulate

PRECISE = 1e-6
"""Tolerance of the compiled stepper where a single comparison is asked for."""


def all_loops(loaded: LoadedConfig, law: UserLaw | None) -> dict[str, Loop]:
    """Closed loops of all runs, by name.

    Parameters
    ----------
    loaded : LoadedConfig
    law : UserLaw or None
        Runs beside the others, on the plant and reference of the first run.

    Raises
    ------
    UsageError
        If the law's name is taken.
    """
    loops = dict(build_loops(loaded.config, loaded.folder))
    if law is None:
        return loops
    if law.name in (*loops, RESERVED):
        message = f"there is something else of the name {law.name!r} among the results"
        raise UsageError(message, where="--law", hint="give the function another name")
    return loops | {law.name: add_user_law(law, next(iter(loops.values())))}


def simulate_all(loaded: LoadedConfig, law: UserLaw | None, talk: Talk) -> list[Trace]:
    """Simulate every run, each on its own.

    Parameters
    ----------
    loaded : LoadedConfig
    law : UserLaw or None
    talk : Talk

    Returns
    -------
    list of Trace
        Each with its status; one that diverged ends early and the others go on.
    """
    from tendonrepro.simulation.codegen.compiled import cache_is_empty

    if cache_is_empty():
        talk.note("compiling once for this machine, about ten seconds")
    loops = all_loops(loaded, law)
    total = sum(loop.reference.time.size for loop in loops.values())
    with talk.bar(f"simulating {len(loops)} runs", total) as progress:
        traces = each(partial(simulate_run, loaded, law), list(loops), progress)
    for trace in traces:
        talk.detail(f"{trace.name}: {trace.status}, {trace.time.size} samples")
    return traces


def simulate_run(loaded: LoadedConfig, law: UserLaw | None, name: str) -> Trace:
    """Simulate one run.

    Parameters
    ----------
    loaded : LoadedConfig
    law : UserLaw or None
    name : str
        Of the run.

    Returns
    -------
    Trace
    """
    loop = all_loops(loaded, law)[name]
    return _trace(loaded, name, loop, simulate(loop, advance))


def simulate_together(loaded: LoadedConfig, law: UserLaw | None, talk: Talk) -> list[Trace]:
    """Simulate every run by the compiled batch stepper.

    Parameters
    ----------
    loaded : LoadedConfig
    law : UserLaw or None
    talk : Talk

    Returns
    -------
    list of Trace

    Raises
    ------
    TendonreproError
        If a plant is too fast for it, or a law is not the package's own.
    """
    from tendonrepro.simulation.batch import simulate_batch
    from tendonrepro.simulation.codegen.compiled import cache_is_empty

    loops = all_loops(loaded, law)
    if cache_is_empty():
        talk.note("compiling once for this machine, some twenty seconds")
    with talk.bar(f"simulating {len(loops)} runs", len(loops)) as progress:
        batch = simulate_batch(
            [*loops.values()], loaded.config.status, progress=progress, record=True, tolerance=PRECISE
        )
    traces = []
    for (name, loop), variables in zip(loops.items(), batch.traces or (), strict=True):
        if variables is None:
            message = f"the plant of {name} is too fast for the compiled stepper"
            raise TendonreproError(message, hint="use --solver scipy")
        traces.append(_trace(loaded, name, loop, variables))
    return traces


def _trace(loaded: LoadedConfig, name: str, loop: Loop, variables: dict[str, Array]) -> Trace:
    """Variables of a run with their status and attributes."""
    t = variables.pop("time")
    limits = loaded.config.status
    status, status_time = status_of(
        t, variables["e"], limits.divergence_limit.si, limits.ringing_frequency.si, limits.ringing_share.si
    )
    if t.size < loop.reference.time.size:
        status, status_time = "diverged", float(t[-1])
    end = {"status": status, "status_time": status_time}
    return Trace(name, t, loaded.config.joints, variables, _attributes(loaded, name, loop) | end)


def _attributes(loaded: LoadedConfig, name: str, loop: Loop) -> dict[str, Any]:
    """Law, gains, readings, payload and reference of a run, as a trace stores them."""
    config = loaded.config
    if not isinstance(config, CompareConfig):
        run = config.runs[name]
        return {
            "law": "motor_position_loop",
            "gains": _vectors(config.position_loop),
            "readings": {},
            "drives": run.drives,
            "payload_mass": run.payload.si,
            "reference_period": reference_period(run.reference),
        }
    chosen = config.runs.get(name) or next(iter(config.runs.values()))
    attributes = {
        "law": chosen.law if name in config.runs else f"user law {name}",
        "gains": _vectors(config.control.gains),
        "readings": config.control.readings.model_dump(),
        "payload_mass": chosen.payload.si,
        "reference_period": reference_period(config.reference),
    }
    if isinstance(loop.controller, TimeDelayController):
        newer, older = loop.controller.law.weights
        attributes |= {"estimator_weight_newer": newer.tolist(), "estimator_weight_older": older.tolist()}
    return attributes


def _vectors(section: Any) -> dict[str, list[float]]:
    present = {name: getattr(section, name) for name in type(section).model_fields}
    return {name: vector.si.tolist() for name, vector in present.items() if vector is not None}


def trace_file(loaded: LoadedConfig, traces: Sequence[Trace], manifest: dict[str, Any]) -> TraceFile:
    """Put runs together with what they were made with.

    Parameters
    ----------
    loaded : LoadedConfig
    traces : sequence of Trace
    manifest : dict
        Without outputs.

    Returns
    -------
    TraceFile
    """
    return TraceFile(
        experiment=loaded.config.experiment,
        source="simulated",
        title=loaded.config.title,
        runs={trace.name: trace for trace in traces},
        plant=plant_record(loaded.config),
        config_yaml=loaded.yaml_text,
        config_sha256=loaded.sha256,
        manifest_json=to_json(manifest),
        created=manifest["created"],
        tendonrepro_version=__version__,
    )
