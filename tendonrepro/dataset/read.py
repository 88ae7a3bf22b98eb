"""Files, folders and archives as tables.

A process of its own reads: a damaged file can crash the HDF5 library.
"""

from __future__ import annotations

import os
import re
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

from loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

from tendonrepro.configuration.strict_yaml import is_yaml
from tendonrepro.dataset.formats import is_labview, packaged, read_lvm, read_package, read_tdms, read_workbook
from tendonrepro.dataset.nested import read_hdf5
from tendonrepro.dataset.tables import BY_JOINT, Columns, Tables, Unreadable, by_joint, with_one_time
from tendonrepro.dataset.text import encoding_of_bytes, read_text_table
from tendonrepro.errors import DataMissingError
from tendonrepro.files import md5_of

MOST_BYTES = 2**31
"""Of a file, and of all files in an archive."""

_BOOKS = {".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"}
_ARCHIVES = {".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz"}
_TEXTS = {".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm", ".log", ".prn", ".mot", ".sto", ""}
_HDF = b"\x89HDF"
"""First bytes of an HDF5 file."""
_UNICODE = 0x800
"""Flag of a name in a zip that is Unicode."""
_UNDECODED = re.compile("[\udc80-\udcff]")
"""Bytes of a file's name that Python could not decode."""


class Contents(NamedTuple):
    """Tables of files; by file why it was `unread`; and by file lines on what is in no table of it."""

    tables: list[Columns]
    unread: dict[str, str]
    left_out: dict[str, list[str]]


def read_files(paths: Sequence[Path]) -> Contents:
    """Read every table of files, folders and archives.

    Raises
    ------
    DataMissingError
        If a path is missing, or nothing can be read.
    """
    for path in paths:
        if not path.exists():
            hint = "tendonrepro data fetch gets the record"
            if is_yaml(path):
                hint = f"to write a mapping there, say --mapping {path}"
            raise DataMissingError("is not there", where=str(path), hint=hint)
    contents = Contents([], {}, {})
    with tempfile.TemporaryDirectory() as scratch, _reader() as read:
        names = {path: "" if path.is_dir() else _readable([path.name])[0] for path in paths}
        folder, unread = Path(scratch), contents.unread
        files = [opened for path, name in names.items() for opened in _files(path, name, folder, unread)]
        packages = [path for path, _ in files if path.suffix == ".json"]
        described = {table.resolve() for path in packages for table in packaged(path)}
        for path, name in files:
            if path.resolve() in described:
                # Its package reads it, and knows its units.
                continue
            try:
                tables, left_out = read(path, name)
            except Unreadable as error:
                contents.unread[name] = str(error)
                continue
            contents.tables.extend(tables)
            if left_out:
                contents.left_out[name] = left_out
    if not contents.tables:
        reasons = "; ".join(f"{file}: {reason}" for file, reason in contents.unread.items()) or "no files"
        raise DataMissingError(f"nothing to read: {reasons}"[:500])
    return contents


@contextmanager
def _reader() -> Iterator[Callable[[Path, str], tuple[list[Columns], list[str]]]]:
    """Give what reads a file as `read_file` does, one that might crash a library in a process of its own."""
    pools: list[ProcessPoolExecutor] = []

    def read(path: Path, name: str) -> tuple[list[Columns], list[str]]:
        if _reader_of(path) not in _MAY_CRASH:
            return read_file(path, name)
        if not pools:
            pools.append(ProcessPoolExecutor(max_workers=1))
        try:
            tables: tuple[list[Columns], list[str]] = pools[0].submit(read_file, path, name).result()
        except BrokenProcessPool:
            pools.clear()
            raise Unreadable("reading it crashed: the file is damaged") from None
        return tables

    try:
        yield read
    finally:
        for pool in pools:
            pool.shutdown()


def _files(path: Path, name: str, scratch: Path, unread: dict[str, str]) -> Iterator[tuple[Path, str]]:
    if path.is_dir():
        members = sorted(path.glob("[!.]*"))
        for member, readable in zip(members, _readable([member.name for member in members]), strict=True):
            yield from _files(member, f"{name}/{readable}".lstrip("/"), scratch, unread)
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


