"""The data lock: which record a folder holds, and the digest of each of its files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from tendonrepro.dataset.repository.names import safe_paths
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import MOST_JSON, md5_of, ordinary, write_atomically

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
    versions.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    schema_version: Literal[2] = 2
    record: Number
    requested: Number
    doi: str | None
    concept_doi: str | None
    title: str | None
    version: str | None
    licence: str | None
    fetched_at: str
    base_url: str
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
    files: Iterable[LockedFile], folder: Path, advance: Callable[[int], None]
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
            raise DataMissingError(message, hint="choose another --out or --from-dir") from error
        advance(file.size)
    return missing, altered


def is_same(path: Path, file: LockedFile) -> bool:
    """Whether a path is a file of this size and, where known, this digest."""
    if not path.is_file() or path.stat().st_size != file.size:
        return False
    return file.md5 is None or md5_of(path) == file.md5
