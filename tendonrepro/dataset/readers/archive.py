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
from contextlib import AbstractContextManager
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import IO, cast

from tendonrepro.dataset.readers.charset import decoded
from tendonrepro.dataset.readers.filetype import FileType, is_tar, kind_of
from tendonrepro.dataset.readers.signals import Unreadable

MOST_BYTES = 2**32
"""Unpacked, of everything inside one file: a record of some gigabytes is not far-fetched, more is."""
MOST_MEMBERS = 10_000
"""The paper's data needs some dozens; unpacking ten thousand takes a minute."""
MOST_RATIO = 300
"""Unpacked to packed. Logs shrink to a tenth, a constant signal to a three-hundredth."""
RATIO_FROM = 2**27
"""Bytes below which no ratio is suspicious."""
DEEPEST = 3
"""Archives within archives: a zip of tar.gz files is two."""
_CHUNK = 2**20
_LONGEST_NAME = 200
_BROKEN = "download it again"
_UNPACK = "unpack it yourself and name the folder"
_NO_ROOM = "make room on the disk for temporary files, or name a folder on another one in TMPDIR"
_STREAMS: Mapping[FileType, Callable[[Path], AbstractContextManager[BufferedIOBase]]] = {
    FileType.GZIP: gzip.GzipFile,
    FileType.BZIP2: bz2.BZ2File,
    FileType.XZ: lzma.LZMAFile,
}
KINDS = frozenset({FileType.ZIP, FileType.TAR, *_STREAMS})
"""Types of files that are read through this module."""


@dataclass(frozen=True)
class Member:
    """A file in an archive.

    Parameters
    ----------
    name : str
        As the archive says.
    path : Path or None
        Where it is unpacked until the next member is asked for; None when it is left out.
    reason : str
        Why it is left out.
    advice : str
        What a user can do about it.
    """

    name: str
    path: Path | None
    reason: str = ""
    advice: str = ""


class TooMuch(Exception):
    """An archive unpacks into more than anyone would publish."""


@dataclass
class Allowance:
    """What may still be unpacked out of one file, archives within archives included."""

    bytes_left: int = MOST_BYTES
    members_left: int = MOST_MEMBERS

    def take_bytes(self, count: int) -> None:
        """Use some up; raises `TooMuch` when there are none left."""
        self.bytes_left -= count
        if self.bytes_left < 0:
            message = f"unpacks into more than {MOST_BYTES / 2**30:.0f} GB"
            raise TooMuch(message)

    def take_member(self) -> None:
        """Use one up; raises `TooMuch` when there are none left."""
        self.members_left -= 1
        if self.members_left < 0:
            message = f"holds more than {MOST_MEMBERS} files"
            raise TooMuch(message)


def members(path: Path, folder: Path, name: str = "", allowance: Allowance | None = None) -> Iterator[Member]:
    """Unpack the members of an archive one after the other.

    Parameters
    ----------
    path : Path
        A zip or tar archive, or a single compressed file.
    folder : Path
        An empty folder of the caller's own. A member is unpacked there under a name that has nothing to do
        with its own, and overwritten by the next one.
    name : str
        Of the archive, from which a single compressed file gets its own.
    allowance : Allowance, optional
        Used up by what is unpacked.

    Yields
    ------
    Member

    Raises
    ------
    Unreadable
        When it cannot be opened at all, or there is no room for what is in it.
    MemoryError
    """
    left = allowance or Allowance()
    try:
        yield from _each(path, folder, name or path.name, left)
    except TooMuch as error:
        yield Member("", None, str(error), _UNPACK)
    except (Unreadable, MemoryError):
        raise
    except Exception as error:  # what a broken archive raises depends on the byte that is wrong
        reason = f"a broken archive ({str(error)[:200]})"
        raise Unreadable(reason, _BROKEN) from error


def _each(path: Path, folder: Path, name: str, left: Allowance) -> Iterator[Member]:
    kind = kind_of(path)
    target = folder / "member"
    packed = path.stat().st_size
    if kind is FileType.ZIP:
        yield from _of_zip(path, target, left)
    elif kind is FileType.TAR:
        with path.open("rb") as stream:
            yield from _of_tar(_Counted(stream, packed, left), target, left)
    else:
        open_packed = _STREAMS[kind]
        with open_packed(path) as peeked:
            holds_tar = is_tar(peeked.read(512))
        with open_packed(path) as opened:
            counted = _Counted(opened, packed, left)
            if holds_tar:
                yield from _of_tar(counted, target, left)
            else:
                yield _unpacked(_without_suffix(name), counted, target)


class _Counted:
    """A stream that stops once more comes out of it than is allowed."""

    def __init__(self, stream: IO[bytes] | BufferedIOBase, packed: int, left: Allowance) -> None:
        self.stream, self.packed, self.left, self.taken = stream, packed, left, 0

    def read(self, size: int = -1) -> bytes:
        """Read like any stream, in pieces that fit memory."""
        data = self.stream.read(_CHUNK if size < 0 else min(size, _CHUNK))
        self.taken += len(data)
        self.left.take_bytes(len(data))
        if self.taken > RATIO_FROM and self.taken > MOST_RATIO * self.packed:
            message = f"unpacks into more than {MOST_RATIO} times its size"
            raise TooMuch(message)
        return data


def _of_zip(path: Path, target: Path, left: Allowance) -> Iterator[Member]:
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name = _zip_name(entry)
            left.take_member()
            if entry.is_dir() or _is_litter(name):
                continue
            reason, advice = _refusal(name)
            kind = stat.S_IFMT(entry.external_attr >> 16)
            if not reason and kind not in {0, stat.S_IFREG}:
                reason = "a link or device, not a file"
            if not reason and entry.flag_bits & 1:
                reason, advice = "encrypted", "ask its authors for the password and unpack it yourself"
            if reason:
                yield Member(name, None, reason, advice)
                continue
            try:
                with archive.open(entry) as stream:
                    member = _unpacked(name, _Counted(stream, entry.compress_size, left), target)
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
            left.take_member()
            if entry.isdir() or _is_litter(name):
                continue
            reason, advice = _refusal(name)
            content = archive.extractfile(entry) if entry.isreg() and not reason else None
            if content is None:
                yield Member(name, None, reason or "a link or device, not a file", advice)
            else:
                # What the stream gave is counted; only a sparse file unpacks into more than that.
                own = left if entry.issparse() else Allowance(left.bytes_left)
                yield _unpacked(name, _Counted(content, entry.size, own), target)


def _unpacked(name: str, stream: _Counted, target: Path) -> Member:
    try:
        with target.open("wb") as file:
            while data := stream.read(_CHUNK):
                file.write(data)
    except OSError as error:
        # Streams raise the same class where their bytes are broken.
        if error.errno == errno.ENOSPC:
            reason = "no room to unpack it"
            raise Unreadable(reason, _NO_ROOM) from error
        raise
    return Member(name, target)


def _refusal(name: str) -> tuple[str, str]:
    """Why a member is left out by its name, and the way out."""
    parts = name.replace("\\", "/").split("/")
    if ".." in parts or not parts[0] or parts[0].endswith(":") or "\0" in name:
        return "would land outside the folder", "do not unpack it with other programs either"
    return "", ""


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
