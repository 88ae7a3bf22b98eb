"""Values of one or two keys on the command line, and the configurations they make."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

from tendonrepro.configuration.fields.strict_yaml import Node, load
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.simulation.stepper import Loop

MOST_KEYS = 2
OPTION = "--over"

_EXAMPLE = f"For example {OPTION} sampling_period=0.5,1,2"
_PERIOD, _STEP = "sampling_period", "solver.max_step"


Axes: TypeAlias = Mapping[str, Sequence[Node]]
"""Values by dotted key."""


@dataclass(frozen=True)
class Point:
    """One configuration of a sweep with its closed loops.

    `label` spells its values as the command line does; `places` is the index of each key's value.
    """

    label: str
    values: Mapping[str, Node]
    places: list[int]
    loaded: LoadedConfig
    loops: Mapping[str, Loop]


def parse_over(over: Sequence[str]) -> Axes:
    """Read ``key=a,b,c``, once or twice."""
    axes = dict(map(_axis, over))
    if not 1 <= len(axes) == len(over) <= MOST_KEYS:
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


def sweep_points(load_changed: Callable[[list[str]], LoadedConfig], axes: Axes) -> list[Point]:
    """Make the configurations of a sweep; the last key's values change fastest.

    `load_changed` loads one with overrides.

    Raises
    ------
    ConfigError
        If one of them cannot be used.
    UsageError
        If they differ in joints or runs.
    """
    unit = load_changed([]).config.sampling_period.unit
    points = []
    for numbered in product(*(enumerate(values) for values in axes.values())):
        values = {key: value for key, (_, value) in zip(axes, numbered, strict=True)}
        label = " ".join(f"{key}={text_of(value)}" for key, value in values.items())
        changed = _following_step(values, unit) | values
        try:
            loaded = load_changed([f"{key}={json.dumps(value)}" for key, value in changed.items()])
            loops = all_loops(loaded)
        except ConfigError as error:
            raise ConfigError(str(error), where=f"{OPTION} {label}") from None
        points.append(Point(label, values, [place for place, _ in numbered], loaded, loops))
    if len({(tuple(point.loaded.config.joints), tuple(point.loops)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    return points


def _following_step(chosen: Mapping[str, Node], unit: str) -> dict[str, Node]:
    """Let the other solver's longest step, which has to divide the sampling period, follow it."""
    if _PERIOD not in chosen or any(key.startswith(_STEP) for key in chosen):
        return {}
    period = chosen[_PERIOD]
    quantity: Node = {"value": period, "unit": unit, "source": "assumed: the sampling period"}
    return {_STEP: period if isinstance(period, dict) else quantity}


def unit_of(key: str, tree: Mapping[str, Node]) -> str | None:
    """Unit of the quantity that a key names or stands in; None where there is none."""
    node: Node = dict(tree)
    unit: Node = None
    for part in key.split("."):
        node = node.get(part) if isinstance(node, dict) else None
        unit = node.get("unit", unit) if isinstance(node, dict) else unit
    return unit if isinstance(unit, str) else None


def numbers_per_joint(values: Sequence[Node], n: int, total: int) -> list[list[float]] | None:
    """Place of every value on an axis of numbers, for each of the n moving joints, the last of `total`.

    None where a value is no number and no list with an entry for each joint, or where two values are the
    same for a joint.
    """
    rows = [value if isinstance(value, list) else [value] * n for value in values]
    numbers = [[float(x) for x in row if isinstance(x, float | int)][-n:] for row in rows]
    if any(len(row) not in (n, total) for row in rows) or any(len(row) < n for row in numbers):
        return None
    distinct = all(len(set(column)) == len(column) for column in zip(*numbers, strict=True))
    return numbers if distinct else None
