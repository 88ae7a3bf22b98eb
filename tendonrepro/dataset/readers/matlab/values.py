"""What objects, structs and cells of a MATLAB file become before they are walked through."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array

EXPORT = (
    "export it again from MATLAB: s.q = ts.Data; s.t = ts.Time; save('x.mat', '-struct', 's'); "
    "a table with writetable(T, 'x.csv')"
)
"""Advice for objects that cannot be read."""
PACKAGE = f"pip install mat-io, or {EXPORT}"


@dataclass(frozen=True, eq=False)
class Series:
    """Samples along any axis with what their container says, as in a `Signal`, and the block logged."""

    values: NDArray[Any]
    time: Array | None = None
    label: str = ""
    unit: str | None = None
    note: str = ""
    block: str = ""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns by name, each (N,), their units as far as they are stored, and the times of the rows in s."""

    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str] = field(default_factory=dict)
    time: Array | None = None
    note: str = ""


@dataclass(frozen=True)
class Lost:
    """Something that holds no signal, or cannot be read."""

    reason: str
    advice: str = ""


Plain: TypeAlias = Any
"""`Series`, `Table`, `Lost`, a mapping of members, a str, or an ndarray of numbers, records or cells."""


def brief(error: Exception) -> str:
    """An error of a library in one line; its type as well where the text is a word or none."""
    words = str(error).split()
    return " ".join(words if len(words) > 1 else [f"{type(error).__name__}:", *words])[:120]


def members(record: Any) -> dict[str, Any]:
    """Fields of one struct: an element of an array of records, or such an array of one element."""
    if isinstance(record, np.ndarray):
        record = record.flat[0] if record.size == 1 else None
    names = getattr(getattr(record, "dtype", None), "names", None) or ()
    return {name: record[name] for name in names}


def text_of(value: Any) -> str:
    """First line of a char array, or of what it is in; empty where there is none."""
    while isinstance(value, np.ndarray) and value.size and value.dtype.kind in "OUST":
        value = value.flat[0]
    return " ".join(value.split()) if isinstance(value, str) else ""


def flat_samples(values: NDArray[Any], samples: int | None) -> tuple[NDArray[Any], str]:
    """Bring an array of one matrix per sample, (N, ...) or (..., N), into rows (N, m), and a note.

    An array without more than two dimensions, or without one of N = `samples`, stays as it was.
    """
    wide = sum(size > 1 for size in values.shape) > 2
    if values.ndim < 3 or samples is None or samples not in (values.shape[0], values.shape[-1]):
        return values, ""
    if values.shape[-1] == samples:
        values = np.moveaxis(values, -1, 0)
    shape = "x".join(map(str, values.shape[1:]))
    note = f"a matrix of {shape} per sample, column by column" if wide else ""
    return values.reshape((samples, -1), order="F"), note
