"""What all configuration models share: strictness, collected problems, and what parts know of each other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, NoReturn, Self, TypeAlias

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from tendonrepro.configuration.fields.strict_yaml import Key

_TITLE = "configuration"


class Model(BaseModel):
    """Base of every configuration model: immutable, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


@dataclass
class Problems:
    """Mistakes found by one check, raised together at the end of a ``with`` block.

    Inside a validator each keeps its own place below the value being validated.
    """

    details: list[InitErrorDetails] = field(default_factory=list)

    def add(self, at: Key, message: str) -> None:
        """Note a mistake at a path relative to the value being validated."""
        self.details.append(_mistake(at, message))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self.details:
            raise ValidationError.from_exception_data(_TITLE, self.details)


def refuse(message: str, *at: str | int) -> NoReturn:
    """Raise a single mistake at a path relative to the value being validated."""
    raise ValidationError.from_exception_data(_TITLE, [_mistake(at, message)])


def _mistake(at: Key, message: str) -> InitErrorDetails:
    error = PydanticCustomError("problem", "{text}", {"text": message})
    return InitErrorDetails(type=error, loc=at, input=None)


@dataclass(frozen=True)
class Outline:
    """What parts of a configuration know of others: joints of the arm, those that move, names of laws.

    None where the text is too broken to tell. It is read before validation and handed down as its context, so
    that a vector of the wrong length is reported beside every other mistake instead of after they are mended.
    """

    joints: int | None = None
    moving: tuple[object, ...] | None = None
    laws: tuple[object, ...] | None = None

    @classmethod
    def of(cls, tree: object) -> Outline:
        """Read the outline from an unvalidated experiment or manipulator."""
        manipulator = tree.get("manipulator", tree) if isinstance(tree, Mapping) else None
        diameters = _entries(manipulator, "routing", "winch_diameter", "value")
        return cls(
            joints=None if diameters is None else len(diameters),
            moving=_entries(tree, "joints"),
            laws=_entries(tree, "control", "laws"),
        )

    @classmethod
    def known(cls, info: ValidationInfo) -> Outline:
        """Outline that the root model handed down."""
        return info.context or cls()


class RootModel(Model):
    """A model of a whole document, which hands its outline down to its parts."""

    @model_validator(mode="wrap")
    @classmethod
    def _hand_down_outline(
        cls, tree: object, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        if info.context is None:
            return cls.model_validate(tree, context=Outline.of(tree))
        return handler(tree)


def _check_version(version: object) -> object:
    if type(version) is not int:  # Literal[1] alone takes True and 1.0 for 1
        refuse(f"must be 1, found {describe(version)}")
    return version


Number: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Identifier: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


def _not_reserved(name: str) -> str:
    if name == "plant":
        refuse("is the name of something else among the results; choose another")
    return name


RunName: TypeAlias = Annotated[Identifier, AfterValidator(_not_reserved)]
SchemaVersion: TypeAlias = Annotated[
    Literal[1], BeforeValidator(_check_version), Field(description="version of this file format")
]


def describe(value: object) -> str:
    """Name a value that is not what was expected, as a reader of the YAML text would."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple):
        return "a list"
    text = f"the text {value!r}" if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def is_multiple(duration: float, step: float) -> bool:
    """Whether a duration is a whole number, from one, of steps, within rounding (1e-9 relative)."""
    count = duration / step
    return math.isfinite(count) and round(count) >= 1 and abs(count - round(count)) <= 1e-9 * count


def _entries(tree: object, *path: str) -> tuple[object, ...] | None:
    for key in path:
        if not isinstance(tree, Mapping):
            return None
        tree = tree.get(key)
    return tuple(tree) if isinstance(tree, list | tuple | Mapping) and tree else None
