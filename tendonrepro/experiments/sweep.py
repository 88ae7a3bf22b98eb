"""The comparison over values of one or two keys."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.configuration.load import LoadedConfig, config_digest, find_source, load_config
from tendonrepro.configuration.models.experiment import CompareConfig, errors_from
from tendonrepro.configuration.request import Request
from tendonrepro.configuration.strict_yaml import Node, load
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import all_loops, build_law
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.slow_error import TYPICAL_ERROR_DEG, error_ratio
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import COMPILED_STEPPER

OPTION = "--over"

_EXAMPLE = f"For example {OPTION} sampling_period=0.5,1,2"
_PERIOD, _STEP = "sampling_period", "solver.max_step"

Axes: TypeAlias = Mapping[str, Sequence[Node]]
"""Values by dotted key."""

PAIRS = {"c1_c2": CONTROLLERS[:2], "c2_c3": CONTROLLERS[1:]}
"""Ratios by their keys, and the runs they compare."""

IN_DEGREES = {"mae_deg": "mae", "rmse_deg": "rmse", "max_deg": "max_error", "overshoot_deg": "overshoot"}
"""Errors that are kept of each run, and the batch's names of them."""

IN_SI = ("s_rms", "torque_rms", "torque_step_rms", "H_hat_rms", "epsilon_rms", "saturated", "fast_share")
"""What else is kept, under the batch's names."""


class Point(NamedTuple):
    """One configuration of a sweep; `places` has the index of each key's value."""

    label: str
    values: Mapping[str, Node]
    places: list[int]
    loaded: LoadedConfig
    loops: Mapping[str, Loop]


class Sweep(NamedTuple):
    """A sweep ready to run; `base` is unchanged but for the digest and inputs of the whole."""

    base: LoadedConfig
    axes: Axes
    points: list[Point]


def run_sweep(request: Request, over: Sequence[str], talk: Talk) -> dict[str, Any]:
    """Run the comparison over one or two of ``dotted.key=a,b,c``, and write the results."""
    sweep = load_sweep(request, over)
    return run_study("sweep", sweep.base, request, lambda _: study_sweep(sweep, over, talk), talk)


def study_sweep(sweep: Sweep, over: Sequence[str], talk: Talk) -> Outcome:
    """Simulate a sweep."""
    from tendonrepro.experiments.figures import draw_sweep

    data = simulate_sweep(sweep, talk)
    manifest = {"solver": {"name": COMPILED_STEPPER}, "over": list(over), "points": len(sweep.points)}
    return Outcome(data, sweep_tables(data), {"sweep": lambda: draw_sweep(data)}, manifest)


