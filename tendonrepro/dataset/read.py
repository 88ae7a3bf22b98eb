"""Files, folders and archives as tables.

A process of its own reads: a damaged file can crash the HDF5 library.
"""

from __future__ import annotations

import shutil
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from joblib.externals.loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

from tendonrepro.dataset.arrays import Columns, Source, Unreadable, read_hdf5, tables_of
from tendonrepro.errors import DataMissingError
from tendonrepro.files import md5_of

MOST_BYTES = 2**31
"""Of a file."""

_BOOKS = {".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"}
_ARCHIVES = {".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz"}
_TEXTS = {".csv", ".tsv", ".txt", ".dat", ".asc", ""}


def read_files(paths: Sequence[Path]) -> tuple[list[Source], dict[str, str]]:
    """Read every table of files, folders and archives; files that were not read have a reason.

    Raises
    ------
    DataMissingError
        If a path is missing, or nothing can be read.
    """
    for path in paths:
        if not path.exists():
            raise DataMissingError("is not there", where=str(path), hint="tendonrepro fetch gets the record")
    sources: list[Source] = []
    unread: dict[str, str] = {}
    reader = ProcessPoolExecutor(max_workers=1)
    with tempfile.TemporaryDirectory() as scratch:
        names = {path: "" if path.is_dir() else path.name for path in paths}
        files = [one for path, name in names.items() for one in _files(path, name, Path(scratch), unread)]
        for path, name in files:
            try:
                sources += reader.submit(read_file, path, name).result()
            except Unreadable as error:
                unread[name] = str(error)
            except BrokenProcessPool:
                unread[name] = "reading it crashed: the file is damaged"
                reader = ProcessPoolExecutor(max_workers=1)
    reader.shutdown()
    if not sources:
        reasons = "; ".join(f"{file}: {reason}" for file, reason in unread.items()) or "no files"
        raise DataMissingError(f"nothing to read: {reasons}"[:500])
    return sources, unread


def _files(path: Path, name: str, scratch: Path, unread: dict[str, str]) -> Iterator[tuple[Path, str]]:
    if path.is_dir():
        for member in sorted(path.glob("[!.]*")):
            yield from _files(member, f"{name}/{member.name}".lstrip("/"), scratch, unread)
    elif path.suffix.lower() in _ARCHIVES:
        folder = Path(tempfile.mkdtemp(dir=scratch))
        try:
            _unpack(path, folder)
        except Exception as error:
            unread[name] = f"cannot be unpacked: {error}"
        else:
            yield from _files(folder, name, scratch, unread)
    else:
        yield path, name


def _unpack(path: Path, folder: Path) -> None:
    if zipfile.is_zipfile(path):
        shutil.unpack_archive(path, folder, "zip")
    elif tarfile.is_tarfile(path):
        with tarfile.open(path) as archive:
            archive.extractall(folder, filter="data")
    else:
        raise Unreadable("neither zip nor tar")


def read_file(path: Path, name: str) -> list[Source]:
    """Read the tables of one file.

    Raises
    ------
    Unreadable
        If there are none or the file is damaged.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise Unreadable(f"{size / 2**30:.1f} GiB, more than {MOST_BYTES >> 30} GiB")
    try:
        tables = _tables(path)
    except Unreadable:
        raise
    except Exception as error:
        raise Unreadable(f"damaged, or not what its name says: {error}"[:200]) from error
    file = {"name": name, "size": size, "md5": md5_of(path)}
    named = {f"{name}:{inner}" if inner else name: columns for inner, columns in tables.items() if columns}
    if not named:
        raise Unreadable("holds no columns of numbers")
    return [Source(table, columns, file) for table, columns in named.items()]


def _tables(path: Path) -> dict[str, Columns]:
    """Tables of a file by their place in it; its first bytes go before its name."""
    from tendonrepro.dataset.matlab import read_matlab
    from tendonrepro.dataset.tables import read_text_table, read_workbook

    with path.open("rb") as stream:
        head = stream.read(512)
    suffix = path.suffix.lower()
    # A figure of MATLAB is a file of MATLAB, and its tables are of colours.
    if suffix == ".mat" or (head.startswith(b"MATLAB") and suffix != ".fig"):
        return dict(tables_of(read_matlab(path)))
    if head.startswith(b"\x89HDF"):
        return dict(tables_of(read_hdf5(path)))
    if suffix in _BOOKS or head.startswith(b"PK\x03\x04"):
        return read_workbook(path)
    if suffix in _TEXTS:
        return read_text_table(path)
    raise Unreadable(f"a format that is not read: {suffix or 'no suffix'}")
