"""One experiment over values of one or two keys: all runs of all points at once, as table and picture."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.overrides import parse_override
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk, columns
from tendonrepro.experiments.loops import all_loops, build_law
from tendonrepro.experiments.run import simulate_run
from tendonrepro.experiments.sweep.points import (
    Axis,
    Point,
    numbers_per_joint,
    parse_over,
    sweep_points,
    unit_of,
)
from tendonrepro.experiments.sweep.report import COLUMNS, PAIRS, sweep_tables
from tendonrepro.experiments.user_law import UserLaw, laws_of, runs_of, with_user_laws
from tendonrepro.files import sha256_of
from tendonrepro.parallel import each
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, error_ratio
from tendonrepro.results.statistics import saturated, statistics
from tendonrepro.results.study import Outcome, foretell, run_study
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.resolution import COMPILED_STEPPER

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Sweep:
    """A sweep that is ready to run; `base` is unchanged but for the digest and inputs of the whole."""

    base: LoadedConfig
    axes: tuple[Axis, ...]
    points: list[Point]
    laws: Sequence[UserLaw] = ()

    @property
    def configs(self) -> list[LoadedConfig]:
        """Configuration of each point."""
        return [replace(self.base, config=point.config) for point in self.points]

    def label(self, point: Point) -> str:
        """A point's values as the command line spells them."""
        return " ".join(axis.option(place) for axis, place in zip(self.axes, point.places, strict=True))


def run_sweep(request: Request, over: Sequence[str], talk: Talk, laws: Sequence[str] = ()) -> dict[str, Any]:
    """Run the comparison over values of one or two keys, and write table, figure and manifest.

    Parameters
    ----------
    request : Request
        The same at every point.
    over : sequence of str
        One or two of ``dotted.key=a,b,c``, values in YAML.
    talk : Talk
    laws : sequence of str
        ``FILE:NAME`` of laws to run beside the controllers, by SciPy.

    Returns
    -------
    dict
        What ``--json`` prints; ``diverged`` lists the runs that did, which asks for exit code 5.

    Raises
    ------
    TendonreproError
        When a value cannot be used or results cannot be written.
    """
    sweep, folder = load_sweep(request, over, laws), request.folder("sweep")
    if request.dry_run:
        foretell(folder, sweep.base.sha256, "sweep", request, talk)
        return _plan(sweep, folder)
    if not sweep.laws and any(axis.key.startswith("solver.") for axis in sweep.axes):
        talk.note("the solver's settings change nothing here: the compiled stepper chooses its own steps")
    return run_study("sweep", sweep.base, request, lambda: study_sweep(sweep, over, talk), talk)


def study_sweep(sweep: Sweep, over: Sequence[str], talk: Talk) -> Outcome:
    """Simulate a sweep."""
    from tendonrepro.experiments.sweep.figures import draw_sweep

    data = simulate_sweep(sweep, talk)
    runs = sweep.points[0].config.runs
    steps = [point["runs"][run]["steps_per_sample"] for point in data["points"] for run in runs]
    manifest = {
        "solver": {"name": COMPILED_STEPPER, "steps_per_sample": [min(steps), max(steps)]},
        "over": list(over),
        "points": len(sweep.points),
    }
    return Outcome(data, sweep_tables(data), {"sweep": lambda: draw_sweep(data)}, manifest)


def _plan(sweep: Sweep, folder: Path) -> dict[str, Any]:
    """Points with the number of samples of their runs."""
    loops = (next(iter(all_loops(config).values())) for config in sweep.configs)
    labels = map(sweep.label, sweep.points)
    samples = {label: int(loop.reference.time.size) for label, loop in zip(labels, loops, strict=True)}
    head = _head(sweep)
    keys = " and ".join(axis.key for axis in sweep.axes)
    lines = columns((label, f"{count} samples") for label, count in samples.items())
    text = f"sweep over {keys}: {len(samples)} points of {len(head['runs'])} runs are valid\n{lines}"
    plan = {"dry_run": True, "samples": samples, "out": str(folder)}
    return head | plan | {"text": f"{text}\nwould write to {folder}"}


def load_sweep(request: Request, over: Sequence[str], laws: Sequence[str] = ()) -> Sweep:
    """Read a configuration and make those of all points; laws are ``FILE:NAME``."""
    taken = [parse_override(text).key for text in request.overrides]
    taken += ["seed"] * (request.seed is not None)
    axes = parse_over(over, taken)
    base = request.load("compare")
    points = sweep_points(base, axes)
    inputs = tuple(dict.fromkeys((*base.inputs, *(path for point in points for path in point.inputs))))
    content = {
        "keys": [axis.key for axis in axes],
        "points": [point.config.model_dump(mode="json", exclude_none=True) for point in points],
        "files": [sha256_of(path) for point in points for path in point.inputs],
    }
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    digest = hashlib.sha256(text.encode()).hexdigest()
    own = laws_of(laws)
    return Sweep(with_user_laws(replace(base, sha256=digest, inputs=inputs), own), axes, points, own)


