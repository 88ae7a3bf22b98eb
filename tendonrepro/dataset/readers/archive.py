"""Members of archives, unpacked one at a time where nothing can land outside."""

from __future__ import annotations

import bz2
import errno
import gzip
import lzma
import stat
import tarfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any, cast

from tendonrepro.dataset.readers.filetype import FileType, decoded, is_tar, kind_of
from tendonrepro.dataset.readers.signals import Allowance, TooMuch, Unreadable

DEEPEST = 3
"""Archives within archives: a zip of tar.gz files is two."""
_CHUNK = 2**20
_LONGEST_NAME = 200
_BROKEN = "download it again"
UNPACK = "unpack it yourself and name the folder"
"""Advice for what is left of an archive."""
_NO_ROOM = "make room on the disk for temporary files, or name a folder on another one in TMPDIR"
_STREAMS: Mapping[FileType, Callable[[Path, Any], Any]] = {
    FileType.GZIP: gzip.GzipFile,
    FileType.BZIP2: bz2.BZ2File,
    FileType.XZ: lzma.LZMAFile,
}
KINDS = frozenset({FileType.ZIP, FileType.TAR, *_STREAMS})
"""Types of files that are read through this module."""


@dataclass(frozen=True)
class Member:
    """A file in an archive: its name there, and where it is unpacked until the next one is asked for.

    The path is None when it is left out; then there is a reason, and advice if a user can do something.
    """

    name: str
    path: Path | None
    reason: str = ""
    advice: str = ""


def members(path: Path, folder: Path, name: str = "", allowance: Allowance | None = None) -> Iterator[Member]:
    """Unpack the members of a zip or tar archive, or a single compressed file, one after the other.

    A member is unpacked into an empty folder of the caller's own under a name that has nothing to do with its
    own, and overwritten by the next one. A single compressed file is named after the archive. `Unreadable`
    when it cannot be opened at all, or there is no room for what is in it.
    """
    try:
        yield from _each(path, folder / "member", name or path.name, allowance or Allowance())
    except TooMuch as error:
        yield Member("", None, str(error), UNPACK)
    except (Unreadable, MemoryError):
        raise
    except Exception as error:  # what a broken archive raises depends on the byte that is wrong
        raise Unreadable(f"a broken archive ({str(error)[:200]})", _BROKEN) from error


def _each(path: Path, target: Path, name: str, left: Allowance) -> Iterator[Member]:
    kind = kind_of(path)
    if kind is FileType.ZIP:
        yield from _of_zip(path, target, left)
        return
    open_packed = _STREAMS.get(kind, Path.open)
    with open_packed(path, "rb") as peeked:
        holds_tar = is_tar(peeked.read(512))
    with open_packed(path, "rb") as opened:
        counted = _Counted(opened, left)
        if holds_tar:
            yield from _of_tar(counted, target, left)
        else:
            yield _unpacked(_without_suffix(name), counted, target)


class _Counted:
    """A stream that stops once more comes out of it than is allowed."""

    def __init__(self, stream: IO[bytes] | BufferedIOBase, left: Allowance) -> None:
        self.stream, self.left = stream, left

    def read(self, size: int = -1) -> bytes:
        """Read like any stream, in pieces that fit memory."""
        data = self.stream.read(_CHUNK if size < 0 else min(size, _CHUNK))
        self.left.unpack(len(data))
        return data


def _of_zip(path: Path, target: Path, left: Allowance) -> Iterator[Member]:
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = _zip_name(entry)
            left.unpack(members=1)
            if entry.is_dir() or _is_litter(name):
                continue
            is_file = stat.S_IFMT(entry.external_attr >> 16) in {0, stat.S_IFREG}
            reason, advice = _refusal(name, is_file=is_file, encrypted=bool(entry.flag_bits & 1))
            if reason:
                yield Member(name, None, reason, advice)
                continue
            try:
                with archive.open(entry) as stream:
                    member = _unpacked(name, _Counted(stream, left), target)
            except (TooMuch, Unreadable, MemoryError):
                raise
            except Exception as error:
                member = Member(name, None, f"broken ({str(error)[:200]})", _BROKEN)
            yield member


def _of_tar(stream: _Counted, target: Path, left: Allowance) -> Iterator[Member]:
    # Read as a stream: no jumping about, so what is unpacked is counted once, headers included.
    with tarfile.open(fileobj=cast("IO[bytes]", stream), mode="r|") as archive:
        for entry in archive:
            name = _readable(entry.name.encode("utf-8", "surrogateescape"))
            left.unpack(members=1)
            if entry.isdir() or _is_litter(name):
                continue
            reason, advice = _refusal(name, is_file=entry.isreg())
            content = None if reason else archive.extractfile(entry)
            if content is None:
                yield Member(name, None, reason, advice)
                continue
            # What the stream gave is counted; only a sparse file unpacks into more than that.
            yield _unpacked(name, _Counted(content, left) if entry.issparse() else content, target)


def _unpacked(name: str, stream: _Counted | IO[bytes], target: Path) -> Member:
    try:
        with target.open("wb") as file:
            while data := stream.read(_CHUNK):
                file.write(data)
    except OSError as error:
        # Streams raise the same class where their bytes are broken.
        if error.errno == errno.ENOSPC:
            raise Unreadable("no room to unpack it", _NO_ROOM) from error
        raise
    return Member(name, target)


def _refusal(name: str, *, is_file: bool, encrypted: bool = False) -> tuple[str, str]:
    """Why a member is left out, and the way out; empty texts when it is not."""
    parts = name.replace("\\", "/").split("/")
    if ".." in parts or not parts[0] or parts[0].endswith(":") or "\0" in name:
        return "would land outside the folder", "do not unpack it with other programs either"
    if not is_file:
        return "a link or device, not a file", ""
    return ("encrypted", "ask its authors for the password and unpack it yourself") if encrypted else ("", "")


def _is_litter(name: str) -> bool:
    """Whether an operating system left it there: hidden files and what a Mac adds."""
    parts = [part for part in name.replace("\\", "/").split("/") if part not in {".", ".."}]
    return any(part.startswith(".") or part == "__MACOSX" for part in parts)


def _zip_name(entry: zipfile.ZipInfo) -> str:
    """Name of a member; without a mark for Unicode it is in the code page of whoever packed it."""
    if entry.flag_bits & 0x800:
        return _printable(entry.orig_filename)
    return _readable(entry.orig_filename.encode("cp437", "replace"))


def _readable(raw: bytes) -> str:
    return _printable(decoded(raw)[0])


def _printable(name: str) -> str:
    return name[:_LONGEST_NAME].encode("utf-8", "replace").decode()


def _without_suffix(name: str) -> str:
    """Name of a single compressed file without its last suffix."""
    stem, dot, suffix = name.rpartition("/")[2].rpartition(".")
    return stem if dot and suffix.lower() in {"gz", "gzip", "bz2", "xz", "z"} else f"{stem}{dot}{suffix}"
