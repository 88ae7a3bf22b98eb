"""The reader for each type of file, and the files below what a user named."""

from __future__ import annotations

import hashlib
import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from tendonrepro.dataset.archive import DEEPEST, KINDS, Allowance, members
from tendonrepro.dataset.filetype import ADVICE, FileType, kind_of
from tendonrepro.dataset.signals import MOST_BYTES, Found, Signal, Skipped, Source
from tendonrepro.dataset.unreadable import Unreadable
from tendonrepro.errors import DataMissingError

_OWN_SUFFIXES = (".part", ".part.json", ".lock", ".lock.json")


def files_below(paths: Sequence[Path]) -> list[tuple[Path, str]]:
    """Files that a user means.

    Parameters
    ----------
    paths : sequence of Path
        Files, and folders to be searched through. Hidden files, links that lead out of the folder, and the
        locks and unfinished downloads of `fetch` are left out.

    Returns
    -------
    list of (Path, str)
        Each file and its name: below its folder, which comes first where several paths were given.

    Raises
    ------
    DataMissingError
        When a path does not exist, or there is no file at all.
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
    return found


def _inside(folder: Path) -> Iterator[Path]:
    """Files below a folder in the order of their names."""
    root = folder.resolve()
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(place, name)
            own = name.startswith(".") or name.endswith(_OWN_SUFFIXES)
            if not own and path.is_file() and path.resolve().is_relative_to(root):
                yield path


def read_file(path: Path, name: str) -> list[Source]:
    """Read whatever a file holds.

    Parameters
    ----------
    path : Path
    name : str
        What the user knows it by.

    Returns
    -------
    list of Source
        One for the file and, for an archive, one for each file in it. What cannot be read is noted in
        `skipped`, nothing is raised.
    """
    with (
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
        tempfile.TemporaryDirectory(prefix="tendonrepro-") as folder,
    ):
        # Libraries warn about odd files; what matters of it is in what they return.
        warnings.simplefilter("ignore")
        return _read(path, name, Path(folder), Allowance(), depth=1)


def _read(path: Path, name: str, folder: Path, left: Allowance, depth: int) -> list[Source]:
    try:
        kind = kind_of(path)
        if kind in KINDS:
            return _read_archive(path, name, kind, folder, left, depth)
        return [_read_one(path, name, kind)]
    except OSError as error:
        return [unread(path, name, f"cannot be opened: {error.strerror or error}")]


def _read_one(path: Path, name: str, kind: FileType) -> Source:
    try:
        found = _reader(kind)(path)
    except Unreadable as error:
        return unread(path, name, error.reason, error.advice, str(kind))
    except MemoryError:
        return unread(path, name, "needs too much memory", "split it into smaller files", str(kind))
    except Exception as error:  # a file no reader foresaw must not stop the others
        reason = f"its reader failed: {type(error).__name__}: {str(error)[:200]}"
        return unread(path, name, reason, "save it again, as CSV or HDF5 for instance", str(kind))
    size, md5 = _digest(path)
    signals, skipped = _affordable(found)
    return Source(name, found.kind, size, md5, signals, skipped, found.texts)


def _reader(kind: FileType) -> Callable[[Path], Found]:
    """Reader for a type of file; its libraries are loaded only now."""
    if kind in {FileType.MATLAB_4, FileType.MATLAB_5, FileType.MATLAB_73}:
        from tendonrepro.dataset.matlab import read_matlab

        return read_matlab
    if kind is FileType.HDF5:
        from tendonrepro.dataset.hdf5_file import read_hdf5

        return read_hdf5
    if kind in {FileType.NPY, FileType.NPZ}:
        from tendonrepro.dataset.arrays_file import read_npy, read_npz

        return read_npy if kind is FileType.NPY else read_npz
    if kind in {FileType.XLSX, FileType.XLSB, FileType.XLS, FileType.ODS}:
        from tendonrepro.dataset.workbook import read_workbook

        return lambda path: read_workbook(path, str(kind))
    if kind is FileType.TEXT:
        from tendonrepro.dataset.text_table import read_text_table

        return read_text_table
    raise Unreadable(_NOT_READ.get(kind, f"{kind}: not a format with signals that is read"), ADVICE[kind])


_NOT_READ = {
    FileType.EMPTY: "empty, 0 bytes",
    FileType.BINARY: "binary of an unknown format",
    FileType.ENCRYPTED_ZIP: "encrypted",
    FileType.ENCRYPTED_OFFICE: "encrypted",
}


def _affordable(found: Found) -> tuple[tuple[Signal, ...], tuple[Skipped, ...]]:
    """Signals until they fill the memory one file may take, and a note of the rest."""
    taken, kept = 0, 0
    for signal in found.signals:
        taken += signal.values.nbytes
        if taken > MOST_BYTES:
            break
        kept += 1
    skipped = tuple(found.skipped)
    if kept < len(found.signals):
        reason = f"{len(found.signals) - kept} signals left out after {MOST_BYTES // 2**30} GB"
        skipped += (Skipped("", reason, "split the file"),)
    if not found.signals and not skipped:
        skipped = (Skipped("", "no numbers in it"),)
    return tuple(found.signals[:kept]), skipped


def _read_archive(
    path: Path, name: str, kind: FileType, folder: Path, left: Allowance, depth: int
) -> list[Source]:
    """One source for the archive, which says what was left out, and those of its members."""
    if depth > DEEPEST:
        reason = f"more than {DEEPEST} archives inside each other"
        return [unread(path, name, reason, "unpack it yourself and name the folder", str(kind))]
    inside: list[Source] = []
    skipped: list[Skipped] = []
    names: set[str] = set()
    own = folder / str(depth)
    own.mkdir(exist_ok=True)
    try:
        for member in members(path, own, name, left):
            if member.path is None:
                skipped.append(Skipped(member.name, member.reason, member.advice))
                continue
            inner = _unused(f"{name}/{member.name}", names)
            inside += _read(member.path, inner, folder, left, depth + 1)
    except Unreadable as error:
        skipped.append(Skipped("", error.reason, error.advice))
    if not inside and not skipped:
        skipped.append(Skipped("", "no files in it"))
    size, md5 = _digest(path)
    return [Source(name, str(kind), size, md5, (), tuple(skipped)), *inside]


def _unused(name: str, names: set[str]) -> str:
    """Name that no member before had; archives may hold several files of one name."""
    number, unused = 2, name
    while unused in names:
        unused = f"{name} ({number})"
        number += 1
    names.add(unused)
    return unused


def unread(path: Path, name: str, reason: str, advice: str = "", kind: str = "unknown") -> Source:
    """What is known of a file that could not be read.

    Parameters
    ----------
    path : Path
    name : str
        What the user knows it by.
    reason, advice : str
        Why, and what can be done about it.
    kind : str
        True type as far as it is known.

    Returns
    -------
    Source
        Without signals; its size and digest are zero and empty when the file cannot even be opened.
    """
    try:
        size, md5 = _digest(path)
    except OSError:
        size, md5 = 0, ""
    return Source(name, kind, size, md5, (), (Skipped("", reason, advice),))


def _digest(path: Path) -> tuple[int, str]:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
        return stream.tell(), digest
