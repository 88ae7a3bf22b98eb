"""One file of a record on its way to disk: resumed where that is safe, checked, put in place whole."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from tendonrepro.dataset.repository.names import LABEL, PART, shown
from tendonrepro.dataset.repository.web import Body, CutShortError, Web
from tendonrepro.dataset.repository.web_errors import BY_HAND, TOO_MANY, WebError
from tendonrepro.dataset.repository.zenodo import RemoteFile
from tendonrepro.errors import DataMissingError, TendonreproError
from tendonrepro.files import md5_of, write_atomically

GAIN = 2**20
"""Bytes that make an attempt worth another one, however often the connection ends."""


def download(
    web: Web, record_id: str, remote: RemoteFile, target: Path, advance: Callable[[int], None]
) -> None:
    """Get one file; what an earlier try left is used.

    Parameters
    ----------
    web : Web
    record_id : str
    remote : RemoteFile
    target : Path
        Where it shall be; a file there is replaced. No other process may write there.
    advance : callable
        Told the number of bytes just won, also those already on disk; negative when they are lost again.

    Raises
    ------
    WebError
        If the repository does not send it. What came stays in ``<name>.part`` for the next time.
    DataMissingError
        If what came is not the file the record describes. Nothing of it stays.
    TendonreproError
        If the disk is full or cannot be written.
    """
    part = _Part(record_id, remote, target)
    try:
        part.open()
        advance(part.size())
        _place(part, _complete(web, part, advance))
    except WebError:
        if part.size() == 0:
            remove_part(target)
        raise
    except OSError as error:
        reason = error.strerror or str(error)
        hint = "make room, or choose another --out, and run the command again: it goes on where it stopped"
        message = f"cannot write {target}: {reason}"
        raise TendonreproError(message, hint=hint if error.errno == errno.ENOSPC else None) from error


@dataclass(frozen=True)
class _Part:
    """What is on disk of a file, and of which file it is a part."""

    record_id: str
    remote: RemoteFile
    target: Path

    @property
    def path(self) -> Path:
        return _working_files(self.target)[0]

    @property
    def label(self) -> Path:
        return _working_files(self.target)[1]

    def open(self) -> None:
        """Keep a part of this very file, begin anew else.

        The server gives no other proof: without record, key, size and digest beside the bytes, two versions
        could be joined.
        """
        self.target.parent.mkdir(parents=True, exist_ok=True)
        mine = {"record": self.record_id, "key": self.remote.key}
        text = json.dumps(mine | {"size": self.remote.size, "md5": self.remote.md5}, indent=2)
        try:
            same = self.label.read_text(encoding="utf-8") == text
        except (OSError, UnicodeDecodeError):
            same = False
        if not same or not self.path.is_file() or self.size() > self.remote.size:
            self.path.unlink(missing_ok=True)
            write_atomically(self.label, text)
            self.path.touch()

    def size(self) -> int:
        return self.path.stat().st_size


def _complete(web: Web, part: _Part, advance: Callable[[int], None]) -> str | None:
    """Ask one address after the other until every byte is there; the digest the server announced."""
    failure: WebError | None = None
    if part.size() == part.remote.size:
        return None
    for url in part.remote.urls:
        try:
            return _exhaust(web, url, part, advance)
        except WebError as error:
            if error.status == TOO_MANY:
                raise
            web.talk.detail(f"{url}: {error.message}")
            failure = failure or error
    assert failure is not None
    raise failure


def _exhaust(web: Web, url: str, part: _Part, advance: Callable[[int], None]) -> str | None:
    """Ask one address again and again, as long as it helps."""
    what, size, most = shown(part.remote.key), part.remote.size, part.size()
    announced: str | None = None
    resume = True
    useless = 0
    while useless < web.patience.tries:
        start = part.size() if resume else 0
        page = part.remote.key.lower().endswith((".html", ".htm"))
        with web.body(url, what, start, page=page) as body:
            useful = body.status == 200 or (body.status == 206 and body.start == start)
            if useful:
                announced = body.md5
                _receive(body, part, advance)
        # A server that cannot send the rest is asked for the whole from now on.
        resume = resume and useful
        if part.size() == size:
            return announced
        useless = 0 if part.size() - most >= GAIN else useless + 1
        most = max(most, part.size())
        web.patience.sleep(web.patience.backoff)
    message = f"{what}: the connection ended again and again, {part.size()} of {size} bytes are here"
    raise WebError(message, hint=f"run the command again: it goes on from there, {BY_HAND}")


def _receive(body: Body, part: _Part, advance: Callable[[int], None]) -> None:
    """Write what comes behind what is there, or over it if the server sends everything."""
    size = part.remote.size
    if body.total is not None and body.total != size:
        message = f"{shown(part.remote.key)}: the server has {body.total} bytes of it, the record says {size}"
        raise WebError(message, hint=f"try again later, {BY_HAND}", status=body.status)
    with part.path.open("r+b") as stream:
        if body.status == 200:
            advance(-part.size())
            stream.truncate(0)
        stream.seek(0, os.SEEK_END)
        try:
            _write(body, part, stream, advance)
        except CutShortError:
            return


def _write(body: Body, part: _Part, stream: BinaryIO, advance: Callable[[int], None]) -> None:
    for chunk in body.chunks:
        if stream.tell() + len(chunk) > part.remote.size:
            stream.truncate(0)
            message = f"{shown(part.remote.key)}: more comes than the {part.remote.size} bytes of the record"
            raise WebError(message, hint=f"try again later, {BY_HAND}", status=body.status)
        stream.write(chunk)
        advance(len(chunk))


def _place(part: _Part, announced: str | None) -> None:
    """Compare the digest and move the file into place."""
    import pooch

    remote, target = part.remote, part.target
    # pooch speaks to the logger of its own on every file.
    pooch.get_logger().setLevel("CRITICAL")
    try:
        pooch.retrieve(
            remote.urls[0],
            known_hash=f"md5:{remote.md5 or announced or md5_of(part.path)}",
            fname=target.name,
            path=target.parent.absolute(),
            downloader=lambda _url, output, _pooch: part.path.replace(output),
        )
    except ValueError as error:
        witness = "the record" if remote.md5 else "the server"
        message = f"{shown(remote.key)} arrived with another MD5 than {witness} says"
        if announced == remote.md5:
            message += ", damaged on its way"
        raise DataMissingError(
            message, hint=f"nothing of it was kept: run the command again, {BY_HAND}"
        ) from error
    finally:
        remove_part(target)


def part_size(target: Path) -> int:
    """Bytes on disk of a file that is not complete yet.

    Parameters
    ----------
    target : Path
        Where the file shall be.

    Returns
    -------
    int
    """
    path = _working_files(target)[0]
    return path.stat().st_size if path.is_file() else 0


def remove_part(target: Path) -> None:
    """Remove what an unfinished download left, where the file came by another way.

    Parameters
    ----------
    target : Path
        Where the file is.
    """
    for path in _working_files(target):
        path.unlink(missing_ok=True)


def _working_files(target: Path) -> tuple[Path, Path]:
    """The bytes so far, and the label that says whose they are."""
    return target.with_name(f"{target.name}{PART}"), target.with_name(f"{target.name}{LABEL}")
