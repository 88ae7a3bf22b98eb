"""Tables of named columns, and nested arrays of MATLAB and HDF5 files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Column: TypeAlias = NDArray[Any]
"""Values of a column, numbers or words."""

Nested: TypeAlias = dict[str, Any]
"""Arrays, `Columns` and further trees by name."""

MOST_COLUMNS = 40
"""Of an array whose columns are signals."""
FEWEST = 8
"""Samples of a column that may be a signal."""
MOST_NAMED = 12
"""Arrays that a line on what was left out names."""


class Unreadable(Exception):
    """A file without signals, or that cannot be read."""


class Columns(dict[str, Column]):
    """Columns of N rows by name, numbers or words, with `notes` of what was left out or read specially."""

    def __init__(self, columns: Mapping[str, Column] | Iterable[tuple[str, Column]] = ()) -> None:
        super().__init__(columns)
        self.notes: list[str] = []

    def add(self, name: str, values: Column, unit: str = "") -> None:
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
    file: dict[str, str | int]

    @property
    def last(self) -> str:
        """Its file, sheet or innermost struct."""
        file, _, inner = self.name.partition(":")
        return inner.rpartition(".")[2] or file.rpartition("/")[2]


@dataclass
class Tables:
    """What a file holds: `tables` by their place in it, and lines on what is in none of them."""

    tables: dict[str, Columns] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def tables_of(tree: Nested) -> Tables:
    """Tables with their paths: what lies together with as many rows, or one clock."""
    tables = Tables()
    apart: dict[str, list[str]] = {}
    _collect(tree, "", tables.tables, apart)
    for why, names in apart.items():
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        tables.left_out.append(f"{', '.join(names[:MOST_NAMED])}{more}: {why}")
    return tables


def _collect(tree: Nested, path: str, tables: dict[str, Columns], apart: dict[str, list[str]]) -> None:
    """Put what lies together into tables, and the rest into `apart`: why -> names."""
    groups: dict[tuple[int, bytes], Columns] = {}
    inner: list[tuple[str, Nested]] = []
    for name, value in tree.items():
        where = f"{path}.{name}" if path else name
        if isinstance(value, Series):
            (first, time), *rest = value.items()
            group = groups.setdefault((len(time), time.tobytes()), Columns({first: time}))
            for label, values in rest:
                is_named = label.split(" (")[0].split("[")[0].strip()
                group.add(label if is_named else f"{name}{label}", values)
        elif isinstance(value, Columns):
            tables[where] = value
        elif isinstance(value, dict):
            inner.append((where, value))
        elif not isinstance(value, np.ndarray) or value.size < 2 or value.dtype.kind not in "biufc":
            is_lost = value is not None and not isinstance(value, str | bytes)
            is_words = isinstance(value, np.ndarray) and value.dtype.kind in "US"
            if is_lost and not is_words and np.size(value):
                apart.setdefault("single values, no signals", []).append(where)
        elif reason := _no_signals(value):
            shape = "×".join(map(str, value.shape))
            apart.setdefault(reason, []).append(f"{where} ({shape})")
        else:
            group = groups.setdefault((_samples_of(value), b""), Columns())
            for index, column in _rows(value):
                group.add(f"{name}[{index}]" if index else name, column)
    for number, ((rows, clock), columns) in enumerate(groups.items(), start=1):
        which = f"[clock {number}]" if clock else f"[{rows} rows]"
        tables[path if len(groups) == 1 else f"{path}{which}"] = columns
    for where, value in inner:
        _collect(value, where, tables, apart)


def _samples_of(values: Column) -> int:
    """Length of the longest axis: that of the samples."""
    return int(max(values.shape))


def _no_signals(values: Column) -> str:
    """Why an array holds no signals, or an empty text."""
    samples = _samples_of(values)
    if values.dtype.kind == "c":
        return "complex numbers"
    if samples < FEWEST:
        return f"fewer than {FEWEST} samples"
    return f"more than {MOST_COLUMNS} columns" if values.size > MOST_COLUMNS * samples else ""


def _rows(values: Column) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Columns of an array of any dimensions, with their places in it, counted from 1."""
    moved = np.moveaxis(values, int(np.argmax(values.shape)), 0).astype(float)
    sizes = moved.shape[1:]
    columns = moved.reshape(len(moved), -1).T
    for place, column in zip(product(*map(range, sizes)), columns, strict=True):
        told = [str(k + 1) for k, size in zip(place, sizes, strict=True) if size > 1]
        yield ",".join(told), column


def read_hdf5(path: Path) -> Nested:
    """Read the datasets of an HDF5 file, with their ``units``."""
    import h5py

    tree: Nested = {}

    def visit(name: str, node: object) -> None:
        if not isinstance(node, h5py.Dataset):
            return
        group, _, last = name.rpartition("/")
        unit = node.attrs.get("units", "")
        unit = unit.decode() if isinstance(unit, bytes) else str(unit)
        place = tree.setdefault(group.replace("/", "."), {})
        if node.dtype.names:
            place[last] = {str(field): node[field] for field in node.dtype.names}
        else:
            place[f"{last} ({unit})" if unit else last] = node[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    return tree
