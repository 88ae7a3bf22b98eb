"""Columns of numbers as a guesser sees them: each with what its names say, and what is made of it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.evidence import sampling_step
from tendonrepro.dataset.meaning.words import Hints, Quantity, hints, text_names, tokens
from tendonrepro.dataset.readers.signals import Signal, Source
from tendonrepro.dataset.readers.units import plain_unit

SHORTEST = 8
"""Fewest samples of a record; what is shorter is a table of settings."""
MOST_JOINTS = 3
"""Columns of a matrix that can be one quantity of all joints; a wider one is a table."""


class Address(NamedTuple):
    """Where a column is: file, signal in it, number of the column from 1; and which rows are meant.

    Each of `rows` is signal and column of a label in the same file, and its value there.
    """

    file: str
    signal: str
    column: int
    rows: tuple[tuple[str, int, float], ...] = ()

    def __str__(self) -> str:
        """The signal, with the number of the column where it matters."""
        return self.signal if self.column == 1 else f"{self.signal} column {self.column}"

    def node(self) -> dict[str, str | int]:
        """As the mapping names it, without the rows."""
        return {"file": self.file, "signal": self.signal, "column": self.column}


_WHERE = frozenset({"joint", "link", "关节", "deg", "rad"})
"""Words that say where a column is from, not what it is."""

Group = tuple[str, str, int]
"""File, part of the file, number of samples: columns of one group are compared with each other."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table in long form.

    Attributes
    ----------
    chosen : ndarray of bool
        Shape (samples of the table,).
    labels : tuple
        Columns that tell the rows apart, each with its value in these rows.
    part : str
        Name of the run they are of; the same for all its joints.
    """

    chosen: NDArray[np.bool_]
    labels: tuple[tuple[Column, float], ...]
    part: str


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
    tabular : bool
        Whether its signal is a table of its own: a matrix with a time axis, or with more columns than joints.
    rows : Rows or None
        Which rows of the signal it is; None where it is all of them.
    quantity : Quantity or None
    joint : int or None
    unit : str or None
        A unit of `units.FACTORS`.
    stated : bool
        Whether the file states the unit.
    scale : float
        Factor beside the unit, such as 0.01 for a motor angle before the reducer.
    offset : float
        What the numbers start at and should not, in their unit.
    assumed : Hints
        Controller and payload where no name speaks of them.
    time : Address or None
        Column with its sampling times; None where the signal has its own or there is none.
    because : list of str
        Reasons, in the order in which they were found.
    doubts : list of str
        What a user has to decide, in words that are the same for all columns in the same doubt.
    """

    source: Source
    signal: Signal
    number: int
    own: Hints
    around: tuple[Hints, ...]
    inside: int
    tabular: bool = False
    rows: Rows | None = None
    quantity: Quantity | None = None
    joint: int | None = None
    unit: str | None = None
    stated: bool = False
    scale: float = 1.0
    offset: float = 0.0
    assumed: Hints = field(default_factory=Hints)
    time: Address | None = None
    because: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    @property
    def values(self) -> Array:
        """Shape (N,), as stored."""
        values = self.signal.column(self.number)
        return values if self.rows is None else values[self.rows.chosen]

    @property
    def address(self) -> Address:
        """Where it is."""
        labels = () if self.rows is None else self.rows.labels
        rows = tuple((label.signal.path, label.number, value) for label, value in labels)
        return Address(self.source.name, self.signal.path, self.number, rows)

    @property
    def group(self) -> Group:
        """What it is compared with."""
        parent = self.signal.path if self.tabular else self.signal.path.rpartition("/")[0]
        part = self.signal.group or parent
        if self.rows is not None:
            return self.source.name, f"{part} {self.rows.part}", int(np.count_nonzero(self.rows.chosen))
        return self.source.name, part, len(self.signal.values)

    @property
    def label(self) -> str:
        """Its own name."""
        return self.signal.label or self.signal.path.rpartition("/")[2]

    @property
    def names(self) -> Iterator[Hints]:
        """All that its names say, nearest first."""
        yield self.own
        yield from self.around
        yield self.assumed

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
        # Only beside other columns does a nought show that joints are counted from it.
        around = next((hint.joint for hint in self.around if hint.joint), None)
        self.joint = around if self.own.joint is None else self.own.joint
        if self.own.quantity:
            self.call(self.own.quantity, f"the name {self.label!r} says {self.own.quantity}")
            inside = {hint.quantity for hint in self.around[: self.inside]}
            if "calculated" in inside and _WHERE.issuperset(
                word for word in tokens(self.label) if word.isalpha()
            ):
                self.call("calculated", "a name around it says calculated")
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
        tabular = _is_table(signal)
        for number in range(1, signal.columns + 1):
            yield _column(source, signal, number, around, len(inside), tabular=tabular)


def _is_table(signal: Signal) -> bool:
    """Whether the columns of a matrix were recorded together, not each beside other matrices."""
    numbers = range(1, signal.columns + 1)
    wide = signal.columns > MOST_JOINTS
    return wide or (signal.columns > 1 and any(sampling_step(signal.column(number)) for number in numbers))


def _scopes(path: str) -> Iterator[str]:
    """A path and all above it, nearest first: a text describes all that lies beside or below it."""
    while path:
        yield path
        path = path.rpartition("/")[0]


def _column(
    source: Source, signal: Signal, number: int, around: tuple[Hints, ...], inside: int, *, tabular: bool
) -> Column:
    name = signal.label or signal.path.rpartition("/")[2]
    column = Column(source, signal, number, hints(name), around, inside, tabular)
    if len(signal.values) < SHORTEST:
        column.because.append("too short for a record")
        return column
    column.name_from()
    column.unit = plain_unit(signal.unit) or _unit_in(tokens(name))
    if column.unit:
        column.stated = True
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
