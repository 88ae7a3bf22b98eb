"""Files that appear whole or not at all, what must not be in their way, and their digests."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias

from tendonrepro.errors import DataMissingError, TendonreproError, UsageError

Json: TypeAlias = dict[str, Any]
"""What a file of JSON holds, as it is read, or made to be written."""


def shipped(folder: str) -> Path:
    """Folder that comes with the package: inside an installed one, beside it in a checkout."""
    package = Path(__file__).parent
    installed = package / folder
    return installed if installed.is_dir() else package.parent / folder


def refuse_file(folder: Path, option: str = "--out") -> None:
    """Raise a UsageError where `folder`, or a folder above it, is a file."""
    found = next((place for place in (folder, *folder.parents) if os.path.lexists(place)), folder)
    if found.exists() and not found.is_dir():
        raise UsageError("is a file, not a folder", where=str(found), hint=f"name a folder with {option}")


def refuse_existing(path: Path, *, force: bool, option: str = "--out", inputs: Iterable[Path] = ()) -> None:
    """Refuse to write a file where something is that must not be lost.

    Raises
    ------
    UsageError
        If `path` is a folder, a device or one of the `inputs`, or lies below a file. If it is a file,
        unless `force`.
    """
    refuse_file(path.parent, option)
    if not path.exists():
        return
    hint = f"choose another name with {option}"
    if not path.is_file():
        raise UsageError("is not a file", where=str(path), hint=hint)
    if any(path.samefile(given) for given in inputs if given.exists()):
        raise UsageError("is what is to be read, and would be overwritten", where=str(path), hint=hint)
    if not force:
        hint += ", or overwrite it with --force"
        raise UsageError("is there already", where=str(path), hint=hint)


def refuse_foreign(path: Path, mark: bytes, *, force: bool = False) -> None:
    """Refuse to write a page where a file is without its `mark` near the beginning; see `refuse_existing`."""
    earlier = path.is_file() and mark in path.read_bytes()[:1000]
    refuse_existing(path, force=force or earlier)


def require_space(path: Path, size: int) -> None:
    """Raise a TendonreproError where a file of `size` bytes cannot fit; `path` need not exist yet."""
    place = next((above for above in path.absolute().parents if above.is_dir()), Path())
    disk = shutil.disk_usage(place)
    # A file system that does not know its size says that it has none.
    if disk.total and disk.free < size:
        message = f"needs {size / 1e6:.1f} MB, and {disk.free / 1e6:.1f} MB are free on this disk"
        raise TendonreproError(message, where=str(path), hint="free some space, or choose another --out")


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, and rename it to `path` when the block ends well.

    The folder is made when missing. The suffix is the same, since some writers choose their format by it.
    A link stays, and what it names is replaced.
    When the block raises, what was at `path` before is untouched.

    Yields
    ------
    Path
        Where to write.

    Raises
    ------
    TendonreproError
        When the folder or file cannot be written: full disk, missing permission, a folder in the way.
    """
    target = path.resolve()
    temporary = target.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(target)
    except OSError as error:
        message = f"cannot write {path}: {error.strerror or error}"
        raise TendonreproError(message) from error
    finally:
        # The folder may be the very thing that is broken; the first error is the one worth reporting.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a whole file by `atomic_path`; text becomes UTF-8 with line ends as they are.

    Bytes of a file's name that are no text become escapes, which JSON reads back.
    """
    data = content.encode(errors="backslashreplace") if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


@contextmanager
def locked(path: Path, folder: Path) -> Iterator[None]:
    """Hold a lock file while the block writes into a folder.

    Raises
    ------
    UsageError
        If another process holds it.
    OSError
        If it cannot be made.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path)
    # Where no file can be made, this says so.
    path.touch()
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        message = "another tendonrepro is writing here"
        raise UsageError(message, where=str(folder), hint="wait for it, or choose another --out") from error
    except OSError:
        path.unlink()
        raise
    try:
        yield
    finally:
        # While it is held: after that it may be another's. Windows removes no open file.
        if os.name == "posix":
            path.unlink(missing_ok=True)
        lock.release()


def digest_of(content: Mapping[str, object]) -> str:
    """SHA-256 of plain values, which JSON of them holds beside them."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes.

    Raises
    ------
    DataMissingError
        When the file is missing or cannot be read.
    """
    return _digest(path, hashlib.sha256)


def md5_of(path: Path) -> str:
    """Hexadecimal MD5 of a file's bytes, the digest that data repositories publish; see `sha256_of`."""
    return _digest(path, lambda: hashlib.md5(usedforsecurity=False))


def _digest(path: Path, new: Callable[[], hashlib._Hash]) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, new).hexdigest()
    except OSError as error:
        message = f"cannot read {path}: {error.strerror or error}"
        raise DataMissingError(message) from error


def read_json(path: Path, hint: str | None = None) -> Json:
    """Mapping that a file of JSON holds.

    Raises
    ------
    DataMissingError
        Where it is missing, damaged, or no mapping.
    """
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is damaged"
        raise DataMissingError(f"cannot be read: {reason}", where=str(path), hint=hint) from error
    if not isinstance(content, dict):
        raise DataMissingError("cannot be read: it is damaged", where=str(path), hint=hint)
    return content


def to_json(content: object) -> str:
    """JSON text with a final newline; numbers that are not finite become null.

    Bytes of a file's name that are no text are escapes, with which the text has an encoding.
    """
    finite = json.loads(json.dumps(content), parse_constant=lambda _: None)
    text = json.dumps(finite, indent=2, ensure_ascii=False) + "\n"
    return text.encode(errors="backslashreplace").decode()
