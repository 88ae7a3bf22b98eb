"""One file of a record on its way to disk: resumed where that is safe, checked, put in place whole."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tendonrepro.dataset.repository.names import LABEL, PART, shown
from tendonrepro.dataset.repository.web import BY_HAND, Body, CutShortError, Web, WebError
from tendonrepro.dataset.repository.zenodo import RemoteFile
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import md5_of, write_atomically

GAIN = 2**20
"""Bytes that make an attempt worth another one, however often the connection ends."""

_LABELLED = {"record", "key", "size", "md5"}
"""What is said of the bytes so far."""

Advance = Callable[[int], None]


def download(web: Web, record_id: str, remote: RemoteFile, target: Path, advance: Advance) -> None:
    """Get one file; what an earlier try left is used, and a file at `target` is replaced.

    `advance` is told the bytes just won, also those already on disk; negative when they are lost again. After
    a WebError what came stays in ``<name>.part`` for the next time; of bytes with another digest nothing is.
    A file of that name that no earlier try left is a UsageError.
    """
    _refuse_foreign(target)
    try:
        _open(record_id, remote, target)
        advance(part_size(target))
        if part_size(target) != remote.size:
            _complete(web, remote, target, advance)
        if remote.md5 and md5_of(_part(target)) != remote.md5:
            remove_part(target)
            message = f"{shown(remote.key)} arrived with another MD5 than the record says"
            raise DataMissingError(message, hint=f"nothing of it was kept: run the command again, {BY_HAND}")
        _part(target).replace(target)
    except OSError as error:
        hint = "make room, or choose another --out, and run the command again: it goes on where it stopped"
        message = f"cannot write {target}: {error.strerror or error}"
        raise TendonreproError(message, hint=hint if error.errno == errno.ENOSPC else None) from error
    finally:
        if part_size(target) == 0:
            remove_part(target)


def _part(target: Path) -> Path:
    """The bytes so far."""
    return target.with_name(f"{target.name}{PART}")


def _label(target: Path) -> Path:
    """What says whose the bytes so far are."""
    return target.with_name(f"{target.name}{LABEL}")


def part_size(target: Path) -> int:
    """Bytes on disk of a file that is not complete yet."""
    try:
        return _part(target).stat().st_size
    except OSError:
        return 0


def remove_part(target: Path) -> None:
    """Remove what an unfinished download left, and folders empty then, up to the one that holds our lock."""
    for path in (_part(target), _label(target)):
        with suppress(OSError):
            path.unlink()
    with suppress(OSError):
        os.removedirs(target.parent)


def _refuse_foreign(target: Path) -> None:
    """Browsers too call ``.part`` what they have not finished."""
    found = [path for path in (_part(target), _label(target)) if path.exists()]
    try:
        ours = not found or set(json.loads(_label(target).read_bytes())) == _LABELLED
    except (OSError, ValueError, TypeError):
        ours = False
    if not ours:
        message = "is in the way, and no download of tendonrepro left it"
        raise UsageError(message, where=str(found[0]), hint="move it elsewhere, or choose another --out")


def _open(record_id: str, remote: RemoteFile, target: Path) -> None:
    """Keep a part of this very file, begin anew else.

    The server gives no other proof: without record, key, size and digest beside the bytes, two versions could
    be joined.
    """
    part, label = _part(target), _label(target)
    mine = {"record": record_id, "key": remote.key, "size": remote.size, "md5": remote.md5}
    text = json.dumps(mine, indent=2)
    target.parent.mkdir(parents=True, exist_ok=True)
    same = label.is_file() and label.read_bytes() == text.encode()
    if not same or not part.is_file() or part_size(target) > remote.size:
        part.unlink(missing_ok=True)
        write_atomically(label, text)
        part.touch()


def _complete(web: Web, remote: RemoteFile, target: Path, advance: Advance) -> None:
    """Ask again and again until every byte is there, as long as it helps."""
    page = remote.key.lower().endswith((".html", ".htm"))
    resume, useless, most = True, 0, part_size(target)
    while useless < web.patience.tries:
        start = part_size(target) if resume else 0
        with web.body(remote.url, shown(remote.key), start, page=page) as body:
            useful = body.start in {0, start}
            if useful:
                _receive(body, remote, target, advance)
        # A server that cannot send the rest is asked for the whole from now on.
        resume = resume and useful
        size = part_size(target)
        if size == remote.size:
            return
        useless = 0 if size - most >= GAIN else useless + 1
        most = max(most, size)
        time.sleep(web.patience.backoff)
    message = (
        f"{shown(remote.key)}: the connection ended again and again, {size} of {remote.size} bytes are here"
    )
    raise WebError(message, hint=f"run the command again: it goes on from there, {BY_HAND}")


def _receive(body: Body, remote: RemoteFile, target: Path, advance: Advance) -> None:
    """Write what comes behind what is there, or over it if the server sends everything."""
    what, hint = shown(remote.key), f"try again later, {BY_HAND}"
    if body.total is not None and body.total != remote.size:
        message = f"{what}: the server has {body.total} bytes of it, the record says {remote.size}"
        raise WebError(message, hint=hint)
    if body.start == 0:
        advance(-part_size(target))
    with _part(target).open("wb" if body.start == 0 else "ab") as stream, suppress(CutShortError):
        for chunk in body.chunks:
            if stream.tell() + len(chunk) > remote.size:
                stream.truncate(0)
                raise WebError(f"{what}: more comes than the {remote.size} bytes of the record", hint=hint)
            stream.write(chunk)
            advance(len(chunk))
