"""What ``tendonrepro data fetch`` does: bring the paper's data set here."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path, PureWindowsPath
from urllib.parse import quote, urlsplit

from requests import RequestException, Response, Session
from requests.adapters import HTTPAdapter
from urllib3.util import Retry

from tendonrepro import __version__, files
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import Json
from tendonrepro.results.tables import Table

SITE = "https://zenodo.org"
VARIABLE = "TENDONREPRO_ZENODO_URL"
_AGENT = f"tendonrepro/{__version__} (+https://doi.org/10.3390/act15050271)"
_BY_HAND = "or download the files in a browser: inspect and ingest read any folder"


_TIMEOUT = 15.0, 60.0
"""For a connection and for the next bytes, s."""
_CHUNK = 2**14
"""Bytes; those of an unfinished one are lost when the connection ends."""
_TRIES = 10
"""Of a download that is cut off."""


def run_fetch(record: str, out: Path, base_url: str | None, force: bool, dry_run: bool, talk: Talk) -> Json:
    """Bring the files of a record into a folder, or show that they are there; the lock is beside it.

    `record` is a number, DOI or address; `base_url`, or the environment, names another site.

    Raises
    ------
    UsageError
        If the record is none, the folder holds other or altered files, or another process writes there.
    DataMissingError
        If the record or its files cannot be had, or a name in it is none of a file below the folder.
    """
    number = record_number(record)
    files.refuse_file(out)
    lock_path = out.resolve().with_name(f"{out.resolve().name}.lock.json")
    lock: Json = {}
    if lock_path.exists():
        lock = files.read_json(lock_path, "remove it, and fetch asks for the record again")
    if number not in (lock.get("record"), lock.get("requested")):
        if lock and not force:
            message = f"holds record {lock['record']}, not {number}"
            raise UsageError(message, where=str(out), hint="choose another --out, or say --force")
        lock = _described(base_url or os.environ.get(VARIABLE) or SITE, number)
    if wrong := [file["key"] for file in lock["files"] if not _is_plain(file["key"])]:
        message = f"the record names {', '.join(map(ascii, wrong))}, which is no place for a file"
        raise DataMissingError(message, where=str(out), hint=f"tell its authors, {_BY_HAND}")
    wanted = [file for file in lock["files"] if not _is_same(out / file["key"], file)]
    for path in (out / file["key"] for file in wanted):
        if path.exists() and not force:
            hint = "move it away, or say --force to replace it"
            raise UsageError("is not the file of the record", where=str(path), hint=hint)
    files.require_space(out / "files", sum(file["size"] for file in wanted))
    if not dry_run:
        _obtain(wanted, out, lock, talk)
        files.write_atomically(lock_path, files.to_json(lock))
    told = [file | {"action": "downloaded" if file in wanted else "present"} for file in lock["files"]]
    return lock | {"out": str(out), "lock": str(lock_path), "dry_run": dry_run, "files": told}


def fetch_text(fetched: Json) -> str:
    """What a terminal shows."""
    told = "{title} ({doi}), version {version}, licence {licence}; in {out}".format_map(fetched)
    shown = ("key", "size", "action")
    return Table("files", told, fetched["files"], terminal=shown).text()


def record_number(text: str) -> str:
    """Number of a record named by number, DOI or address.

    >>> record_number("https://doi.org/10.5281/zenodo.19467931")
    '19467931'
    """
    match = re.fullmatch(r"(?:\S+/records?/|\S*10\.5281/zenodo\.)?(\d{1,12})/?", text.strip())
    if match is None:
        hint = "give its number, as in 19467931, its DOI or its address"
        raise UsageError(f"{text!r} is not a record of Zenodo", hint=hint)
    return match[1]


def _is_plain(key: str) -> bool:
    """Whether a name is a path downwards in its shortest form, without drive or control character."""
    path = PureWindowsPath(key)
    is_below = bool(path.parts) and not path.anchor and ".." not in path.parts
    return is_below and path.as_posix() == key and key.isprintable()


def _is_same(path: Path, file: Json) -> bool:
    return path.is_file() and path.stat().st_size == file["size"] and files.md5_of(path) == file["md5"]


def _described(site: str, number: str) -> Json:
    """What the site says of a record: the lock, but for its files' actions."""
    site = site.rstrip("/").removesuffix("/api")
    url = f"{site}/api/records/{number}"
    with _session() as session, _asked(session, url) as response:
        try:
            data = response.json()
            meta, number_now = data["metadata"], str(data["id"])
            listed = [
                {"key": file["key"], "size": file["size"], "md5": file["checksum"].removeprefix("md5:")}
                for file in data.get("files") or ()
            ]
        except (ValueError, KeyError, TypeError) as error:
            hint = f"a proxy or a login page may be in the way: look at {url}, {_BY_HAND}"
            raise DataMissingError("the answer is no record", where=url, hint=hint) from error
    if not listed:
        raise DataMissingError(f"record {number} shows no files", where=url, hint="ask its authors")
    return {
        "schema_version": 3,
        "record": number_now,
        "requested": number,
        "base_url": site,
        "doi": data.get("doi"),
        "title": meta.get("title"),
        "version": meta.get("version"),
        "licence": (meta.get("license") or {}).get("id"),
        "fetched_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "files": listed,
    }


