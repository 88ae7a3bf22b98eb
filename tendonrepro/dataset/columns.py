"""Columns of numbers as a guesser sees them: each with what its names say, and what is made of it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePosixPath
from typing import NamedTuple

from tendonrepro.arrays import Array
from tendonrepro.dataset.signals import Signal, Source
from tendonrepro.dataset.units import plain_unit
from tendonrepro.dataset.words import Hints, Quantity, hints, text_names, tokens

SHORTEST = 8
"""Fewest samples of a record; what is shorter is a table of settings."""


class Address(NamedTuple):
    """Where a column is: file, signal in it, number of the column from 1."""

    file: str
    signal: str
    column: int

    def __str__(self) -> str:
        """The signal, with the number of the column where it matters."""
        return self.signal if self.column == 1 else f"{self.signal} column {self.column}"


Group = tuple[str, str, int]
"""File, part of the file, number of samples: columns of one group are compared with each other."""


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
        From names it stands below, nearest first: table, sheet, titles, then file and folders.
    inside : int
        How many of these are inside the file.
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
    inside: int
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
    def group(self) -> Group:
        """What it is compared with."""
        parent = self.signal.group or self.signal.path.rpartition("/")[0]
        return self.source.name, parent, len(self.signal.values)

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
        if not said or said[0] == 0.0:
            return said[0] if said else None
        return next((mass for mass in said if not math.isnan(mass) and mass > 0.0), said[0])

    @property
    def figure(self) -> tuple[int, str | None] | None:
        """Number of the paper's figure and letter of its panel, by the nearest name that has one."""
        return next(((name.figure, name.panel) for name in self.names if name.figure is not None), None)

    @property
    def decoupling(self) -> bool:
        """Whether a name speaks of the decoupling experiment, or of one of its figures."""
        figure = self.figure
        return any(name.decoupling for name in self.names) or (figure is not None and figure[0] <= 12)

    def call(self, quantity: Quantity, reason: str) -> None:
        """Settle what it is."""
        self.quantity = quantity
        self.because.append(reason)

    def name_from(self) -> None:
        """Settle quantity and joint by the names, as far as they say."""
        self.joint = next((hint.joint for hint in self.names if hint.joint), None)
        if self.own.quantity:
            label = self.signal.label or self.signal.path.rpartition("/")[2]
            self.call(self.own.quantity, f"the name {label!r} says {self.own.quantity}")
            return
        # A single letter is a name for a column or, with a number, over an axis; in a file's name it could be
        # anything. What a folder is called is about an experiment, not about a quantity.
        near = [
            hint.quantity
            for place, hint in enumerate(self.around[: self.inside + 1])
            if hint.quantity and (not hint.letter or (hint.joint and place < self.inside))
        ]
        near = [quantity for quantity in near if quantity not in {"time", "index"}]
        # "Joint 2" over an axis labelled "error" is where, not what.
        found = next((quantity for quantity in near if quantity != "measured"), next(iter(near), None))
        if found:
            self.call(found, f"a name around it says {found}")


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
    return [column for source in sources for column in _columns(source)]


def _columns(source: Source) -> Iterator[Column]:
    # A file may hold thousands of signals and of texts: each text and each name is read once.
    read = cache(hints)
    titles: dict[str, list[Hints]] = defaultdict(list)
    for path, text in source.texts.items():
        titles[path.rpartition("/")[0]] += [read(line) for line in text_names(text)]
    outside = [*map(read, _path_names(source.name)), *titles[""]]
    for signal in source.signals:
        *parents, last = signal.path.split("/")
        inside = [read(last)] if signal.label and signal.label != last else []
        inside += [title for scope in _scopes(signal.path) for title in titles.get(scope, ())]
        inside += map(read, reversed(parents))
        around = (*inside, *outside)
        for number in range(1, signal.columns + 1):
            yield _column(source, signal, number, around, len(inside))


def _scopes(path: str) -> Iterator[str]:
    """A path and all above it, nearest first: a text describes all that lies beside or below it."""
    while path:
        yield path
        path = path.rpartition("/")[0]


def _column(source: Source, signal: Signal, number: int, around: tuple[Hints, ...], inside: int) -> Column:
    name = signal.label or signal.path.rpartition("/")[2]
    column = Column(source, signal, number, hints(name), around, inside)
    if len(signal.values) < SHORTEST:
        column.because.append("too short for a record")
        return column
    column.name_from()
    column.unit = plain_unit(signal.unit) or _unit_in(tokens(name))
    if column.unit:
        column.because.append(f"its unit is given as {signal.unit or column.unit}")
    return column


def _path_names(name: str) -> list[str]:
    """Names of a file and of the folders and archives above it, nearest first, without suffixes."""
    parts = name.split("/")
    # A dot in a folder's name, as in 0.2kg, begins no suffix.
    return [PurePosixPath(parts[-1]).stem, *(part.removesuffix(".zip") for part in reversed(parts[:-1]))]


def _unit_in(words: Sequence[str]) -> str | None:
    """A unit among the words of a name; short ones could be anything else."""
    return next((unit for word in words if len(word) > 2 and (unit := plain_unit(word))), None)
