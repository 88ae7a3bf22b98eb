"""The comparison over values of one or two keys: its configurations, and what their runs give."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import ConfigLike, LoadedConfig, config_digest, find_source, load_config
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.configuration.overrides import Overrides, override, overrides_of
from tendonrepro.configuration.strict_yaml import Node, entry, load
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import PAIRS
from tendonrepro.results.tables import TableRows
from tendonrepro.simulation.loop import Loop

if TYPE_CHECKING:
    from tendonrepro.simulation.batch import Batch

OPTION = "--over"

SweptValues: TypeAlias = Sequence[str] | Mapping[str, Sequence[object]]
"""Texts ``key=a,b,c`` as of the command line; or values by dotted key, as of Python."""

IN_DEGREES = {"mae_deg": "mae", "rmse_deg": "rmse", "max_deg": "max_error", "overshoot_deg": "overshoot"}
"""Errors that are kept of each run, and the batch's names of them."""

IN_SI = ("s_rms", "torque_rms", "torque_step_rms", "H_hat_rms", "epsilon_rms", "saturated", "fast_share")
"""What else is kept, under the batch's names."""

LASTED = ("ok", "ringing")
"""Statuses of runs whose errors can be compared."""


@dataclass(frozen=True)
class Axis:
    """A key and its values.

    `unit` is that of the quantity, if it is one. `numbers` are the values of the only key as numbers of each
    moving joint, (values, n); None where they are words, or where there are two keys.
    """

    key: str
    values: Sequence[Node]
    unit: str | None
    numbers: Array | None


class Point(NamedTuple):
    """One configuration of a sweep."""

    label: str
    values: Mapping[str, Node]
    loaded: LoadedConfig
    loops: Mapping[str, Loop]


@dataclass(frozen=True)
class Grid:
    """Configurations of a sweep, checked; `base` is unchanged but for the digest and inputs of the whole."""

    base: LoadedConfig
    axes: Sequence[Axis]
    points: Sequence[Point]

    @property
    def joints(self) -> tuple[int, ...]:
        """The moving joints."""
        return self.points[0].loaded.config.joints

    @property
    def runs(self) -> list[str]:
        """Names of the runs of every point."""
        return list(self.points[0].loops)


@dataclass(frozen=True)
class Sweep:
    """What the runs of a sweep gave.

    `rows` has a row for each point, run and joint; a diverged run has its sizes up to its end. `points` has
    one for each point and joint, with the MAE of every run, deg, and ratios of MAE by the names of `PAIRS`,
    NaN where one did not last.
    """

    grid: Grid
    rows: TableRows
    points: TableRows


def load_grid(
    over: SweptValues,
    source: ConfigLike = None,
    *,
    overrides: Overrides | None = None,
    seed: int | None = None,
    controllers: str | Sequence[int] | None = None,
) -> Grid:
    """Read and check the configurations of all points; the last key's values change fastest.

    Raises
    ------
    UsageError
        If it is not over one or two keys with two values or more, or its points cannot be compared.
    ConfigError
        If a point is no configuration; names the point.
    """
    values_of = parse_over(over)
    if seed is not None and not {"seed", "seed.value"}.isdisjoint(values_of):
        raise UsageError("the seed is swept, so --seed has no place", where=OPTION)
    changes = overrides_of(overrides)
    # Standard input can be read only once.
    source = find_source(source, "compare")
    load_one = partial(load_config, source, "compare", seed=seed, controllers=controllers)
    base = load_one(overrides=changes)
    points = []
    for values in product(*values_of.values()):
        chosen = dict(zip(values_of, values, strict=True))
        label = " ".join(f"{key}={text_of(value)}" for key, value in chosen.items())
        point_changes = _following_step(chosen, base.config.sampling_period.unit) | chosen
        changed = [override(key, value) for key, value in point_changes.items()]
        try:
            loaded = load_one(overrides=[*changes, *changed])
            points.append(Point(label, chosen, loaded, all_loops(loaded)))
        except ConfigError as error:
            raise ConfigError(str(error), where=f"{OPTION} {label}") from None
    _check_comparable(points)
    base = replace(
        base,
        sha256=config_digest({point.label: point.loaded.sha256 for point in points}),
        inputs=tuple(dict.fromkeys(path for point in points for path in point.loaded.inputs)),
        # Of a key that is read at one point, the sweep shows what it does.
        remarks=tuple(
            remark
            for remark in points[0].loaded.remarks
            if all(remark in point.loaded.remarks for point in points)
        ),
    )
    n, alone = len(points[0].loaded.config.joints), len(values_of) == 1
    axes = [
        Axis(key, values, unit_of(key, base.tree), numbers_per_joint(values, n) if alone else None)
        for key, values in values_of.items()
    ]
    return Grid(base, axes, points)


