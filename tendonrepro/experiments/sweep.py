"""The comparison over values of one or two keys: its configurations, and what their runs give."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import ConfigLike, LoadedConfig, config_digest, find_source, load_config
from tendonrepro.configuration.models.experiment import CompareConfig, errors_from
from tendonrepro.configuration.overrides import Overrides, override, overrides_of
from tendonrepro.configuration.strict_yaml import Node, load
from tendonrepro.console import Talk, count_of
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import all_loops, slow_error_ratio
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import PAIRS
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

Statuses: TypeAlias = NDArray[np.str_]

OPTION = "--over"

_EXAMPLE = f"For example {OPTION} sampling_period=0.5,1,2"
_PERIOD, _STEP = "sampling_period", "solver.max_step"

SweptValues: TypeAlias = Sequence[str] | Mapping[str, Sequence[object]]
"""Texts ``key=a,b,c`` as of the command line; or values by dotted key, as of Python."""

IN_DEGREES = {"mae_deg": "mae", "rmse_deg": "rmse", "max_deg": "max_error", "overshoot_deg": "overshoot"}
"""Errors that are kept of each run, and the batch's names of them."""

IN_SI = ("s_rms", "torque_rms", "torque_step_rms", "H_hat_rms", "epsilon_rms", "saturated", "fast_share")
"""What else is kept, under the batch's names."""


@dataclass(frozen=True)
class Axis:
    """A key and its values.

    `unit` is that of the quantity, if it is one. `numbers` are the values as numbers of each moving joint,
    (values, n), or None where they are words.
    """

    key: str
    values: Sequence[Node]
    unit: str | None
    numbers: list[list[float]] | None


class Point(NamedTuple):
    """One configuration of a sweep; `places` has the index of each key's value."""

    label: str
    values: Mapping[str, Node]
    places: list[int]
    loaded: LoadedConfig
    loops: Mapping[str, Loop]


@dataclass(frozen=True)
class Grid:
    """Configurations of a sweep, checked.

    `base` is unchanged but for the digest and inputs of the whole. `words` are what was asked for.
    """

    base: LoadedConfig
    words: list[str]
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


class ErrorRatio(NamedTuple):
    """Ratio of two runs' MAE, (P, n), NaN where one did not last; and as a slow load would give it."""

    simulated: Array
    predicted: Array


@dataclass(frozen=True)
class Sweep:
    """What the runs of a sweep gave: P points, R runs, n joints.

    Attributes
    ----------
    status : array of str (P, R)
    status_time : array (P, R)
        End of each run, s.
    steps : array of int (P, R)
        Integrator's steps in a sampling period.
    sizes : mapping of str to array (P, R, n)
        By the names of `IN_DEGREES`, deg, and of `IN_SI`. A diverged run has its sizes up to its end.
    ratios : mapping of str to Ratio
        By the names of `PAIRS`, those whose runs are there.
    """

    grid: Grid
    status: Statuses
    status_time: Array
    steps: NDArray[np.int64]
    sizes: Mapping[str, Array]
    ratios: Mapping[str, ErrorRatio]

    def named(self, status: str) -> list[str]:
        """Points and runs that ended so."""
        places = np.argwhere(self.status == status)
        return [f"{self.grid.points[p].label} {self.grid.runs[r]}" for p, r in places]


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
    load_one = partial(
        load_config, find_source(source, "compare"), "compare", seed=seed, controllers=controllers
    )
    base = load_one(overrides=changes)
    points = []
    for places in product(*(range(len(values)) for values in values_of.values())):
        chosen = {key: values_of[key][place] for key, place in zip(values_of, places, strict=True)}
        label = " ".join(f"{key}={text_of(value)}" for key, value in chosen.items())
        changed = _following_step(chosen, base.config.sampling_period.unit) | chosen
        try:
            loaded = load_one(overrides=[*changes, *(override(key, value) for key, value in changed.items())])
            points.append(Point(label, chosen, [*places], loaded, all_loops(loaded)))
        except ConfigError as error:
            raise ConfigError(str(error), where=f"{OPTION} {label}") from None
    _check_comparable(points)
    words = _words_of(over)
    base = replace(
        base,
        sha256=config_digest({"over": words, "points": [point.loaded.sha256 for point in points]}),
        inputs=tuple(dict.fromkeys(path for point in points for path in point.loaded.inputs)),
        # Of a key that is read at one point, the sweep shows what it does.
        remarks=tuple(
            words for words in base.remarks if all(words in point.loaded.remarks for point in points)
        ),
    )
    config = points[0].loaded.config
    n, total = len(config.joints), config.manipulator.joints
    axes = [
        Axis(key, values, unit_of(key, base.tree), numbers_per_joint(values, n, total))
        for key, values in values_of.items()
    ]
    return Grid(base, words, axes, points)


