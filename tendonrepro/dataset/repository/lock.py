"""The data lock: which record a folder holds, and the digest of each of its files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from tendonrepro.dataset.repository.names import safe_paths
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import md5_of, write_atomically

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class LockedFile:
    """A file as it must be on disk.

    Attributes
    ----------
    key : str
        Name in the record.
    size : int
        Bytes.
    md5 : str or None
        None only before the file was seen, where the record gives none.
    path : str
        Below the folder, with slashes.
    """

    key: str
    size: int
    md5: str | None
    path: str


@dataclass(frozen=True)
class DataLock:
    """What a folder holds.

    Attributes
    ----------
    record, requested : str
        Number of the version, and the number asked for, which may be that of all versions.
    doi, concept_doi, title, version, licence : str or None
    fetched_at : str
        UTC, ISO 8601.
    base_url : str
    verified : bool
        Whether the files were compared with the record; if not, the digests are those they came with.
    files : tuple of LockedFile
    """

    record: str
    requested: str
    doi: str | None
    concept_doi: str | None
    title: str | None
    version: str | None
    licence: str | None
    fetched_at: str
    base_url: str
    verified: bool
    files: tuple[LockedFile, ...]


def lock_path(out: Path) -> Path:
    """Where the lock of a data folder stands: beside it, under its name.

    Parameters
    ----------
    out : Path

    Returns
    -------
    Path

    Raises
    ------
    UsageError
        If the folder has no name, as the root has none.
    """
    # The name of "." is known only from the full path.
    folder = out if out.name not in {"", ".."} else out.resolve()
    if not folder.name:
        message = "cannot be the folder of a data set"
        raise UsageError(message, where=str(out), hint="choose another --out")
    return folder.with_name(f"{folder.name}.lock.json")


def read_lock(path: Path) -> DataLock | None:
    """Read a lock, strictly.

    Parameters
    ----------
    path : Path

    Returns
    -------
    DataLock or None
        None if there is none.

    Raises
    ------
    DataMissingError
        If it cannot be read, or is not a lock of this version.
    """
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        return _lock_of(tree)
    except FileNotFoundError:
        return None
    except OSError as error:
        message = f"cannot read the data lock: {error.strerror or error}"
        raise DataMissingError(message, where=str(path)) from error
    except (ValueError, TypeError, RecursionError) as error:
        message = f"is not a data lock of this version: {error}"
        hint = "restore it, or remove it and fetch again: files that are right are kept"
        raise DataMissingError(message, where=str(path), hint=hint) from error


def write_lock(path: Path, lock: DataLock) -> None:
    """Write a lock, whole or not at all.

    Parameters
    ----------
    path : Path
    lock : DataLock

    Raises
    ------
    TendonreproError
        If it cannot be written.
    """
    tree = {"schema_version": SCHEMA_VERSION, **asdict(lock)}
    write_atomically(path, json.dumps(tree, indent=2, ensure_ascii=False) + "\n")


def find_differences(
    files: Iterable[LockedFile], folder: Path, advance: Callable[[int], None] = lambda _: None
) -> tuple[list[LockedFile], list[LockedFile]]:
    """Compare files on disk with what they must be.

    Parameters
    ----------
    files : iterable of LockedFile
    folder : Path
    advance : callable
        Told the bytes just checked.

    Returns
    -------
    missing, altered : list of LockedFile

    Raises
    ------
    DataMissingError
        If a file cannot be read.
    """
    missing, altered = [], []
    for file in files:
        path = folder / file.path
        if not path.exists():
            missing.append(file)
        elif not is_same(path, file):
            altered.append(file)
        advance(file.size)
    return missing, altered


def is_same(path: Path, file: LockedFile) -> bool:
    """Whether a path is a file of this size and, where known, this digest."""
    if not path.is_file() or path.stat().st_size != file.size:
        return False
    return file.md5 is None or md5_of(path) == file.md5


def _lock_of(tree: Any) -> DataLock:
    """Check every value; a ValueError says which one is wrong."""
    names = {"schema_version", *_names(DataLock)}
    _need(isinstance(tree, dict) and set(tree) == names, f"its keys must be {', '.join(sorted(names))}")
    _need(tree["schema_version"] == SCHEMA_VERSION, f"schema_version must be {SCHEMA_VERSION}")
    for key in ("record", "requested"):
        _need(_is_match(tree[key], "[0-9]{1,12}"), f"{key} must be a number in quotes")
    for key in ("doi", "concept_doi", "title", "version", "licence"):
        _need(tree[key] is None or isinstance(tree[key], str), f"{key} must be text or null")
    for key in ("fetched_at", "base_url"):
        _need(isinstance(tree[key], str), f"{key} must be text")
    _need(isinstance(tree["verified"], bool), "verified must be true or false")
    _need(isinstance(tree["files"], list) and len(tree["files"]) > 0, "files must be a list")
    files = tuple(_file_of(entry) for entry in tree["files"])
    paths = [file.path for file in files]
    _need(len(set(paths)) == len(paths), "a path comes twice")
    safe_paths(paths)
    return DataLock(**{key: tree[key] for key in _names(DataLock)} | {"files": files})


def _file_of(entry: Any) -> LockedFile:
    names = _names(LockedFile)
    _need(isinstance(entry, dict) and set(entry) == names, f"a file must have {', '.join(sorted(names))}")
    _need(isinstance(entry["key"], str) and isinstance(entry["path"], str), "key and path must be text")
    size = entry["size"]
    _need(isinstance(size, int) and not isinstance(size, bool) and size >= 0, "size must be a whole number")
    _need(_is_match(entry["md5"], "[0-9a-f]{32}"), "md5 must be 32 hexadecimal digits")
    return LockedFile(**entry)


def _names(kind: type[DataLock] | type[LockedFile]) -> set[str]:
    return {field.name for field in fields(kind)}


def _is_match(value: Any, pattern: str) -> bool:
    return isinstance(value, str) and re.fullmatch(pattern, value) is not None


def _need(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)
