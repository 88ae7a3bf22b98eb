"""Files that somebody downloaded by hand, found in their folder, checked and copied."""

from __future__ import annotations

import shutil
from collections.abc import Container, Sequence
from pathlib import Path, PurePosixPath

from tendonrepro.dataset.repository.lock import LockedFile, is_same
from tendonrepro.dataset.repository.names import is_ours, printable, safe_paths, shown
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import atomic_path, md5_of

_GIVE = "give the folder with the downloaded files"


def _files_in(folder: Path, wanted: Container[str] = ()) -> dict[str, Path]:
    """Files below a folder by relative name, without our own and, unless wanted, without hidden ones."""
    if not folder.is_dir():
        message = "is not a folder"
        raise UsageError(message, where=str(folder), hint=_GIVE)
    try:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
    except OSError as error:
        message = f"cannot be read: {error.strerror or error}"
        raise UsageError(message, where=str(folder)) from error
    names = {path.relative_to(folder).as_posix(): path for path in paths}
    return {
        name: path
        for name, path in names.items()
        if name in wanted or not (is_ours(path.name) or "/." in f"/{name}")
    }


def find_files(expected: Sequence[LockedFile], folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Look for a record's files in a folder: where each is, by path in the record, and what else is there.

    A file may stand under its path or its bare name. One that is not the record's is a DataMissingError.
    """
    names = {file: (PurePosixPath(file.path).name, file.path) for file in expected}
    there = _files_in(folder, {name for pair in names.values() for name in pair})
    # The path comes last, and wins.
    found = {file: there[name] for file, pair in names.items() for name in pair if name in there}
    if wrong := [shown(file.key) for file, path in found.items() if not is_same(path, file)]:
        message = f"not the record's files, by size or MD5: {', '.join(wrong)}"
        hint = "download them again: they are cut short, changed, or of another version"
        raise DataMissingError(message, where=str(folder), hint=hint)
    used = set(found.values())
    ignored = [printable(name) for name, path in there.items() if path not in used]
    return {file.path: path for file, path in found.items()}, ignored


def take_as_they_are(folder: Path) -> tuple[LockedFile, ...]:
    """Describe every file of a folder, for a record nobody could ask about."""
    there = _files_in(folder)
    if not there:
        message = "holds no files"
        raise UsageError(message, where=str(folder), hint=_GIVE)
    try:
        paths = safe_paths(there)
    except ValueError as error:
        raise UsageError(str(error), where=str(folder), hint=f"rename the file, or {_GIVE} only") from error
    return tuple(
        LockedFile(key=name, size=path.stat().st_size, md5=md5_of(path), path=str(paths[name]))
        for name, path in there.items()
    )


def copy_file(source: Path, file: LockedFile, target: Path) -> None:
    """Copy one file, compare the copy, and move it into place; else what was there stays."""
    if target.exists() and source.samefile(target):
        return
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)
        if not is_same(temporary, file):
            message = f"{source} changed while it was copied"
            raise TendonreproError(message, hint="run the command again")
