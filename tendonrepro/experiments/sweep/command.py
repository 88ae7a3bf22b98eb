"""One experiment over values of one or two keys, as tables and picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tendonrepro.configuration.load import (
    CompareConfig,
    LoadedConfig,
    config_digest,
    find_source,
    load_config,
)
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.experiments.loops import build_law
from tendonrepro.experiments.sweep.points import (
    Axes,
    Point,
    numbers_per_joint,
    parse_over,
    sweep_points,
    text_of,
    unit_of,
)
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, error_ratio
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.resolution import COMPILED_STEPPER

SCHEMA_VERSION = 1

PAIRS = {"c1_c2": CONTROLLERS[:2], "c2_c3": CONTROLLERS[1:]}
"""Ratios by their keys, and the runs they compare."""

IN_DEGREES = {"mae_deg": "mae", "rmse_deg": "rmse", "max_deg": "max_error", "overshoot_deg": "overshoot"}
"""Errors that are kept of each run, and the batch's names of them."""

IN_SI = ("s_rms", "torque_rms", "torque_step_rms", "H_hat_rms", "epsilon_rms", "saturated", "fast_share")
"""What else is kept, under the batch's names."""


@dataclass(frozen=True)
class Sweep:
    """A sweep that is ready to run; `base` is unchanged but for the digest and inputs of the whole."""

    base: LoadedConfig
    axes: Axes
    points: list[Point]


def run_sweep(request: Request, over: Sequence[str], talk: Talk) -> dict[str, Any]:
    """Run the comparison over values of one or two keys, and write tables, figure and manifest.

    Parameters
    ----------
    request : Request
        The same at every point.
    over : sequence of str
        One or two of ``dotted.key=a,b,c``, values in YAML.
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints; ``diverged`` lists the runs that did, which asks for exit code 5.

    Raises
    ------
    TendonreproError
        When a value cannot be used or results cannot be written.
    """
    sweep = load_sweep(request, over)
    return run_study("sweep", sweep.base, request, lambda: study_sweep(sweep, over, talk), talk)


def study_sweep(sweep: Sweep, over: Sequence[str], talk: Talk) -> Outcome:
    """Simulate a sweep."""
    from tendonrepro.experiments.sweep.figures import draw_sweep

    data = simulate_sweep(sweep, talk)
    manifest = {"solver": {"name": COMPILED_STEPPER}, "over": list(over), "points": len(sweep.points)}
    return Outcome(data, sweep_tables(data), {"sweep": lambda: draw_sweep(data)}, manifest)


def load_sweep(request: Request, over: Sequence[str]) -> Sweep:
    """Read a configuration and make those of all points."""
    axes = parse_over(over)
    # Standard input can be read only once.
    source = find_source(request.config, "compare")

    load = partial(load_config, source, "compare", seed=request.seed, controllers=request.controllers)

    def load_changed(changes: list[str]) -> LoadedConfig:
        return load(overrides=[*request.overrides, *changes])

    base, points = load_changed([]), sweep_points(load_changed, axes)
    base = replace(
        base,
        sha256=config_digest({"over": list(over), "points": [point.loaded.sha256 for point in points]}),
        inputs=tuple(dict.fromkeys(path for point in points for path in point.loaded.inputs)),
    )
    return Sweep(base, axes, points)


def simulate_sweep(sweep: Sweep, talk: Talk) -> dict[str, Any]:
    """Simulate every run of every point; what does not exist is NaN, which JSON writes as null."""
    total = sum(len(point.loops) for point in sweep.points)
    with talk.bar(f"simulating {total} runs", total) as progress:
        points = [_simulate_point(point, progress) for point in sweep.points]
    status = {f"{p['label']} {run}": found["status"] for p in points for run, found in p["runs"].items()}
    for name, ended in status.items():
        talk.detail(f"{name}: {ended}")
    config = sweep.points[0].loaded.config
    return {
        "schema_version": SCHEMA_VERSION,
        "experiment": "sweep",
        "config": sweep.base.origin,
        "config_sha256": sweep.base.sha256,
        "joints": list(config.joints),
        "runs": list(config.runs),
        "keys": [
            {
                "key": key,
                "unit": unit_of(key, sweep.base.tree),
                "values": values,
                "texts": [text_of(value) for value in values],
                "numbers": numbers_per_joint(values, len(config.joints), config.manipulator.joints),
            }
            for key, values in sweep.axes.items()
        ],
        "points": points,
        "status": status,
        "diverged": [name for name, ended in status.items() if ended == "diverged"],
    }


