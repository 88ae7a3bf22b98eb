"""YAML 1.2 without surprises: ``on`` and ``1:30`` are text, keys are unique, entries know their line."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeAlias

import yaml

from tendonrepro.errors import ConfigError

Node: TypeAlias = "dict[str, Node] | list[Node] | str | int | float | bool | None"
"""A value as YAML and JSON have it."""
Tree: TypeAlias = dict[str, Node]
"""Values by their keys."""
Section: TypeAlias = dict[str, Any]
"""Part of a tree that is known to be sound; of many draws, with arrays as values."""
Key: TypeAlias = tuple[str | int, ...]

STDIN = "<stdin>"

_CONSTANTS: Mapping[str, bool | None] = {"null": None, "~": None, "": None, "true": True, "false": False}
_INTEGER = re.compile(r"[-+]?[0-9]{1,300}")  # what is longer is an infinite float
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")

# The base loaders leave every scalar as text. libyaml's is several times faster.
_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


class Location(NamedTuple):
    """File and line of an entry, or the option that gave it; places sort in reading order."""

    name: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.name}:{self.line}" if self.line else self.name


@dataclass
class Document:
    """A YAML text as plain Python values, with the place of every key and list item.

    The `tree` is whatever a user wrote, most often a `Tree`.
    """

    tree: Any
    places: dict[Key, Location]

    def place(self, path: Key) -> Location:
        """Place of an entry, or of its nearest ancestor in the text."""
        while path not in self.places:
            path = path[:-1]
        return self.places[path]

    def paths(self) -> list[Key]:
        """Paths of all entries, first those of the text, then what the tree has from elsewhere, as a base."""
        return list(dict.fromkeys((*self.places, *_paths(self.tree))))

    def places_below(self, path: Key) -> dict[Key, Location]:
        """Places of an entry and of what it holds, by the rest of their paths."""
        below = {at[len(path) :]: place for at, place in self.places.items() if at[: len(path)] == path}
        return {(): self.place(path)} | below


def is_yaml(path: Path) -> bool:
    """Whether a path is named as a file of YAML."""
    return path.suffix in {".yaml", ".yml"}


def _paths(node: object, above: Key = ()) -> Iterator[Key]:
    inner = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in inner:
        yield (*above, key)
        yield from _paths(value, (*above, key))


def read_text(path: Path | None, hint: str | None = None) -> str:
    """Read a file as UTF-8 text, None is standard input."""
    name = STDIN if path is None else str(path)
    try:
        raw = path.read_bytes() if path else sys.stdin.buffer.read()
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError("is not UTF-8 text", where=f"{name}:{line}") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL inside the path
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"cannot be read: {reason}", where=name, hint=hint) from None


def load(text: str, name: str) -> Document:
    """Read one YAML document, which messages call `name`."""
    try:
        root = yaml.compose(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: half of a surrogate pair
        problem = getattr(error, "problem", None) or "it contains control characters"
        hint = "Text that contains ': ' must be in quotes." if "mapping values" in problem else None
        _refuse(f"not valid YAML: {problem}", name, getattr(error, "problem_mark", None), hint)
    if root is None:
        raise ConfigError("is empty", where=name)
    places: dict[Key, Location] = {(): Location(name, root.start_mark.line + 1)}
    return Document(_value(root, (), places, name), places)


def dump(tree: Node) -> str:
    """Write a tree as YAML that `load` reads back; keys stay in order."""
    text: str = yaml.dump(
        tree, Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )
    return text


def section(tree: Tree, *path: str) -> Tree:
    """A mapping inside a tree that is known to be whole."""
    for key in path:
        inner = tree[key]
        assert isinstance(inner, dict)
        tree = inner
    return tree


def holds(node: object, key: str | int) -> bool:
    """Whether a mapping has a key, or a list an index."""
    is_index = isinstance(node, list) and isinstance(key, int) and 0 <= key < len(node)
    return is_index or (isinstance(node, dict) and key in node)


def _value(node: yaml.Node, path: Key, places: dict[Key, Location], name: str) -> Node:
    """Plain value of a node; places below it go into `places`."""
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style else _plain(node.value)
    if isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            places[*path, index] = Location(name, item.start_mark.line + 1)
        return [_value(item, (*path, index), places, name) for index, item in enumerate(node.value)]
    tree: dict[str, Node] = {}
    for key_node, item in node.value:
        key, mark = key_node.value, key_node.start_mark
        if not isinstance(key_node, yaml.ScalarNode):
            _refuse("a key must be a word", name, mark)
        if key in tree:
            first = places[*path, key].line
            _refuse(f"key {key!r} is given twice, first on line {first}", name, mark)
        places[*path, key] = Location(name, mark.line + 1)
        tree[key] = _value(item, (*path, key), places, name)
    return tree


def _plain(text: str) -> Node:
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _INTEGER.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text


class _Dumper(yaml.SafeDumper):
    """Quotes what `load` would not read as text, and never writes aliases."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(_plain(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _represent_text)


def _refuse(message: str, name: str, mark: yaml.Mark | None, hint: str | None = None) -> NoReturn:
    where = name if mark is None else f"{name}:{mark.line + 1}"
    raise ConfigError(message, where=where, hint=hint) from None
