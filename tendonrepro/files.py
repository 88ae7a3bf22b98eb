"""Files that appear whole or not at all, and their digests."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from tendonrepro.errors import DataMissingError, TendonreproError


def shipped(folder: str) -> Path:
    """Folder that comes with the package: inside an installed one, beside it in a checkout."""
    package = Path(__file__).parent
    installed = package / folder
    return installed if installed.is_dir() else package.parent / folder


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to, and rename it to `path` when the block ends well.

    The folder is made when missing. The suffix is the same, since some writers choose their format by it.
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
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        message = f"cannot write {path}: {error.strerror or error}"
        raise TendonreproError(message) from error
    finally:
        # The folder may be the very thing that is broken; the first error is the one worth reporting.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_atomically(path: Path, content: bytes | str) -> None:
    """Write a whole file by `atomic_path`; text becomes UTF-8 with line ends as they are."""
    data = content.encode() if isinstance(content, str) else content
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def digest_of(content: Mapping[str, Any]) -> str:
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


def _digest(path: Path, new: Callable[[], Any]) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, new).hexdigest()
    except OSError as error:
        message = f"cannot read {path}: {error.strerror or error}"
        raise DataMissingError(message) from error


def to_json(content: Any) -> str:
    """JSON text with a final newline; numbers that are not finite become null."""
    finite = json.loads(json.dumps(content), parse_constant=lambda _: None)
    return json.dumps(finite, indent=2, ensure_ascii=False) + "\n"