def load_sweep(request: Request, over: Sequence[str]) -> Sweep:
    """Configurations of all points; the last key's values change fastest."""
    axes = parse_over(over)
    if request.seed is not None and not {"seed", "seed.value"}.isdisjoint(axes):
        raise UsageError("the seed is swept, so --seed has no place", where=OPTION)
    # Standard input can be read only once.
    source = find_source(request.config, "compare")
    load_one = partial(load_config, source, "compare", seed=request.seed, controllers=request.controllers)
    base = load_one(overrides=request.overrides)
    points = []
    for places in product(*(range(len(listed)) for listed in axes.values())):
        values = {key: axes[key][place] for key, place in zip(axes, places, strict=True)}
        label = " ".join(f"{key}={text_of(value)}" for key, value in values.items())
        changed = _following_step(values, base.config.sampling_period.unit) | values
        changes = [f"{key}={json.dumps(value)}" for key, value in changed.items()]
        try:
            loaded = load_one(overrides=[*request.overrides, *changes])
            points.append(Point(label, values, [*places], loaded, all_loops(loaded)))
        except ConfigError as error:
            raise ConfigError(str(error), where=f"{OPTION} {label}") from None
    if len({(tuple(point.loaded.config.joints), tuple(point.loops)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    if any(errors_from(point.loaded.config) > 0.0 for point in points):
        hint = "say --set errors_from=0, or run compare for each value"
        raise UsageError("a sweep averages whole runs, so errors_from must be 0", where=OPTION, hint=hint)
    base = replace(
        base,
        sha256=config_digest({"over": list(over), "points": [point.loaded.sha256 for point in points]}),
        inputs=tuple(dict.fromkeys(path for point in points for path in point.loaded.inputs)),
        # Of a key that is read at one point, the sweep shows what it does.
        unread=tuple(set.intersection(*(set(point.loaded.unread) for point in points))),
    )
    return Sweep(base, axes, points)


def parse_over(over: Sequence[str]) -> Axes:
    """Read ``key=a,b,c``, once or twice."""
    axes = dict(map(_axis, over))
    if not 1 <= len(axes) == len(over) <= 2:
        message = f"a sweep is over one or two keys, each given once, not {len(over)}"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    return axes


def _axis(text: str) -> tuple[str, list[Node]]:
    key, equals, listed = text.partition("=")
    key = key.strip()
    values = load(f"[{listed}]", f"{OPTION} {key}").tree
    if not equals or not isinstance(values, list) or len(values) < 2:
        message = f"{text!r} is not of the form key=a,b,c with two values or more"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    return key, values


def text_of(value: Node) -> str:
    """A value for a reader."""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _following_step(chosen: Mapping[str, Node], unit: str) -> dict[str, Node]:
    """Let the other solver's longest step, which must divide the sampling period, follow it."""
    period = chosen.get(_PERIOD, chosen.get(f"{_PERIOD}.value"))
    if period is None or any(key.startswith(_STEP) for key in chosen):
        return {}
    quantity: Node = {"value": period, "unit": unit, "source": "assumed: the sampling period"}
    return {_STEP: period if isinstance(period, dict) else quantity}


def unit_of(key: str, tree: Mapping[str, Node]) -> str | None:
    """Unit of the quantity that a key names or stands in."""
    node: Node = dict(tree)
    unit: Node = None
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
        unit = node.get("unit", unit) if isinstance(node, dict) else unit
    return unit if isinstance(unit, str) else None


def numbers_per_joint(values: Sequence[Node], n: int, total: int) -> list[list[float]] | None:
    """Values as numbers for each of the n moving joints, the last of `total`.

    None where they are no numbers, or two are the same for a joint.
    """
    rows = [value if isinstance(value, list) else [value] * n for value in values]
    numbers = [[float(x) for x in row if isinstance(x, float | int)][-n:] for row in rows]
    if any(len(row) not in (n, total) for row in rows) or any(len(row) < n for row in numbers):
        return None
    distinct = all(len(set(column)) == len(column) for column in zip(*numbers, strict=True))
    return numbers if distinct else None


def simulate_sweep(sweep: Sweep, talk: Talk) -> dict[str, Any]:
    """Simulate every run of every point; what does not exist is NaN."""
    total = sum(len(point.loops) for point in sweep.points)
    with talk.bar(f"simulating {count_of(total, 'run')}", total) as progress:
        points = [_simulate_point(point, progress) for point in sweep.points]
    status = {f"{p['label']} {run}": found["status"] for p in points for run, found in p["runs"].items()}
    config = sweep.points[0].loaded.config
    return {
        "schema_version": 1,
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
    """Ratios of MAE where both runs lasted, and under a slow load."""
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
    """A short table for the terminal, and one of everything."""
    swept = f"{data['config']} over {' and '.join(axis['key'] for axis in data['keys'])}"
    points = f"{swept}: MAE of each run, deg, and ratios of MAE."
    every = f"{swept}, sweep {data['config_sha256'][:12]}. A diverged run has its numbers up to its end."
    return [
        Table("points", points, list(point_rows(data))),
        Table("sweep", every, list(run_rows(data)), terminal=()),
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
