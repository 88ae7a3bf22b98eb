"""Samples of logs that Simulink has streamed into a MATLAB 7.3 file.

Newer releases keep them apart from the objects they belong to, in ``#sigstream#/<k>`` for k = 0, 1, ...: the
raw little-endian bytes ``#data#``, the number of samples ``#length#`` and the bytes of one sample
``#sampleSize#`` (8 for a double, 8 m for m of them). Where the solver chose its steps, each record of
samples has an odd number and follows the record of its times. Where the steps are fixed there is no record of
times, and the object tells start, step and count instead (``CompressedTime``).

The object of a signal is a struct below ``#refs#`` with its ``Name`` and with ``Values``, whose ``DataR2`` is
the number of the record. A file can hold records without any such struct, when the log they belong to was not
saved with them; then the names are lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.readers.matlab.hdf import STREAMS
from tendonrepro.dataset.readers.matlab.values import EXPORT, brief, flat_samples
from tendonrepro.dataset.readers.signals import MOST_SIGNALS, Found

_TYPES = {4: "<f4", 2: "<i2", 1: "u1"}
_NO_NAME = "a streamed log without its name"


@dataclass(frozen=True, eq=False)
class _Named:
    """What the object of a signal tells about its records."""

    name: str
    record: int
    clock: tuple[float, float] | None


def read_streams(path: Path, found: Found) -> None:
    """Note the streamed samples of a MATLAB 7.3 file, and as skipped the records that cannot be read."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            records = dict(_records(file[STREAMS], found))
            named = list(_named(file.get("#refs#", {})))
    except Exception as error:
        found.skip(STREAMS, f"streamed logs cannot be read ({brief(error)})", EXPORT)
        return
    used = set()
    for own in named:
        if own.record in records:
            used |= {own.record, *_add(found, records, own)}
    for number in sorted(records):
        following = number + 1 not in used and _times(records, number + 1) is not None
        if number not in used and not following:
            used |= _add(found, records, _Named("", number, None))


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
        message = f"{length} samples of {size} bytes announced, {raw.size} bytes stored"
        raise ValueError(message)
    kind = np.dtype(_TYPES.get(size, "<f8"))
    if size % kind.itemsize:
        message = f"samples of {size} bytes are of no known type"
        raise ValueError(message)
    numbers = raw[: size * length].view(kind)
    return numbers.reshape(length, -1) if size > kind.itemsize else numbers


def _named(refs: Any) -> Iterator[_Named]:
    """Signals that objects in the file tell about."""
    import h5py

    for candidate in refs.values():
        if not isinstance(candidate, h5py.Group) or not {"Name", "Values"} <= candidate.keys():
            continue
        values = candidate["Values"]
        if not isinstance(values, h5py.Group) or "DataR2" not in values:
            continue
        record = int(np.ravel(values["DataR2"][()])[0])
        clock = np.ravel(values["CompressedTime"][()]) if "CompressedTime" in values else np.empty(0)
        regular = clock.size == 3 and clock.dtype.kind == "f" and clock[1] > 0.0
        yield _Named(_text(candidate["Name"]), record, (clock[0], clock[1]) if regular else None)


def _text(dataset: Any) -> str:
    codes = np.ravel(dataset[()])
    if codes.dtype != np.uint16 or dataset.attrs.get("MATLAB_empty", 0):
        return ""
    return codes.tobytes().decode("utf-16-le", "replace").replace("\0", "").strip()


def _times(records: dict[int, NDArray[Any]], number: int) -> Array | None:
    """Times of a record with an odd number, if the record before it can be times."""
    clock, values = records.get(number - 1), records.get(number)
    if clock is None or values is None or clock.ndim > 1 or clock.dtype != np.float64:
        return None
    fits = len(clock) == len(values) > 1 and bool((np.diff(clock) > 0.0).all())
    return clock if fits and number % 2 else None


def _add(found: Found, records: dict[int, NDArray[Any]], own: _Named) -> set[int]:
    """Note one record as a signal; tells the records that served."""
    values = records[own.record]
    time = _times(records, own.record)
    served = {own.record - 1, own.record}
    if own.clock is not None:
        start, step = own.clock
        time, served = np.asarray(start + step * np.arange(len(values)), np.float64), {own.record}
    notes = [] if own.name else [_NO_NAME]
    if time is not None and own.clock is None:
        notes.append(f"times from record {own.record - 1}")
    if values.dtype.kind != "f" or values.dtype.itemsize != 8:
        notes.append(f"taken for {values.dtype}, the file does not tell the type")
    flat, note = flat_samples(values, len(values))
    found.add(
        f"{STREAMS}/{own.name or own.record}",
        flat,
        label=own.name,
        group=STREAMS,
        time=time,
        note="; ".join([*notes, note] if note else notes),
    )
    return served if time is not None else {own.record}
