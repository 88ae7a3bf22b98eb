"""What all configuration models share: strictness, and refusals in the words of the file, with a place."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from typing import Annotated, Literal, NoReturn, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from tendonrepro.configuration.strict_yaml import Key, Parsed, holds, paths, place
from tendonrepro.console import count_of
from tendonrepro.errors import ConfigError, did_you_mean, nearest

Mistakes: TypeAlias = Iterable[tuple[Key, str]]
"""Places below the value being validated, each with words."""

Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
SchemaVersion: TypeAlias = Annotated[Literal[1], Field(description="version of this file format")]
Identifier: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]

SOURCE_PATTERN = r"^(printed|derived|datasheet|assumed|identified|user): \S"
Provenance: TypeAlias = Annotated[str, Field(pattern=SOURCE_PATTERN)]
"""``origin: words`` with origin printed, derived, datasheet, assumed, identified or user."""

_MAPPING = "must be a mapping of keys"
_ORIGINS = (
    "must begin with printed:, derived:, datasheet:, assumed:, identified: or user: and then say where from"
)
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


class Model(BaseModel):
    """Base of every configuration model: immutable, and unknown keys are errors.

    The text below a field is its description in the JSON schema.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True, defer_build=True)

    @model_validator(mode="after")
    def _check(self) -> Self:
        refuse_all(self._mistakes())
        return self

    def _mistakes(self) -> Mistakes:
        """What is wrong although every field by itself is right, at paths below this model."""
        return ()


def refuse(message: str) -> NoReturn:
    """Raise a mistake of the value being validated."""
    raise PydanticCustomError("problem", "{text}", {"text": message})


def refuse_all(mistakes: Mistakes) -> None:
    """Raise mistakes together, if any, each at its path below the value being validated."""
    details = [
        InitErrorDetails(type=PydanticCustomError("problem", "{text}", {"text": message}), loc=at, input=None)
        for at, message in mistakes
    ]
    if details:
        raise ValidationError.from_exception_data("configuration", details)


def describe(value: object) -> str:
    """Show an unexpected value as YAML of at most one line."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:60]}..."


def explain(error: ValidationError, tree: Parsed, name: str) -> ConfigError:
    """Turn a validation error into one message, a line ``file:line: path: what`` for each mistake.

    `name` is what messages call a tree without places.
    """
    details = [(detail, _written_path(detail, tree)) for detail in error.errors(include_url=False)]
    missing = {path for detail, path in details if detail["type"] == "missing"}
    unknown = dict.fromkeys(path for detail, path in details if detail["type"] == "extra_forbidden")
    known = missing | set(paths(tree)) - unknown.keys()
    meant = {path: _meant(path, known) for path in unknown}
    mistakes = []
    for detail, path in details:
        kind = detail["type"]
        # A misspelt key is missing under its right name; a list with wrong entries counts as empty.
        if (kind == "missing" and path in meant.values()) or (kind == "too_short" and detail["input"]):
            continue
        shown = ".".join(map(str, path[:-1] if kind in ("missing", "extra_forbidden") else path))
        words = _words(detail, path, meant.get(path))
        mistakes.append((place(tree, path, name), f"{shown}: {words}" if shown else words))
    mistakes.sort(key=lambda mistake: mistake[0])
    lines = [f"{here}: {message}" for here, message in mistakes]
    return ConfigError("\n".join([f"{count_of(len(lines), 'mistake')} in the configuration", *lines]))


def _meant(unknown: Key, known: Iterable[Key]) -> Key | None:
    """Path of the key beside an unknown one that was probably meant, missing or set already."""
    parent = unknown[:-1]
    word = nearest(str(unknown[-1]), [str(path[-1]) for path in known if path[:-1] == parent])
    return None if word is None else (*parent, word)


def _words(detail: ErrorDetails, path: Key, meant: Key | None) -> str:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "union_tag_not_found" and not isinstance(detail["input"], dict):
        kind = "dict_type"
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
            given = context.get("tag", detail["input"])
            hint = did_you_mean(given, re.findall("'(.*?)'", expected))
            return f"must be {expected}, found {describe(given)}{hint}"
        case "string_pattern_mismatch":
            words = _ORIGINS if context["pattern"] == SOURCE_PATTERN else _NAME
        case _:
            words = detail["msg"].replace("Input should be", "must be")
    return f"{words}, found {describe(detail['input'])}"


def _written_path(detail: ErrorDetails, tree: Parsed) -> Key:
    """Pydantic's path without what is not in the file: kinds of unions and marks for keys."""
    path: list[str | int] = []
    for key in detail["loc"]:
        is_kind = isinstance(tree, dict) and key not in tree and tree.get("kind") == key
        if not is_kind and key != "[key]":
            path.append(key)
            tree = tree[key] if holds(tree, key) else None
    return (*path, "kind") if detail["type"] == "union_tag_invalid" else tuple(path)
