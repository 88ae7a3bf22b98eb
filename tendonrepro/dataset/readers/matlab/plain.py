"""Plain variables of MATLAB 7.3 files without mat-io: numbers, texts, structs, cells, but no objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.dataset.readers.matlab.values import EXPORT, Lost

DEEPEST = 32
"""Structs and cells in one another that are followed."""
_NEEDS = f"pip install mat-io, or {EXPORT}"


def is_hdf(path: Path) -> bool:
    """Whether a MATLAB file is of version 7.3."""
    import h5py

    return bool(h5py.is_hdf5(path))


def load_plain(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Read variables of a MATLAB 7.3 file whose sizes have been checked.

    Parameters
    ----------
    path : Path
    names : sequence of str

    Returns
    -------
    dict
        Name -> array, text, array of records for a struct or of objects for a cell; `Lost` where it is
        neither.
    """
    import h5py

    values: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        for name in names:
            try:
                values[name] = _value(file, file[name], 0)
            except Exception as error:
                detail = " ".join(str(error).split())[:120]
                values[name] = Lost(f"cannot be read ({type(error).__name__}: {detail})", EXPORT)
    return values


def _value(file: Any, node: Any, depth: int) -> Any:
    kind = _class_of(node)
    if depth > DEEPEST:
        return Lost("nested too deep")
    if "MATLAB_object_decode" in node.attrs:
        return Lost(f"an object of class {kind}, and reading it needs the package mat-io", _NEEDS)
    if not hasattr(node, "dtype"):
        return _struct(file, node, depth)
    if node.dtype.kind == "O":
        return _cells(file, node, depth)
    return _array(node, kind)


def _array(node: Any, kind: str) -> Any:
    if "MATLAB_empty" in node.attrs:
        return np.empty((0, 0))
    array = np.asarray(node[()]).T
    if kind == "char":
        return "".join(map(chr, array.ravel().tolist()))
    return array if array.dtype.names is None else array["real"] + 1j * array["imag"]


def _class_of(node: Any) -> str:
    kind = node.attrs.get("MATLAB_class", b"")
    return kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)


def _struct(file: Any, node: Any, depth: int) -> Any:
    """A struct as one record; the fields of an array of structs are lists of references."""
    fields = {name: _value(file, node[name], depth + 1) for name in node}
    alone = any(hasattr(node[name], "dtype") is False or _class_of(node[name]) for name in node)
    shape = (1, 1) if alone or not fields else next(iter(fields.values())).shape
    records = np.empty(shape, dtype=[(name, object) for name in fields])
    for name, value in fields.items():
        if alone:
            records[name][0, 0] = value
        else:
            records[name] = value
    return records


def _cells(file: Any, node: Any, depth: int) -> Any:
    references = np.asarray(node[()]).T
    cells = np.empty(references.shape, dtype=object)
    for place, reference in np.ndenumerate(references):
        cells[place] = _value(file, file[reference], depth + 1)
    return cells
