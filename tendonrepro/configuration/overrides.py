"""Overrides from the command line: ``dotted.key=VALUE`` put into the tree before it is validated."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TypeGuard

from tendonrepro.configuration.fields.strict_yaml import Key, Node, load
from tendonrepro.configuration.messages import nearest
from tendonrepro.errors import ConfigError, UsageError

COMMAND_LINE = "assumed: set on the command line"
MOST_MEANT = 3
"""Keys that are suggested for one."""

_QUANTITY = {"value", "unit", "source"}


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
        """The key in parts; a number that no list is long enough for stays text."""
        numbers = "[0-9]{1,9}"
        return tuple(int(part) if re.fullmatch(numbers, part) else part for part in self.key.split("."))


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


def apply_overrides(tree: dict[str, Node], overrides: Iterable[Override]) -> None:
    """Set the values in place; a quantity whose value or unit is set says so in its source.

    Only the last part of a key may be new, so that optional keys can be given.
    """
    # A source given by hand must outlive the value it belongs to, whatever their order.
    for override in sorted(overrides, key=lambda override: override.path[-1] == "source"):
        _apply(tree, override)


def _apply(tree: dict[str, Node], override: Override) -> None:
    *parents, last = override.path
    if override.path[0] not in tree and (meant := list(islice(_ending(tree, override.path), MOST_MEANT))):
        message = f"unknown key {override.key!r}, did you mean {' or '.join(map(repr, meant))}?"
        raise ConfigError(message, where=override.option)
    node: Node = tree
    quantity: dict[str, Node] | None = None
    for part in parents:
        if _is_quantity(node):
            quantity = node
        node = _child(node, part, override)
    if _is_quantity(node):
        quantity = node
    _set(node, last, override)
    if quantity is not None and "source" not in override.path:
        quantity["source"] = COMMAND_LINE


def _ending(node: Node, end: Key, path: Key = ()) -> Iterator[str]:
    """Keys that end like one that begins too far down."""
    if path[-len(end) :] == end:
        yield ".".join(map(str, path))
    for key, below in node.items() if isinstance(node, dict) else ():
        yield from _ending(below, end, (*path, key))


def _child(node: Node, part: str | int, override: Override) -> Node:
    if isinstance(node, dict) and part in node:
        return node[str(part)]
    if isinstance(node, list) and isinstance(part, int) and part < len(node):
        return node[part]
    raise ConfigError(_unknown(node, part), where=override.option)


def _set(node: Node, last: str | int, override: Override) -> None:
    if isinstance(node, dict) and isinstance(last, str):
        current = node.get(last)
        if _is_quantity(current) and not isinstance(override.value, dict):
            current |= {"value": _for_all(current["value"], override.value), "source": COMMAND_LINE}
        else:
            node[last] = _for_all(current, override.value)
    elif isinstance(node, list) and isinstance(last, int) and last < len(node):
        node[last] = override.value
    else:
        raise ConfigError(_unknown(node, last), where=override.option)


def _for_all(current: Node, value: Node) -> Node:
    """One number in place of one a joint means all of them."""
    numbers = isinstance(current, list) and all(isinstance(one, int | float) for one in current)
    one = isinstance(value, int | float) and not isinstance(value, bool)
    return [value] * len(current) if numbers and one and isinstance(current, list) else value


def _unknown(node: Node, part: str | int) -> str:
    if isinstance(node, dict):
        meant = nearest(str(part), node)
        return f"unknown key {str(part)!r}" + ("" if meant is None else f", did you mean {meant!r}?")
    if isinstance(node, list):
        return f"no entry {part} in a list of {len(node)}; they are numbered from 0"
    return f"nothing below it can be set: {part!r} is asked of a single value"


def _is_quantity(node: Node) -> TypeGuard[dict[str, Node]]:
    return isinstance(node, dict) and "value" in node and set(node) <= _QUANTITY
