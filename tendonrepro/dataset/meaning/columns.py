"""Columns of numbers as a guesser sees them: each with what its names say, and what is made of it."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.words import NOT_JOINTS, Hints, Quantity, hints, tokens
from tendonrepro.dataset.readers.heading import split_unit
from tendonrepro.dataset.readers.signals import BELOW, MISFIT, Signal, Source
from tendonrepro.dataset.readers.units import FACTORS, plain_unit

SHORTEST = 8
"""Fewest samples of a record; what is shorter is a table of settings."""
_UNEVEN = 0.5
_REGULAR = 0.95  # share of steps that are even; a logger drops a cycle now and then
_MOST_JOINTS = 3  # columns of a matrix that can be one quantity of all joints; a wider one is a table
_LONGEST_NAME = 80  # letters of a line of text that can be a name
_NUMBERED = re.compile(r" \([0-9]+\)$")
# Words that say where a column is from, not what it is.
_WHERE = frozenset({"joint", "j", "link", "关节", "deg", "rad"})


class Address(NamedTuple):
    """Where a column is: file, signal in it, number of the column from 1."""

    file: str
    signal: str
    column: int

    def __str__(self) -> str:
        """The signal, with the number of the column where it matters."""
        return self.signal if self.column == 1 else f"{self.signal} column {self.column}"


def sampling_step(values: Array) -> float | None:
    """Median step of at least 8 numbers (N,) that increase, nearly all evenly; None where they do not.

    Cells without a number at the end, where a longer column stands beside it, do not count.
    """
    values = without_tail(values)
    if len(values) < SHORTEST or not np.isfinite(values).all():
        return None
    steps = np.diff(values)
    middle = float(np.median(steps))
    if steps.min() <= 0.0:
        return None
    return middle if np.mean(np.abs(steps - middle) < _UNEVEN * middle) >= _REGULAR else None


def without_tail(values: Array) -> Array:
    """Numbers up to the last finite one, shape (M,)."""
    known = np.flatnonzero(np.isfinite(values))
    return values[: known[-1] + 1] if known.size else values[:0]


def same_curve(a: Array, b: Array) -> bool:
    """Whether two columns hold the same numbers, one perhaps with empty cells below."""
    return np.array_equal(without_tail(a), without_tail(b), equal_nan=True)


Group = tuple[str, str, int]
"""File, part of the file, number of samples: columns of one group are compared with each other."""


@dataclass(eq=False)
class Column:
    """One column of a signal, by its `number` from 1, and what is known of it so far.

    What names say is in `own`, its own name, and `around`, those it stands below, nearest first: table,
    sheet, titles, then file and folders; so many of them are `inside` the file. A `tabular` signal is a
    table of its own: a matrix with a time axis, or with more columns than joints. `time` is the column with
    its sampling times, None where the signal has its own or there is none. `because` holds reasons,
    `doubts` what a user has to decide, in the same words for all columns in the same doubt.
    """

    source: Source
    signal: Signal
    number: int
    own: Hints
    around: tuple[Hints, ...]
    inside: int
    tabular: bool = False
    quantity: Quantity | None = None
    joint: int | None = None
    unit: str | None = None
    time: Address | None = None
    because: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

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
        """Table it is a column of."""
        parent = self.signal.path if self.tabular else self.signal.path.rpartition("/")[0]
        return self.source.name, self.signal.group or parent, len(self.signal.values)

    @property
    def label(self) -> str:
        """Its own name."""
        return self.signal.label or self.signal.path.rpartition("/")[2]

    @property
    def still(self) -> bool:
        """Whether it has numbers, and all are the same."""
        return len(set(self.values[np.isfinite(self.values)].tolist())) == 1

    @property
    def nameless(self) -> bool:
        """Whether its own name says at most where or of which run it is, as ``column 2`` and ``NTSM`` do."""
        words = {word for word in tokens(self.label) if word.isalpha()}
        return words <= _WHERE | NOT_JOINTS or (self.own.controller, self.own.payload_mass) != (None, None)

    @property
    def names(self) -> tuple[Hints, ...]:
        """All that its names say, nearest first."""
        return self.own, *self.around

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
    def decoupling(self) -> bool:
        """Whether the nearest name that speaks of that experiment or of a controller speaks of it."""
        return next((name.decoupling for name in self.names if name.decoupling or name.controller), False)

    def call(self, quantity: Quantity, reason: str) -> None:
        """Settle what it is."""
        self.quantity = quantity
        self.because.append(reason)

    def name_from(self) -> None:
        """Settle quantity and joint by the names, as far as they say."""
        # Only beside other columns does a nought show that joints are counted from it.
        around = next((hint.joint for hint in self.around if hint.joint), None)
        self.joint = around if self.own.joint is None else self.own.joint
        if len({hint.joint for hint in self.names if hint.joint}) > 1:
            self.doubts.append("names within each other say different joints: `joint`")
        if self.own.quantity:
            self.call(self.own.quantity, f"the name {self.label!r} says {self.own.quantity}")
            return
        # A single letter is a name for a column or, with a number, over an axis; in a file's name it could be
        # anything. What a folder is called is about an experiment, not about a quantity, and a file's name is
        # not about columns that have names of another kind, such as obstacles in "tracking error.csv".
        near = [
            hint.quantity
            for place, hint in enumerate(self.around[: self.inside + self.nameless])
            if hint.quantity not in {None, "time", "index"}
            and (not hint.letter or (hint.joint and place < self.inside))
        ]
        # "Joint 2" over an axis labelled "error" is where, not what.
        found = next((quantity for quantity in near if quantity != "measured"), next(iter(near), None))
        if found:
            self.call(found, f"a name around it says {found}")


def columns_of(sources: Iterable[Source]) -> list[Column]:
    """Take every signal apart into columns, with what their names and stored units say."""
    return [column for source in sources for column in _columns(source)]


def _columns(source: Source) -> Iterator[Column]:
    # A file may hold thousands of signals and of texts: each text and each name is read once.
    read = cache(hints)
    titles: dict[str, list[Hints]] = defaultdict(list)
    for path, text in source.texts.items():
        lines = (line.strip() for line in text.splitlines())
        titles[path.rpartition("/")[0]] += [read(line) for line in lines if 0 < len(line) <= _LONGEST_NAME]
    *folders, file = source.name.split("/")
    # A dot in a folder's name, as in 0.2kg, begins no suffix.
    above = [PurePosixPath(file).stem, *(folder.removesuffix(".zip") for folder in reversed(folders))]
    outside = [*map(read, above), *titles[""]]
    paths = {signal.path for signal in source.signals}
    for signal in source.signals:
        # Of columns of one name readers number all but the first.
        bare = _NUMBERED.sub("", signal.path)
        *parents, last = (bare if bare in paths else signal.path).split("/")
        inside = [read(split_unit(last)[0])] if signal.label and signal.label != last else []
        # A text describes all that lies beside or below it.
        scopes = ["/".join([*parents, last][:depth]) for depth in range(len(parents) + 1, 0, -1)]
        inside += [title for scope in scopes for title in titles.get(scope, ())]
        inside += map(read, reversed(parents))
        numbers = range(1, signal.columns + 1)
        timed = len(numbers) > 1 and any(sampling_step(signal.column(number)) for number in numbers)
        tabular = timed or len(numbers) > _MOST_JOINTS
        own = read(signal.label or last)
        for number in numbers:
            column = Column(source, signal, number, own, (*inside, *outside), len(inside), tabular)
            _read_names(column)
            yield column


def _read_names(column: Column) -> None:
    """Take what names and a stored unit say; of a name's words the last can be a unit, if it is not short."""
    if len(column.values) < SHORTEST:
        column.because.append("too short for a record")
        return
    column.name_from()
    asked = [note for note in column.signal.note.split("; ") if note.endswith("?")]
    column.doubts += [note if note in {BELOW, MISFIT} else f"{column.label!r}: {note}" for note in asked]
    *_, last = ["", *(word for word in tokens(column.label) if word.isalpha())]
    column.unit = plain_unit(column.signal.unit) or (plain_unit(last) if len(last) > 2 else None)
    if column.quantity == "time" and column.unit not in {None, *FACTORS["time"]}:
        column.quantity = None
    if column.unit:
        column.because.append(f"its unit is given as {column.signal.unit or column.unit}")
