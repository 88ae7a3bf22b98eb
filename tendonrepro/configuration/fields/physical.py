"""What a configuration field asks of its quantity: unit, range and number of entries."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import GetCoreSchemaHandler, ValidationInfo, WithJsonSchema, WrapValidator
from pydantic_core import CoreSchema

from tendonrepro.configuration.fields.model import Outline, Problems, describe, refuse
from tendonrepro.configuration.fields.quantity import UNITS, Quantity, to_si

Size: TypeAlias = Literal["one", "pair", "joints", "moving"]

LARGEST = 1e30
"""Largest size of a quantity, and of its inverse unless it is 0, SI: products of some stay finite."""

_PER_ENTRY: Mapping[Size, str] = {
    "pair": "lowest first",
    "joints": "one per joint of the manipulator",
    "moving": "one per moving joint",
}


@dataclass(frozen=True)
class Limit:
    """One end of a range: its names in a message and the JSON schema, its bound in SI, what it admits."""

    words: str
    keyword: str
    bound: float
    admits: Callable[[float, float], bool]

    def in_unit(self, unit: str) -> float:
        """Express the bound in a unit, to 12 digits, so that it prints as people write it."""
        return float(f"{self.bound * UNITS[unit].divisor / UNITS[unit].factor:.12g}")


@dataclass(frozen=True)
class Physical:
    """Requirements on a quantity; made by `physical`."""

    units: tuple[str, ...]
    about: str
    limits: tuple[Limit, ...]
    size: Size
    whole: bool

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        described = Annotated[
            source, WrapValidator(self._validate), WithJsonSchema(self._json_schema(source))
        ]
        return handler.generate_schema(described)

    def _validate(self, raw: object, handler: Callable[[object], Quantity], info: ValidationInfo) -> Quantity:
        if not isinstance(raw, dict | Quantity):
            example = f"{{value: ..., unit: {self.units[0]}, source: 'assumed: ...'}}"
            refuse(f"must carry unit and source, as in {example}, found {describe(raw)}")
        quantity = handler(raw)
        with Problems() as problems:
            self._check_size(quantity, Outline.known(info), problems)
            self._check_range(quantity, problems)
        return quantity

    def _check_size(self, quantity: Quantity, outline: Outline, problems: Problems) -> None:
        moving = None if outline.moving is None else len(outline.moving)
        expected = {"moving": moving, "joints": outline.joints, "pair": 2, "one": None}[self.size]
        if expected is None:
            return
        shape = np.shape(quantity.value)
        if shape != (expected,) * len(shape):
            entries = "1 entry" if expected == 1 else f"{expected} entries"
            wanted = f"have {entries}" if len(shape) == 1 else f"be {expected} by {expected}"
            found = " by ".join(map(str, shape))
            problems.add(("value",), f"must {wanted}, {_PER_ENTRY[self.size]}, found {found}")

    def _check_range(self, quantity: Quantity, problems: Problems) -> None:
        if quantity.unit not in self.units:
            problems.add(("unit",), f"must be {' or '.join(self.units)}, found {describe(quantity.unit)}")
            return
        for index, value in quantity.entries():
            si = to_si(value, quantity.unit)
            if not all(limit.admits(si, limit.bound) for limit in self.limits):
                allowed = self._allowed(quantity.unit)
                problems.add(
                    ("value", *index), f"must be {allowed}, found {_with_unit(value, quantity.unit)}"
                )
            elif si and not 1.0 / LARGEST <= abs(si) <= LARGEST:
                problems.add(("value", *index), f"is too near to 0 or too large to compute with: {value:g}")
            elif self.whole and not value.is_integer():
                problems.add(("value", *index), f"must be a whole number, found {value:g}")

    def _allowed(self, unit: str) -> str:
        return " and ".join(f"{limit.words} {_with_unit(limit.in_unit(unit), unit)}" for limit in self.limits)

    def _json_schema(self, quantity: type[Quantity]) -> dict[str, Any]:
        plain = _plain_schema(quantity)
        size = "" if self.size == "one" else f"; {_PER_ENTRY[self.size]}"
        return {
            "type": "object",
            "description": f"{self.about}{size}; unit {' or '.join(self.units)}",
            "properties": {
                "value": self._value_schema(plain["value"]),
                "unit": {"enum": list(self.units)},
                "source": plain["source"],
            },
            "required": list(plain),
            "additionalProperties": False,
        }

    def _value_schema(self, plain: dict[str, Any]) -> dict[str, Any]:
        if "items" in plain:
            length = {"minItems": 2, "maxItems": 2} if self.size == "pair" else {"minItems": 1}
            return plain | length | {"items": self._value_schema(plain["items"])}
        # A schema knows no units, so it can only state limits that are the same number in all of them.
        known = [limit for limit in self.limits if limit.bound == 0.0 or len(self.units) == 1]
        kind = {"type": "integer"} if self.whole else {}
        return plain | kind | {limit.keyword: limit.bound for limit in known}


def physical(
    unit: str,
    about: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    size: Size = "one",
    whole: bool = False,
) -> Physical:
    """Declare what a `Quantity` field means and allows, as metadata in ``Annotated``.

    ``unit`` is the SI unit, of the bounds too; the file may use every unit that converts to it. ``above`` and
    ``below`` exclude the bound itself. ``size`` is that of a vector, or of the rows and columns of a matrix.
    """
    units = tuple(name for name, candidate in UNITS.items() if candidate.si == unit)
    bounds = (
        ("above", "exclusiveMinimum", above, float.__gt__),
        ("at least", "minimum", at_least, float.__ge__),
        ("below", "exclusiveMaximum", below, float.__lt__),
        ("at most", "maximum", at_most, float.__le__),
    )
    limits = tuple(
        Limit(words, keyword, bound, admits) for words, keyword, bound, admits in bounds if bound is not None
    )
    return Physical(units, about, limits, size, whole)


per_joint = partial(physical, size="joints")
per_moving_joint = partial(physical, size="moving")


@cache
def _plain_schema(quantity: type[Quantity]) -> dict[str, Any]:
    properties: dict[str, Any] = quantity.model_json_schema()["properties"]
    return {
        name: {key: item for key, item in schema.items() if key != "title"}
        for name, schema in properties.items()
    }


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.12g}" if unit == "1" else f"{value:.12g} {unit}"
