"""What all configuration models share: strictness, and refusals with a place."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Annotated, Literal, NoReturn, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from tendonrepro.configuration.fields.strict_yaml import Key

Mistakes: TypeAlias = Iterable[tuple[Key, str]]
"""Places below the value being validated, each with words."""


class Model(BaseModel):
    """Base of every configuration model: immutable, and an unknown key is an error.

    The text below a field is its description in the JSON schema.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


def refuse(message: str, *at: str | int) -> NoReturn:
    """Raise a single mistake at a path relative to the value being validated."""
    raise _error([(at, message)])


def refuse_all(mistakes: Mistakes) -> None:
    """Raise mistakes together, each at its path relative to the value being validated; or none."""
    if found := list(mistakes):
        raise _error(found)


def _error(mistakes: Mistakes) -> ValidationError:
    details = [
        InitErrorDetails(type=PydanticCustomError("problem", "{text}", {"text": message}), loc=at, input=None)
        for at, message in mistakes
    ]
    return ValidationError.from_exception_data("configuration", details)


Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Identifier: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
SchemaVersion: TypeAlias = Annotated[Literal[1], Field(description="version of this file format")]


def describe(value: object) -> str:
    """Show a value that is not what was expected, as YAML of at most one line."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:60]}..."
