"""What a configuration field asks of its quantity: unit, range and number of entries."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, GetCoreSchemaHandler, ValidationInfo, WithJsonSchema, WrapValidator
from pydantic_core import CoreSchema

from tendonrepro.configuration.fields.model import Model, Outline, describe, refuse, refuse_all
from tendonrepro.configuration.fields.quantity import SOURCE_PATTERN, UNITS, Quantity, to_si
from tendonrepro.configuration.fields.strict_yaml import Key

Size: TypeAlias = Literal["one", "pair", "joints", "moving"]

LARGEST = 1e30
"""Largest size of a quantity, and of its inverse unless it is 0, SI: products of some stay finite."""

_PER_ENTRY: Mapping[Size, str] = {
    "pair": "lowest first",
    "joints": "one per joint of the manipulator",
    "moving": "one per moving joint",
}
_LIMITS: Mapping[str, tuple[str, Callable[[float, float], bool]]] = {
    "above": ("exclusiveMinimum", operator.gt),
    "at_least": ("minimum", operator.ge),
    "below": ("exclusiveMaximum", operator.lt),
    "at_most": ("maximum", operator.le),
}
"""Name of a limit in the JSON schema, and what it admits."""


@dataclass(frozen=True)
class Physical:
    """What a field with a unit means and allows, as metadata in ``Annotated``.

    ``unit`` is the SI unit, of the limits too; the file may use every unit that converts to it. ``above`` and
    ``below`` exclude the limit itself. ``size`` is that of a vector, or of the rows and columns of a matrix.
    """

    unit: str
    about: str
    _: KW_ONLY
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    size: Size = "one"
    whole: bool = False

    def __get_pydantic_core_schema__(self, source: type[Model], handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: Any = Field(description=self.about)
        if issubclass(source, Quantity):
            schema = WithJsonSchema(self._json_schema(source.rank))
        return handler.generate_schema(Annotated[source, WrapValidator(self._validate), schema])

    @property
    def _units(self) -> list[str]:
        return [name for name, unit in UNITS.items() if unit.si == self.unit]

    @property
    def _limits(self) -> dict[str, float]:
        return {name: limit for name in _LIMITS if (limit := getattr(self, name)) is not None}

    def _validate(self, raw: object, handler: Callable[[object], Any], info: ValidationInfo) -> Any:
        if not isinstance(raw, dict | Model):
            example = f"{{value: ..., unit: {self._units[0]}, source: 'assumed: ...'}}"
            refuse(f"must carry unit and source, as in {example}, found {describe(raw)}")
        held = handler(raw)
        refuse_all([*self._wrong_size(held, Outline.known(info)), *self._out_of_range(held)])
        return held

    def _wrong_size(self, held: Any, outline: Outline) -> Iterator[tuple[Key, str]]:
        moving = None if outline.moving is None else len(outline.moving)
        expected = {"moving": moving, "joints": outline.joints, "pair": 2, "one": None}[self.size]
        if expected is None:
            return
        lengths = [len(held.value), *(len(row) for row in held.value if isinstance(row, tuple))]
        if lengths != [expected] * len(lengths):
            rows = "rows and columns" if len(lengths) > 1 else "entry" if expected == 1 else "entries"
            found = " and ".join(map(str, sorted(set(lengths))))
            yield ("value",), f"must have {expected} {rows}, {_PER_ENTRY[self.size]}, found {found}"

    def _out_of_range(self, held: Any) -> Iterator[tuple[Key, str]]:
        """Mistakes of anything with a unit and numbers: a quantity, or a row of the box."""
        unit = held.unit
        unit_words = "" if unit == "1" else f" {unit}"
        if unit not in self._units:
            yield ("unit",), f"must be {' or '.join(self._units)}, found {describe(unit)}"
            return
        for place, value in held.numbers():
            si = to_si(value, unit)
            if not all(_LIMITS[name][1](si, limit) for name, limit in self._limits.items()):
                allowed = " and ".join(
                    f"{name.replace('_', ' ')} {limit / to_si(1.0, unit):.12g}"
                    for name, limit in self._limits.items()
                )
                yield place, f"must be {allowed}{unit_words}, found {value:.12g}"
            elif si and not 1.0 / LARGEST <= abs(si) <= LARGEST:
                yield place, f"is too near to 0 or too large to compute with: {value:g}"
            elif self.whole and not value.is_integer():
                yield place, f"must be a whole number, found {value:g}"

    def _json_schema(self, rank: int) -> dict[str, Any]:
        value: dict[str, Any] = {"type": "integer" if self.whole else "number"}
        for name, limit in self._limits.items():
            # A schema knows no units, so it can only state limits that are the same number in all of them.
            if limit == 0.0 or len(self._units) == 1:
                value[_LIMITS[name][0]] = limit
        length = {"minItems": 2, "maxItems": 2} if self.size == "pair" else {"minItems": 1}
        for _ in range(rank):
            value = {"type": "array", "items": value} | length
        size = f"; {_PER_ENTRY[self.size]}" if rank else ""
        return {
            "type": "object",
            "description": f"{self.about}{size}; unit {' or '.join(self._units)}",
            "properties": {
                "value": value,
                "unit": {"enum": self._units},
                "source": {"type": "string", "pattern": SOURCE_PATTERN},
            },
            "required": ["value", "unit", "source"],
            "additionalProperties": False,
        }


per_joint = partial(Physical, size="joints")
per_moving_joint = partial(Physical, size="moving")
