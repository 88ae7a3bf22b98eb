"""Tables of named columns, and nested arrays of MATLAB and HDF5 files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Tree: TypeAlias = dict[str, Any]
"""Arrays, `Columns` and further trees by name."""

MOST_COLUMNS = 40
"""Of an array whose columns are signals."""
FEWEST = 8
"""Samples of a column that may be a signal."""


class Unreadable(Exception):
    """A file without signals, or that cannot be read."""


class Columns(dict[str, NDArray[Any]]):
    """Columns of N rows by name, numbers or words."""

    def add(self, name: str, values: NDArray[Any], unit: str = "") -> None:
        """Add a column; a second of its name is numbered."""
        full = f"{name} ({unit})" if unit and f"({unit})" not in name and f"[{unit}]" not in name else name
        number, free = 1, full
        while free in self:
            number += 1
            free = f"{full} #{number}"
        self[free] = values


class Series(Columns):
    """Samples of one signal behind their times."""


@dataclass(frozen=True, eq=False)
class Source:
    """One table.

    `name` is that of the mapping: the file, and after a colon the sheet or struct. `file` has ``name``,
    ``size`` in bytes and ``md5``.
    """

    name: str
    columns: Columns
    file: dict[str, Any]

    @property
    def last(self) -> str:
        """Its file, sheet or innermost struct."""
        file, _, inner = self.name.partition(":")
        return inner.rpartition(".")[2] or file.rpartition("/")[2]


def tables_of(tree: Tree, path: str = "") -> Iterator[tuple[str, Columns]]:
    """Yield tables with their paths: what lies together with as many rows, or one clock."""
    groups: dict[tuple[int, bytes], Columns] = {}
    inner: list[tuple[str, Tree]] = []
    for name, value in tree.items():
        where = f"{path}.{name}" if path else name
        if isinstance(value, Series):
            (first, time), *rest = value.items()
            group = groups.setdefault((len(time), time.tobytes()), Columns({first: time}))
            for column, values in rest:
                is_named = column.split(" (")[0].split("[")[0].strip()
                group.add(column if is_named else f"{name}{column}", values)
        elif isinstance(value, Columns):
            yield where, value
        elif isinstance(value, dict):
            inner.append((where, value))
        elif (array := _rows(value)) is not None:
            group = groups.setdefault((len(array), b""), Columns())
            for number, column in enumerate(array.T, start=1):
                group.add(f"{name}[{number}]" if array.shape[1] > 1 else name, column)
    for number, ((rows, clock), columns) in enumerate(groups.items(), start=1):
        which = f"[clock {number}]" if clock else f"[{rows} rows]"
        yield (path if len(groups) == 1 else f"{path}{which}"), columns
    for where, value in inner:
        yield from tables_of(value, where)


def _rows(value: Any) -> NDArray[np.float64] | None:
    """Numbers with samples in rows, (N, m); None of anything else."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
        return None
    array = np.squeeze(value)
    array = np.atleast_2d(array)
    array = array.T if array.shape[0] < array.shape[1] else array
    is_table = array.ndim == 2 and len(array) >= FEWEST and array.shape[1] <= MOST_COLUMNS
    return array.astype(float) if is_table else None


def read_hdf5(path: Path) -> Tree:
    """Read the datasets of an HDF5 file, with their ``units``."""
    import h5py

    tree: Tree = {}

    def visit(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset) and node.dtype.kind in "biuf":
            group, _, last = name.rpartition("/")
            unit = node.attrs.get("units", "")
            unit = unit.decode() if isinstance(unit, bytes) else str(unit)
            place = tree.setdefault(group.replace("/", "."), {})
            place[f"{last} ({unit})" if unit else last] = node[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    return tree
