"""Files that appear whole or not at all, and their digests."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tendonrepro.errors import DataMissingError, TendonreproError

_TEMPORARY = re.compile(r"\..+\.([1-9][0-9]*)-[0-9a-f]{8}(\.[^.]+)?")
"""Names that `atomic_path` gives."""

written: set[Path] = set()
"""Files that this process has put in their place, so that half a result can be taken away again."""

guards: list[Callable[[], None]] = []
"""Asked before any file is put in its place; one raises where the folder is no longer this process's."""

MOST_BYTES = 2**29
"""Of a stored file that is read as a whole."""
MOST_JSON = 2**25
"""Of stored JSON, which takes many times its size in memory."""


def shipped(folder: str) -> Path:
    """Folder that comes with the package: inside an installed one, beside it in a checkout."""
    package = Path(__file__).parent
    installed = package / folder
    return installed if installed.is_dir() else package.parent / folder


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, and rename it to `path` when the block ends well.

    The temporary file stands in the same folder, which is made when missing, and keeps the suffix, since
    some writers choose their format by it. When the block raises, the temporary file is removed and whatever
    was at `path` before is untouched.

    Parameters
    ----------
    path : Path
        Where the finished file shall be.

    Yields
    ------
    Path
        Where to write it.

    Raises
    ------
    TendonreproError
        When the folder or file cannot be written: full disk, missing permission, a folder in the way.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        if path.parent.exists() and not path.parent.is_dir():
            message = f"cannot write {path}: what should be its folder is a file"
            raise TendonreproError(message)
        if path.exists() and not (path.is_file() or path.is_dir()):
            message = f"cannot write {path}: it is no ordinary file"
            raise TendonreproError(message)
        for guard in guards:
            guard()
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        for guard in guards:
            guard()
        written.add(path)
        temporary.replace(path)
    except OSError as error:
        message = f"cannot write {path}: {_reason(error)}"
        raise TendonreproError(message) from error
    finally:
        # The folder may be the very thing that is broken; the first error is the one worth reporting.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def sweep_temporary(folder: Path) -> None:
    """Remove what processes that no longer live left of `atomic_path` in a folder and those directly in it.

    Nobody else may be writing there, since a number says nothing of processes of other machines.

    Parameters
    ----------
    folder : Path
    """
    for path in (*folder.glob(".*"), *folder.glob("*/.*")):
        found = _TEMPORARY.fullmatch(path.name)
        if found and not _lives(int(found[1])):
            with suppress(OSError):
                path.unlink()


def _lives(pid: int) -> bool:
    # This process writes nothing there while it asks; in a container its number may have been another's.
    if pid == os.getpid():
        return False
    # Windows has no such question, and there a file that someone holds open cannot be removed anyway.
    if sys.platform == "win32":
        return False
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a whole file at once; text becomes UTF-8 with line ends as they are.

    Parameters
    ----------
    path : Path
        Where to; its folder is made when missing.
    content : bytes or str
        What to write.

    Raises
    ------
    TendonreproError
        When it cannot be written; an earlier file at `path` is then untouched.
    """
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def ordinary(path: Path, most: int | None = MOST_BYTES) -> Path:
    """Give back the path of a stored file, unless reading it might never end.

    Parameters
    ----------
    path : Path
    most : int, optional
        Largest size, bytes; None where it is read piece by piece.

    Raises
    ------
    OSError
        When it is missing, a pipe or a device, or larger.
    """
    found = path.stat()
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.EINVAL, "it is no ordinary file", str(path))
    if most is not None and found.st_size > most:
        raise OSError(errno.EFBIG, f"it is larger than {most >> 20} MiB", str(path))
    return path


def sealed(content: bytes) -> bytes:
    """Content with its SHA-256 behind it, by which `unsealed` tells whether it is as it was written."""
    return content + hashlib.sha256(content).digest()


def unsealed(path: Path) -> bytes:
    """Read what was written `sealed`, before a library is given it that damage may lead astray.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bytes
        The content without its seal.

    Raises
    ------
    DataMissingError
        When the file is missing, cannot be read, or is not as it was written.
    """
    try:
        whole = ordinary(path).read_bytes()
    except OSError as error:
        message = f"cannot be read: {_reason(error)}"
        raise DataMissingError(message, where=str(path)) from error
    content = whole[: -hashlib.sha256().digest_size]
    if sealed(content) != whole:
        message = "is damaged: it is not as it was written"
        raise DataMissingError(message, where=str(path))
    return content


def digest_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values, which JSON of them holds beside them."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def sha256_of(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes.

    Parameters
    ----------
    path : Path
        An existing file.

    Returns
    -------
    str
        64 lower-case hexadecimal digits.

    Raises
    ------
    DataMissingError
        When the file is missing or cannot be read.
    """
    return _digest(path, hashlib.sha256)


def md5_of(path: Path) -> str:
    """Hexadecimal MD5 of a file's bytes, the digest that data repositories publish; see `sha256_of`."""
    return _digest(path, lambda: hashlib.md5(usedforsecurity=False))


def _digest(path: Path, new: Callable[[], Any]) -> str:
    try:
        with ordinary(path, None).open("rb") as stream:
            return hashlib.file_digest(stream, new).hexdigest()
    except OSError as error:
        message = f"cannot read {path}: {_reason(error)}"
        raise DataMissingError(message) from error


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


def to_json(content: Any) -> str:
    """JSON text with a final newline; numbers that are not finite become null.

    Parameters
    ----------
    content : object
        Of dicts, lists, strings, numbers, booleans and None.
    """
    return json.dumps(_finite(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, float) and not abs(content) < float("inf"):
        return None
    return content
