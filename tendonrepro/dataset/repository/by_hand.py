"""Files that somebody downloaded by hand, found in their folder, checked and copied."""

from __future__ import annotations

import shutil
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from tendonrepro.dataset.repository.lock import LockedFile, is_same
from tendonrepro.dataset.repository.names import is_ours, printable, safe_paths, shown
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import atomic_path, md5_of


@dataclass(frozen=True)
class OnDisk:
    """What a folder holds of a record.

    Attributes
    ----------
    sources : dict of Path
        Where each file was found, by its path in the record.
    ignored : list of str
        Files that are none of the record's.
    """

    sources: dict[str, Path]
    ignored: list[str]


def list_folder(folder: Path, wanted: Container[str] = ()) -> dict[str, Path]:
    """Files below a folder by their relative names; hidden ones and our own working files are left out.

    Parameters
    ----------
    folder : Path
    wanted : container of str
        Names that are listed even when they are hidden.

    Returns
    -------
    dict of Path

    Raises
    ------
    UsageError
        If there is no such folder, or it cannot be read.
    """
    if not folder.is_dir():
        message = "is not a folder"
        raise UsageError(message, where=str(folder), hint="give the folder with the downloaded files")
    try:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
        raise UsageError(message, where=str(folder)) from error
    names = {path.relative_to(folder).as_posix(): path for path in paths}
    return {
        name: path
        for name, path in names.items()
        if name in wanted
        or not (is_ours(path.name) or any(piece.startswith(".") for piece in name.split("/")))
    }


def find_files(expected: Sequence[LockedFile], folder: Path) -> OnDisk:
    """Look for a record's files in a folder, by their path or their bare name.

    Parameters
    ----------
    expected : sequence of LockedFile
    folder : Path

    Returns
    -------
    OnDisk

    Raises
    ------
    UsageError
        If the folder cannot be read.
    DataMissingError
        If a file is there but is not that of the record.
    """
    there = list_folder(folder, {name for file in expected for name in _names_of(file)})
    sources = {}
    for file in expected:
        name = next((name for name in _names_of(file) if name in there), None)
        if name is not None:
            sources[file.path] = there[name]
    wrong = [file for file in expected if file.path in sources and not is_same(sources[file.path], file)]
    if wrong:
        names = ", ".join(shown(file.key) for file in wrong)
        message = f"not the record's files, by size or MD5: {names}"
        hint = "download them again: they are cut short, changed, or of another version"
        raise DataMissingError(message, where=str(folder), hint=hint)
    used = set(sources.values())
    return OnDisk(sources, [printable(name) for name, path in there.items() if path not in used])


def _names_of(file: LockedFile) -> tuple[str, str]:
    """Names under which a file of a record may stand in a folder."""
    return file.path, PurePosixPath(file.path).name


def take_as_they_are(folder: Path) -> tuple[LockedFile, ...]:
    """Describe every file of a folder, for a record nobody could ask about.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    tuple of LockedFile

    Raises
    ------
    UsageError
        If the folder cannot be read, is empty, or holds a name that does not work everywhere.
    """
    there = list_folder(folder)
    if not there:
        message = "holds no files"
        raise UsageError(message, where=str(folder), hint="give the folder with the downloaded files")
    try:
        paths = safe_paths(there)
    except ValueError as error:
        raise UsageError(str(error), where=str(folder), hint="rename the file") from error
    return tuple(
        LockedFile(name, path.stat().st_size, md5_of(path), str(paths[name])) for name, path in there.items()
    )


def copy_file(source: Path, file: LockedFile, target: Path) -> None:
    """Copy one file, compare the copy, and move it into place.

    Parameters
    ----------
    source : Path
    file : LockedFile
    target : Path
        What is there is replaced.

    Raises
    ------
    TendonreproError
        If it cannot be copied or changed meanwhile; nothing is left at `target` then but what was there.
    """
    if target.exists() and source.samefile(target):
        return
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)
        if not is_same(temporary, file):
            message = f"{source} changed while it was copied"
            raise TendonreproError(message, hint="run the command again")
