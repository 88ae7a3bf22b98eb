"""Nested arrays of MATLAB and HDF5 files as tables: what lies together with as many rows, or one clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.tables import FEWEST, Column, Columns, Tables

Nested: TypeAlias = dict[str, Any]
"""Arrays, `Series`, `Columns` and further trees by name."""

MOST_COLUMNS = 40
"""Of an array whose columns are signals."""
MOST_NAMED = 12
"""Arrays that a line on what was left out names."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one signal: `time` (T,), s, and `values`, T of them along the first axis.

    Where it has no `name` of its own, it has that of its place in the tree.
    """

    time: Column
    values: Column
    name: str = ""
    unit: str = ""


def tables_of(tree: Nested) -> Tables:
    """Tables of a tree, by their paths in it."""
    tables = Tables()
    apart: dict[str, list[str]] = {}
    _collect(tree, "", tables, apart)
    for why, names in apart.items():
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        tables.left_out.append(f"{', '.join(names[:MOST_NAMED])}{more}: {why}")
    return tables


def _collect(tree: Nested, path: str, tables: Tables, apart: dict[str, list[str]]) -> None:
    """Put what lies together into tables, and the rest into `apart`: why -> names."""
    groups: dict[tuple[int, bytes], Columns] = {}
    inner: list[tuple[str, Nested]] = []
    for name, value in tree.items():
        where = f"{path}.{name}" if path else name
        if isinstance(value, Series):
            same = len(value.time), value.time.tobytes()
            group = groups.setdefault(same, Columns({"time (s)": value.time}))
            for signal, column in _signals(value.name or name, value.values, 0):
                group.add(signal, column, value.unit)
        elif isinstance(value, Columns):
            tables[where] = value
        elif isinstance(value, dict):
            inner.append((where, value))
        elif not isinstance(value, np.ndarray) or value.size < 2 or value.dtype.kind not in "biufc":
            is_words = np.asarray(value).dtype.kind in "US"
            if value is not None and np.size(value) and not is_words:
                apart.setdefault("single values, no signals", []).append(where)
        elif reason := _no_signals(value):
            shape = "×".join(map(str, value.shape))
            apart.setdefault(reason, []).append(f"{where} ({shape})")
        else:
            group = groups.setdefault((max(value.shape), b""), Columns())
            for signal, column in _signals(name, value, int(np.argmax(value.shape))):
                group.add(signal, column)
    for number, ((rows, clock), columns) in enumerate(groups.items(), start=1):
        which = f"[clock {number}]" if clock else f"[{rows} rows]"
        tables[path if len(groups) == 1 else f"{path}{which}"] = columns
    for where, value in inner:
        _collect(value, where, tables, apart)


def _no_signals(values: Column) -> str:
    """Why an array holds no signals, or an empty text."""
    samples = max(values.shape)
    if values.dtype.kind == "c":
        return "complex numbers"
    if samples < FEWEST:
        return f"fewer than {FEWEST} samples"
    return f"more than {MOST_COLUMNS} columns" if values.size > MOST_COLUMNS * samples else ""


def _signals(name: str, values: Column, axis: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Columns of an array with samples along an axis, named by their places in it, counted from 1."""
    moved = np.moveaxis(values, axis, 0).astype(float)
    sizes = moved.shape[1:]
    columns = moved.reshape(len(moved), -1).T
    for place, column in zip(product(*map(range, sizes)), columns, strict=True):
        told = ",".join(str(k + 1) for k, size in zip(place, sizes, strict=True) if size > 1)
        yield f"{name}[{told}]" if told else name, column


def read_hdf5(path: Path) -> Tables:
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

    with h5py.File(path, locking=False) as file:
        file.visititems(visit)
    return tables_of(tree)
