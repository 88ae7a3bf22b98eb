"""MATLAB 7.3 files, which are HDF5 files: what they announce, and their plain variables without mat-io."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.dataset.readers.matlab.values import EXPORT, Lost, brief
from tendonrepro.dataset.readers.signals import BEST_PACKING, HARMLESS, MOST_BYTES

STREAMS = "#sigstream#"
"""Group with the samples of streamed logs."""

_DEEPEST = 32


@dataclass(frozen=True)
class Contents:
    """Variables that can be read without danger, reasons for the others by name, and whether logs are
    streamed beside."""

    names: tuple[str, ...]
    refused: Mapping[str, str]
    streams: bool


def contents(path: Path) -> Contents:
    """List the variables of a MATLAB 7.3 file; what they share is refused as ``#refs#`` and the like."""
    import h5py

    most = min(MOST_BYTES, max(HARMLESS, BEST_PACKING * path.stat().st_size))
    refused: dict[str, str] = {}
    total = 0

    def link(name: str, kind: object) -> None:
        if not isinstance(kind, h5py.HardLink):
            refused[name.partition("/")[0]] = "it refers to another file"

    def node(name: str, item: Any) -> None:
        nonlocal total
        variable = name.partition("/")[0]
        if not isinstance(item, h5py.Dataset) or variable in refused:
            return
        if item.is_virtual or item.external:
            refused[variable] = "it refers to another file"
        elif total + item.nbytes > most:
            refused[variable] = "it announces more than the file can hold, or than is read at once"
        else:
            total += item.nbytes

    with h5py.File(path, "r") as file:
        file.visititems_links(link)
        file.visititems(node)
        names = tuple(name for name in file if name not in refused and not name.startswith("#"))
        return Contents(names, refused, STREAMS in file)


def load_plain(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Read variables whose sizes have been checked: numbers, texts, structs, cells, but no objects.

    A struct becomes an array of records, a cell an array of objects; anything else is `Lost`.
    """
    import h5py

    values: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        for name in names:
            try:
                values[name] = _value(file, file[name], 0)
            except Exception as error:
                values[name] = Lost(f"cannot be read ({brief(error)})", EXPORT)
    return values


def _value(file: Any, node: Any, depth: int) -> Any:
    kind = _class_of(node)
    if depth > _DEEPEST:
        return Lost("nested too deep")
    if "MATLAB_object_decode" in node.attrs:
        needs = f"an object of class {kind}, and reading it needs the package mat-io"
        return Lost(needs, f"pip install mat-io, or {EXPORT}")
    if not hasattr(node, "dtype"):
        return _struct(file, node, depth)
    if "MATLAB_empty" in node.attrs:
        return np.empty((0, 0))
    array = np.asarray(node[()]).T
    if node.dtype.kind == "O":
        cells = np.empty(array.shape, dtype=object)
        for place, reference in np.ndenumerate(array):
            cells[place] = _value(file, file[reference], depth + 1)
        return cells
    if kind == "char":
        return "".join(map(chr, array.ravel().tolist()))
    return array if array.dtype.names is None else array["real"] + 1j * array["imag"]


def _class_of(node: Any) -> str:
    kind = node.attrs.get("MATLAB_class", b"")
    return kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)


def _struct(file: Any, node: Any, depth: int) -> Any:
    """A struct as one record; the fields of an array of structs are lists of references."""
    fields = {name: _value(file, node[name], depth + 1) for name in node}
    alone = any(not hasattr(node[name], "dtype") or _class_of(node[name]) for name in node)
    shape = (1, 1) if alone or not fields else next(iter(fields.values())).shape
    records = np.empty(shape, dtype=[(name, object) for name in fields])
    for name, value in fields.items():
        if alone:
            records[name][0, 0] = value
        else:
            records[name] = value
    return records