def _check_comparable(points: Sequence[Point]) -> None:
    if len({(tuple(point.loaded.config.joints), tuple(point.loops)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    if any(errors_from(point.loaded.config) > 0.0 for point in points):
        hint = "say --set errors_from=0, or run compare for each value"
        raise UsageError("a sweep averages whole runs, so errors_from must be 0", where=OPTION, hint=hint)


def parse_over(over: SweptValues) -> dict[str, list[Node]]:
    """Values by key; a UsageError where it is not over one or two keys with two values or more."""
    if isinstance(over, Mapping):
        pairs = [(key, override(key, values).value) for key, values in over.items()]
    else:
        texts = [text.partition("=") for text in over]
        pairs = [(key.strip(), load(f"[{listed}]", f"{OPTION} {key}")) for key, _, listed in texts]
    values_of = {key: values for key, values in pairs if isinstance(values, list) and len(values) > 1}
    if not 1 <= len(values_of) == len(pairs) <= 2:
        message = f"a sweep is over one or two keys, each given once with two values or more, not {over!r}"
        raise UsageError(message, where=OPTION, hint=f"For example {OPTION} sampling_period=0.5,1,2")
    return values_of


def text_of(value: Node) -> str:
    """A value for a reader."""
    return value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))


def _following_step(chosen: Mapping[str, Node], unit: str) -> dict[str, Node]:
    """Let the longest step of single runs, which must divide the sampling period, follow it."""
    period = chosen.get("sampling_period", chosen.get("sampling_period.value"))
    if period is None:
        return {}
    quantity: Node = {"value": period, "unit": unit, "source": "assumed: the sampling period"}
    return {"solver.max_step": period if isinstance(period, dict) else quantity}


def unit_of(key: str, tree: Mapping[str, Node]) -> str | None:
    """Unit of the quantity that a key names or stands in."""
    quantity = entry(tree, key.partition(".value")[0].split("."))
    return quantity.get("unit") if isinstance(quantity, dict) else None


def numbers_per_joint(values: Sequence[Node], n: int) -> Array | None:
    """Values as numbers for each of the n moving joints, the last ones of a list, (values, n).

    None where they are no numbers, or two are the same for a joint.
    """
    try:
        numbers = np.array([np.broadcast_to(np.array(x, dtype=float, ndmin=1)[-n:], n) for x in values])
    except (TypeError, ValueError):
        return None
    return numbers if all(len(np.unique(column)) == len(values) for column in numbers.T) else None


def simulate(grid: Grid, talk: Talk) -> Sweep:
    """Simulate every run of every point."""
    # Where nothing is run, whoever imports this needs no compiler.
    from tendonrepro.simulation.batch import simulate_batch

    total = sum(len(point.loops) for point in grid.points)
    rows: list[dict[str, object]] = []
    points: list[dict[str, object]] = []
    with talk.bar(f"simulating {count_of(total, 'run')}", total) as progress:
        for point in grid.points:
            batch = simulate_batch([*point.loops.values()], progress=progress)
            rows += _run_rows(point, batch, grid.joints)
            points += _point_rows(point, batch, grid.joints)
    return Sweep(grid, rows, points)


def _run_rows(point: Point, batch: Batch, joints: Sequence[int]) -> Iterator[dict[str, object]]:
    """Values of the keys, then all numbers of a run and joint."""
    texts = {key: text_of(value) for key, value in point.values.items()}
    sizes = {name: np.rad2deg(batch.statistics[statistic]) for name, statistic in IN_DEGREES.items()}
    sizes |= {name: batch.statistics[name] for name in IN_SI}
    for r, run in enumerate(point.loops):
        status = {"status": STATUSES[batch.status[r]], "status_time_s": float(batch.status_time[r])}
        for k, joint in enumerate(joints):
            numbers = {name: float(size[r, k]) for name, size in sizes.items()}
            yield {**texts, "run": run, "joint": joint, **status, **numbers}


def _point_rows(point: Point, batch: Batch, joints: Sequence[int]) -> Iterator[dict[str, object]]:
    """MAE of every run, ratios, and the runs that are not ok."""
    status = {run: STATUSES[code] for run, code in zip(point.loops, batch.status, strict=True)}
    bad = [f"{run} {word}" for run, word in status.items() if word != "ok"]
    for k, joint in enumerate(joints):
        mae = dict(zip(status, np.rad2deg(batch.statistics["mae"][:, k]).tolist(), strict=True))
        comparable = {run for run in mae if status[run] in LASTED and mae[run] > 0.0}
        ratios = {
            pair: mae[a] / mae[b] if {a, b} <= comparable else np.nan
            for pair, (a, b) in PAIRS.items()
            if {a, b} <= mae.keys()
        }
        yield {"point": point.label, "joint": joint, **mae, **ratios, "status": bad or "ok"}
