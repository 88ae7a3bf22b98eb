"""What was read: named columns of one table, sheet or struct."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

FEWEST = 8
"""Samples of a column that may be a signal."""


class Unreadable(Exception):
    """A file that holds no signals, or cannot be read; its text says why."""


class Columns(dict[str, NDArray[Any]]):
    """Columns of N rows by name, numbers or words; a unit that is stored apart stands behind its name."""

    def add(self, name: str, values: NDArray[Any], unit: str = "") -> None:
        """Add a column; of those of one name all but the first are numbered."""
        full = f"{name} ({unit})" if unit and f"({unit})" not in name and f"[{unit}]" not in name else name
        number, free = 1, full
        while free in self:
            number += 1
            free = f"{full} #{number}"
        self[free] = values


class Series(Columns):
    """Samples of one signal behind their times; those of one clock that lie together are one table."""


@dataclass(frozen=True, eq=False)
class Source:
    """One table.

    Attributes
    ----------
    name : str
        As the mapping names it: the file, and within it after a colon the sheet or struct.
    columns : Columns
    md5 : str
        Of its file.
    size : int
        Of its file, bytes.
    """

    name: str
    columns: Columns
    md5: str
    size: int