def _simulate_point(point: Point, progress: Callable[[int], None]) -> dict[str, Any]:
    config = point.loaded.config
    assert isinstance(config, CompareConfig)
    batch = simulate_batch([*point.loops.values()], config.status, progress=progress)
    runs = {
        run: {
            "status": STATUSES[batch.status[k]],
            "status_time_s": float(batch.status_time[k]),
            "steps_per_sample": int(batch.steps[k]),
        }
        | {name: np.rad2deg(batch.statistics[key][k]).tolist() for name, key in IN_DEGREES.items()}
        | {name: batch.statistics[name][k].tolist() for name in IN_SI}
        for k, run in enumerate(point.loops)
    }
    found = {"label": point.label, "values": point.values, "places": point.places, "runs": runs}
    return found | _ratios(runs, config)


def _ratios(runs: Mapping[str, Mapping[str, Any]], config: CompareConfig) -> dict[str, Any]:
    """Ratios of MAE where both runs lasted, and of errors under a slow load, which no plant enters."""
    e, delay = float(np.deg2rad(TYPICAL_ERROR_DEG)), int(config.manipulator.actuator.output_delay.si)
    ratio, predicted = {}, {}
    for pair, names in PAIRS.items():
        if not config.runs.keys() >= set(names):
            continue
        one, other = (build_law(config, config.runs[name].law) for name in names)
        predicted[pair] = error_ratio(one, other, e, delay).tolist()
        first, second = (np.array(runs[name]["mae_deg"]) for name in names)
        lasted = all(runs[name]["status"] in {"ok", "ringing"} for name in names)
        unknown = np.full_like(first, np.nan)
        ratio[pair] = np.divide(first, second, out=unknown, where=(second > 0.0) & lasted).tolist()
    return {"ratio": ratio, "predicted_ratio": predicted}


def sweep_tables(data: Mapping[str, Any]) -> list[Table]:
    """A row per point and joint for the terminal, and a row per point, run and joint with every number."""
    keys = " and ".join(axis["key"] for axis in data["keys"])
    caption = f"{data['config']} over values of {keys} (sweep {data['config_sha256'][:12]}). "
    caption += "A diverged run has its numbers up to its end."
    return [
        Table(
            "points", f"Sweep over {keys}: MAE of each run, deg, and ratios of MAE", list(point_rows(data))
        ),
        Table("sweep", caption, list(run_rows(data)), terminal=()),
    ]


def point_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """MAE of every run, ratios, and the runs that are not ok."""
    for point in data["points"]:
        runs, ratios = point["runs"].items(), point["ratio"].items()
        bad = [f"{run} {found['status']}" for run, found in runs if found["status"] != "ok"]
        for k, joint in enumerate(data["joints"]):
            row = {"point": point["label"], "joint": joint}
            row |= {run: found["mae_deg"][k] for run, found in runs} | {x: r[k] for x, r in ratios}
            yield row | {"status": bad or "ok"}


def run_rows(data: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Values of the keys, then all numbers of a run and joint."""
    for point in data["points"]:
        texts = {key: text_of(value) for key, value in point["values"].items()}
        for run, found in point["runs"].items():
            for k, joint in enumerate(data["joints"]):
                row = texts | {"run": run, "joint": joint}
                row |= {name: found[name] for name in ("status", "status_time_s")}
                yield row | {name: found[name][k] for name in (*IN_DEGREES, *IN_SI)}
