"""Values of one or two keys on the command line, and the configurations they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from tendonrepro.configuration.fields.strict_yaml import Node, load
from tendonrepro.configuration.load import CompareConfig, ConfigSource, Draft, LoadedConfig
from tendonrepro.configuration.models.reference import Sampled
from tendonrepro.configuration.overrides import Override
from tendonrepro.errors import ConfigError, UsageError

MOST_KEYS = 2
OPTION = "--over"

_EXAMPLE = f"For example {OPTION} sampling_period=0.5,1,2"
_PERIOD = "sampling_period"
_STEP = "solver.max_step"
_FOLLOWING = f"{OPTION} {_STEP} follows"
_DRAFTED = "configuration"


@dataclass(frozen=True)
class Axis:
    """A dotted key, its values as written, and an override for each."""

    key: str
    texts: tuple[str, ...]
    overrides: tuple[Override, ...]

    @property
    def values(self) -> list[Node]:
        """The values, read as YAML."""
        return [override.value for override in self.overrides]

    def option(self, place: int) -> str:
        """One of the values as the command line spells it."""
        return f"{self.key}={self.texts[place]}"


@dataclass(frozen=True)
class Point:
    """One configuration: index of each key's value, and files it names besides those of the unchanged one."""

    places: tuple[int, ...]
    config: CompareConfig
    inputs: tuple[Path, ...]


def parse_over(over: Sequence[str], taken: Sequence[str] = ()) -> tuple[Axis, ...]:
    """Read ``key=a,b,c``, once or twice; keys that another option sets are `taken`."""
    if not 1 <= len(over) <= MOST_KEYS:
        message = f"a sweep is over one or two keys, not {len(over)}"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    axes = tuple(_axis(text) for text in over)
    if len({axis.key for axis in axes}) < len(axes):
        message = f"{axes[0].key} is given twice"
        raise UsageError(message, where=OPTION, hint="put all values behind one --over")
    for axis in axes:
        if axis.key in taken:
            message = f"{axis.key} is also set by --set or --seed"
            raise UsageError(message, where=OPTION, hint="leave one of them out")
    return axes


def _axis(text: str) -> Axis:
    key, equals, listed = text.partition("=")
    key, texts = key.strip(), split_values(listed)
    if not equals or not all(key.split(".")) or not all(texts):
        message = f"{text!r} is not of the form key=a,b,c"
        raise UsageError(message, where=OPTION, hint=_EXAMPLE)
    if len(texts) == 1:
        message = "needs at least two values"
        raise UsageError(message, where=f"{OPTION} {key}", hint=f"For one value use --set {text}")
    options = [f"{OPTION} {key}={value}" for value in texts]
    if len(set(options)) < len(options):
        twice = next(value for value in texts if texts.count(value) > 1)
        message = f"the value {twice} is given twice"
        raise UsageError(message, where=f"{OPTION} {key}")
    overrides = (
        Override(key, load(x, option).tree, option) for x, option in zip(texts, options, strict=True)
    )
    return Axis(key, tuple(texts), tuple(overrides))


def split_values(text: str) -> list[str]:
    """Split at the commas that part two YAML values; one inside brackets or quotes does not."""
    values: list[str] = []
    for piece in text.split(","):
        if values and values[-1].strip() and not _is_yaml(values[-1]):
            values[-1] += f",{piece}"
        else:
            values.append(piece)
    return [value.strip() for value in values]


def _is_yaml(text: str) -> bool:
    try:
        load(text, "")
    except ConfigError:
        return False
    return True


