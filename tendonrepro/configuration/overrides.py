"""Overrides from the command line: ``dotted.key=VALUE`` put into a document before validation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

from tendonrepro.configuration.strict_yaml import Document, Key, Node, Place, holds, load
from tendonrepro.errors import ConfigError, UsageError, did_you_mean

COMMAND_LINE = "assumed: set on the command line"

Override: TypeAlias = tuple[Key, Node]
"""Where, and which value; a number in the path is an index of a list, from 0."""


def parse_override(text: str) -> Override:
    """Read ``key=VALUE``, VALUE in YAML; a UsageError or ConfigError where that fails."""
    key, equals, value = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        message = f"{text!r} is not of the form key=VALUE"
        raise UsageError(message, where="--set", hint='For example --set "control.gains.lam=[8, 8]"')
    path = tuple(int(part) if part.isdecimal() else part for part in parts)
    return path, load(value, _option(path)).tree


def apply_overrides(document: Document, overrides: Iterable[Override]) -> None:
    """Set the values in place; a quantity whose value or unit is set says so in its source.

    Only the last part of a key may be new.
    """
    # A source given by hand must outlive the value it belongs to, whatever their order.
    for path, value in sorted(overrides, key=lambda override: override[0][-1] == "source"):
        _apply(document, path, value)


def _apply(document: Document, path: Key, value: Node) -> None:
    option = _option(path)
    ending = [place for place in document.places if place[-len(path) :] == path]
    if ending and not holds(document.tree, path[0]):
        # Of many, a key inside something that is named after it: the payload of the run with payload.
        word = str(path[0])
        ending.sort(key=lambda place: not any(word in str(part) for part in place[: -len(path)]))
        meant = " or ".join(repr(_dotted(place)) for place in ending[:3])
        raise ConfigError(f"unknown key {_dotted(path)!r}, did you mean {meant}?", where=option)
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
    for held in nodes:
        if _is_quantity(held) and last != "source":
            held["source"] = COMMAND_LINE
    kept = {place: at for place, at in document.places.items() if place[: len(path)] != path}
    document.places = kept | {path: Place(option)}


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


def _is_quantity(node: Any) -> bool:
    return isinstance(node, dict) and "value" in node and node.keys() <= {"value", "unit", "source"}


def _option(path: Key) -> str:
    return f"--set {_dotted(path)}"


def _dotted(path: Key) -> str:
    return ".".join(map(str, path))
