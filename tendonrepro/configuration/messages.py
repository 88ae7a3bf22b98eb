"""Validation errors in the words of the configuration file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from tendonrepro.configuration.quantity import SOURCE_PATTERN
from tendonrepro.configuration.strict_model import describe
from tendonrepro.configuration.strict_yaml import Document, Key, holds
from tendonrepro.errors import ConfigError

_MAPPING = "must be a mapping of keys"
_ORIGINS = "must begin with printed:, derived:, datasheet:, assumed: or identified: and then say where from"
_NAME = "a name must be lower-case letters, digits and _, beginning with a letter"
# What replaces words of pydantic that speak of Python, by the type of the mistake.
_WORDS = {
    "model_type": _MAPPING,
    "model_attributes_type": _MAPPING,
    "dict_type": _MAPPING,
    "tuple_type": "must be a list",
    "string_type": "must be text",
    "union_tag_not_found": "missing key 'kind'",
    "too_short": "must not be empty",
    "string_too_short": "must not be empty",
}


def explain(error: ValidationError, document: Document) -> ConfigError:
    """Turn a validation error into one message, a line ``file:line: path: what`` for each mistake."""
    details = [(detail, _written_path(detail, document.tree)) for detail in error.errors(include_url=False)]
    missing = {path for detail, path in details if detail["type"] == "missing"}
    unknown = dict.fromkeys(path for detail, path in details if detail["type"] == "extra_forbidden")
    known = missing | document.places.keys() - unknown.keys() - {()}
    meant = {path: _meant(path, known) for path in unknown}
    found = []
    for detail, path in details:
        kind = detail["type"]
        # A misspelt key is missing under its right name; a list with wrong entries counts as empty.
        if (kind == "missing" and path in meant.values()) or (kind == "too_short" and detail["input"]):
            continue
        name = ".".join(map(str, path[:-1] if kind in ("missing", "extra_forbidden") else path))
        words = _words(detail, path, meant.get(path))
        found.append((document.place(path), f"{name}: {words}" if name else words))
    found.sort(key=lambda mistake: mistake[0])
    count = "1 mistake" if len(found) == 1 else f"{len(found)} mistakes"
    lines = (f"{place}: {message}" for place, message in found)
    return ConfigError("\n".join([f"{count} in the configuration", *lines]))


def nearest(word: str, words: Iterable[str]) -> str | None:
    """The word that was probably meant, if any is near."""
    lower = {candidate.lower(): candidate for candidate in words}
    close = get_close_matches(word.lower(), lower, n=1)
    return lower[close[0]] if close else None


def did_you_mean(word: object, words: Iterable[str]) -> str:
    """Question after the word that was probably meant, or nothing."""
    meant = nearest(str(word), words)
    return "" if meant is None else f", did you mean {meant!r}?"


def _meant(unknown: Key, known: Iterable[Key]) -> Key | None:
    """Path of the key beside an unknown one that was probably meant, missing or set already."""
    parent = unknown[:-1]
    word = nearest(str(unknown[-1]), [str(path[-1]) for path in known if path[:-1] == parent])
    return None if word is None else (*parent, word)


def _words(detail: ErrorDetails, path: Key, meant: Key | None) -> str:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind in _WORDS:
        return _WORDS[kind]
    match kind:
        case "problem":
            return detail["msg"]
        case "missing":
            return f"missing key {path[-1]!r}"
        case "extra_forbidden":
            hint = "" if meant is None else f", did you mean {meant[-1]!r}?"
            return f"unknown key {path[-1]!r}{hint}"
        case "literal_error" | "union_tag_invalid":
            expected = context.get("expected") or context["expected_tags"]
            found = context.get("tag", detail["input"])
            hint = did_you_mean(found, re.findall("'(.*?)'", expected))
            return f"must be {expected}, found {describe(found)}{hint}"
        case "string_pattern_mismatch":
            words = _ORIGINS if context["pattern"] == SOURCE_PATTERN else _NAME
        case _:
            words = detail["msg"].replace("Input should be", "must be")
    return f"{words}, found {describe(detail['input'])}"


def _written_path(detail: ErrorDetails, tree: Any) -> Key:
    """Pydantic's path without what is not in the file: kinds of unions and marks for keys."""
    path: list[str | int] = []
    for key in detail["loc"]:
        is_kind = isinstance(tree, dict) and key not in tree and tree.get("kind") == key
        if not is_kind and key != "[key]":
            path.append(key)
            tree = tree[key] if holds(tree, key) else None
    return (*path, "kind") if detail["type"] == "union_tag_invalid" else tuple(path)
