"""Values of one or two keys on the command line, and the configurations they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from tendonrepro.config.draft import ConfigSource, Draft
from tendonrepro.config.fields.strict_yaml import Node
from tendonrepro.config.load import CompareConfig, LoadedConfig
from tendonrepro.config.models.reference import Sampled
from tendonrepro.config.overrides import Override, parse_override
from tendonrepro.errors import ConfigError, UsageError

MOST_KEYS = 2
OPTION = "--over"

_PERIOD = "sampling_period"
_STEP = "solver.max_step"
_FOLLOWING = f"{OPTION} {_STEP} follows"
_DRAFTED = "configuration"
_BRACKETS = {"[": "]", "{": "}"}


@dataclass(frozen=True)
class Axis:
    """A key and the values it takes.

    Attributes
    ----------
    key : str
        Dotted.
    texts : tuple of str
        The values as written.
    overrides : tuple of Override
        One per value.
    """

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
    """One configuration of a sweep.

    Attributes
    ----------
    places : tuple of int
        Index of each key's value.
    config : CompareConfig
    inputs : tuple of Path
        Files it names besides those of the unchanged configuration.
    """

    places: tuple[int, ...]
    config: CompareConfig
    inputs: tuple[Path, ...]


def parse_over(over: Sequence[str], taken: Sequence[str] = ()) -> tuple[Axis, ...]:
    """Read ``key=a,b,c``, once or twice.

    Parameters
    ----------
    over : sequence of str
        A comma inside brackets or quotes does not part two values.
    taken : sequence of str
        Keys that another option sets already.

    Returns
    -------
    tuple of Axis

    Raises
    ------
    UsageError
        When the form is wrong, or a key or value is given twice.
    ConfigError
        When a value is not YAML.
    """
    if not 1 <= len(over) <= MOST_KEYS:
        message = f"a sweep is over one or two keys, not {len(over)}"
        raise UsageError(message, where=OPTION, hint="For example --over sampling_period=0.5,1,2")
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
    key = key.strip()
    texts = split_values(listed)
    if not equals or not all(key.split(".")) or not all(texts):
        message = f"{text!r} is not of the form key=a,b,c"
        raise UsageError(message, where=OPTION, hint="For example --over sampling_period=0.5,1,2")
    twice = next((value for value in texts if texts.count(value) > 1), None)
    if twice is not None or len(texts) == 1:
        message = "needs at least two values" if twice is None else f"the value {twice} is given twice"
        hint = f"For one value use --set {text}" if twice is None else None
        raise UsageError(message, where=f"{OPTION} {key}", hint=hint)
    return Axis(key, tuple(texts), tuple(_override(key, value) for value in texts))


def _override(key: str, value: str) -> Override:
    text = f"{key}={value}"
    try:
        return parse_override(text)
    except ConfigError as error:
        raise ConfigError(error.message, where=f"{OPTION} {text}", hint=error.hint) from error


def split_values(text: str) -> list[str]:
    """Split at the commas outside brackets and quotes.

    Parameters
    ----------
    text : str

    Returns
    -------
    list of str
        Without the space around them.
    """
    values, open_brackets, quote = [""], [], ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter in _BRACKETS:
            open_brackets.append(_BRACKETS[letter])
        elif open_brackets and letter == open_brackets[-1]:
            open_brackets.pop()
        elif letter == "," and not open_brackets:
            values.append("")
            continue
        values[-1] += letter
    return [value.strip() for value in values]


@dataclass
class _Mistakes:
    """Mistakes of all points, each with the values it belongs to."""

    axes: Sequence[Axis]
    at_value: dict[tuple[str, str], None] = field(default_factory=dict)
    elsewhere: dict[str, list[tuple[int, ...]]] = field(default_factory=dict)

    def note(self, places: tuple[int, ...], error: ConfigError) -> None:
        """Take a point's mistakes apart, line by line."""
        lines = error.message.splitlines()
        for line in lines[1:] if len(lines) > 1 else [f"{error.where}: {error.message}"]:
            where, _, words = line.partition(": ")
            guilty = [
                axis.option(place)
                for axis, place in zip(self.axes, places, strict=True)
                if axis.overrides[place].option == where
            ]
            if guilty:
                self.at_value[guilty[0], words] = None
            elif where != _FOLLOWING:
                self.elsewhere.setdefault(words if _DRAFTED in where else line, []).append(places)

    def raise_if_any(self) -> None:
        """Raise all of them together."""
        lines = [f"{OPTION} {option}: {words}" for option, words in self.at_value]
        lines += [f"{OPTION} {self._common(found)}: {words}" for words, found in self.elsewhere.items()]
        if lines:
            count = "1 mistake" if len(lines) == 1 else f"{len(lines)} mistakes"
            raise ConfigError("\n".join([f"{count} in the values", *lines]))

    def _common(self, found: Sequence[tuple[int, ...]]) -> str:
        """The value that all points with a mistake share, or else the first of these points."""
        shared = [
            axis.option(places[0])
            for axis, places in zip(self.axes, zip(*found, strict=True), strict=True)
            if len(set(places)) == 1
        ]
        first = (axis.option(place) for axis, place in zip(self.axes, found[0], strict=True))
        return " ".join(shared or first)


