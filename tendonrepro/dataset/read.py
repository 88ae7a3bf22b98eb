"""Files, folders and archives as tables."""

from __future__ import annotations

import os
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from tendonrepro.dataset import formats
from tendonrepro.dataset.tables import BY_JOINT, Columns, Tables, Unreadable, by_joint, with_one_time
from tendonrepro.dataset.text import encoding_of_bytes, read_text_table
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import md5_of

MOST_BYTES = 2**31
"""Of a file, and of all files in an archive."""

_BOOKS = {".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"}
_ARCHIVES = {".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz"}
_TEXTS = {".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm", ".log", ".prn", ".mot", ".sto", ""}
_UNICODE = 0x800
"""Flag of a name in a zip that is Unicode."""


class Contents(NamedTuple):
    """Tables of files; by file why it was `unread`; and by file lines on what is in no table of it."""

    tables: list[Columns]
    unread: dict[str, str]
    left_out: dict[str, list[str]]


def read_files(paths: Sequence[Path]) -> Contents:
    """Read every table of files, folders and archives.

    Raises
    ------
    UsageError
        If there are no paths.
    DataMissingError
        If a path is missing, or nothing can be read.
    """
    if not paths:
        raise UsageError("names nothing to read", where="PATHS", hint="name files, folders or archives")
    for path in paths:
        if not path.exists():
            hint = "tendonrepro data fetch gets the record"
            raise DataMissingError("is not there", where=str(path), hint=hint)
    tables: list[Columns] = []
    unread: dict[str, str] = {}
    left_out: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        names = {path: "" if path.is_dir() else _as_text(path.name) for path in paths}
        files = [file for path, name in names.items() for file in _files(path, name, scratch, unread)]
        packages = [path for path, _ in files if path.suffix == ".json"]
        # A package reads the tables beside it, and knows their units.
        described = {table.resolve() for path in packages for table in formats.packaged(path)}
        for path, name in files:
            if path.resolve() in described:
                continue
            try:
                of_file, lines = read_file(path, name)
            except Unreadable as error:
                unread[name] = str(error)
                continue
            tables += of_file
            if lines:
                left_out[name] = lines
    if not tables:
        reasons = "; ".join(f"{file}: {reason}" for file, reason in unread.items()) or "no files"
        raise DataMissingError(f"nothing to read: {reasons}"[:500])
    return Contents(tables, unread, left_out)


def _files(path: Path, name: str, scratch: str, unread: dict[str, str]) -> Iterator[tuple[Path, str]]:
    """Files of a path, unpacked, and their names."""
    if path.is_dir():
        for member in sorted(path.glob("[!.]*")):
            yield from _files(member, f"{name}/{_as_text(member.name)}".lstrip("/"), scratch, unread)
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


def _as_text(name: str) -> str:
    """A file's name without bytes that are not of this system's encoding."""
    return name.encode("utf-8", "replace").decode()


def _unpack(path: Path, folder: Path) -> None:
    """Unpack an archive of no more than a file may have, with names that may be Chinese or Western."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            # The others say that they are Unicode.
            names = [member.filename for member in archive.infolist() if not member.flag_bits & _UNICODE]
            _refuse_large(member.file_size for member in archive.infolist())
        encoding = _encoding_of(name.encode("cp437", "ignore") for name in names)
        with zipfile.ZipFile(path, metadata_encoding=encoding) as archive:
            archive.extractall(folder)
    elif tarfile.is_tarfile(path):
        with tarfile.open(path) as archive:
            _refuse_large(member.size for member in archive)
            encoding = _encoding_of(map(os.fsencode, archive.getnames()))
        with tarfile.open(path, encoding=encoding) as archive:
            archive.extractall(folder, filter="data")
    else:
        raise Unreadable("neither zip nor tar")


def _refuse_large(sizes: Iterable[int]) -> None:
    """Refuse what says that it needs more than `MOST_BYTES` when it is unpacked, before it is."""
    if sum(sizes) > MOST_BYTES:
        raise Unreadable(f"more than {MOST_BYTES >> 30} GiB when unpacked; unpack it, and name its folder")


def _encoding_of(names: Iterable[bytes]) -> str:
    return encoding_of_bytes(b"\n".join(names))[0].removesuffix("-sig")


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
    filled = {inner: columns for inner, columns in tables.items() if columns}
    for columns in filled.values():
        with_one_time(columns)
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
    if suffix == ".mat" or head.startswith(b"MATLAB"):
        # Its libraries take half a second to import.
        from tendonrepro.dataset.matlab import read_matlab

        return read_matlab
    if head.startswith(b"\x89HDF"):
        return formats.read_hdf5
    if suffix == ".tdms" or head.startswith(b"TDSm"):
        return formats.read_tdms
    if head.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        return formats.read_workbook
    if suffix == ".json":
        return formats.read_package
    if suffix in _TEXTS | _BOOKS:
        return formats.read_lvm if head.startswith(b"LabVIEW Measurement") else read_text_table
    raise Unreadable(f"a format that is not read: {suffix or 'no suffix'}")
