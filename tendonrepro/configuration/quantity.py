"""Numbers that carry unit and source, and what a field asks of them."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, ValidatorFunctionWrapHandler, WithJsonSchema, WrapValidator
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from tendonrepro.arrays import Array, Numeric
from tendonrepro.configuration import strict_model
from tendonrepro.configuration.strict_model import Mistakes, Model, Number, Provenance
from tendonrepro.configuration.strict_yaml import Key
from tendonrepro.console import count_of


class _Unit(NamedTuple):
    """``value * factor / divisor`` in the SI unit; dividing keeps 77 mm the float nearest .077."""

    si: str
    factor: float = 1.0
    divisor: float = 1.0


_SI_UNITS = (
    "1", "s", "Hz", "s-1", "s-2", "m", "m s-1", "m s-2", "rad", "rad s-1", "rad s-2", "kg", "kg m2",
    "N", "N m", "N m-1", "N s m-1", "N m rad-1", "N m s rad-1",
)  # fmt: skip
_DEGREE = math.pi / 180.0
UNITS = {unit: _Unit(unit) for unit in _SI_UNITS} | {
    "ms": _Unit("s", divisor=1000.0),
    "mm": _Unit("m", divisor=1000.0),
    "deg": _Unit("rad", _DEGREE),
    "deg s-1": _Unit("rad s-1", _DEGREE),
    "deg s-2": _Unit("rad s-2", _DEGREE),
    "N m s": _Unit("N m s rad-1"),
}


Value = TypeVar("Value", float, Array, Numeric)


def to_si(value: Value, unit: str) -> Value:
    """A number or an array in its SI unit and radians."""
    known = UNITS[unit]
    return value * known.factor / known.divisor


Size: TypeAlias = Literal["any", "joints", "moving"]


class Quantity(Model):
    """A value as written, with unit (UDUNITS spelling) and source."""

    rank: ClassVar[int]
    size: ClassVar[Size] = "any"
    value: Any
    unit: str
    source: Provenance


def _numbers(value: object, path: Key = ()) -> Iterator[tuple[Key, float]]:
    if isinstance(value, float):
        yield path, value
    elif isinstance(value, tuple | Model):
        for key, item in value if isinstance(value, Model) else enumerate(value):
            yield from _numbers(item, (*path, key))


class Scalar(Quantity):
    """One number."""

    rank = 0
    value: Number

    def __str__(self) -> str:
        return f"{self.value:.12g} {self.unit}"

    @property
    def si(self) -> float:
        """In SI units and radians."""
        return float(to_si(self.value, self.unit))


class _Several(Quantity):
    @property
    def si(self) -> Array:
        """In SI units and radians, read-only, (n,) or (rows, columns)."""
        array = np.asarray(to_si(np.array(self.value, dtype=np.float64), self.unit))
        array.setflags(write=False)
        return array


Row: TypeAlias = Annotated[tuple[Number, ...], Field(min_length=1)]


class Vector(_Several):
    """A list of numbers."""

    rank = 1
    value: Row


class Joints(Vector):
    """One number per joint of the manipulator."""

    size = "joints"


class Moving(Vector):
    """One number per moving joint."""

    size = "moving"


class Matrix(_Several):
    """Rows of numbers, one per joint of the manipulator both ways."""

    rank = 2
    size = "joints"
    value: Annotated[tuple[Row, ...], Field(min_length=1)]


LARGEST = 1e30
"""Largest size of a quantity, and of its inverse unless it is 0, SI: products of some stay finite."""

PER_ENTRY: Mapping[Size, str] = {
    "joints": "one per joint of the manipulator",
    "moving": "one per moving joint",
}


def quantities(part: object, path: Key = ()) -> Iterator[tuple[Key, Quantity, Sequence[object]]]:
    """Every quantity in a model or dict: its path, itself, and what its field says of it."""
    inner = part.items() if isinstance(part, dict) else part if isinstance(part, Model) else ()
    for name, value in inner:
        if isinstance(value, Quantity):
            yield (*path, name), value, type(part).model_fields[name].metadata  # type: ignore[attr-defined]
        else:
            yield from quantities(value, (*path, name))


def wrong_sizes(part: object, sizes: Mapping[Size, int]) -> Mistakes:
    """Mistakes of all vectors and matrices in a model or dict; `sizes` holds what is known."""
    for path, quantity, _ in quantities(part):
        if quantity.size in sizes:
            lengths = {len(quantity.value), *map(len, quantity.value if isinstance(quantity, Matrix) else ())}
            if lengths != {sizes[quantity.size]}:
                there_are = " and ".join(map(str, sorted(lengths)))
                many = count_of(sizes[quantity.size], "entry", "entries")
                yield (*path, "value"), f"must have {many}, {PER_ENTRY[quantity.size]}, found {there_are}"


# Name of a limit in the JSON schema, and what it admits.
_LIMITS: Mapping[str, tuple[str, Callable[[float, float], bool]]] = {
    "above": ("exclusiveMinimum", operator.gt),
    "at_least": ("minimum", operator.ge),
    "below": ("exclusiveMaximum", operator.lt),
    "at_most": ("maximum", operator.le),
}


Ends: TypeAlias = tuple[float, float]
"""Lower and upper end of a range."""


class Physical:
    """What a field with a unit means and allows, as metadata in ``Annotated``.

    ``unit`` is SI, as are the limits; ``above`` and ``below`` exclude the limit itself. Other values than 0
    lie between the ends of ``usual`` on arms of any size: what does not is possible, and told.
    """

    def __init__(
        self, unit: str, about: str, *, whole: bool = False, usual: Ends | None = None, **limits: float
    ) -> None:
        self.about, self.whole, self.usual, self.limits = about, whole, usual, limits
        self.units = [name for name, known in UNITS.items() if known.si == unit]

    def __get_pydantic_core_schema__(self, source: type[Model], handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: FieldInfo | WithJsonSchema = Field(description=self.about)
        if issubclass(source, Quantity):
            schema = WithJsonSchema(self._json_schema(source))
        return handler.generate_schema(Annotated[source, WrapValidator(self._validate), schema])

    def _validate(self, raw: object, handler: ValidatorFunctionWrapHandler) -> object:
        if not isinstance(raw, dict | Model):
            example = f"{{value: ..., unit: '{self.units[0]}', source: 'assumed: ...'}}"
            strict_model.refuse(
                f"must carry unit and source, as in {example}, found {strict_model.describe(raw)}"
            )
        quantity = handler(raw)
        strict_model.refuse_all(self._out_of_range(quantity, quantity.unit))
        return quantity

    def _out_of_range(self, quantity: Model, unit: str) -> Mistakes:
        """Mistakes of a quantity or a row of the box."""
        if unit not in self.units:
            yield ("unit",), f"must be {' or '.join(self.units)}, found {strict_model.describe(unit)}"
            return
        for place, value in _numbers(quantity):
            si = to_si(value, unit)
            if not all(_LIMITS[name][1](si, limit) for name, limit in self.limits.items()):
                allowed = " and ".join(
                    f"{name.replace('_', ' ')} {limit / to_si(1.0, unit):.12g}"
                    for name, limit in self.limits.items()
                )
                yield place, f"must be {allowed}{'' if unit == '1' else f' {unit}'}, found {value:.12g}"
            elif si and not 1.0 / LARGEST <= abs(si) <= LARGEST:
                yield place, f"is too near to 0 or too large to compute with: {value:g}"
            elif self.whole and not value.is_integer():
                yield place, f"must be a whole number, found {value:g}"

    def unusual(self, quantity: Quantity) -> str | None:
        """What is told of a quantity far from what is usual."""
        if self.usual is None:
            return None
        low, high = (end / to_si(1.0, quantity.unit) for end in self.usual)
        sizes = [abs(value) for _, value in _numbers(quantity) if value]
        odd = [value for value in sizes if not low <= value <= high]
        unit = "" if quantity.unit == "1" else f" {quantity.unit}"
        words = f"{unit} is unusual, {low:g} to {high:g}{unit} is not; is the unit right?"
        return f"{odd[0]:g}{words}" if odd else None

    def _json_schema(self, kind: type[Quantity]) -> dict[str, object]:
        value: dict[str, object] = {"type": "integer" if self.whole else "number"}
        for name, limit in self.limits.items():
            # A schema knows no units, so it can only state limits that are the same number in all of them.
            if limit == 0.0 or len(self.units) == 1:
                value[_LIMITS[name][0]] = limit
        for _ in range(kind.rank):
            value = {"type": "array", "items": value, "minItems": 1}
        size = f"; {PER_ENTRY[kind.size]}" if kind.size in PER_ENTRY else ""
        return {
            # With a base a value may stand alone.
            "type": ["object", "number", "array"],
            "description": f"{self.about}{size}; unit {' or '.join(self.units)}",
            "properties": {
                "value": value,
                "unit": {"enum": self.units},
                "source": {"type": "string", "pattern": strict_model.SOURCE_PATTERN},
            },
            "required": ["value"],
            "additionalProperties": False,
        }


def unusual(part: object) -> Mistakes:
    """Say of each quantity in a model that it is far from what is usual."""
    for path, quantity, rules in quantities(part):
        for rule in rules:
            if isinstance(rule, Physical) and (words := rule.unusual(quantity)):
                yield path, words


positive = partial(Physical, above=0.0)
nonneg = partial(Physical, at_least=0.0)
whole = partial(Physical, "1", whole=True)
