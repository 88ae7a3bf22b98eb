"""Overrides from the command line: ``dotted.key=VALUE`` put into a document before it is validated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tendonrepro.configuration.fields.strict_yaml import Document, Key, Node, Place, holds, load
from tendonrepro.configuration.messages import did_you_mean
from tendonrepro.errors import ConfigError, UsageError

COMMAND_LINE = "assumed: set on the command line"


@dataclass(frozen=True)
class Override:
    """One value given on the command line, read as YAML, with the option's spelling for messages.

    The key is a dotted path; a number in it is an index of a list, from 0.
    """

    key: str
    value: Node
    option: str

    @property
    def path(self) -> Key:
        """The key in parts."""
        return tuple(int(part) if part.isdecimal() else part for part in self.key.split("."))


def parse_override(text: str) -> Override:
    """Read ``key=VALUE``.

    Raises
    ------
    UsageError
        When there is no ``=`` or no key.
    ConfigError
        When VALUE is not YAML.
    """
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        message = f"{text!r} is not of the form key=VALUE"
        raise UsageError(message, where="--set", hint='For example --set "control.gains.lam=[8, 8]"')
    option = f"--set {key}"
    return Override(key, load(value, option).tree, option)


def apply_overrides(document: Document, overrides: Iterable[Override]) -> None:
    """Set the values in place; a quantity whose value or unit is set says so in its source.

    Only the last part of a key may be new, so that optional keys can be given.
    """
    # A source given by hand must outlive the value it belongs to, whatever their order.
    for override in sorted(overrides, key=lambda override: override.path[-1] == "source"):
        _apply(document, override)


def _apply(document: Document, override: Override) -> None:
    *parents, last = path = override.path
    ending = [place for place in document.places if place[-len(path) :] == path]
    if ending and not holds(document.tree, path[0]):
        meant = " or ".join(repr(".".join(map(str, place))) for place in ending[:3])
        message = f"unknown key {override.key!r}, did you mean {meant}?"
        raise ConfigError(message, where=override.option)
    nodes: list[Any] = [document.tree]
    for part in parents:
        nodes.append(_below(nodes[-1], part, override))
    node, new = nodes[-1], isinstance(nodes[-1], dict) and last not in nodes[-1]
    current: Any = None if new else _below(node, last, override)
    if _is_quantity(current) and not isinstance(override.value, dict):
        nodes.append(current)
        current["value"] = _for_all(current["value"], override.value)
    else:
        node[last] = _for_all(current, override.value)
    for held in nodes:
        if _is_quantity(held) and last != "source":
            held["source"] = COMMAND_LINE
    kept = {place: at for place, at in document.places.items() if place[: len(path)] != path}
    document.places = kept | {path: Place(override.option)}


def _below(node: Any, part: str | int, override: Override) -> Any:
    """Entry of a node, which must be there."""
    if holds(node, part):
        return node[part]
    if isinstance(node, dict):
        message = f"unknown key {str(part)!r}{did_you_mean(part, node)}"
    elif isinstance(node, list):
        message = f"no entry {part} in a list of {len(node)}; they are numbered from 0"
    else:
        message = f"nothing below it can be set: {part!r} is asked of a single value"
    raise ConfigError(message, where=override.option)


def _for_all(current: Node, value: Node) -> Node:
    """One number in place of one a joint means all of them."""
    numbers = isinstance(current, list) and all(isinstance(one, int | float) for one in current)
    one = isinstance(value, int | float) and not isinstance(value, bool)
    return [value] * len(current) if numbers and one and isinstance(current, list) else value


def _is_quantity(node: Any) -> bool:
    return isinstance(node, dict) and "value" in node and set(node) <= {"value", "unit", "source"}