def sweep_points(base: LoadedConfig, axes: Sequence[Axis]) -> list[Point]:
    """Make and validate the configurations of a sweep; the last key's values change fastest.

    Every wrong value is named by one error; points that differ in joints or runs are refused.
    """
    source = ConfigSource(base.yaml_text, _DRAFTED, _DRAFTED, base.folder, ())
    points: list[Point] = []
    mistakes: dict[str, list[tuple[int, ...]]] = {}
    for places in product(*(range(len(axis.texts)) for axis in axes)):
        try:
            points.append(_point(source, base, axes, places))
        except ConfigError as error:
            # A validated configuration has a line for each mistake, below one that counts them.
            for line in error.message.splitlines()[1:] or [f"{error.where}: {error.message}"]:
                mistakes.setdefault(line, []).append(places)
    if mistakes:
        lines = [_blamed(axes, line, at) for line, at in mistakes.items() if not line.startswith(_FOLLOWING)]
        count = "1 mistake" if len(lines) == 1 else f"{len(lines)} mistakes"
        raise ConfigError("\n".join([f"{count} in the values", *lines]))
    if len({(tuple(point.config.joints), tuple(point.config.runs)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    return points


def _point(source: ConfigSource, base: LoadedConfig, axes: Sequence[Axis], places: tuple[int, ...]) -> Point:
    changes = [axis.overrides[place] for axis, place in zip(axes, places, strict=True)]
    draft = Draft(source, "compare", [*_following_step(changes, base), *changes])
    config = draft.validate(CompareConfig)
    reference, files = config.reference, draft.files
    if isinstance(reference, Sampled):
        files = [*files, draft.named_file(reference.file, "reference", "file", shipped=False)]
    return Point(places, config, tuple(files))


def _following_step(changes: Sequence[Override], base: LoadedConfig) -> list[Override]:
    """Let the other solver's longest step, which has to divide the sampling period, follow it."""
    if any(change.key.startswith(_STEP) for change in changes):
        return []
    period = next((c.value for c in changes if c.key in (_PERIOD, f"{_PERIOD}.value")), None)
    if isinstance(period, float | int):
        unit = base.config.sampling_period.unit
        period = {"value": period, "unit": unit, "source": "assumed: the sampling period"}
    return [Override(_STEP, period, _FOLLOWING)] if isinstance(period, dict) else []


def _blamed(axes: Sequence[Axis], line: str, found: Sequence[tuple[int, ...]]) -> str:
    """A mistake with its value: one that all points with it share, else the first point's."""
    if line.startswith(OPTION):
        return line
    shared = [
        axis.option(places[0])
        for axis, places in zip(axes, zip(*found, strict=True), strict=True)
        if len(set(places)) == 1
    ]
    first = [axis.option(place) for axis, place in zip(axes, found[0], strict=True)]
    where, _, words = line.partition(": ")
    return f"{OPTION} {' '.join(shared or first)}: {words if where.startswith(_DRAFTED) else line}"


def unit_of(key: str, tree: Mapping[str, Node]) -> str | None:
    """Unit of the quantity that a key names or stands in; None where there is none."""
    node: Node = dict(tree)
    unit: Node = None
    for part in (*key.split("."), ""):
        if isinstance(node, list):
            node = dict(zip(map(str, range(len(node))), node, strict=True))
        if not isinstance(node, dict):
            break
        unit = node["unit"] if "value" in node and "unit" in node else unit
        node = node.get(part)
    return unit if isinstance(unit, str) else None


def numbers_per_joint(axis: Axis, joints: Sequence[int], total: int) -> list[list[float]] | None:
    """Place of every value on an axis of numbers, for each of the moving joints of `total`.

    None where a value is no number and no list with an entry for each joint, or where two values are the
    same for a joint.
    """
    rows = [_per_joint(value, joints, total) for value in axis.values]
    found = [row for row in rows if row is not None]
    distinct = all(len(set(column)) == len(column) for column in zip(*found, strict=True))
    return found if len(found) == len(rows) and distinct else None


def _per_joint(value: Node, joints: Sequence[int], total: int) -> list[float] | None:
    entries = value if isinstance(value, list) else [value] * len(joints)
    numbers = [float(x) for x in entries if isinstance(x, float | int) and not isinstance(x, bool)]
    if len(numbers) < len(entries) or len(numbers) not in (len(joints), total):
        return None
    return numbers if len(numbers) == len(joints) else [numbers[joint - 1] for joint in joints]
