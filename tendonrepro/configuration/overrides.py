"""New values of single keys, put into a tree before validation."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias, TypeGuard

from tendonrepro.configuration import strict_yaml
from tendonrepro.configuration.strict_yaml import Key, Location, Map, Node, Parsed
from tendonrepro.errors import ConfigError, UsageError, did_you_mean

FILES = ("manipulator", "base", "file")
"""Keys that name files; a name that an option gives is looked for in the current folder first."""

COMMAND_LINE = "assumed: set on the command line"


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
    path = _path(key if equals else "", text)
    option = f"--set {_dotted(path)}"
    return Override(path, strict_yaml.load(value, option) if known is None else known, text, option)


def _path(key: str, text: str) -> Key:
    parts = key.strip().split(".")
    if not all(parts):
        message = f"{text!r} is not of the form key=VALUE"
        raise UsageError(message, where="--set", hint='For example --set "control.gains.lam=[8, 8]"')
    return tuple(int(part) if part.isdecimal() else part for part in parts)


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
    node[last], node.at[last] = strict_yaml.located(_for_all(current, value), here), here
    for part in nodes:
        if is_quantity(part) and change.path[-1] != "source":
            part["source"] = COMMAND_LINE


def _refuse_ending(tree: Map, change: Override) -> None:
    """Refuse a path that is only the end of others, and name these; it may lack the value of a quantity."""
    asked = _without_value(change.path)
    alike = [path for path in strict_yaml.paths(tree) if path[-1] == change.path[-1]]
    ending = [path for path in alike if _without_value(path)[-len(asked) :] == asked]
    if ending:
        # First a key inside something that is named after it: the payload of the run with payload.
        ending.sort(key=lambda path: not any(str(asked[0]) in str(part) for part in path[: -len(asked)]))
        meant = " or ".join(repr(_dotted(path)) for path in ending[:3])
        message = f"unknown key {_dotted(change.path)!r}, did you mean {meant}?"
        raise ConfigError(message, where=change.option)


def _without_value(path: Key) -> Key:
    return tuple(part for part in path if part != "value") or path


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


def _for_all(current: Node, value: Node) -> Node:
    """One number in place of many means all of them."""
    if isinstance(current, list) and {type(value), *map(type, current)} <= {int, float}:
        return [value] * len(current)
    return value


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
