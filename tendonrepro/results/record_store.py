"""A file of records: what independent pieces of work gave, with which an interrupted study goes on."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tendonrepro.errors import DataMissingError

Records: TypeAlias = NDArray[Any]
"""A structured array, an entry for each piece of work."""

RecordType: TypeAlias = np.dtype[Any]
"""Fields of a record."""

_DONE = "done"
_AGAIN = "remove it, and run the same command again"


class RecordStore:
    """Records of a study's pieces of work, numbered from 0, in a file of NumPy's.

    ``missing()`` tells what is still to be done, and that is how a study goes on after an interruption:

    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "squares.npy"
    >>> file = RecordStore(path, np.dtype([("square", float)]), 4)
    >>> file.put([0, 2], np.array([(0.0,), (4.0,)], file.dtype))
    >>> RecordStore(path, np.dtype([("square", float)]), 4).missing().tolist()
    [1, 3]
    >>> file.put([1, 3], np.array([(1.0,), (9.0,)], file.dtype))
    >>> file.read()["square"].tolist()
    [0.0, 1.0, 4.0, 9.0]

    One process writes; others send it their records, as those of `tendonrepro.parallel.as_ready` do. A kill
    at any instant leaves whole records, and a file that was interrupted ends with the same bytes as one that
    was not. Whatever decides a record belongs into the name of the file, as a digest. A study of more pieces
    takes up the file of one of fewer.

    Parameters
    ----------
    path
        Made where there is none.
    dtype
        Of a record: fields of one size. A text goes into a field of bytes.
    count
        Pieces of work.

    Raises
    ------
    DataMissingError
        If the file is damaged, or holds something else.
    """

    def __init__(self, path: Path, dtype: RecordType, count: int) -> None:
        self.path, self.dtype, self.count = path, dtype, count
        # The last byte of a record is written last: a record that is cut off is not done.
        self._stored = np.dtype([*((name, dtype[name]) for name in dtype.names or ()), (_DONE, np.bool_)])
        before = self._opened() if path.exists() else np.empty(0, self._stored)
        if len(before) < count:
            self._make(before)

    def missing(self) -> NDArray[np.int64]:
        """Numbers of the pieces that have no record yet."""
        return np.flatnonzero(~self._opened()[: self.count][_DONE])

    def put(self, places: Iterable[int], records: Records) -> None:
        """Write records of some pieces, and see that they are on disk."""
        whole = np.zeros(len(records), self._stored)
        for name in self.dtype.names or ():
            whole[name] = records[name]
        whole[_DONE] = True
        size = self._stored.itemsize
        start = self.path.stat().st_size - len(self._opened()) * size
        # No memory map: where a disk is full, that would end the process, and this raises an error.
        with self.path.open("r+b") as stream:
            for place, record in zip(places, whole, strict=True):
                stream.seek(start + int(place) * size)
                stream.write(record.tobytes())
            stream.flush()
            os.fsync(stream.fileno())

    def read(self) -> Records:
        """Records of all pieces, which have to be done; they stay on disk until they are looked at."""
        return finished(self.path, self.count, _AGAIN)

    def _opened(self) -> Records:
        records = _opened(self.path, _AGAIN)
        if records.dtype != self._stored:
            raise DataMissingError("holds other records", where=str(self.path), hint=_AGAIN)
        return records

    def _make(self, before: Records) -> None:
        """Make the file, with the records of a smaller one; what is not written takes no room."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self.path.with_name(f".{self.path.name}")
        header = {"descr": npy.dtype_to_descr(self._stored), "fortran_order": False, "shape": (self.count,)}
        with fresh.open("wb") as stream:
            npy.write_array_header_1_0(stream, header)
            start = stream.tell()
            stream.write(before.tobytes())
            stream.truncate(start + self.count * self._stored.itemsize)
        fresh.replace(self.path)


def finished(path: Path, count: int, hint: str) -> Records:
    """Read the first records of a file, which stay on disk until they are looked at.

    Raises
    ------
    DataMissingError
        If the file is missing, damaged, or holds fewer; `hint` says what to do.
    """
    records = _opened(path, hint)[:count]
    if len(records) < count or not records[_DONE].all():
        raise DataMissingError("is not finished", where=str(path), hint=hint)
    return records


def _opened(path: Path, hint: str) -> Records:
    """Records as they are on disk."""
    try:
        records: Records = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise DataMissingError(
            "is missing, damaged or no file of records", where=str(path), hint=hint
        ) from error
    if _DONE not in (records.dtype.names or ()):
        raise DataMissingError("holds no records", where=str(path), hint=hint)
    return records