def simulate_sweep(sweep: Sweep, talk: Talk) -> dict[str, Any]:
    """Simulate every run of every point; what does not exist is NaN, which JSON writes as null."""
    loops = [all_loops(config, sweep.laws) for config in sweep.configs]
    points: list[dict[str, Any]] = [
        {
            "label": sweep.label(point),
            "values": {axis.key: axis.values[k] for axis, k in zip(sweep.axes, point.places, strict=True)},
            "places": list(point.places),
            "runs": dict.fromkeys(named),
        }
        for point, named in zip(sweep.points, loops, strict=True)
    ]
    # A batch has one set of limits of statuses, which may be swept over.
    alike: dict[str, list[tuple[int, str]]] = {}
    for i, point in enumerate(sweep.points):
        alike.setdefault(str(point.config.status), []).extend((i, run) for run in point.config.runs)
    total = sum(map(len, loops))
    talk.detail(f"{total} runs; code for laws and options not met before is compiled once")
    with talk.bar(f"simulating {total} runs", total) as progress:
        for members in alike.values():
            limits = sweep.points[members[0][0]].config.status
            chosen = [loops[i][run] for i, run in members]
            batch = simulate_batch(chosen, limits, progress=progress, threads=os.cpu_count() or 1)
            for k, (i, run) in enumerate(members):
                points[i]["runs"][run] = {
                    "status": STATUSES[batch.status[k]],
                    "status_time_s": float(batch.status_time[k]),
                    "steps_per_sample": int(batch.steps[k]),
                } | {
                    name: (factor * batch.statistics[statistic][k]).tolist()
                    for name, (statistic, _, factor) in COLUMNS.items()
                }
        pieces = [
            (i, run)
            for i, point in enumerate(sweep.points)
            for law in sweep.laws
            for run in runs_of(law, point.config)
        ]
        own = each(own_run, [(sweep.configs[i], sweep.laws, run) for i, run in pieces])
        for (i, run), one in zip(pieces, own, strict=True):
            points[i]["runs"][run] = one
        progress(len(own))
    for point, found in zip(sweep.points, points, strict=True):
        found |= {"ratio": _ratios(found["runs"]), "predicted_ratio": _predicted(point.config)}
    status = {f"{p['label']} {run}": found["status"] for p in points for run, found in p["runs"].items()}
    for name, ended in status.items():
        talk.detail(f"{name}: {ended}")
    diverged = [name for name, ended in status.items() if ended == "diverged"]
    return _head(sweep) | {"points": points, "status": status, "diverged": diverged}


def own_run(piece: tuple[LoadedConfig, Sequence[UserLaw], str]) -> dict[str, Any]:
    """Simulate a run of a user's law by SciPy; return what a sweep keeps of a run."""
    loaded, laws, run = piece
    trace, loop = simulate_run(loaded, laws, run), all_loops(loaded)[next(iter(loaded.config.runs))]
    found = statistics(trace, ringing_frequency=loaded.config.status.ringing_frequency.si)
    found["saturated"] = saturated(trace, loop.plant.drive.S, loop.actuator.limit)
    unknown = np.full(len(trace.joint), np.nan)
    return {
        "status": trace.status,
        "status_time_s": trace.attributes["status_time"],
        "steps_per_sample": None,
    } | {name: (factor * found.get(key, unknown)).tolist() for name, (key, _, factor) in COLUMNS.items()}


def _ratios(found: Mapping[str, Mapping[str, Any]]) -> dict[str, list[float]]:
    """Ratios of MAE where both runs lasted, per joint."""
    ratios = {}
    for pair, (first, second) in PAIRS.items():
        if first in found and second in found:
            a, b = (np.asarray(found[run]["mae_deg"]) for run in (first, second))
            lasted = all(found[run]["status"] in {"ok", "ringing"} for run in (first, second))
            ratio = np.divide(a, b, out=np.full_like(a, np.nan), where=(b > 0.0) & lasted)
            ratios[pair] = ratio.tolist()
    return ratios


def _predicted(config: CompareConfig) -> dict[str, list[float]]:
    """Ratios of errors under a slowly changing load, which no plant enters."""
    e, delay = float(np.deg2rad(TYPICAL_ERROR_DEG)), int(config.manipulator.actuator.output_delay.si)
    laws = {name: build_law(config, run.law) for name, run in config.runs.items()}
    return {
        pair: error_ratio(laws[first], laws[second], e, delay).tolist()
        for pair, (first, second) in PAIRS.items()
        if first in laws and second in laws
    }


def _head(sweep: Sweep) -> dict[str, Any]:
    """What a sweep is over, of which configuration, with which runs."""
    config = sweep.points[0].config
    return {
        "schema_version": SCHEMA_VERSION,
        "experiment": "sweep",
        "config": sweep.base.origin,
        "config_sha256": sweep.base.sha256,
        "joints": list(config.joints),
        "runs": [*config.runs, *(run for law in sweep.laws for run in runs_of(law, config))],
        "keys": [
            {
                "key": axis.key,
                "unit": unit_of(axis.key, sweep.base.tree),
                "values": axis.values,
                "texts": list(axis.texts),
                "numbers": numbers_per_joint(axis, config.joints, config.manipulator.joints),
            }
            for axis in sweep.axes
        ],
    }
