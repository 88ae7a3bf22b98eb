"""The command that brings the paper's data set onto this machine, and proves that it is there."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any, NoReturn
from urllib.parse import quote, urlsplit

from filelock import FileLock, Timeout
from requests import RequestException, Response, Session
from requests.adapters import HTTPAdapter
from urllib3.util import Retry

from tendonrepro import __version__
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import md5_of, to_json, write_atomically

SITE = "https://zenodo.org"
VARIABLE = "TENDONREPRO_ZENODO_URL"
AGENT = f"tendonrepro/{__version__} (+https://doi.org/10.3390/act15050271)"
SCHEMA_VERSION = 2
BY_HAND = "or download the files in a browser and give their folder with --from-dir"

_TIMEOUT = 15.0, 60.0
"""For a connection and for the next bytes, s."""
_CHUNK = 2**14
"""Bytes; those of an unfinished one are lost when the connection ends."""
_TRIES = 4
"""Of a download that is cut off, without a byte more."""


@dataclass(frozen=True)
class RemoteFile:
    """A file of a record: name, bytes, digest if the record gives one, and path below the folder."""

    key: str
    size: int
    md5: str | None
    path: str


def run_fetch(
    record: str,
    out: Path,
    base_url: str | None,
    from_dir: Path | None,
    force: bool,
    dry_run: bool,
    talk: Talk,
) -> dict[str, Any]:
    """Bring the files of a record into a folder, or show that they are there.

    Parameters
    ----------
    record : str
        Number, DOI or address.
    out : Path
        Folder for the files; the lock is written beside it.
    base_url : str or None
        Another site than zenodo.org; else the environment may name one.
    from_dir : Path or None
        Folder with files downloaded by hand, taken instead of downloading.
    force : bool
        Replace files that were altered, and another record.
    dry_run : bool
        Ask and compare, write nothing.
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    UsageError
        If the record is not one, the folder holds other or altered files, or another process writes there.
    DataMissingError
        If the record or its files cannot be had.
    TendonreproError
        If the disk is full or cannot be written.
    """
    number = record_number(record)
    if from_dir is not None and not from_dir.is_dir():
        raise UsageError("is not a folder", where=str(from_dir), hint="give the folder of the downloads")
    site = (base_url or os.environ.get(VARIABLE) or SITE).rstrip("/").removesuffix("/api")
    lock = _read_lock(lock_path(out))
    if lock is not None and number not in {lock["record"], lock["requested"]} and not force:
        message = f"holds record {lock['record']}, not {number}"
        raise UsageError(message, where=str(out), hint="choose another --out, or say --force")
    if lock is None or number not in {lock["record"], lock["requested"]}:
        lock, network = _described(site, number), True
    else:
        network = False
    files = [RemoteFile(**file) for file in lock["files"]]
    wanted = [file for file in files if not _is_same(out / file.path, file)]
    if wanted and not network and from_dir is None:
        lock, network = _followed(lock, site, number, force=force), True
        files = [RemoteFile(**file) for file in lock["files"]]
        wanted = [file for file in files if not _is_same(out / file.path, file)]
    for file in wanted:
        if (out / file.path).exists() and not force:
            hint = "move it away, or say --force to replace it"
            raise UsageError("is not the file of the record", where=str(out / file.path), hint=hint)
    if not dry_run:
        _obtain(wanted, out, from_dir, lock, talk)
    done = {file.path: "copied" if from_dir else "downloaded" for file in wanted}
    head = {key: value for key, value in lock.items() if key not in {"files", "schema_version"}}
    return {
        "schema_version": SCHEMA_VERSION,
        **head,
        "out": str(out),
        "lock": str(lock_path(out)),
        "network": network,
        "dry_run": dry_run,
        "files": [file | {"action": done.get(file["path"], "present")} for file in lock["files"]],
    }


def fetch_text(found: dict[str, Any]) -> str:
    """Title, version, licence and the files of a record, for a terminal."""
    files = found["files"]
    rows = [f"  {file['path']}  {file['size']:,} bytes  {file['action']}" for file in files]
    foot = f"{len(files)} files, {sum(file['size'] for file in files):,} bytes, in {found['out']}"
    return "\n".join(
        [
            f"{found['title'] or 'record'} ({found['doi'] or found['record']})",
            f"version {found['version'] or 'not given'}, licence {found['licence'] or 'not given'}",
            *rows,
            "nothing written (--dry-run)" if found["dry_run"] else foot,
        ]
    )


def record_number(text: str) -> str:
    """Read how a user names a record: by number, DOI or address.

    >>> record_number("https://doi.org/10.5281/zenodo.19467931")
    '19467931'
    """
    found = re.fullmatch(
        r"(?:https?://\S+/records?/|(?:doi:|https?://(?:dx\.)?doi\.org/)?10\.5281/zenodo\.)?(\d{1,12})/?",
        text.strip(),
        re.IGNORECASE,
    )
    if found is None:
        hint = "give its number, as in 19467931, its DOI or its address"
        raise UsageError(f"{text!r} is not a record of Zenodo", hint=hint)
    return str(int(found[1]))


def lock_path(out: Path) -> Path:
    """Where the lock of a data folder stands: beside it, under its name."""
    folder = out.resolve()
    return folder.with_name(f"{folder.name}.lock.json")


def _read_lock(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        lock: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        [RemoteFile(**file) for file in lock["files"]]
        return lock
    except (ValueError, TypeError, KeyError) as error:
        hint = "remove it and fetch again: files that are right are kept"
        raise DataMissingError("is not a data lock of this version", where=str(path), hint=hint) from error


def _is_same(path: Path, file: RemoteFile) -> bool:
    if not path.is_file() or path.stat().st_size != file.size:
        return False
    return file.md5 is None or md5_of(path) == file.md5


def _described(site: str, number: str) -> dict[str, Any]:
    """Ask for a record: what it is, and its files."""
    url = f"{site}/api/records/{number}"
    with _asked(_session(), url) as response:
        try:
            data = response.json()
            meta = data["metadata"]
            number_now = str(data["id"])
            files = [_remote(entry) for entry in data.get("files") or ()]
        except (ValueError, KeyError, TypeError) as error:
            hint = f"a proxy or a login page may be in the way: look at {url}, {BY_HAND}"
            raise DataMissingError("the answer is no record", where=url, hint=hint) from error
    if not files:
        access = meta.get("access_right", "open")
        message = f"record {number} shows no files: its access is {access}"
        raise DataMissingError(message, hint=f"ask its authors, {BY_HAND}")
    return {
        "schema_version": SCHEMA_VERSION,
        "record": number_now,
        "requested": number,
        "base_url": site,
        "doi": data.get("doi"),
        "concept_doi": data.get("conceptdoi"),
        "title": meta.get("title"),
        "version": meta.get("version"),
        "licence": (meta.get("license") or {}).get("id"),
        "fetched_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "files": [asdict(file) for file in files],
    }


def _remote(entry: dict[str, Any]) -> RemoteFile:
    """A file of a record; one whose name leads out of the folder is refused."""
    key = entry["key"]
    path = PurePosixPath(key)
    if path.is_absolute() or ".." in path.parts or not path.name or "\\" in key or ":" in key:
        raise DataMissingError(f"the record has a file whose name is no path: {key!r}", hint=BY_HAND)
    checksum = entry.get("checksum") or ""
    found = re.fullmatch(r"(?:md5:)?([0-9a-f]{32})", checksum)
    return RemoteFile(key, int(entry["size"]), found[1] if found else None, path.as_posix())


def _followed(lock: dict[str, Any], site: str, number: str, *, force: bool) -> dict[str, Any]:
    """Record of a lock as the site shows it today; files that changed under its number need `force`."""
    fresh = _described(site, lock["record"]) | {"requested": number}
    before, now = ({f["key"]: (f["size"], f["md5"]) for f in one["files"]} for one in (lock, fresh))
    if before != now and not force:
        message = f"record {lock['record']} shows other files now than the lock says"
        raise UsageError(message, hint="say --force to follow the record")
    return fresh


def _session() -> Session:
    """Ask as who we are, again where the site is busy, and no sooner than it says."""
    session = Session()
    session.headers["User-Agent"] = AGENT
    retry = Retry(
        total=5,
        connect=1,
        status_forcelist=(429, 500, 502, 503, 504),
        backoff_factor=0.5,
        raise_on_status=False,
    )
    for scheme in ("http://", "https://"):
        session.mount(scheme, HTTPAdapter(max_retries=retry))
    return session


def _asked(session: Session, url: str, start: int = 0) -> Response:
    """Get an answer that can be used; else a DataMissingError that says what to do."""
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
    try:
        response = session.get(url, headers=headers, timeout=_TIMEOUT, stream=True)
    except (RequestException, ValueError) as error:
        hint = f"look at the network and at HTTPS_PROXY, {BY_HAND}"
        raise DataMissingError("cannot be reached", where=urlsplit(url).netloc, hint=hint) from error
    if response.status_code in (200, 206, 416):
        return response
    response.close()
    said = {
        404: "there is no such record or file",
        410: "the record was deleted",
        401: "it is not open to everyone",
        403: "it is not open to everyone",
        429: "too many requests: try again in an hour",
    }.get(response.status_code, f"the site answers {response.status_code}: try again later")
    raise DataMissingError(said, where=url, hint=f"check the number and --base-url, {BY_HAND}")


def _obtain(
    files: list[RemoteFile], out: Path, from_dir: Path | None, lock: dict[str, Any], talk: Talk
) -> None:
    """Put files in place, each whole, and write the lock when all are there."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with (
            FileLock(out.with_name(f".{out.name}.lock"), timeout=0),
            talk.bar("fetching", sum(file.size for file in files)) as advance,
        ):
            session = _session()
            for file in files:
                target = out / file.path
                target.parent.mkdir(parents=True, exist_ok=True)
                if from_dir is None:
                    url = f"{lock['base_url']}/api/records/{lock['record']}/files/{quote(file.key)}/content"
                    _download(session, url, file, target, advance)
                else:
                    _copy(from_dir, file, target)
            digests = [file | {"md5": file["md5"] or md5_of(out / file["path"])} for file in lock["files"]]
            write_atomically(lock_path(out), to_json(lock | {"files": digests}))
    except Timeout as error:
        raise UsageError("another tendonrepro is writing here", where=str(out)) from error
    except OSError as error:
        message = f"cannot write: {error.strerror or error}"
        hint = "make room, or choose another --out, and run the command again: it goes on where it stopped"
        raise TendonreproError(message, where=str(out), hint=hint) from error
    finally:
        out.with_name(f".{out.name}.lock").unlink(missing_ok=True)


