"""What a reader finds in a file: signals, and what had to be left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.repository.names import Numbered

MOST_NUMBERS = 2**30
"""Bytes of signals in memory: a hundred million numbers, hours of the paper's record."""
MOST_UNPACKED = 2**32
"""Bytes that archives unpack into: a record of some gigabytes is not far-fetched, more is."""
MOST_MEMBERS = 10_000
"""Files in archives: the paper's data needs some dozens; unpacking ten thousand takes a minute."""
MOST_RATIO = 300
"""Unpacked to packed. Logs shrink to a tenth, a constant signal to a three-hundredth."""
RATIO_FROM = 2**26
"""Bytes below which no ratio is suspicious."""


class TooMuch(Exception):
    """An archive unpacks into more than anyone would publish."""


def unpacked_size(dataset: Any) -> int:
    """Bytes that reading an HDF5 dataset takes: its numbers, or its chunk, which is unpacked whole."""
    return max(int(dataset.nbytes), prod(dataset.chunks or (0,)) * int(dataset.dtype.itemsize))


@dataclass
class Allowance:
    """What may still be kept of the files of one command, and unpacked from archives.

    Bytes of signals in memory, bytes written to temporary files, and files in archives; `size` and `inside`
    are the bytes of the file at hand, and what it was unpacked into so far, archives within it included.
    """

    numbers: int = MOST_NUMBERS
    unpacked: int = MOST_UNPACKED
    members: int = MOST_MEMBERS
    size: int = MOST_UNPACKED
    inside: int = 0

    def begin(self, size: int) -> None:
        """Go on to a file of so many bytes."""
        self.size, self.inside = size, 0

    def unpack(self, count: int = 0, members: int = 0) -> None:
        """Use some bytes or members up; raises `TooMuch` when there are none left."""
        self.unpacked -= count
        self.members -= members
        self.inside += count
        most = max(RATIO_FROM, MOST_RATIO * self.size)
        message = ""
        if self.inside > most:
            message = f"unpacks into more than {most / 2**20:.0f} MB, too much for {self.size} packed bytes"
        elif self.unpacked < 0:
            message = f"left out after {MOST_UNPACKED / 2**30:.0f} GB unpacked, the most of one command"
        elif self.members < 0:
            message = f"left out after {MOST_MEMBERS} files in archives, the most of one command"
        if message:
            raise TooMuch(message)


ROWS_AS_SIGNALS = 16
"""Most rows of an array that can be signals stored one per row."""
_LONGER = 4
MOST_SIGNALS = 5000
"""A record of every state of the arm has some hundred signals; more is a file of another kind."""
MOST_SAMPLES = 2**25
"""Of one signal: nine hours at 1 kHz. What a column means is told with copies of it."""
BEST_PACKING = 1032
"""Bytes that one compressed byte can stand for at most; deflate packs no better."""
HARMLESS = 2**24
"""Bytes that a file may announce whatever it holds."""
MISFIT = "the row of names has another number of cells than the rows below: is each above its column?"
"""Note of signals whose names may be those of their neighbours. A note that asks is put to the user."""
BELOW = "words stand below the last of several tables: is a caption of the table above, not of the next?"
"""Note of signals whose tables may have their captions below them."""
WORDS = "cells of words"
"""Why a column is no signal."""
_LONGEST_TEXT = 1000
_MOST_TEXTS = 2000


class Unreadable(Exception):
    """A file that cannot be read as a whole: why, in a few words, and what a user can do about it."""

    def __init__(self, reason: str, advice: str = "") -> None:
        super().__init__(reason)
        self.reason, self.advice = reason, advice


@dataclass(frozen=True, eq=False)
class Signal:
    """Numbers found in a file, samples along the first axis.

    The `path` says where, parts joined by ``/``: variable, field, sheet, column; it is unique within the
    file. `values` (N,) or (N, m) are as stored, in the `unit` as written there; `dtype` is their type
    there. The `label` is its own name where the file tells one: header of a column, name of a logged
    signal, legend of a curve. Signals of one `group`, the path of a sheet, table or log, share their
    samples. `time` (N,), s, is where the container itself stores it, as a timeseries does. A `note` says
    what a reader did to it.
    """

    path: str
    values: Array
    dtype: str
    label: str = ""
    unit: str | None = None
    group: str = ""
    time: Array | None = None
    note: str = ""

    @property
    def columns(self) -> int:
        """Number of columns; 1 for a vector."""
        return 1 if self.values.ndim == 1 else self.values.shape[1]

    def column(self, number: int) -> Array:
        """Column by its number from 1, shape (N,)."""
        return self.values if self.values.ndim == 1 else self.values[:, number - 1]


@dataclass(frozen=True)
class Skipped:
    """Something in a file that is no signal, or cannot be read.

    Its path is empty for the file as a whole, and its advice when it is no loss, such as a text.
    """

    path: str
    reason: str
    advice: str = ""


