"""Validation errors in the words of the configuration file, each with its line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import NamedTuple, TypeAlias

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from tendonrepro.configuration.fields.model import describe
from tendonrepro.configuration.fields.strict_yaml import Document, Key
from tendonrepro.errors import ConfigError


class Place(NamedTuple):
    """Where an entry stands: order of its file, the command line being first, line in it, and words for it.

    Places sort in reading order.
    """

    rank: int
    line: int
    text: str


MOST_NAMED = 20
"""Mistakes that a message names; the rest is counted."""

Locate: TypeAlias = Callable[[Key], Place]

_EXPECTED: Mapping[str, str] = {
    "model_type": "a mapping of keys",
    "model_attributes_type": "a mapping of keys",
    "dict_type": "a mapping of keys",
    "tuple_type": "a list",
    "string_type": "text",
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
}
_KEY = "[key]"  # pydantic's place for a mistake in the name of a key


def places_in(document: Document) -> Locate:
    """Places of the entries of a document that stands alone."""
    return lambda path: Place(0, document.line(path), document.where(path))


def explain(error: ValidationError, tree: object, locate: Locate) -> ConfigError:
    """Turn a validation error of `tree` into one message that lists every mistake.

    Returns
    -------
    ConfigError
        The first `MOST_NAMED` mistakes, each on a line of its own, ``file:line: path: what``, below a line
        that counts all of them.
    """
    details = error.errors(include_url=False)
    missing = [detail["loc"] for detail in details if detail["type"] == "missing"]
    unknown = [detail["loc"] for detail in details if detail["type"] == "extra_forbidden"]
    meant = {key: _meant(key, missing, tree) for key in unknown[:MOST_NAMED]}
    found: list[tuple[Place, str]] = []
    for detail in details:
        # A misspelt key is missing under its right name; a list with wrong entries counts as empty.
        misspelt = detail["type"] == "missing" and detail["loc"] in meant.values()
        if misspelt or (detail["type"] == "too_short" and detail["input"]):
            continue
        place, name, words = _mistake(detail, tree, meant.get(detail["loc"]))
        path = ".".join(str(key) for key in name)
        found.append((locate(place), f"{path}: {words}" if path else words))
    found.sort(key=lambda mistake: mistake[0][:2])
    count = "1 mistake" if len(found) == 1 else f"{len(found)} mistakes"
    lines = [f"{place.text}: {message}" for place, message in found[:MOST_NAMED]]
    if len(found) > MOST_NAMED:
        lines.append(f"... and {len(found) - MOST_NAMED} more")
    return ConfigError("\n".join([f"{count} in the configuration", *lines]))


def nearest(word: str, words: Iterable[str]) -> str | None:
    """Find the word that was probably meant; None when nothing is near."""
    lower = {candidate.lower(): candidate for candidate in words}
    close = get_close_matches(word.lower(), lower, n=1)
    return lower[close[0]] if close else None


def _meant(unknown: Key, missing: Iterable[Key], tree: object) -> Key | None:
    """Path of the key beside an unknown one that it was probably meant to be, missing or set already."""
    *parent, key = unknown
    for step in _written_path(tuple(parent), tree):
        tree = _below(tree, step)
    known = [str(path[-1]) for path in missing if path[:-1] == unknown[:-1]]
    known += [str(other) for other in tree if other != key] if isinstance(tree, Mapping) else []
    word = nearest(str(key), known)
    return None if word is None else (*parent, word)


def _mistake(detail: ErrorDetails, tree: object, meant: Key | None) -> tuple[Key, Key, str]:
    """Place, name and description of a mistake; the first two are paths as written in the file."""
    place = name = _written_path(detail["loc"], tree)
    found, context = detail["input"], detail.get("ctx", {})
    match detail["type"]:
        case "missing":
            words = f"missing key {name[-1]!r}"
            place = name = name[:-1]
        case "extra_forbidden":
            hint = "" if meant is None else f", did you mean {meant[-1]!r}?"
            words = f"unknown key {name[-1]!r}{hint}"
            name = name[:-1]
        case "union_tag_invalid":
            words = _choice(context["expected_tags"], context["tag"])
            place = name = (*name, "kind")
        case "union_tag_not_found":
            words = "missing key 'kind'"
        case "literal_error":
            words = _choice(context["expected"], found)
        case "too_short" | "string_too_short":
            words = "must not be empty"
        case "string_pattern_mismatch":
            words = "a name must be lower-case letters, digits and _, beginning with a letter"
        case kind if kind in _EXPECTED:
            words = f"must be {_EXPECTED[kind]}, found {describe(found)}"
        case _:
            words = detail["msg"]
    return place, name, words


def _choice(expected: str, found: object) -> str:
    allowed = [word.strip("'") for word in expected.replace(" or ", ", ").split(", ")]
    meant = nearest(found, allowed) if isinstance(found, str) else None
    hint = "" if meant is None else f", did you mean {meant!r}?"
    words = f"one of {', '.join(allowed)}" if len(allowed) > 2 else " or ".join(allowed)
    return f"must be {words}, found {describe(found)}{hint}"


def _written_path(loc: Key, tree: object) -> Key:
    """Leave out of pydantic's path what is not in the file: the kinds of unions and marks for keys."""
    path: list[str | int] = []
    for key in loc:
        is_kind = isinstance(tree, Mapping) and key not in tree and tree.get("kind") == key
        if is_kind or key == _KEY:
            continue
        path.append(key)
        tree = _below(tree, key)
    return tuple(path)


def _below(tree: object, key: str | int) -> object:
    if isinstance(tree, Mapping):
        return tree.get(key)
    return tree[key] if isinstance(tree, list) and isinstance(key, int) and key < len(tree) else None