def _readable(names: Sequence[str]) -> list[str]:
    """Names of files as text, those too that are not in the encoding of this system."""
    foreign = [name for name in names if _UNDECODED.search(name)]
    encoding = _encoding_of_names(map(os.fsencode, foreign))
    return [os.fsencode(name).decode(encoding, "replace") if name in foreign else name for name in names]


def _unpack(path: Path, folder: Path) -> None:
    """Unpack an archive of no more than a file may have, with names that may be Chinese or Western."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            # The others say that they are Unicode.
            names = [member.filename for member in archive.infolist() if not member.flag_bits & _UNICODE]
            _refuse_large(member.file_size for member in archive.infolist())
        encoding = _encoding_of_names(name.encode("cp437", "ignore") for name in names)
        with zipfile.ZipFile(path, metadata_encoding=encoding) as archive:
            archive.extractall(folder)
    elif tarfile.is_tarfile(path):
        with tarfile.open(path) as archive:
            _refuse_large(member.size for member in archive)
            encoding = _encoding_of_names(map(os.fsencode, archive.getnames()))
        with tarfile.open(path, encoding=encoding) as archive:
            archive.extractall(folder, filter="data")
    else:
        raise Unreadable("neither zip nor tar")


def _refuse_large(sizes: Iterable[int]) -> None:
    """Refuse what says that it needs more than `MOST_BYTES` when it is unpacked, before it is."""
    if any(total > MOST_BYTES for total in accumulate(sizes)):
        raise Unreadable(f"more than {MOST_BYTES >> 30} GiB when unpacked; unpack it, and name its folder")


def _encoding_of_names(names: Iterable[bytes]) -> str:
    encoding, _ = encoding_of_bytes(b"\n".join(names))
    return encoding.removesuffix("-sig")


def read_file(path: Path, name: str) -> tuple[list[Columns], list[str]]:
    """Read the tables of one file, and lines on what is in none of them.

    Raises
    ------
    Unreadable
        If there are none or the file is damaged.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise Unreadable(f"{size / 2**30:.1f} GiB, more than {MOST_BYTES >> 30} GiB")
    try:
        tables = _reader_of(path)(path)
    except Unreadable:
        raise
    except Exception as error:
        raise Unreadable(f"damaged, or not what its name says: {error}"[:200]) from error
    left_out = tables.left_out + [
        f"{inner}: {note}" if inner else note for inner, columns in tables.items() for note in columns.notes
    ]
    filled = {inner: with_one_time(columns) for inner, columns in tables.items() if columns}
    wide = {f"{inner}.{BY_JOINT}".strip("."): by_joint(columns) for inner, columns in filled.items()}
    filled |= {inner: columns for inner, columns in wide.items() if columns}
    if not filled:
        reasons = f": {'; '.join(left_out)}" if left_out else ""
        raise Unreadable(f"holds no columns of numbers{reasons}"[:400])
    file: dict[str, str | int] = {"name": name, "size": size, "md5": md5_of(path)}
    for inner, columns in filled.items():
        columns.name, columns.file = f"{name}:{inner}" if inner else name, file
    return list(filled.values()), left_out


def _reader_of(path: Path) -> Callable[[Path], Tables]:
    """What reads a file, by its first bytes before its name."""
    with path.open("rb") as stream:
        head = stream.read(512)
    suffix = path.suffix.lower()
    if suffix == ".mat" or head.startswith(b"MATLAB") or (suffix == ".fig" and head.startswith(_HDF)):
        return _read_matlab
    if head.startswith(_HDF):
        return read_hdf5
    if suffix == ".tdms" or head.startswith(b"TDSm"):
        return read_tdms
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        return read_workbook
    if suffix == ".json":
        return read_package
    if suffix in _TEXTS | _BOOKS:
        return read_lvm if is_labview(path) else read_text_table
    raise Unreadable(f"a format that is not read: {suffix or 'no suffix'}")


def _read_matlab(path: Path) -> Tables:
    # Its libraries take half a second to import.
    from tendonrepro.dataset.matlab import read_matlab

    return read_matlab(path)


_MAY_CRASH = {_read_matlab, read_hdf5}
"""Readers whose libraries a damaged file can crash."""
