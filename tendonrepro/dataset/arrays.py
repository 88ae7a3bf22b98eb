"""Nested arrays, as MATLAB, HDF5 and NumPy files hold them, as tables of columns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.source import FEWEST, Columns, Series, Unreadable

Tree: TypeAlias = dict[str, Any]
"""Arrays, `Columns` and further trees by name."""

MOST_COLUMNS = 40
"""Of an array whose columns are signals."""


def tables_of(tree: Tree, path: str = "") -> Iterator[tuple[str, Columns]]:
    """Yield the tables of a tree with their paths: what lies together and has as many rows."""
    groups: dict[int, Columns] = {}
    timed: list[tuple[str, Columns]] = []
    inner: list[tuple[str, Tree]] = []
    for name, value in tree.items():
        where = f"{path}.{name}" if path else name
        if isinstance(value, Columns):
            timed.append((name, value))
        elif isinstance(value, dict):
            inner.append((where, value))
        elif (array := _rows(value)) is not None:
            group = groups.setdefault(len(array), Columns())
            for number, column in enumerate(array.T, start=1):
                group.add(f"{name}[{number}]" if array.shape[1] > 1 else name, column)
    for rows, columns in groups.items():
        yield (path if len(groups) == 1 else f"{path}[{rows} rows]"), columns
    yield from _together(timed, path)
    for where, value in inner:
        yield from tables_of(value, where)


def _rows(value: Any) -> NDArray[np.float64] | None:
    """Samples in rows of an array of numbers (N, m); None of what is none."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
        return None
    array = np.squeeze(value)
    array = array[:, np.newaxis] if array.ndim == 1 else array
    if array.ndim == 3:
        # One matrix a sample, along the first or the last axis.
        array = np.moveaxis(array, int(np.argmax(array.shape)), 0).reshape(max(array.shape), -1)
    if array.ndim != 2:
        return None
    if array.shape[0] < array.shape[1]:
        array = array.T
    return array.astype(float) if len(array) >= FEWEST and array.shape[1] <= MOST_COLUMNS else None


def _together(series: list[tuple[str, Columns]], path: str) -> Iterator[tuple[str, Columns]]:
    """Put timeseries that lie together and have the same times into one table; a table stays as it is."""
    clocks: list[tuple[NDArray[Any], Columns]] = []
    for name, columns in series:
        if not isinstance(columns, Series):
            yield (f"{path}.{name}" if path else name), columns
            continue
        (first, time), *rest = columns.items()
        shared = next((held for clock, held in clocks if np.array_equal(clock, time)), None)
        if shared is None:
            shared = Columns({first: time})
            clocks.append((time, shared))
        for column, values in rest:
            label = column if column.split(" (")[0].split("[")[0].strip() else f"{name}{column}"
            shared.add(label, values)
    for number, (_, columns) in enumerate(clocks, start=1):
        yield (path if len(clocks) == 1 else f"{path}[clock {number}]"), columns


def read_hdf5(path: Path) -> Tree:
    """Read the datasets of an HDF5 or netCDF-4 file, with their attribute ``units``."""
    import h5py

    tree: Tree = {}

    def visit(name: str, node: object) -> None:
        if isinstance(node, h5py.Dataset) and node.dtype.kind in "biuf" and node.ndim in (1, 2):
            *folders, last = name.split("/")
            place = tree
            for folder in folders:
                place = place.setdefault(folder, {})
            unit = node.attrs.get("units", "")
            unit = unit.decode() if isinstance(unit, bytes) else str(unit)
            place[f"{last} ({unit})" if unit else last] = node[()]

    with h5py.File(path) as file:
        file.visititems(visit)
    return tree


def read_numpy(path: Path) -> Tree:
    """Read an npy or npz file; one that holds Python objects is refused.

    Raises
    ------
    Unreadable
        If it does.
    """
    try:
        loaded = np.load(path, allow_pickle=False)
        held = {"": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
    except ValueError as error:
        raise Unreadable(f"no arrays of numbers: {error}") from error
    tree: Tree = {}
    for name, array in held.items():
        if array.dtype.names is None:
            tree[name or "column"] = array
        else:
            tree |= {field: array[field] for field in array.dtype.names}
    return tree
