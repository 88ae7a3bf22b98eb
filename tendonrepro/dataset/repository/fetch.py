"""The command that brings the paper's data set onto this machine, and proves that it is there."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urlsplit

from tendonrepro.console import Talk
from tendonrepro.dataset.repository.download import download, remove_part
from tendonrepro.dataset.repository.lock import (
    DataLock,
    LockedFile,
    find_differences,
    is_same,
    lock_path,
    read_lock,
    write_lock,
)
from tendonrepro.dataset.repository.names import LOCK, safe_paths, shown
from tendonrepro.dataset.repository.web import BY_HAND, Patience, Web, WebError
from tendonrepro.dataset.repository.zenodo import SITE, Record, parse_record, record_number
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import atomic_path, md5_of
from tendonrepro.results.folder import locked

VARIABLE = "TENDONREPRO_ZENODO_URL"


@dataclass(frozen=True)
class _Job:
    """What was asked for, and what became of it so far."""

    requested: str
    site: str
    out: Path
    from_dir: Path | None
    force: bool
    dry_run: bool
    talk: Talk
    web: Web
    warnings: list[str] = field(default_factory=list)
    done: dict[str, str] = field(default_factory=dict)

    def warn(self, text: str) -> None:
        self.warnings.append(text)
        self.talk.note(f"note: {text}")


def run_fetch(
    record: str,
    out: Path,
    base_url: str | None,
    from_dir: Path | None,
    force: bool,
    dry_run: bool,
    talk: Talk,
    *,
    patience: Patience | None = None,
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
    patience : Patience, optional
        With the network.

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
    site = site_of(base_url)
    web = Web(talk, patience or Patience())
    job = _Job(record_number(record, site), site, out, from_dir, force, dry_run, talk, web)
    lock_path(out)  # an `out` without a name is refused before anything is made
    if from_dir is not None and not from_dir.is_dir():
        hint = "give the folder with the downloaded files"
        raise UsageError("is not a folder", where=str(from_dir), hint=hint)
    with nullcontext() if dry_run else _held(out):
        lock, network = _settled(job)
    described = lock.model_dump(exclude={"schema_version", "files"})
    files = [file.model_dump() | {"action": job.done.get(file.path, "present")} for file in lock.files]
    return {
        "schema_version": 2,
        **described,
        "out": str(out),
        "lock": str(lock_path(out)),
        "network": network,
        "dry_run": dry_run,
        "files": files,
        "warnings": job.warnings,
    }


def fetch_text(found: dict[str, Any]) -> str:
    """Title, version, licence and a table of the files, from what `run_fetch` found, for a terminal."""
    files = found["files"]
    width = max(len(file["path"]) for file in files)
    foot = f"{len(files)} files, {sum(file['size'] for file in files):,} bytes, in {found['out']}"
    return "\n".join(
        [
            f"{found['title'] or 'record'} ({found['doi'] or found['record']})",
            f"version {found['version'] or 'not given'}, licence {found['licence'] or 'not given'}",
            *(f"  {file['path']:<{width}}  {file['size']:>13,} bytes  {file['action']}" for file in files),
            "nothing written (--dry-run)" if found["dry_run"] else foot,
        ]
    )


def site_of(base_url: str | None) -> str:
    """Address of the site to ask: the one given, else of the environment, else Zenodo."""
    site = (base_url or os.environ.get(VARIABLE) or SITE).strip().rstrip("/")
    try:
        parts = urlsplit(site)
        good = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:
        good = False
    # A password in an address would end up in the lock.
    if not good or "@" in parts.netloc or parts.query or parts.fragment or not re.fullmatch(r"[!-~]+", site):
        message = f"{shown(site)} is not the address of a site"
        raise UsageError(message, hint=f"give --base-url or {VARIABLE} as in {SITE}")
    return site.removesuffix("/api")


@contextmanager
def _held(out: Path) -> Iterator[None]:
    """Be the only one who writes into the folder; a failure leaves no lock and no empty folder of its own."""
    new = [folder for folder in (out, *out.parents) if not folder.exists()]
    unlocked = not (out / LOCK).exists()
    with locked(out):
        try:
            yield
        except BaseException:
            with suppress(OSError):
                if unlocked:
                    (out / LOCK).unlink()
                inner = [path for path in out.rglob("*") if path.is_dir()] if new else []
                for folder in [*sorted(inner, reverse=True), *new]:
                    with suppress(OSError):
                        folder.rmdir()
            raise


def _settled(job: _Job) -> tuple[DataLock, bool]:
    """The lock of a folder that holds what it shall, and whether the network was asked."""
    lock = read_lock(lock_path(job.out))
    if lock is not None and job.requested not in {lock.record, lock.requested}:
        if not job.force:
            message = f"holds record {lock.record}, not {job.requested}"
            hint = "choose another --out, or say --force to replace its files"
            raise UsageError(message, where=str(job.out), hint=hint)
        lock = None
    if lock is None:
        record = resolve(job.web, job.site, job.requested, job.warn)
        return _obtained(job, _lock_for(job, record), record), True
    wanted = _wanted(job, lock.files)
    for file in wanted:
        job.talk.note(f"{shown(file.key)} is missing or was altered")
    if not wanted:
        place = lock_path(job.out)
        job.talk.note(f"all {len(lock.files)} files are as {place} says: nothing asked of the network")
        return lock, False
    if job.from_dir is not None:
        return _obtained(job, lock, None), False
    record = resolve(job.web, job.site, lock.record, job.warn)
    fresh = _lock_for(job, record).model_copy(update={"requested": lock.requested})
    before = {file.key: (file.size, file.md5) for file in lock.files}
    # Where the record gives no digest, that of the lock stands in.
    now = {file.key: (file.size, file.md5 or before.get(file.key, (0, None))[1]) for file in fresh.files}
    if now != before:
        message = f"record {lock.record} shows other files now than {lock_path(job.out)} says"
        if not job.force:
            raise UsageError(message, hint="say --force to follow the record")
        job.warn(message)
    return _obtained(job, fresh, record), True


def _lock_for(job: _Job, record: Record) -> DataLock:
    words = ("doi", "concept_doi", "title", "version", "licence")
    return DataLock.model_validate(
        {word: getattr(record, word) for word in words}
        | {"record": record.record_id, "requested": job.requested, "base_url": job.site}
        | {"fetched_at": datetime.now(UTC).isoformat(timespec="seconds"), "files": expected_files(record)}
    )


def resolve(web: Web, site: str, number: str, warn: Callable[[str], None]) -> Record:
    """Ask for a record and its files; a number of all versions leads to the latest.

    `warn` is told what may surprise: another version than the number says, or a later one. Raises a WebError
    where the repository does not answer, does not have the record, or does not show its files.
    """
    record = parse_record(web.json(f"{site}/api/records/{number}", f"record {number}"), site)
    found = record.record_id
    if found != number:
        warn(f"{number} stands for all versions and leads to {found} today: ask for {found} to stay with it")
    if record.is_latest is False:
        warn(f"record {found} is not the latest version")
    if record.files:
        return record
    if record.access != "open":
        until = f" until {record.embargo_date}" if record.embargo_date else ""
        message = f"the files of record {found} are not open to everyone ({record.access}{until})"
        raise WebError(message, hint="ask its authors for the files", status=403)
    raise WebError(f"record {found} shows no files", hint=f"check its number, {BY_HAND}", status=200)


def expected_files(record: Record) -> tuple[LockedFile, ...]:
    """Files of a record as they shall be on disk; a DataMissingError if a name cannot be used there."""
    try:
        paths = safe_paths(file.key for file in record.files)
    except ValueError as error:
        message = f"record {record.record_id} has a file name that cannot be used: {error}"
        hint = "download the files in a browser, rename that one, and read them from there"
        raise DataMissingError(message, hint=hint) from error
    return tuple(
        LockedFile(key=file.key, size=file.size, md5=file.md5, path=str(paths[file.key]))
        for file in record.files
    )


def _wanted(job: _Job, files: Sequence[LockedFile]) -> list[LockedFile]:
    """Files that are missing, or altered and to be replaced; others that are altered are refused."""
    with job.talk.bar("checking", sum(file.size for file in files)) as advance:
        missing, altered = find_differences(files, job.out, advance)
    if altered and not job.force:
        names = ", ".join(shown(file.path) for file in altered)
        message = f"differs from the record: {names}"
        hint = "move them away to keep them, or say --force to replace them"
        raise UsageError(message, where=str(job.out), hint=hint)
    return [*missing, *altered]


def _obtained(job: _Job, lock: DataLock, record: Record | None) -> DataLock:
    """Copy or download what is not on disk yet, and write the lock, now that every file is there."""
    wanted = _wanted(job, lock.files)
    if bare := [shown(file.key) for file in lock.files if file.md5 is None]:
        job.warn(f"the record gives no MD5 of {', '.join(bare)}: only the size could be compared")
    if job.from_dir is not None:
        _copy(job, job.from_dir, wanted)
    elif record is not None:
        _download(job, record, wanted)
    if job.dry_run:
        return lock
    for file in lock.files:
        remove_part(job.out / file.path)
    files = [file.model_copy(update={"md5": file.md5 or md5_of(job.out / file.path)}) for file in lock.files]
    lock = lock.model_copy(update={"files": tuple(files)})
    write_lock(lock_path(job.out), lock)
    return lock


def _copy(job: _Job, folder: Path, wanted: list[LockedFile]) -> None:
    """Copy what is wanted from a folder that holds it, under its path or its bare name."""
    with job.talk.bar("checking", sum(file.size for file in wanted)) as advance:
        absent, wrong = find_differences(wanted, folder, advance)
    bare = {file: file.model_copy(update={"path": PurePosixPath(file.path).name}) for file in absent}
    absent, others = find_differences(bare.values(), folder, lambda _: None)
    if wrong := [*wrong, *others]:
        message = f"not the record's files, by size or MD5: {', '.join(shown(file.key) for file in wrong)}"
        hint = "download them again: they are cut short, changed, or of another version"
        raise DataMissingError(message, where=str(folder), hint=hint)
    if absent:
        message = f"lacks {len(absent)} of the {len(wanted)} files wanted from it: "
        hint = "put them there, unpacked if they came as one archive, or download them without --from-dir"
        names = ", ".join(shown(file.key) for file in absent)
        raise DataMissingError(message + names, where=str(folder), hint=hint)
    job.done.update((file.path, "to copy" if job.dry_run else "copied") for file in wanted)
    for file in () if job.dry_run else wanted:
        with atomic_path(job.out / file.path) as temporary:
            shutil.copyfile(folder / bare.get(file, file).path, temporary)
            if not is_same(temporary, file):
                raise DataMissingError(f"{shown(file.key)} changed while it was copied", where=str(folder))


def _download(job: _Job, record: Record, wanted: list[LockedFile]) -> None:
    job.done.update((file.path, "to download" if job.dry_run else "downloaded") for file in wanted)
    if job.dry_run:
        return
    remotes = {remote.key: remote for remote in record.files}
    with job.talk.bar("downloading", sum(file.size for file in wanted)) as advance:
        for file in wanted:
            job.talk.detail(f"downloading {shown(file.key)}, {file.size:,} bytes")
            download(job.web, record.record_id, remotes[file.key], job.out / file.path, advance)
