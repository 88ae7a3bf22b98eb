"""One experiment in memory: the runs of a configuration, simulated, as traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.plant_record import plant_record
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.files import to_json
from tendonrepro.parallel import each
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.stepper import Loop, simulate

PRECISE = 1e-6
"""Tolerance of the compiled stepper where a single comparison is asked for."""


def simulate_all(
    asked: Sequence[tuple[LoadedConfig, UserLaw | None]],
    talk: Talk,
    solver: Literal["scipy", "compiled"] = "scipy",
) -> list[list[Trace]]:
    """Simulate every run of every configuration, each with its status; one that diverged ends early."""
    from tendonrepro.simulation.codegen.cache import NOTHING_COMPILED

    loops = [all_loops(loaded, law) for loaded, law in asked]
    if NOTHING_COMPILED:
        talk.note("compiling once for this machine, a few seconds")
    if solver == "compiled":
        return [
            _simulate_together(loaded, named, talk) for (loaded, _), named in zip(asked, loops, strict=True)
        ]
    runs = [(*one, name) for one, named in zip(asked, loops, strict=True) for name in named]
    with talk.bar(f"simulating {len(runs)} runs", len(runs)) as progress:
        traces = each(_simulated, runs, progress)
    for trace in traces:
        talk.detail(f"{trace.name}: {trace.status}, {trace.time.size} samples")
    rest = iter(traces)
    return [[next(rest) for _ in named] for named in loops]


def _simulated(run: tuple[LoadedConfig, UserLaw | None, str]) -> Trace:
    return simulate_run(*run)


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
    return _trace(loaded, name, loop, simulate(loop))


def _simulate_together(loaded: LoadedConfig, loops: Mapping[str, Loop], talk: Talk) -> list[Trace]:
    """Simulate by the compiled batch stepper; a plant too fast for it, or a foreign law, is refused."""
    from tendonrepro.simulation.batch import simulate_batch

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
    config, period = loaded.config, {"reference_period": loop.reference.period}
    if not isinstance(config, CompareConfig):
        run = config.runs[name]
        gains = {"law": "motor_position_loop", "gains": _vectors(config.position_loop), "readings": {}}
        return gains | {"drives": run.drives, "payload_mass": run.payload.si} | period
    chosen = config.runs.get(name) or next(iter(config.runs.values()))
    attributes = {
        "law": chosen.law if name in config.runs else f"user law {name}",
        "gains": _vectors(config.control.gains),
        "readings": config.control.readings.model_dump(),
        "payload_mass": chosen.payload.si,
    }
    if isinstance(loop.controller, TimeDelayController):
        newer, older = loop.controller.law.weights
        attributes |= {"estimator_weight_newer": newer.tolist(), "estimator_weight_older": older.tolist()}
    return attributes | period


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