def sweep_points(base: LoadedConfig, axes: Sequence[Axis]) -> list[Point]:
    """Make and validate the configurations of a sweep.

    Parameters
    ----------
    base : LoadedConfig
        What every point starts from.
    axes : sequence of Axis

    Returns
    -------
    list of Point
        The last key's values change fastest.

    Raises
    ------
    ConfigError
        With the mistakes of every value that is wrong.
    UsageError
        When points differ in joints or in the names of their runs.
    """
    source = ConfigSource(base.yaml_text, _DRAFTED, _DRAFTED, base.folder, ())
    mistakes, points = _Mistakes(axes), []
    for places in product(*(range(len(axis.texts)) for axis in axes)):
        try:
            points.append(_point(source, base, axes, places))
        except ConfigError as error:
            mistakes.note(places, error)
    mistakes.raise_if_any()
    if len({(tuple(point.config.joints), tuple(point.config.runs)) for point in points}) > 1:
        message = "all points of a sweep must move the same joints and have the same runs"
        raise UsageError(message, where=OPTION)
    return points


def _point(
    source: ConfigSource,
    base: LoadedConfig,
    axes: Sequence[Axis],
    places: tuple[int, ...],
) -> Point:
    draft = Draft(source, "compare")
    changes = [axis.overrides[place] for axis, place in zip(axes, places, strict=True)]
    draft.apply([*_following_step(changes, base), *changes])
    config = draft.validate(CompareConfig)
    reference, files = config.reference, draft.files
    if isinstance(reference, Sampled):
        files = [*files, draft.existing_file(reference.file, ("reference", "file"))]
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


def unit_of(key: str, tree: Mapping[str, Node]) -> str | None:
    """Unit of the quantity that a key names or stands in; None where there is none.

    Parameters
    ----------
    key : str
    tree : mapping
        Of a configuration.
    """
    node: Node = dict(tree)
    unit: Node = None
    for part in (*key.split("."), None):
        if isinstance(node, dict) and "unit" in node and "value" in node:
            unit = node["unit"]
        if isinstance(node, dict) and part in node:
            node = node[str(part)]
        elif isinstance(node, list) and part is not None and part.isdecimal() and int(part) < len(node):
            node = node[int(part)]
        else:
            break
    return unit if isinstance(unit, str) else None


def numbers_per_joint(axis: Axis, joints: Sequence[int], total: int) -> list[list[float]] | None:
    """Place of every value on an axis of numbers, for each moving joint.

    Parameters
    ----------
    axis : Axis
    joints : sequence of int
        The joints that move.
    total : int
        Joints of the manipulator.

    Returns
    -------
    list of list of float, or None
        Per value, per joint; None where a value is no number and no list with an entry for each joint, or
        where two values are the same for a joint.
    """
    rows = [_per_joint(value, joints, total) for value in axis.values]
    found = [row for row in rows if row is not None]
    distinct = all(len(set(column)) == len(column) for column in zip(*found, strict=True))
    return found if len(found) == len(rows) and distinct else None


def _per_joint(value: Node, joints: Sequence[int], total: int) -> list[float] | None:
    if _is_number(value):
        return [float(value)] * len(joints)  # type: ignore[arg-type]
    if not isinstance(value, list) or not all(map(_is_number, value)):
        return None
    numbers = [float(entry) for entry in value]  # type: ignore[arg-type]
    if len(numbers) == len(joints):
        return numbers
    return [numbers[joint - 1] for joint in joints] if len(numbers) == total else None


def _is_number(value: Node) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)
