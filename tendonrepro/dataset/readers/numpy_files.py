"""Arrays in NumPy's own files: npy and npz."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.dataset.readers.signals import MOST_SIGNALS, Found, Unreadable, is_full, note_rest, seconds

_BROKEN = "save it again with numpy.save or numpy.savez"
_PICKLED = "objects run code when they are loaded; save the plain arrays one by one with numpy.savez"
_NESTED_FIELDS = 8


def read_npy(path: Path) -> Found:
    """Read the array of an npy file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Found
        A signal ``array``, or one a field of a structured array in the group ``array``.

    Raises
    ------
    Unreadable
        When it is broken or too large, or holds Python objects.
    """
    found = Found("NumPy array (npy)")
    with path.open("rb") as stream:
        add_array(found, "array", _read(found, stream, path.stat().st_size))
    return found


def read_npz(path: Path) -> Found:
    """Read the arrays of an npz file; one that is broken does not stop the rest.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Found
        A signal an array, under its name.

    Raises
    ------
    Unreadable
        When the archive itself is broken.
    """
    found = Found("NumPy arrays (npz)")
    try:
        archive = zipfile.ZipFile(path)
    except Exception as error:  # by what is broken, errors of many kinds
        reason = f"a broken npz file ({error})"
        raise Unreadable(reason, _BROKEN) from error
    with archive:
        entries = archive.infolist()
        for position, entry in enumerate(entries):
            if is_full(found) or position >= MOST_SIGNALS:
                note_rest(found, len(entries) - position, "arrays")
                break
            _add_member(found, archive, entry, str(PurePosixPath(entry.filename).with_suffix("")))
    return found


def _add_member(found: Found, archive: zipfile.ZipFile, entry: zipfile.ZipInfo, name: str) -> None:
    try:
        with archive.open(entry) as stream:
            add_array(found, name, _read(found, stream, entry.file_size))
    except Unreadable as error:
        found.skip(name, error.reason, error.advice)
    except Exception as error:
        found.skip(name, f"broken ({error})", _BROKEN)


def _read(found: Found, stream: IO[bytes], size: int) -> NDArray[Any]:
    """Read an array once it is known that it is all there and may be kept."""
    try:
        shape, fortran, kind = _header(stream)
    except Exception as error:
        reason = f"a broken header ({str(error)[:200]})"
        raise Unreadable(reason, _BROKEN) from error
    if kind.hasobject:
        reason = "saved as Python objects"
        raise Unreadable(reason, _PICKLED)
    announced = math.prod(shape) * kind.itemsize
    held = size - stream.tell()
    if announced > held or min(shape, default=0) < 0:
        reason = f"cut short: its header announces {announced} bytes, {held} are there"
        raise Unreadable(reason, "copy or download it again")
    if not announced:
        return np.zeros(0)
    reason, advice = found.refusal(max(math.prod(shape), announced // 8))
    if reason:
        raise Unreadable(reason, advice)
    flat = np.frombuffer(stream.read(announced), kind)
    return flat.reshape(shape, order="F" if fortran else "C")


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(stream)
    shape, fortran, kind = np.lib.format.read_array_header_2_0(stream)
    # Version 3 is version 2 with the names of fields in UTF-8, and NumPy has no function for it alone.
    return shape, fortran, _from_utf8(kind) if version == (3, 0) else kind


def _from_utf8(kind: np.dtype[Any]) -> np.dtype[Any]:
    """A type whose names of fields were in UTF-8 but taken for Latin."""
    if kind.subdtype:
        inner, shape = kind.subdtype
        return np.dtype((_from_utf8(inner), shape))
    if kind.fields is None or kind.names is None:
        return kind
    members = [kind.fields[name] for name in kind.names]
    return np.dtype(
        {
            "names": [name.encode("latin-1").decode("utf-8", "replace") for name in kind.names],
            "formats": [_from_utf8(member[0]) for member in members],
            "offsets": [member[1] for member in members],
            "itemsize": kind.itemsize,
        }
    )


def add_array(found: Found, name: str, values: NDArray[Any], *, unit: str | None = None) -> None:
    """Add an array as a signal, or one signal a field of a structured one.

    Parameters
    ----------
    found : Found
    name : str
        Path of the array.
    values : ndarray
        Of any type but objects.
    unit : str or None
        As written.
    """
    if values.dtype.names:
        for field, column in _fields(values, _NESTED_FIELDS):
            if is_full(found):
                return
            _add(found, f"{name}/{field}", column, unit, label=field, group=name)
    else:
        _add(found, name, values, unit, label=name.rpartition("/")[2], group=name.rpartition("/")[0])


def _fields(values: NDArray[Any], depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in values.dtype.names or ():
        column = values[name]
        if column.dtype.names and depth:
            yield from ((f"{name}/{inner}", below) for inner, below in _fields(column, depth - 1))
        else:
            yield name, column


def _add(found: Found, path: str, values: NDArray[Any], unit: str | None, *, label: str, group: str) -> None:
    kind = values.dtype.kind
    if kind in "mM":
        numbers, note = seconds(values)
        found.add(path, numbers, label=label, unit="s", group=group, note=note)
    elif kind in "SU":
        words = np.asarray(values).ravel()[:20].astype(str)
        found.text(path, ", ".join(words))
        found.skip(path, "text")
    else:
        found.add(path, values, label=label, unit=unit, group=group)
