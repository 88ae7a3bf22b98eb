"""The reader for each type of file, and the files below what a user named."""

from __future__ import annotations

import hashlib
import os
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from tendonrepro.dataset.readers.archive import DEEPEST, KINDS, UNPACK, members
from tendonrepro.dataset.readers.filetype import FileType, kind_of
from tendonrepro.dataset.readers.signals import MOST_UNPACKED, Allowance, Found, Skipped, Source, Unreadable
from tendonrepro.dataset.repository.lock import lock_path
from tendonrepro.dataset.repository.names import Numbered, is_ours, printable
from tendonrepro.errors import DataMissingError

_NO_MEMORY = ("needs too much memory", "split it into smaller files")


def files_below(paths: Sequence[Path]) -> list[tuple[Path, str]]:
    """Files that a user means by files and folders, each with its name below its folder.

    The folder comes first where several paths were given. A mark stands for what is no text in a name, and
    a number follows where two become the same by that. Links that lead out of a folder are left out, and so
    are hidden files and what `fetch` leaves there for itself. A DataMissingError where a path does not
    exist, or there is no file.
    """
    found: list[tuple[Path, str]] = []
    for path in paths:
        if path.is_dir():
            prefix = f"{path.name or path.resolve().name}/" if len(paths) > 1 else ""
            found += [(file, prefix + file.relative_to(path).as_posix()) for file in _inside(path)]
        elif path.is_file():
            found.append((path, path.name))
        else:
            message = f"{path} does not exist" if not path.exists() else f"{path} is neither file nor folder"
            raise DataMissingError(message, hint="name a file, an archive or a folder")
    if not found:
        message = f"no files in {', '.join(map(str, paths))}"
        raise DataMissingError(message, hint="tendonrepro fetch downloads the paper's data")
    used = Numbered()
    names = {name: used.take(printable(name)) for name in dict.fromkeys(name for _, name in found)}
    return [(path, names[name]) for path, name in found]


def _inside(folder: Path) -> Iterator[Path]:
    """Files below a folder in the order of their names."""
    root = folder.resolve()
    for place, folders, files in os.walk(folder):
        here = Path(place)
        locks = {lock_path(here / name).name for name in folders}
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = here / name
            left_out = name.startswith(".") or is_ours(name) or name in locks
            if not left_out and path.is_file() and path.resolve().is_relative_to(root):
                yield path


def read_bit_by_bit(path: Path, name: str, left: Allowance) -> Iterator[Source]:
    """Sources of a file as they are read; an archive comes first and, with what was left out, again."""
    with (
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
        tempfile.TemporaryDirectory(prefix="tendonrepro-") as folder,
    ):
        # Libraries warn about odd files; what matters of it is in what they return.
        warnings.simplefilter("ignore")
        with suppress(OSError):
            left.begin(path.stat().st_size)
        yield from _read(path, name, Path(folder), left, depth=1)


def _read(path: Path, name: str, folder: Path, left: Allowance, depth: int) -> Iterator[Source]:
    try:
        kind = kind_of(path)
        if kind in KINDS:
            yield from _read_archive(path, name, kind, folder, left, depth)
        else:
            yield _read_one(path, name, kind, left)
    except OSError as error:
        yield unread(path, name, f"cannot be opened: {error.strerror or error}")


def _read_one(path: Path, name: str, kind: FileType, left: Allowance) -> Source:
    try:
        found = _found(path, kind, left)
    except Unreadable as error:
        return unread(path, name, error.reason, error.advice, str(kind))
    except MemoryError:
        return unread(path, name, *_NO_MEMORY, str(kind))
    except Exception as error:  # a file no reader foresaw must not stop the others
        reason = f"its reader failed: {type(error).__name__}: {str(error)[:200]}"
        return unread(path, name, reason, "save it again, as CSV or HDF5 for instance", str(kind))
    if not found.signals and not found.skipped:
        found.skip("", "no numbers in it")
    return Source(name, found.kind, *_digest(path), tuple(found.signals), tuple(found.skipped), found.texts)


def _found(path: Path, kind: FileType, left: Allowance) -> Found:
    """Read a file of a type; the libraries for it are loaded only now."""
    match kind:
        case FileType.MATLAB_5 | FileType.MATLAB_73:
            from tendonrepro.dataset.readers.matlab.file import read_matlab

            return read_matlab(path, left)
        case FileType.HDF5:
            from tendonrepro.dataset.readers.arrays import read_hdf5

            return read_hdf5(path, left)
        case FileType.NPY | FileType.NPZ:
            from tendonrepro.dataset.readers.arrays import read_npy, read_npz

            return (read_npy if kind is FileType.NPY else read_npz)(path, left)
        case FileType.XLSX | FileType.XLSB | FileType.XLS | FileType.ODS:
            from tendonrepro.dataset.readers.workbook import read_workbook

            return read_workbook(path, str(kind), left)
        case FileType.TEXT:
            from tendonrepro.dataset.readers.text import read_text_table

            return read_text_table(path, left)
    raise Unreadable(f"{kind}: not a format with signals that is read", kind.advice)


def _read_archive(
    path: Path, name: str, kind: FileType, folder: Path, left: Allowance, depth: int
) -> Iterator[Source]:
    """The archive, its members, and the archive with what was left out."""
    if depth > DEEPEST:
        reason = f"more than {DEEPEST} archives inside each other"
        yield unread(path, name, reason, UNPACK, str(kind))
        return
    whole = Source(name, str(kind), *_digest(path))
    yield whole
    skipped: list[Skipped] = []
    names, inside = Numbered(), 0
    own = folder / str(depth)
    own.mkdir(exist_ok=True)
    try:
        for member in members(path, own, name, left):
            if member.path is None:
                skipped.append(Skipped(member.name, member.reason, member.advice))
                continue
            inner = names.take(f"{name}/{member.name}")
            inside += 1
            yield from _read(member.path, inner, folder, left, depth + 1)
    except Unreadable as error:
        skipped.append(Skipped("", error.reason, error.advice))
    except MemoryError:
        skipped.append(Skipped("", *_NO_MEMORY))
    if not (inside or skipped):
        skipped.append(Skipped("", "no files in it"))
    yield replace(whole, skipped=tuple(skipped))


def unread(path: Path, name: str, reason: str, advice: str = "", kind: str = "unknown") -> Source:
    """What is known of a file that could not be read; size 0 and no digest if it cannot even be opened."""
    try:
        size, md5 = _digest(path)
    except OSError:
        size, md5 = 0, ""
    return Source(name, kind, size, md5, (), (Skipped("", reason, advice),))


def _digest(path: Path) -> tuple[int, str]:
    """Bytes of a file and their md5; none of what no reader would read, which may be empty space on end."""
    size = path.stat().st_size
    if size > MOST_UNPACKED:
        return size, ""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
        return stream.tell(), digest
