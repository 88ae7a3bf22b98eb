"""The command that brings the paper's data set onto this machine, and proves that it is there."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tendonrepro.console import Talk
from tendonrepro.dataset.repository.by_hand import copy_file, find_files, take_as_they_are
from tendonrepro.dataset.repository.download import download, part_size, remove_part
from tendonrepro.dataset.repository.fetch_text import readable
from tendonrepro.dataset.repository.lock import (
    DataLock,
    LockedFile,
    find_differences,
    lock_path,
    read_lock,
    write_lock,
)
from tendonrepro.dataset.repository.names import shown
from tendonrepro.dataset.repository.resolve import expected_files, resolve, site_of
from tendonrepro.dataset.repository.web import Patience, Web
from tendonrepro.dataset.repository.web_errors import WebError
from tendonrepro.dataset.repository.zenodo import Record, record_number
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import md5_of
from tendonrepro.results.folder import locked


@dataclass(frozen=True)
class _Job:
    """What was asked for, and what is known before anyone is asked."""

    requested: str
    site: str
    out: Path
    from_dir: Path | None
    force: bool
    dry_run: bool
    talk: Talk
    web: Web
    lock: DataLock | None
    warnings: list[str]

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
        Folder with files downloaded by hand, used instead of downloading.
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
    number = record_number(record, site)
    place = lock_path(out)
    with nullcontext() if dry_run else locked(out):
        job = _Job(
            number,
            site,
            out,
            from_dir,
            force,
            dry_run,
            talk,
            Web(talk, patience or Patience()),
            read_lock(place),
            [],
        )
        return _carry_out(job, place)


def _carry_out(job: _Job, place: Path) -> dict[str, Any]:
    lock = job.lock
    known = lock is not None and job.requested in {lock.record, lock.requested}
    if lock is not None and not known and not job.force:
        message = f"holds record {lock.record}, not {job.requested}"
        raise UsageError(
            message, where=str(job.out), hint="choose another --out, or say --force to replace its files"
        )
    if lock is None or not known:
        return _first_time(job, place)
    missing, altered = _compare(job, lock.files)
    for file in missing:
        job.talk.note(f"{shown(file.key)} is missing")
    _refuse_altered(job, altered)
    if not missing and not altered and (lock.verified or not job.force):
        job.talk.note(f"all {len(lock.files)} files are as {place} says: nothing asked of the network")
        if not lock.verified:
            job.warn("these files were never compared with the record; --force does it now")
        return _answer(job, lock, dict.fromkeys((file.path for file in lock.files), "present"), network=False)
    return _again(job, place, lock, [*missing, *altered]) if lock.verified else _first_time(job, place)


def _again(job: _Job, place: Path, lock: DataLock, wanted: list[LockedFile]) -> dict[str, Any]:
    """Mend a folder whose record is known."""
    if job.from_dir is not None:
        done, ignored = _copy(job, job.from_dir, lock.files, wanted)
        return _answer(job, lock, done, network=False, ignored=ignored)
    record = resolve(job.web, job.site, lock.record, job.warn)
    fresh = _lock_for(job, record)
    before = {file.key: (file.size, file.md5) for file in lock.files}
    # Where the record gives no digest, that of the lock stands in.
    now = {file.key: (file.size, file.md5 or before.get(file.key, (0, None))[1]) for file in fresh.files}
    if now != before:
        message = f"record {lock.record} shows other files now than {place} says"
        if not job.force:
            raise UsageError(message, hint="say --force to follow the record")
        job.warn(message)
    return _obtain(job, place, replace(fresh, requested=lock.requested), record)


def _first_time(job: _Job, place: Path) -> dict[str, Any]:
    try:
        record = resolve(job.web, job.site, job.requested, job.warn)
    except WebError as error:
        # That there is no such record is an answer; silence is none, and closed files may come by other ways.
        if job.from_dir is None or error.status in {404, 410}:
            raise
        return _unverified(job, place, job.from_dir, error)
    return _obtain(job, place, _lock_for(job, record), record)


def _lock_for(job: _Job, record: Record) -> DataLock:
    described = (record.doi, record.concept_doi, record.title, record.version, record.licence)
    return DataLock(
        record.record_id, job.requested, *described, _now(), job.site, True, expected_files(record)
    )


def _obtain(job: _Job, place: Path, lock: DataLock, record: Record) -> dict[str, Any]:
    """Copy or download what is not on disk yet, and write the lock."""
    missing, altered = _compare(job, lock.files)
    _refuse_altered(job, altered)
    wanted = [*missing, *altered]
    ignored: list[str] = []
    if bare := [shown(file.key) for file in lock.files if file.md5 is None]:
        job.warn(f"the record gives no MD5 of {', '.join(bare)}: only the size could be compared")
    if job.from_dir is not None:
        done, ignored = _copy(job, job.from_dir, lock.files, wanted)
    else:
        done = _download(job, lock, record, wanted)
    return _settle(job, place, lock, done, network=True, ignored=ignored)


def _unverified(job: _Job, place: Path, folder: Path, error: WebError) -> dict[str, Any]:
    """Take files as they are, because nobody could be asked."""
    job.warn(f"{error.message}; the files of {folder} are taken as they are, NOT compared with the record")
    files = take_as_they_are(folder)
    nothing = (None, None, None, None, None)
    lock = DataLock(job.requested, job.requested, *nothing, _now(), job.site, False, files)
    missing, altered = _compare(job, files)
    _refuse_altered(job, altered)
    done, ignored = _copy(job, folder, files, [*missing, *altered])
    return _settle(job, place, lock, done, network=False, ignored=ignored)


def _copy(
    job: _Job, folder: Path, files: Sequence[LockedFile], wanted: list[LockedFile]
) -> tuple[dict[str, str], list[str]]:
    """Copy what the folder has of what is wanted; what each file of the record went through, and the rest."""
    found = find_files(files, folder)
    here = [file for file in wanted if file.path in found.sources]
    done = {file.path: "present" for file in files}
    done |= {file.path: "to copy" if job.dry_run else "copied" for file in here}
    if not job.dry_run:
        _need_room(job, sum(file.size for file in here))
        with job.talk.bar("copying", sum(file.size for file in here)) as advance:
            for file in here:
                copy_file(found.sources[file.path], file, job.out / file.path)
                advance(file.size)
    if found.ignored:
        job.talk.note(f"ignored, not of the record: {', '.join(map(shown, found.ignored))}")
    absent = [shown(file.key) for file in wanted if file.path not in found.sources]
    if absent:
        message = f"lacks {len(absent)} of the record's {len(files)} files: {', '.join(absent)}"
        hint = "put them there, unpacked if they came as one archive, or download them without --from-dir"
        raise DataMissingError(message, where=str(folder), hint=hint)
    return done, found.ignored


def _download(job: _Job, lock: DataLock, record: Record, wanted: list[LockedFile]) -> dict[str, str]:
    done = {file.path: "present" for file in lock.files}
    done |= {file.path: "to download" if job.dry_run else "downloaded" for file in wanted}
    if job.dry_run:
        return done
    remotes = {remote.key: remote for remote in record.files}
    size = sum(file.size for file in wanted)
    _need_room(job, size - sum(part_size(job.out / file.path) for file in wanted))
    with job.talk.bar("downloading", size) as advance:
        for file in wanted:
            job.talk.detail(f"downloading {shown(file.key)}, {readable(file.size)}")
            download(job.web, record.record_id, remotes[file.key], job.out / file.path, advance)
    return done


def _need_room(job: _Job, size: int) -> None:
    try:
        free = shutil.disk_usage(job.out).free
    except OSError:
        return
    if free < size:
        message = f"the files need {readable(size)}, {readable(free)} are free"
        raise TendonreproError(message, where=str(job.out), hint="make room, or choose another --out")


def _compare(job: _Job, files: Sequence[LockedFile]) -> tuple[list[LockedFile], list[LockedFile]]:
    with job.talk.bar("checking", sum(file.size for file in files)) as advance:
        return find_differences(files, job.out, advance)


def _refuse_altered(job: _Job, altered: list[LockedFile]) -> None:
    if altered and not job.force:
        names = ", ".join(shown(file.path) for file in altered)
        message = f"differs from the record: {names}"
        hint = "move them away to keep them, or say --force to replace them"
        raise UsageError(message, where=str(job.out), hint=hint)


def _settle(
    job: _Job, place: Path, lock: DataLock, done: dict[str, str], *, network: bool, ignored: list[str]
) -> dict[str, Any]:
    """Write the lock, now that every file is there."""
    if not job.dry_run:
        files = tuple(replace(file, md5=file.md5 or md5_of(job.out / file.path)) for file in lock.files)
        lock = replace(lock, files=files)
        write_lock(place, lock)
        for file in files:
            remove_part(job.out / file.path)
    return _answer(job, lock, done, network=network, ignored=ignored)


def _answer(
    job: _Job, lock: DataLock, done: dict[str, str], *, network: bool, ignored: Sequence[str] = ()
) -> dict[str, Any]:
    files = [
        {"key": file.key, "size": file.size, "md5": file.md5, "path": file.path, "action": done[file.path]}
        for file in lock.files
    ]
    described = {
        key: getattr(lock, key)
        for key in ("record", "requested", "doi", "concept_doi", "title", "version", "licence", "fetched_at")
    }
    return {
        "schema_version": 1,
        **described,
        "base_url": lock.base_url,
        "out": str(job.out),
        "lock": str(lock_path(job.out)),
        "verified": lock.verified,
        "network": network,
        "dry_run": job.dry_run,
        "files": files,
        "ignored": list(ignored),
        "warnings": job.warnings,
    }


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
