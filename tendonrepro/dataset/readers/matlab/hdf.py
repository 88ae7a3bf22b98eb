"""MATLAB 7.3 files, which are HDF5 files: what they announce, and the samples of streamed logs.

Newer releases of Simulink keep samples apart from the objects they belong to, in ``#sigstream#/<k>``,
k = 0, 1, ...: the raw little-endian bytes ``#data#``, the number of samples ``#length#`` and the bytes of one
sample ``#sampleSize#`` (8 for a double, 8 m for m of them). Where the solver chose its steps, each record of
samples has an odd number and follows the record of its times. Where the steps are fixed there is no record of
times. What a signal is called stands in an object, if that was saved at all; the object has the number of its
record, and so has what is said of it. Records are listed by their numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.matlab.values import EXPORT, brief, flat_samples
from tendonrepro.dataset.readers.signals import (
    BEST_PACKING,
    HARMLESS,
    MOST_SIGNALS,
    Found,
    Unreadable,
    unpacked_size,
)

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
        yield None if node.is_virtual or node.external else unpacked_size(node)
    else:
        for inner in node if isinstance(node, h5py.Group) else ():
            yield from _sizes(node, inner, depth + 1)


_TYPES = {4: "<f4", 2: "<i2", 1: "u1"}


def read_streams(path: Path, found: Found) -> None:
    """Note the streamed samples of a MATLAB 7.3 file, and as skipped the records that cannot be read."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            records = dict(_records(file[STREAMS], found))
    except Exception as error:
        found.skip(STREAMS, f"streamed logs cannot be read ({brief(error)})", EXPORT)
        return
    clocks = {number - 1 for number in records if _times(records, number) is not None}
    for number, values in sorted(records.items()):
        if number not in clocks:
            _add(found, number, values, _times(records, number))


def _records(group: Any, found: Found) -> Iterator[tuple[int, NDArray[Any]]]:
    numbers = sorted(int(name) for name in group if name.isdecimal())
    for number in numbers[:MOST_SIGNALS]:
        try:
            yield number, _samples(group[str(number)])
        except Exception as error:
            found.skip(f"{STREAMS}/{number}", f"cannot be read ({brief(error)})", EXPORT)
    if len(numbers) > MOST_SIGNALS:
        found.skip(STREAMS, f"{len(numbers) - MOST_SIGNALS} more records are left out")


def _samples(record: Any) -> NDArray[Any]:
    """One record, shape (N,) or (N, m)."""
    size, length = (int(np.ravel(record[name][()])[0]) for name in ("#sampleSize#", "#length#"))
    raw = np.asarray(record["#data#"][()], np.uint8).ravel()
    if size <= 0 or length < 0 or size * length > raw.size:
        raise ValueError(f"{length} samples of {size} bytes announced, {raw.size} bytes stored")
    kind = np.dtype(_TYPES.get(size, "<f8"))
    if size % kind.itemsize:
        raise ValueError(f"samples of {size} bytes are of no known type")
    numbers = raw[: size * length].view(kind)
    return numbers.reshape(length, -1) if size > kind.itemsize else numbers


def _times(records: dict[int, NDArray[Any]], number: int) -> Array | None:
    """Times of a record with an odd number, if the record before it can be times."""
    clock, values = records.get(number - 1), records.get(number)
    if clock is None or values is None or clock.ndim > 1 or clock.dtype != np.float64:
        return None
    fits = len(clock) == len(values) > 1 and bool((np.diff(clock) > 0.0).all())
    return clock if fits and number % 2 else None


def _add(found: Found, number: int, values: NDArray[Any], time: Array | None) -> None:
    """Note one record as a signal."""
    notes = ["a streamed log without its name"]
    if time is not None:
        notes.append(f"times from record {number - 1}")
    if values.dtype.kind != "f" or values.dtype.itemsize != 8:
        notes.append(f"taken for {values.dtype}, the file does not tell the type")
    flat, note = flat_samples(values, len(values))
    notes += [note] if note else []
    found.add(f"{STREAMS}/{number}", flat, group=STREAMS, time=time, note="; ".join(notes))
