"""Columns of numbers as a guesser sees them: each with what its names say, and what is made of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import NamedTuple

from tendonrepro.arrays import Array
from tendonrepro.dataset.signals import Signal, Source
from tendonrepro.dataset.units import plain_unit
from tendonrepro.dataset.words import Hints, Quantity, hints, tokens


class Address(NamedTuple):
    """Where a column is: file, signal in it, number of the column from 1."""

    file: str
    signal: str
    column: int


@dataclass(eq=False)
class Column:
    """One column of a signal, and what is known of it so far.

    Attributes
    ----------
    source : Source
    signal : Signal
    number : int
        Of the column, from 1.
    own : Hints
        From the column's own name.
    around : tuple of Hints
        From the names it stands below, nearest first: table, sheet, file, folder.
    quantity : Quantity or None
    joint : int or None
    unit : str or None
        A unit of `units.FACTORS`.
    scale : float
        Factor beside the unit, such as 0.01 for a motor angle before the reducer.
    time : Address or None
        Column with its sampling times; None where the signal has its own or there is none.
    because : list of str
        Reasons, in the order in which they were found.
    """

    source: Source
    signal: Signal
    number: int
    own: Hints
    around: tuple[Hints, ...]
    quantity: Quantity | None = None
    joint: int | None = None
    unit: str | None = None
    scale: float = 1.0
    time: Address | None = None
    because: list[str] = field(default_factory=list)

    @property
    def values(self) -> Array:
        """Shape (N,), as stored."""
        return self.signal.column(self.number)

    @property
    def address(self) -> Address:
        """Where it is."""
        return Address(self.source.name, self.signal.path, self.number)

    @property
    def group(self) -> tuple[str, str, int]:
        """What it shares its samples with: file, part of the file, number of samples."""
        return self.source.name, self.signal.group or self.signal.path, len(self.signal.values)

    @property
    def names(self) -> Iterator[Hints]:
        """All that its names say, nearest first."""
        yield self.own
        yield from self.around

    @property
    def controller(self) -> int | None:
        """Number of the controller, by the nearest name that has one."""
        return next((name.controller for name in self.names if name.controller is not None), None)

    @property
    def payload_mass(self) -> float | None:
        """Payload by the nearest name that speaks of one, kg; NaN where none says how heavy."""
        said = [name.payload_mass for name in self.names if name.payload_mass is not None]
        weighed = [mass for mass in said if not math.isnan(mass)]
        return next(iter(weighed or said), None)

    @property
    def figure(self) -> int | None:
        """Number of the paper's figure, by the nearest name that has one."""
        return next((name.figure for name in self.names if name.figure is not None), None)

    def call(self, quantity: Quantity, reason: str) -> None:
        """Settle what it is."""
        self.quantity = quantity
        self.because.append(reason)


def columns_of(sources: Iterable[Source]) -> list[Column]:
    """Take every signal apart into columns, and read their names.

    Parameters
    ----------
    sources : iterable of Source

    Returns
    -------
    list of Column
        With what names and stored units say.
    """
    return [
        _column(source, signal, number)
        for source in sources
        for signal in source.signals
        for number in range(1, signal.columns + 1)
    ]


def _column(source: Source, signal: Signal, number: int) -> Column:
    *parents, last = signal.path.split("/")
    name = signal.label or last
    places = [*reversed(_path_names(source.name)), *parents]
    around = tuple(hints(place) for place in reversed(places))
    if signal.label and signal.label != last:
        around = (hints(last), *around)
    column = Column(source, signal, number, hints(name), around)
    # A folder's name is about an experiment, not about a quantity.
    _by_name(column, name, around[: len(around) - len(_path_names(source.name)) + 1])
    return column


def _path_names(name: str) -> list[str]:
    """Names of a file and of the folders and archives above it, nearest first, without suffixes."""
    return [PurePosixPath(part).stem for part in reversed(name.split("/"))]


def _by_name(column: Column, name: str, around: Sequence[Hints]) -> None:
    column.joint = next((hint.joint for hint in column.names if hint.joint), None)
    column.quantity = column.own.quantity
    if column.quantity:
        column.because.append(f"the name {name!r} says {column.quantity}")
    elif near := next((hint.quantity for hint in around if hint.quantity not in {None, "time"}), None):
        column.call(near, f"a name around it says {near}")
    column.unit = plain_unit(column.signal.unit) or _unit_in(tokens(name))
    if column.unit:
        column.because.append(f"its unit is given as {column.signal.unit or column.unit}")


def _unit_in(words: Sequence[str]) -> str | None:
    """A unit among the words of a name; short ones could be anything else."""
    return next((unit for word in words if len(word) > 2 and (unit := plain_unit(word))), None)
