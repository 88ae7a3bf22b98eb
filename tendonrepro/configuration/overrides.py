"""New values of single keys, put into a document before validation."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeGuard

from tendonrepro.configuration.strict_yaml import Document, Key, Location, Node, Tree, holds, load
from tendonrepro.errors import ConfigError, UsageError, did_you_mean

COMMAND_LINE = "assumed: set on the command line"


class Override(NamedTuple):
    """A new value, and the words that a manifest keeps of it.

    A number in the path is an index of a list, from 0.
    """

    path: Key
    value: Node
    text: str


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
    return changes if seed is None else [*changes, override("seed", seed)]


def override(key: str, value: object) -> Override:
    """A value by dotted key; arrays become lists, and paths text."""
    plain = _plain(value)
    text = f"{key}={json.dumps(plain)}"
    return Override(_path(key, text), plain, text)


def _read(text: str) -> Override:
    key, equals, value = text.partition("=")
    path = _path(key if equals else "", text)
    return Override(path, load(value, _option(path)).tree, text)


def _path(key: str, text: str) -> Key:
    parts = key.strip().split(".")
    if not all(parts):
        message = f"{text!r} is not of the form key=VALUE"
        raise UsageError(message, where="--set", hint='For example --set "control.gains.lam=[8, 8]"')
    return tuple(int(part) if part.isdecimal() else part for part in parts)


def _plain(value: Any) -> Node:
    """A value as YAML has it."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, Path):
        return str(value)
    plain: Node = value.tolist() if hasattr(value, "tolist") else value
    return plain


def apply_overrides(document: Document, overrides: Iterable[Override]) -> None:
    """Set the values in place; a quantity whose value or unit is set says so in its source.

    Only the last part of a key may be new.
    """
    # A source given by hand must outlive the value it belongs to, whatever their order.
    for path, value, _ in sorted(overrides, key=lambda override: override.path[-1] == "source"):
        _apply(document, path, value)


def _apply(document: Document, path: Key, value: Node) -> None:
    option = _option(path)
    if not holds(document.tree, path[0]):
        _refuse_ending(document, path)
    nodes: list[Any] = [document.tree]
    for part in path[:-1]:
        nodes.append(_below(nodes[-1], part, option))
    node, last = nodes[-1], path[-1]
    if isinstance(node, dict):
        node.setdefault(last, None)
    current = _below(node, last, option)
    if _is_quantity(current) and not isinstance(value, dict):
        nodes.append(current)
        current["value"] = _for_all(current["value"], value)
    else:
        node[last] = _for_all(current, value)
    for part in nodes:
        if _is_quantity(part) and last != "source":
            part["source"] = COMMAND_LINE
    kept = {place: at for place, at in document.places.items() if place[: len(path)] != path}
    document.places = kept | {path: Location(option)}


def _refuse_ending(document: Document, path: Key) -> None:
    """Refuse a path that is only the end of others, and name these."""
    ending = [place for place in document.paths() if place[-len(path) :] == path]
    if ending:
        # Of many, a key inside something that is named after it: the payload of the run with payload.
        word = str(path[0])
        ending.sort(key=lambda place: not any(word in str(part) for part in place[: -len(path)]))
        meant = " or ".join(repr(_dotted(place)) for place in ending[:3])
        raise ConfigError(f"unknown key {_dotted(path)!r}, did you mean {meant}?", where=_option(path))


def _below(node: Any, part: str | int, option: str) -> Any:
    if holds(node, part):
        return node[part]
    if isinstance(node, dict):
        message = f"unknown key {str(part)!r}{did_you_mean(part, node)}"
    elif isinstance(node, list):
        message = f"no entry {part} in a list of {len(node)}; they are numbered from 0"
    else:
        message = f"nothing below it can be set: {part!r} is asked of a single value"
    raise ConfigError(message, where=option)


def _for_all(current: Node, value: Node) -> Node:
    """One number in place of many means all of them."""
    if isinstance(current, list) and {type(value), *map(type, current)} <= {int, float}:
        return [value] * len(current)
    return value


def _is_quantity(node: object) -> TypeGuard[Tree]:
    return isinstance(node, dict) and "value" in node and node.keys() <= {"value", "unit", "source"}


def _option(path: Key) -> str:
    return f"--set {_dotted(path)}"


def _dotted(path: Key) -> str:
    return ".".join(map(str, path))