def _check_comparable(points: Sequence[Point]) -> None:
    if len({(tuple(point.loaded.config.joints), tuple(point.loops)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    if any(errors_from(point.loaded.config) > 0.0 for point in points):
        hint = "say --set errors_from=0, or run compare for each value"
        raise UsageError("a sweep averages whole runs, so errors_from must be 0", where=OPTION, hint=hint)


def parse_over(over: SweptValues) -> dict[str, list[Node]]:
    """Values by key; a UsageError where it is not over one or two keys."""
    if isinstance(over, Mapping):
        pairs = [(key, _checked(str(key), override(key, values).value)) for key, values in over.items()]
    else:
        pairs = [_parsed(text) for text in over]
    values_of = dict(pairs)
    if not 1 <= len(values_of) == len(pairs) <= 2:
        message = f"a sweep is over one or two keys, each given once, not {len(pairs)}"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    return values_of


def _parsed(text: str) -> tuple[str, list[Node]]:
    key, equals, listed = text.partition("=")
    key = key.strip()
    return key, _checked(text, load(f"[{listed}]", f"{OPTION} {key}") if equals else None)


def _checked(text: str, values: Node) -> list[Node]:
    if not isinstance(values, list) or len(values) < 2:
        message = f"{text!r} is not of the form key=a,b,c with two values or more"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    return values


def _words_of(over: SweptValues) -> list[str]:
    """What was asked for, as on the command line."""
    if not isinstance(over, Mapping):
        return list(over)
    return [f"{key}={','.join(map(text_of, values))}" for key, values in parse_over(over).items()]


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


def simulate(grid: Grid, talk: Talk) -> Sweep:
    """Simulate every run of every point."""
    total = sum(len(point.loops) for point in grid.points)
    with talk.bar(f"simulating {count_of(total, 'run')}", total) as progress:
        batches = [simulate_batch([*point.loops.values()], progress=progress) for point in grid.points]
    status = np.array(STATUSES)[np.array([batch.status for batch in batches])]

    def stacked(name: str) -> Array:
        return np.stack([batch.statistics[name] for batch in batches])

    sizes = {name: np.rad2deg(stacked(statistic)) for name, statistic in IN_DEGREES.items()}
    return Sweep(
        grid=grid,
        status=status,
        status_time=np.array([batch.status_time for batch in batches]),
        steps=np.array([batch.steps for batch in batches]),
        sizes=sizes | {name: stacked(name) for name in IN_SI},
        ratios={
            pair: ErrorRatio(
                ratio_of(sizes["mae_deg"], status, [grid.runs.index(run) for run in both]),
                np.array([_predicted(point, both) for point in grid.points]),
            )
            for pair, both in PAIRS.items()
            if set(both) <= set(grid.runs)
        },
    )


def ratio_of(mae: Array, status: Statuses, pair: Sequence[int]) -> Array:
    """Ratio (P, n) of MAE (P, R, n) of two of the runs, NaN where one of them did not last."""
    first, second = (mae[:, run] for run in pair)
    lasted = np.isin(status[:, pair], ("ok", "ringing")).all(axis=1, keepdims=True)
    unknown = np.full_like(first, np.nan)
    return np.divide(first, second, out=unknown, where=(second > 0.0) & lasted)


def _predicted(point: Point, pair: Sequence[str]) -> Array:
    """Ratio of two runs' errors under a slow load, (n,)."""
    config = point.loaded.config
    assert isinstance(config, CompareConfig)
    return slow_error_ratio(config, [config.runs[run].law for run in pair])