def _download(
    session: Session, url: str, file: RemoteFile, target: Path, advance: Callable[[int], None]
) -> None:
    """Get one file; what an earlier try left of it in ``<name>.part`` is used."""
    # The digest in its name tells a part of this very file from one of another version.
    part = target.with_name(f"{target.name}.{(file.md5 or str(file.size))[:8]}.part")
    part.touch()
    useless = 0
    while (start := part.stat().st_size) < file.size:
        with _asked(session, url, start) as response:
            if "text/html" in response.headers.get("Content-Type", "") and not target.suffix.startswith(
                ".htm"
            ):
                raise DataMissingError("a web page came instead of the file", where=url, hint=BY_HAND)
            append = response.status_code == 206
            with part.open("ab" if append else "wb") as stream:
                _receive(response, stream.write, advance)
        useless = 0 if part.stat().st_size > start else useless + 1
        if useless == _TRIES or part.stat().st_size > file.size:
            _give_up(file, part)
    if file.md5 and md5_of(part) != file.md5:
        part.unlink()
        message = f"{file.key} arrived with another MD5 than the record says"
        raise DataMissingError(message, hint=f"run the command again, {BY_HAND}")
    part.replace(target)


def _receive(response: Response, write: Callable[[bytes], int], advance: Callable[[int], None]) -> None:
    """Write what comes until it ends or is cut off."""
    try:
        for chunk in response.iter_content(_CHUNK):
            write(chunk)
            advance(len(chunk))
    except RequestException:
        return


def _give_up(file: RemoteFile, part: Path) -> NoReturn:
    size = part.stat().st_size
    if size > file.size:
        part.unlink()
        raise DataMissingError(
            f"{file.key}: more came than the {file.size} bytes of the record", hint=BY_HAND
        )
    message = f"{file.key}: the connection ended again and again, {size} of {file.size} bytes are here"
    raise DataMissingError(message, hint=f"run the command again: it goes on from there, {BY_HAND}")


def _copy(from_dir: Path, file: RemoteFile, target: Path) -> None:
    """Take a file that was downloaded by hand, below its folder or by its name alone."""
    found = next((p for p in (from_dir / file.path, from_dir / Path(file.path).name) if p.is_file()), None)
    if found is None:
        raise DataMissingError(f"there is no {file.path}", where=str(from_dir), hint="download it too")
    if not _is_same(found, file):
        message = "is not the file of the record: size or MD5 differ"
        raise DataMissingError(message, where=str(found), hint="download it again")
    shutil.copyfile(found, target.with_name(f"{target.name}.part"))
    target.with_name(f"{target.name}.part").replace(target)