def _session() -> Session:
    """A session that asks a busy site again, no sooner than it says."""
    session = Session()
    session.headers.update({"User-Agent": _AGENT, "Accept-Encoding": "identity"})
    busy = (429, 500, 502, 503, 504)
    retry = Retry(5, connect=1, status_forcelist=busy, backoff_factor=0.5, raise_on_status=False)
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry))
    return session


def _asked(session: Session, url: str, start: int = 0) -> Response:
    """Get an answer, or raise a DataMissingError."""
    headers = {"Range": f"bytes={start}-"} if start else {}
    try:
        response = session.get(url, headers=headers, timeout=_TIMEOUT, stream=True)
    except (RequestException, ValueError) as error:
        hint = f"look at the network and at HTTPS_PROXY, {_BY_HAND}"
        raise DataMissingError("cannot be reached", where=urlsplit(url).netloc, hint=hint) from error
    is_page = "text/html" in response.headers.get("Content-Type", "")
    if response.ok and not is_page:
        return response
    response.close()
    said = "with a web page" if response.ok else f"{response.status_code} {response.reason}"
    hint = f"check the number and --base-url, try again later, {_BY_HAND}"
    raise DataMissingError(f"the site answers {said}", where=url, hint=hint)


def _obtain(wanted: list[Json], out: Path, lock: Json, talk: Talk) -> None:
    only_writer = out.with_name(f".{out.name}.lock")
    out.mkdir(parents=True, exist_ok=True)
    size = sum(file["size"] for file in wanted)
    with files.locked(only_writer, out), _session() as session, talk.bar("fetching", size) as advance:
        for file in wanted:
            target = out / file["key"]
            target.parent.mkdir(parents=True, exist_ok=True)
            # The digest in its name tells a part of this very file from one of another version.
            part = target.with_name(f"{target.name}.{file['md5'][:8]}.part")
            record = f"{lock['base_url']}/api/records/{lock['record']}"
            url = f"{record}/files/{quote(file['key'])}/content"
            _download(session, url, file["size"], part, advance)
            if not _is_same(part, file):
                part.unlink()
                message = f"there is no {file['key']} of the size and MD5 that the record says"
                raise DataMissingError(message, where=url, hint=f"try again, {_BY_HAND}")
            part.replace(target)


def _download(session: Session, url: str, size: int, part: Path, advance: Callable[[int], None]) -> None:
    """Get a file of `size` bytes, from where an earlier try ended."""
    part.touch()
    for _ in range(_TRIES):
        start = part.stat().st_size
        if start >= size:
            return
        with (
            _asked(session, url, start) as response,
            part.open("ab" if response.status_code == 206 else "wb") as stream,
            suppress(RequestException),
        ):
            for chunk in response.iter_content(_CHUNK):
                advance(stream.write(chunk))
    if (start := part.stat().st_size) < size:
        message = f"the connection ended again and again, {start} of {size} bytes are here"
        raise DataMissingError(message, where=url, hint=f"run the command again: it goes on, {_BY_HAND}")