@dataclass(frozen=True, eq=False)
class Source:
    """One file, or one member of an archive, as read.

    The `name` is below what the user named; members of an archive follow its name and ``/``. The `kind` is
    the true type by content, such as ``MATLAB 5`` or ``text table (comma, utf-8)``. `texts` holds short
    texts found inside that may say what the numbers are: one at ``D/x`` describes every signal whose path
    begins with ``D/``, one at a path without ``/`` the whole file.
    """

    name: str
    kind: str
    size: int
    md5: str
    signals: tuple[Signal, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    texts: Mapping[str, str] = field(default_factory=dict)


@dataclass
class Found:
    """What a reader has found so far; one unreadable part never stops the rest.

    What it keeps it takes from an allowance, by default that of a command with this file alone.
    """

    kind: str
    left: Allowance = field(default_factory=Allowance)
    signals: list[Signal] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    _names: Numbered = field(default_factory=Numbered, init=False, repr=False)

    def add(
        self,
        path: str,
        values: NDArray[Any],
        *,
        label: str = "",
        unit: str | None = None,
        group: str = "",
        time: Array | None = None,
        note: str = "",
    ) -> None:
        """Note an array of numbers of any shape as a signal, or why it is none or is left out.

        The path is made unique. A time that does not fit the samples is skipped, the signal is kept.
        """
        path = self._names.unused(path)
        reason, advice = _no_signal(values), ""
        # Signals of one group often share their times, and then they are counted once.
        clock = 0 if time is None or any(time is one.time for one in self.signals[-1:]) else time.size
        if not reason:
            reason, advice = self.refusal(values.size + clock, max(values.shape))
        if reason:
            self.skip(path, reason, advice)
            return
        numbers, turned = samples_first(np.asarray(values), None if time is None else len(time))
        if time is not None and len(time) != len(numbers):
            self.skip(f"{path}/time", f"{len(time)} times for {len(numbers)} samples")
            time = None
        notes = "; ".join(text for text in (note, turned) if text)
        if not numbers.flags.forc:
            # A part of a larger array would keep all of it.
            numbers = numbers.copy()
        self.left.numbers -= numbers.nbytes + 8 * clock
        self._names.take(path)
        self.signals.append(Signal(path, numbers, str(values.dtype), label, unit, group, time, notes))

    def refusal(self, count: int, samples: int = 0) -> tuple[str, str]:
        """Why so many more numbers, or so many of one signal, are not kept, and the way out.

        Empty texts when they are. Readers ask before they take a large array into memory.
        """
        # Every number becomes a float64, however few bytes it takes in the file.
        size = 8 * count
        if samples > MOST_SAMPLES:
            return f"{samples} samples are more than {MOST_SAMPLES}", "save the part of interest alone"
        if size > MOST_NUMBERS:
            return f"{size} bytes are too many", "save the part of interest alone"
        if size > self.left.numbers:
            most = f"one command keeps {MOST_NUMBERS / 2**30:g} GB at most"
            return "no room is left for its numbers", f"{most}: name fewer files at once, or split this one"
        return "", ""

    def skip(self, path: str, reason: str, advice: str = "") -> None:
        """Note what is left out."""
        self.skipped.append(Skipped(path, reason, advice))

    def text(self, path: str, text: str) -> None:
        """Note a text that may say what the numbers are; long ones are cut, and very many left out."""
        if text.strip() and len(self.texts) < _MOST_TEXTS:
            self.texts[path] = text.strip()[:_LONGEST_TEXT]


def is_full(found: Found) -> bool:
    """Whether no more signals shall be added."""
    return len(found.signals) >= MOST_SIGNALS


def note_rest(found: Found, count: int, what: str) -> None:
    """Note how many things were left out because there are too many."""
    if count > 0:
        found.skip("", f"{count} more {what} left out after {MOST_SIGNALS} signals", "split the file")


def _no_signal(values: NDArray[Any]) -> str:
    """Why an array is no signal; empty when it is one."""
    if values.dtype.kind not in "biuf":
        return f"{values.dtype} is not real numbers"
    if values.size < 2:
        return "a single number" if values.size else "empty"
    if sum(size > 1 for size in values.shape) > 2:
        return f"an array of {'x'.join(map(str, values.shape))} has too many dimensions"
    return ""


def samples_first(values: NDArray[Any], samples: int | None = None) -> tuple[Array, str]:
    """Bring numbers into shape (N,) or (N, m), and a note when rows became columns.

    Samples are along the axis of length `samples` where that is known, else along the longer one if the
    other is short enough to be a list of signals. At most two dimensions may be longer than one.
    """
    numbers = np.asarray(values, np.float64)
    flat = numbers.reshape([size for size in numbers.shape if size > 1] or [1])
    if flat.ndim < 2:
        return flat, ""
    rows, columns = flat.shape
    along_rows = columns >= _LONGER * rows and rows <= ROWS_AS_SIGNALS
    if samples is not None and samples in (rows, columns):
        along_rows = samples != rows
    if along_rows:
        return np.ascontiguousarray(flat.T), "stored one signal per row, turned"
    return flat, ""


def seconds(values: NDArray[Any]) -> tuple[Array, str]:
    """Dates (datetime64) as s from the first, durations (timedelta64) as s, NaN for none, and a note."""
    missing = np.isnat(values)
    # Counts of nanoseconds overflow within 292 years; microseconds reach any date, and the rest is added.
    coarse = values.astype(f"{values.dtype.kind}8[us]")
    fine = values - coarse
    note = "durations in s"
    if values.dtype.kind == "M" and not missing.all():
        first = np.argmin(missing)
        note = f"dates, in s from {np.datetime_as_string(values.flat[first], unit='ms')}"
        coarse, fine = coarse - coarse.flat[first], fine - fine.flat[first]
    numbers = coarse.astype(np.int64) / 1e6 + fine / np.timedelta64(1, "s")
    return np.where(missing, np.nan, numbers), note
