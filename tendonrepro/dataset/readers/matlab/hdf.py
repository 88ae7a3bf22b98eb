"""MATLAB 7.3 files, which are HDF5 files: what they announce, and their plain variables without mat-io."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.matlab.values import EXPORT, Lost, brief
from tendonrepro.dataset.readers.signals import BEST_PACKING, HARMLESS, Unreadable

STREAMS = "#sigstream#"
"""Group with the samples of streamed logs."""

_DEEPEST = 32


def contents(path: Path, left: int) -> tuple[list[str], dict[str, str], bool]:
    """Variables that can be read, reasons for the others by name, and whether logs are streamed beside.

    `left` is how many bytes may be read. `Unreadable` if what the variables share lies in another file or
    announces too much.
    """
    import h5py

    most = min(left, max(HARMLESS, BEST_PACKING * path.stat().st_size))
    refused: dict[str, str] = {}
    total = 0
    with h5py.File(path, "r") as file:
        names = [str(name) for name in file]
        for name in names:
            sizes = list(_sizes(file, name, 0))
            size = sum(filter(None, sizes))
            if None in sizes:
                refused[name] = "it refers to another file, or is nested too deeply"
            elif total + size > most:
                refused[name] = "it announces more than the file can hold, or than is read at once"
            else:
                total += size
    shared = [reason for name, reason in refused.items() if name.startswith("#")]
    if shared:
        raise Unreadable(shared[0], "copy or download it again")
    plain = [name for name in names if name not in refused and not name.startswith("#")]
    return plain, refused, STREAMS in names


def _sizes(group: Any, name: str, depth: int) -> Iterator[int | None]:
    """Bytes that each dataset of a variable announces; None for what lies in another file, or too deep."""
    import h5py

    if depth > _DEEPEST or not isinstance(group.get(name, getlink=True), h5py.HardLink):
        yield None
        return
    node = group[name]
    if isinstance(node, h5py.Dataset):
        yield None if node.is_virtual or node.external else node.nbytes
    else:
        for inner in node if isinstance(node, h5py.Group) else ():
            yield from _sizes(node, inner, depth + 1)


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
    array: NDArray[Any] = np.empty((0, 0)) if "MATLAB_empty" in node.attrs else np.asarray(node[()]).T
    if array.dtype.kind == "O":
        cells = np.empty(array.shape, dtype=object)
        for place, reference in np.ndenumerate(array):
            cells[place] = _value(file, file[reference], depth + 1)
        return cells
    if kind == "char" and array.size:
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
