"""What stands over what before a configuration is checked: an option over a file, a file over its base."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypeGuard, TypeVar

from pydantic import ValidationError

from tendonrepro.arrays import Array
from tendonrepro.configuration import strict_yaml
from tendonrepro.configuration.models.manipulator import MOST_JOINTS, Links
from tendonrepro.configuration.strict_model import describe
from tendonrepro.configuration.strict_yaml import Items, Key, Location, Map, Node, Parsed
from tendonrepro.errors import ConfigError, UsageError, did_you_mean

FILES = ("manipulator", "base", "file")
"""Keys that name files; a name that an option gives is looked for in the current folder first."""

COMMAND_LINE = "assumed: set on the command line"
USER = "user: given without a source"

Item = TypeVar("Item")


class Override(NamedTuple):
    """A new value, the words that a manifest keeps of it, and the `option` that messages call it.

    A number in the path is an index of a list, from 0.
    """

    path: Key
    value: Node
    text: str
    option: str


Overrides: TypeAlias = Sequence[str | Override] | Mapping[str, object]
"""Texts ``dotted.key=VALUE`` as of the command line, VALUE in YAML; or values by dotted key, as of Python."""


def overrides_of(given: Overrides | None, seed: int | None = None) -> list[Override]:
    """Read overrides, that of the seed behind the others.

    Raises
    ------
    UsageError, ConfigError
        For a text that is not of the form, or whose value is no YAML.
    """
    if isinstance(given, Mapping):
        changes = [override(key, value) for key, value in given.items()]
    else:
        changes = [_read(text) if isinstance(text, str) else text for text in given or ()]
    return changes if seed is None else [*changes, override("seed", seed)._replace(option="--seed")]


def override(key: str, value: object) -> Override:
    """A value by dotted key; arrays become lists, and paths text."""
    told = json.dumps(value, default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x))
    return _read(f"{key}={told}", json.loads(told))


def _read(text: str, known: Node | None = None) -> Override:
    """An override from its text; its value is in YAML, unless it is `known`."""
    key, equals, value = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        message = f"{text!r} is not of the form key=VALUE"
        raise UsageError(message, where="--set", hint='For example --set "control.gains.lam=[8, 8]"')
    path = tuple(int(part) if part.isdecimal() else part for part in parts)
    option = f"--set {_dotted(path)}"
    return Override(path, strict_yaml.load(value, option) if known is None else known, text, option)


def split(changes: Sequence[Override], key: str) -> tuple[list[Override], list[Override]]:
    """Changes inside a key, as seen from there, and the others."""
    inner = [change for change in changes if change.path[0] == key and len(change.path) > 1]
    others = [change for change in changes if change not in inner]
    return [change._replace(path=change.path[1:]) for change in inner], others


def apply_overrides(tree: Map, overrides: Iterable[Override]) -> None:
    """Set the values in place; a quantity whose value or unit is set says so in its source.

    Only the last part of a key may be new.
    """
    # A source given by hand must outlive the value it belongs to, whatever their order.
    for change in sorted(overrides, key=lambda override: override.path[-1] == "source"):
        _apply(tree, change)


def _apply(tree: Map, change: Override) -> None:
    if change.path[0] not in tree:
        _refuse_ending(tree, change)
    nodes: list[Parsed] = [tree]
    for part in change.path[:-1]:
        nodes.append(_below(nodes[-1], part, change))
    node, last = nodes[-1], change.path[-1]
    if isinstance(node, dict) and isinstance(last, str):
        node.setdefault(last, None)
    current, here = _below(node, last, change), Location(change.option)
    value = _found_here(last, change.value)
    if is_quantity(current) and not isinstance(value, dict):
        nodes.append(current)
        node, last, current = current, "value", current["value"]
    if isinstance(current, list) and {type(value), *map(type, current)} <= {int, float}:
        value = [value] * len(current)  # one number in place of many means all of them
    node[last], node.at[last] = strict_yaml.located(value, here), here
    for part in nodes:
        if is_quantity(part) and change.path[-1] != "source":
            part["source"] = COMMAND_LINE


def _refuse_ending(tree: Map, change: Override) -> None:
    """Refuse a path that is only the end of others, and name these; it may lack the value of a quantity."""
    asked = [part for part in change.path if part != "value"]
    ending = [
        path
        for path in strict_yaml.paths(tree)
        if path[-1] == change.path[-1] and [part for part in path if part != "value"][-len(asked) :] == asked
    ]
    if ending:
        name = change.option.removeprefix("--set ")
        above = name.removesuffix(_dotted(change.path))  # of a change inside an arm: its key
        meant = " or ".join(repr(above + _dotted(path)) for path in ending[:4])
        raise ConfigError(f"unknown key {name!r}, did you mean {meant}?", where=change.option)


def _below(node: Parsed, part: str | int, change: Override) -> Parsed:
    if strict_yaml.holds(node, part):
        return node[part]
    if isinstance(node, dict):
        is_entry = isinstance(part, int) and is_quantity(node)
        meant = f", did you mean 'value.{part}'?" if is_entry else did_you_mean(part, node)
        message = f"unknown key {str(part)!r}{meant}"
    elif isinstance(node, list):
        message = f"no entry {part} in a list of {len(node)}; they are numbered from 0"
    else:
        message = f"nothing below it can be set: {part!r} is asked of a single value"
    raise ConfigError(message, where=change.option)


def _found_here(key: str | int, value: Node) -> Node:
    """A value in which files that the current folder has, as an arm or a motion, have their whole path."""
    if isinstance(value, dict):
        return {name: _found_here(name, inner) for name, inner in value.items()}
    is_here = key in FILES and isinstance(value, str) and Path(value).is_file()
    return str(Path.cwd() / str(value)) if is_here else value


def is_quantity(node: object) -> TypeGuard[Map]:
    """Whether a node is a value with its unit and source."""
    return isinstance(node, dict) and "value" in node and node.keys() <= {"value", "unit", "source"}


def _dotted(path: Key) -> str:
    return ".".join(map(str, path))


def complete_experiment(tree: Map, base: Map, base_name: str) -> None:
    """Complete an experiment from another one, with as many entries as joints move, in place.

    Its arm is known, or the base's stays out of it.
    """
    moving = len(joints) if isinstance(joints := tree.get("joints"), list) else 0
    winches = strict_yaml.entry(tree, ("manipulator", "routing", "winch_diameter", "value"))
    arm = len(winches) if isinstance(winches, list) else 0
    mark = f"assumed: from {base_name}, for as many joints as there are here"
    like = Map(
        (key, _fitted(value, arm if key == "posture" else moving, mark))
        for key, value in base.items()
        if key != "manipulator"
    ).placed(base.here, base.at)
    if isinstance(tree.get("runs"), Map) and isinstance(runs := like.get("runs"), Map) and runs:
        # A new run is like the base's first one.
        first = next(iter(runs.values()))
        like["runs"] = Map((name, runs.get(name, first)) for name in tree["runs"]).placed(runs.here, {})
    _complete(tree, like)


def complete_arm(arm: Map, base: Map, base_name: str, changes: Iterable[Override] = ()) -> None:
    """Complete a manipulator from the whole tree of another one, and make changes, in place.

    Bare numbers take the base's units, and one number stands for all joints.
    """
    n = arm.pop("joints", len(base["routing"]["winch_diameter"]["value"]))
    if type(n) is not int or not 1 <= n <= MOST_JOINTS:
        words = f"joints: must be a whole number from 1 to {MOST_JOINTS}, found {describe(n)}"
        raise ConfigError(words, where=str(arm.at["joints"]))
    given = {*links} if isinstance(links := arm.get("links"), Map) else set()
    _complete(arm, _fitted(base, n, f"assumed: from {base_name}", all_marked=True))
    changes = [*changes]
    apply_overrides(arm, changes)
    given |= {str(change.path[1]) for change in changes if change.path[0] == "links" and change.path[1:]}
    _follow(arm, base, base_name, given)


def _fitted(base: Parsed, n: int, mark: str, *, all_marked: bool = False) -> Parsed:
    """What a base has, its lists of numbers with n entries, or as they are where n is 0.

    `mark` is the source of what changed its length, or of all.
    """
    if not isinstance(base, Map):
        return base
    if not is_quantity(base):
        inner = {
            key: _fitted(value, 0 if key == "band" else n, mark, all_marked=all_marked)
            for key, value in base.items()
        }
        return Map(inner).placed(base.here, base.at)
    value = base["value"]
    if n and isinstance(value, list) and value:
        resized = _extended_matrix(value, n) if isinstance(value[0], list) else _extended(value, n)
        value = strict_yaml.located(resized, base.at["value"])
    source = {"source": mark} if all_marked or value != base["value"] else {}
    return Map(base | {"value": value} | source).placed(base.here, base.at)


def _extended(values: Sequence[Item], n: int) -> list[Item]:
    """Entries of n joints from those of other ones: the first n, or the last one repeated."""
    return [values[min(i, len(values) - 1)] for i in range(n)]


def _extended_matrix(rows: Sequence[Sequence[Item]], n: int) -> list[list[Item | int]]:
    """Rows of n joints from those of other ones.

    What a further tendon does is what the base's last one does: on the joint where it ends, and on those that
    it passes.
    """
    last = len(rows) - 1

    def entry(p: int, q: int) -> Item | int:
        if p == q:
            return rows[min(p, last)][min(p, last)]
        return rows[min(p, max(last - 1, 0))][min(q, last)] if p < q else 0

    return [[entry(p, q) for q in range(n)] for p in range(n)]


def _complete(own: Map, base: Map, path: Key = ()) -> None:
    """Give a section what it leaves to its base: keys, and of bare numbers unit and source.

    Sections with a ``kind``, laws and runs say all of themselves, though their numbers may stand alone: what
    else is left out there has a meaning, as no such law, no start offset, joints that move at once.
    """
    is_whole = path == ("control", "laws") or path[:1] == ("runs",) or (path and "kind" in own)
    for key, theirs in base.items():
        if key in own:
            own[key] = _completed(own[key], theirs, own.at[key], (*path, key))
        elif not is_whole:
            own[key], own.at[key] = theirs, base.at[key]


def _completed(value: Parsed, base: Parsed, here: Location, path: Key) -> Parsed:
    """What a file says of a key of its base: a section, or a quantity, one number for all of its entries."""
    if isinstance(base, Map) and isinstance(value, Map) and not is_quantity(base):
        _complete(value, base, path)
    if not is_quantity(base):
        return value
    if type(value) in (int, float, Items):
        value = Map(value=value).placed(here, {"value": here})
    if isinstance(value, Map) and "value" in value:
        number, like = value["value"], base["value"]
        if type(number) in (int, float) and isinstance(like, list) and like:
            # In a matrix, on the diagonal and above: no tendon passes the joints after its own.
            rows = [[number if q >= p else 0 for q in range(len(like))] for p in range(len(like))]
            alike = rows if isinstance(like[0], list) else [number] * len(like)
            value["value"] = strict_yaml.located(alike, value.at["value"])
        value.setdefault("unit", base.get("unit"))
        value.setdefault("source", USER)
    return value


def _follow(arm: Map, base: Map, base_name: str, given: set[str]) -> None:
    """Let centres of mass and inertias that are not `given` follow lengths and masses that are.

    A centre of mass keeps the base's share of the length, an inertia its share of m l².
    """
    try:
        own, theirs = (Links.model_validate(tree["links"]) for tree in (arm, base))
    except ValidationError:
        return  # the arm will be validated, which says what is wrong
    if not given & {"length", "mass"} or len(own.length.si) != len(own.mass.si):
        return
    followed = {
        "com": ("m", "the length", theirs.com.si / theirs.length.si, own.length.si),
        "inertia": ("kg m2", "m l^2", theirs.inertia.si / _ml2(theirs), _ml2(own)),
    }
    for key in [key for key in followed if key not in given]:
        unit, words, of_base, sizes = followed[key]
        shares = _extended(of_base.tolist(), len(sizes))
        value = [float(f"{share * size:.12g}") for share, size in zip(shares, sizes.tolist(), strict=True)]
        told = ", ".join(dict.fromkeys(f"{share:.3g}" for share in shares))
        source = f"assumed: {told} of {words}, as in {base_name}"
        arm["links"][key] = strict_yaml.located({"value": value, "unit": unit, "source": source}, arm.here)


def _ml2(links: Links) -> Array:
    return links.mass.si * links.length.si**2
