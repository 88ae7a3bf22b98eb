"""YAML 1.2 without surprises: ``on`` and ``1:30`` are text, keys are unique, entries know their line."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, Self, TypeAlias

import yaml

from tendonrepro.errors import ConfigError

Node: TypeAlias = "dict[str, Node] | list[Node] | str | int | float | bool | None"
"""A value as YAML and JSON have it."""
Tree: TypeAlias = dict[str, Any]
"""Values by their keys, as deep as they go."""
Key: TypeAlias = tuple[str | int, ...]

Parsed: TypeAlias = Any
"""What a file holds before it is checked: a `Map`, `Items` or a plain value."""

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


Places: TypeAlias = Mapping[Any, Location]
"""Places of entries, by key or index."""


class Branch:
    """A mapping or a list that knows where it was written, and where each of its entries was.

    What is taken from one tree into another, as from a base, so keeps its place.
    """

    here: Location
    at: dict[str | int, Location]

    def placed(self, here: Location, at: Places) -> Self:
        """Itself, with its place, and those of its entries by key or index."""
        self.here, self.at = here, dict(at)
        return self


class Map(Branch, dict[str, Any]):
    """A mapping with places."""


class Items(Branch, list[Any]):
    """A list with places."""


def located(value: Parsed, here: Location) -> Parsed:
    """Plain values, all at one place, as those of an option are."""
    if isinstance(value, dict):
        inner = {key: located(part, here) for key, part in value.items()}
        return Map(inner).placed(here, dict.fromkeys(value, here))
    if isinstance(value, list):
        items = Items(located(part, here) for part in value)
        return items.placed(here, dict.fromkeys(range(len(value)), here))
    return value


def place(tree: Parsed, path: Key, name: str) -> Location:
    """Place of an entry, or of its nearest ancestor that has one; a tree without places has its `name`."""
    here = tree.here if isinstance(tree, Branch) else Location(name)
    for key in path:
        if not isinstance(tree, Branch) or key not in tree.at:
            break
        here, tree = tree.at[key], entry(tree, (key,))
    return here


def entry(tree: Parsed, path: Iterable[str | int]) -> Parsed:
    """What stands at a path, None where nothing does."""
    for key in path:
        tree = tree[key] if holds(tree, key) else None
    return tree


def paths(node: Parsed, above: Key = ()) -> Iterator[Key]:
    """Paths of all entries of a tree."""
    inner = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in inner:
        yield (*above, key)
        yield from paths(value, (*above, key))


def is_yaml(path: Path) -> bool:
    """Whether a path is named as a file of YAML."""
    return path.suffix in {".yaml", ".yml"}


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


def load(text: str, name: str) -> Parsed:
    """Read one YAML document, which messages call `name`."""
    try:
        root = yaml.compose(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError) as error:  # ValueError: half of a surrogate pair
        problem = getattr(error, "problem", None) or "it contains control characters"
        hint = "Text that contains ': ' must be in quotes." if "mapping values" in problem else None
        # Of a bracket that nobody closes: where it was opened.
        is_open = "flow" in (getattr(error, "context", None) or "")
        mark = getattr(error, "context_mark" if is_open else "problem_mark", None)
        _refuse(f"not valid YAML: {problem}", name, mark, hint)
    if root is None:
        raise ConfigError("is empty", where=name)
    return _value(root, name, _location(name, root))


def dump(tree: Node) -> str:
    """Write a tree as YAML that `load` reads back; keys stay in order."""
    text: str = yaml.dump(
        tree, Dumper=_Dumper, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110
    )
    return text


def holds(node: object, key: str | int) -> bool:
    """Whether a mapping has a key, or a list an index."""
    is_index = isinstance(node, list) and isinstance(key, int) and 0 <= key < len(node)
    return is_index or (isinstance(node, dict) and key in node)


def _value(node: yaml.Node, name: str, here: Location) -> Parsed:
    """Value of a node at a place, with the places of what it holds."""
    if isinstance(node, yaml.ScalarNode):
        return node.value if node.style else _plain(node.value)
    if isinstance(node, yaml.SequenceNode):
        at = dict(enumerate(_location(name, item) for item in node.value))
        return Items(_value(item, name, at[index]) for index, item in enumerate(node.value)).placed(here, at)
    tree: Map = Map().placed(here, {})
    for key, item in node.value:
        if not isinstance(key, yaml.ScalarNode):
            _refuse("a key must be a word", name, key.start_mark)
        if key.value in tree:
            first = tree.at[key.value].line
            _refuse(f"key {key.value!r} is given twice, first on line {first}", name, key.start_mark)
        tree.at[key.value] = _location(name, key)
        tree[key.value] = _value(item, name, tree.at[key.value])
    return tree


def _location(name: str, node: yaml.Node) -> Location:
    return Location(name, node.start_mark.line + 1)


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

    def represent_text(self, text: str) -> yaml.ScalarNode:
        """As `load` reads it back."""
        style = None if isinstance(_plain(text), str) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _Dumper.represent_text)
_Dumper.add_representer(Map, _Dumper.represent_dict)
_Dumper.add_representer(Items, _Dumper.represent_list)


def _refuse(message: str, name: str, mark: yaml.Mark | None, hint: str | None = None) -> NoReturn:
    where = name if mark is None else f"{name}:{mark.line + 1}"
    raise ConfigError(message, where=where, hint=hint) from None
