"""What readers of files give: tables of named columns, with notes on what is in none of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from numpy.typing import NDArray

Column: TypeAlias = NDArray[Any]
"""Values of a column, numbers or words."""

FEWEST = 8
"""Samples of a column that may be a signal."""


class Unreadable(Exception):
    """A file without signals, or that cannot be read."""


class Columns(dict[str, Column]):
    """Columns of N rows by name, numbers or words, with `notes` of what was left out or read specially.

    `angle_unit` is that of angles and rates whose names say none, where the file states it.
    """

    def __init__(self, columns: Mapping[str, Column] | Iterable[tuple[str, Column]] = ()) -> None:
        super().__init__(columns)
        self.notes: list[str] = []
        self.angle_unit = ""

    def add(self, name: str, values: Column, unit: str = "") -> None:
        """Add a column; a second of its name is numbered."""
        name = " ".join(name.split())
        full = f"{name} ({unit})" if unit and f"({unit})" not in name and f"[{unit}]" not in name else name
        number, free = 1, full
        while free in self:
            number += 1
            free = f"{full} #{number}"
        self[free] = values


class Tables(dict[str, Columns]):
    """Tables of a file by their place in it, and lines on what is in none of them: `left_out`."""

    def __init__(self, tables: Mapping[str, Columns] | None = None, left_out: Sequence[str] = ()) -> None:
        super().__init__(tables or {})
        self.left_out = [*left_out]


@dataclass(frozen=True, eq=False)
class SourceTable:
    """One table of one file.

    `name` is that of the mapping: the file, and after a colon the sheet or struct. `file` has ``name``,
    ``size`` in bytes and ``md5``.
    """

    name: str
    columns: Columns
    file: dict[str, str | int]

    @property
    def last(self) -> str:
        """Its file, sheet or innermost struct."""
        file, _, inner = self.name.partition(":")
        return inner.rpartition(".")[2] or file.rpartition("/")[2]
