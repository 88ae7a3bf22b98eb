"""The data lock: which record a folder holds, the digest of each of its files, and files brought by hand."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Container, Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from tendonrepro.dataset.repository.names import is_ours, printable, safe_paths, shown
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import MOST_JSON, atomic_path, md5_of, ordinary, write_atomically

Number = Annotated[str, Field(pattern="^[0-9]{1,12}$")]
Digest = Annotated[str, Field(pattern="^[0-9a-f]{32}$")]


class LockedFile(BaseModel):
    """A file as it must be on disk: name in the record, bytes, digest, and path below the folder.

    The path has slashes. The digest is None only before the file was seen, where the record gives none.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    key: str
    size: Annotated[int, Field(ge=0)]
    md5: Digest | None
    path: str


class DataLock(BaseModel):
    """What a folder holds.

    `record` is the number of the version, `requested` the number asked for, which may be that of all
    versions. Files that are `verified` were compared with the record; else the digests are those they came
    with.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    schema_version: Literal[1] = 1
    record: Number
    requested: Number
    doi: str | None
    concept_doi: str | None
    title: str | None
    version: str | None
    licence: str | None
    fetched_at: str
    base_url: str
    verified: bool
    files: Annotated[tuple[LockedFile, ...], Field(min_length=1)]

    @field_validator("files")
    @classmethod
    def _check(cls, files: tuple[LockedFile, ...], info: ValidationInfo) -> tuple[LockedFile, ...]:
        safe_paths(file.path for file in files)
        if info.mode == "json" and any(file.md5 is None for file in files):
            raise ValueError("a file without md5")
        return files


def lock_path(out: Path) -> Path:
    """Where the lock of a data folder stands: beside it, under its name; the root has none, a UsageError."""
    # The name of "." is known only from the full path.
    folder = out if out.name not in {"", ".."} else out.resolve()
    if not folder.name:
        raise UsageError("cannot be the folder of a data set", where=str(out), hint="choose another --out")
    return folder.with_name(f"{folder.name}.lock.json")


def read_lock(path: Path) -> DataLock | None:
    """Read a lock, strictly; None if there is none, a DataMissingError if it is not one of this version."""
    try:
        return DataLock.model_validate_json(ordinary(path, MOST_JSON).read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        message = f"cannot read the data lock: {error.strerror or error}"
        raise DataMissingError(message, where=str(path)) from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        message = f"is not a data lock of this version: {place}: {first['msg']}"
        hint = "restore it, or remove it and fetch again: files that are right are kept"
        raise DataMissingError(message, where=str(path), hint=hint) from error


def write_lock(path: Path, lock: DataLock) -> None:
    """Write a lock, whole or not at all."""
    write_atomically(path, lock.model_dump_json(indent=2) + "\n")


def find_differences(
    files: Iterable[LockedFile], folder: Path, advance: Callable[[int], None] = lambda _: None
) -> tuple[list[LockedFile], list[LockedFile]]:
    """Compare files on disk with what they must be: those missing, and those altered.

    `advance` is told the bytes just checked. A file that cannot be read is a DataMissingError.
    """
    missing, altered = [], []
    for file in files:
        path = folder / file.path
        try:
            if not path.exists():
                missing.append(file)
            elif not is_same(path, file):
                altered.append(file)
        except OSError as error:
            message = f"cannot look at {path}: {error.strerror or error}"
            raise DataMissingError(message, hint="choose another --out") from error
        advance(file.size)
    return missing, altered


def is_same(path: Path, file: LockedFile) -> bool:
    """Whether a path is a file of this size and, where known, this digest."""
    if not path.is_file() or path.stat().st_size != file.size:
        return False
    return file.md5 is None or md5_of(path) == file.md5


_GIVE = "give the folder with the downloaded files"


def _files_in(folder: Path, wanted: Container[str] = ()) -> dict[str, Path]:
    """Files below a folder by relative name, without our own and, unless wanted, without hidden ones."""
    if not folder.is_dir():
        raise UsageError("is not a folder", where=str(folder), hint=_GIVE)
    try:
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
    except OSError as error:
        raise UsageError(f"cannot be read: {error.strerror or error}", where=str(folder)) from error
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
        raise UsageError("holds no files", where=str(folder), hint=_GIVE)
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
            raise TendonreproError(f"{source} changed while it was copied", hint="run the command again")
