"""YAML without surprises: numbers are numbers, keys are unique, every entry knows its line.

A small subset of YAML 1.2 is read: mappings, lists and scalars. Whatever lets a text mean something other
than it shows is an error (aliases, tags, merge keys) or stays text (``on`` as a boolean, ``1:30`` as ninety).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

import yaml

from tendonrepro.errors import ConfigError

Node: TypeAlias = "dict[str, Node] | list[Node] | str | int | float | bool | None"
Key: TypeAlias = tuple[str | int, ...]
Position: TypeAlias = tuple[int, int]

MAX_BYTES = 1 << 20
MAX_DEPTH = 32
MAX_DIGITS = 300  # the largest float has 309 digits before the point

_CONSTANTS: Mapping[str, bool | None] = {
    "null": None, "Null": None, "NULL": None, "~": None, "": None,
    "true": True, "True": True, "TRUE": True,
    "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")

_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "seq", "map")}  # of nodes that carry none

# The base loaders leave every scalar as text. libyaml's is several times faster.
_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)


@dataclass(frozen=True)
class Document:
    """One YAML text as plain Python values, with the line and column (from 1) of every key and list item.

    `name` is what messages call the text, usually the file's path.
    """

    tree: Node
    name: str
    positions: Mapping[Key, Position]

    def line(self, path: Key) -> int:
        """Line of an entry, or of its nearest ancestor that is written in the text."""
        while path not in self.positions:
            path = path[:-1]
        return self.positions[path][0]

    def where(self, path: Key) -> str:
        """Place of an entry as ``name:line``."""
        return f"{self.name}:{self.line(path)}"


def read_text(path: Path, hint: str | None = None) -> str:
    """Read a YAML file of at most 1 MiB as UTF-8 text; the hint is said besides when there is no such file.

    Raises
    ------
    ConfigError
        When the file is missing, a folder, unreadable, too large, binary or not UTF-8.
    """
    name = str(path)
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        _fail("no such file", name, hint)
    except OSError as error:
        is_folder = "is a folder, not a YAML file"
        _fail(is_folder if _is_folder(path) else f"cannot be read ({error.strerror or error})", name)
    except ValueError as error:  # a NUL inside the path
        _fail(f"is not a usable path ({error})", repr(name))
    return decode(raw, name)


def _is_folder(path: Path) -> bool:
    # Systems disagree on the error of opening a folder, and even asking may be forbidden.
    with suppress(OSError):
        return path.is_dir()
    return False


def decode(raw: bytes, name: str) -> str:
    """Turn the bytes of a YAML text into a string; the limits are those of `read_text`."""
    if len(raw) > MAX_BYTES:
        hint = "Samples of a motion stand in a file of their own: reference: {kind: sampled, file: FILE.csv}."
        _fail("is larger than 1 MiB, so it is not a configuration", name, hint)
    if b"\0" in raw:
        _fail("is a binary file, not YAML text", name)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        _fail("is not UTF-8 text", f"{name}:{line}")


def load(text: str, name: str) -> Document:
    """Read one YAML document; messages call it `name`.

    Raises
    ------
    ConfigError
        With ``name:line:column``, for a syntax error and for everything this subset leaves out: duplicate
        keys, anchors, aliases, tags, merge keys, several documents, numbers that are not finite, more than
        32 levels.
    """
    try:
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = name if mark is None else _at(name, mark)
        context = f" {error.context}" if error.context else ""
        colon = "mapping values are not allowed" in (error.problem or "")
        hint = "Text that contains ': ' must be in quotes." if colon else None
        _fail(f"not valid YAML: {error.problem}{context}", where, hint)
    except (yaml.reader.ReaderError, UnicodeEncodeError):
        _fail("contains control characters, so it is not YAML text", name)
    if root is None or root.start_mark.index == root.end_mark.index:
        _fail("is empty", name)
    reader = _Reader(name)
    return Document(reader.node(root, ()), name, reader.positions)


def dump(tree: Node, *, line_by_line: bool = False) -> str:
    """Write a tree as YAML that `load` reads back to equal values; keys stay in order.

    `line_by_line` gives every entry one line of its own, which can be deleted; else the innermost share one.
    """
    width, flow = (math.inf, False) if line_by_line else (110, None)
    text: str = yaml.dump(
        tree, Dumper=_Dumper, sort_keys=False, default_flow_style=flow, allow_unicode=True, width=width
    )
    return text


class _Reader:
    """Makes plain values of YAML nodes, noting where every entry begins."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._seen: set[int] = set()
        self.positions: dict[Key, Position] = {}

    def node(self, node: yaml.Node, path: Key) -> Node:
        """Plain value of a node; an entry of a mapping has its position already, that of its key."""
        self._check(node, path)
        mark = node.start_mark
        self.positions.setdefault(path, (mark.line + 1, mark.column + 1))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path)
        if isinstance(node, yaml.SequenceNode):
            return [self.node(item, (*path, i)) for i, item in enumerate(node.value)]
        assert isinstance(node, yaml.ScalarNode)
        return self._scalar(node)

    def _check(self, node: yaml.Node, path: Key) -> None:
        if id(node) in self._seen:
            self._refuse("anchors and aliases (&, *) are not read here; write the value out", node)
        self._seen.add(id(node))
        if node.tag not in _TAGS:
            self._refuse(f"tags are not read here; leave out {node.tag!r}", node)
        if len(path) > MAX_DEPTH:
            self._refuse(f"nested more than {MAX_DEPTH} levels deep", node)

    def _mapping(self, mapping: yaml.MappingNode, path: Key) -> dict[str, Node]:
        tree: dict[str, Node] = {}
        for key_node, item in mapping.value:
            key = key_node.value
            if not isinstance(key_node, yaml.ScalarNode) or not key:
                self._refuse("a key must be a word", key_node)
            if key == "<<" and not key_node.style:
                self._refuse("merge keys (<<) are not read here; write the entries out", key_node)
            if key in tree:
                first = self.positions[*path, key][0]
                self._refuse(f"key {key!r} is given twice, first on line {first}", key_node)
            mark = key_node.start_mark
            self.positions[*path, key] = mark.line + 1, mark.column + 1
            tree[key] = self.node(item, (*path, key))
        return tree

    def _scalar(self, node: yaml.ScalarNode) -> Node:
        text: str = node.value
        if node.style:
            if "\0" in text:
                self._refuse("the text holds a NUL character, which the result files cannot store", node)
            return text
        if _NOT_FINITE.fullmatch(text):
            self._refuse(f"{text} is not a finite number", node)
        value = _plain_value(text)
        too_large = isinstance(value, int) and len(text) > MAX_DIGITS
        if too_large or (isinstance(value, float) and not math.isfinite(value)):
            self._refuse(f"the number {text[:20]}{'...' if len(text) > 20 else ''} is too large", node)
        return value

    def _refuse(self, message: str, node: yaml.Node) -> NoReturn:
        _fail(message, _at(self._name, node.start_mark))


def _plain_value(text: str) -> Node:
    """Read an unquoted scalar; an integer is cut after `MAX_DIGITS`, where the caller refuses it."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text):
        return int(text[: MAX_DIGITS + 1])
    if _FLOAT.fullmatch(text):
        return float(text)
    return text


class _Dumper(yaml.SafeDumper):
    """Quotes what `load` would not read as text, and never writes aliases."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        return True


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    ambiguous = not isinstance(_plain_value(text), str) or _NOT_FINITE.fullmatch(text) or text == "<<"
    # Other quotes would fold line breaks that only some systems know, such as NEL.
    quoted = ambiguous or not text.isprintable()
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"' if quoted else None)


_Dumper.add_representer(str, _represent_text)


def _at(name: str, mark: Any) -> str:
    return f"{name}:{mark.line + 1}:{mark.column + 1}"


def _fail(message: str, where: str, hint: str | None = None) -> NoReturn:
    raise ConfigError(message, where=where, hint=hint) from None
