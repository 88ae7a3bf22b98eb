"""What all configuration models share: strictness, and refusals with a place."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Annotated, Literal, NoReturn, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from tendonrepro.configuration.strict_yaml import Key

Mistakes: TypeAlias = Iterable[tuple[Key, str]]
"""Places below the value being validated, each with words."""


class Model(BaseModel):
    """Base of every configuration model: immutable, and unknown keys are errors.

    The text below a field is its description in the JSON schema.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

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


Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Identifier: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
SchemaVersion: TypeAlias = Annotated[Literal[1], Field(description="version of this file format")]


def describe(value: object) -> str:
    """Show an unexpected value as YAML of at most one line."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else f"{text[:60]}..."
