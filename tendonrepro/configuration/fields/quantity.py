"""Numbers that carry their unit and where they come from."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from tendonrepro.arrays import Array
from tendonrepro.configuration.fields.model import Model, Number
from tendonrepro.configuration.fields.strict_yaml import Key


class _Unit(NamedTuple):
    """A unit as ``value * factor / divisor`` of its SI unit; dividing keeps 77 mm the float nearest .077."""

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

SOURCE_PATTERN = r"^(printed|derived|datasheet|assumed|identified): \S"
Source: TypeAlias = Annotated[str, Field(pattern=SOURCE_PATTERN)]
"""``origin: words`` with origin printed, derived, datasheet, assumed or identified."""


def to_si(value: Any, unit: str) -> Any:
    """A number or an array of them in its SI unit and radians."""
    known = UNITS[unit]
    return value * known.factor / known.divisor


class Quantity(Model):
    """A value as written, with unit (UDUNITS spelling) and source; use `Scalar`, `Vector` or `Matrix`."""

    rank: ClassVar[int]
    value: Any
    unit: str
    source: Source

    def numbers(self) -> Iterator[tuple[Key, float]]:
        """Every single number with its place below the quantity."""
        return _numbers(self.value, ("value",))

    @property
    def si_unit(self) -> str:
        """Unit of `si`."""
        return UNITS[self.unit].si


def _numbers(value: Any, path: Key) -> Iterator[tuple[Key, float]]:
    if isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _numbers(item, (*path, index))
    else:
        yield path, value


class Scalar(Quantity):
    """One number."""

    rank = 0
    value: Number

    def __str__(self) -> str:
        """Value and unit, as written."""
        return f"{self.value:.12g} {self.unit}"

    @property
    def si(self) -> float:
        """The value in SI units and radians."""
        return float(to_si(self.value, self.unit))


class _Several(Quantity):
    @property
    def si(self) -> Array:
        """The values in SI units and radians, read-only, shape (n,) or (rows, columns)."""
        array = np.asarray(to_si(np.array(self.value, dtype=np.float64), self.unit))
        array.setflags(write=False)
        return array


Row: TypeAlias = Annotated[tuple[Number, ...], Field(min_length=1)]


class Vector(_Several):
    """A list of numbers, one per joint unless said otherwise."""

    rank = 1
    value: Row


class Matrix(_Several):
    """A list of rows of numbers."""

    rank = 2
    value: Annotated[tuple[Row, ...], Field(min_length=1)]
