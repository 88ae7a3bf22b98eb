"""From a record's number to its files: asked of the repository, with what a user should know about it."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from urllib.parse import urlsplit

from tendonrepro.dataset.repository.lock import LockedFile
from tendonrepro.dataset.repository.names import safe_paths, shown
from tendonrepro.dataset.repository.web import Web
from tendonrepro.dataset.repository.web_errors import BY_HAND, WebError
from tendonrepro.dataset.repository.zenodo import SITE, Record, RemoteFile, parse_files, parse_record
from tendonrepro.errors import DataMissingError, UsageError

VARIABLE = "TENDONREPRO_ZENODO_URL"


def site_of(base_url: str | None) -> str:
    """Address of the site to ask: the one given, else of the environment, else Zenodo.

    Parameters
    ----------
    base_url : str or None

    Returns
    -------
    str
        Without a slash at its end.

    Raises
    ------
    UsageError
        If it is no address.
    """
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


def resolve(web: Web, site: str, number: str, warn: Callable[[str], None]) -> Record:
    """Ask for a record and its files.

    Parameters
    ----------
    web : Web
    site : str
    number : str
        Of one version, or of all versions together, which leads to the latest.
    warn : callable
        Told what may surprise: another version than the number says, or a later one.

    Returns
    -------
    Record
        With at least one file.

    Raises
    ------
    WebError
        If the repository does not answer, does not have the record, or does not show its files.
    DataMissingError
        If its answer makes no sense.
    """
    record = parse_record(web.json(f"{site}/api/records/{number}", f"record {number}"), site)
    if record.record_id != number:
        found = record.record_id
        warn(f"{number} stands for all versions and leads to {found} today: ask for {found} to stay with it")
    if record.is_latest is False:
        warn(f"record {record.record_id} is not the latest version")
    return record if record.files else replace(record, files=_listed(web, site, record))


def expected_files(record: Record) -> tuple[LockedFile, ...]:
    """Files of a record as they shall be on disk.

    Parameters
    ----------
    record : Record

    Returns
    -------
    tuple of LockedFile

    Raises
    ------
    DataMissingError
        If a name would leave the folder, or two would meet.
    """
    try:
        paths = safe_paths(file.key for file in record.files)
    except ValueError as error:
        message = f"record {record.record_id} has a file name that cannot be used: {error}"
        hint = "download the files in a browser, rename that one, and read them from there"
        raise DataMissingError(message, hint=hint) from error
    return tuple(LockedFile(file.key, file.size, file.md5, str(paths[file.key])) for file in record.files)


def _listed(web: Web, site: str, record: Record) -> tuple[RemoteFile, ...]:
    """Files of a record that does not show them itself, or why there are none."""
    name = f"record {record.record_id}"
    if record.access != "open":
        until = f" until {record.embargo_date}" if record.embargo_date else ""
        message = f"the files of {name} are not open to everyone ({record.access}{until})"
        raise WebError(message, hint="ask its authors for the files, then use --from-dir DIR", status=403)
    answer = web.json(f"{site}/api/records/{record.record_id}/files", f"the files of {name}")
    files = parse_files(answer, record.record_id, site)
    if not files:
        message = f"{name} shows no files"
        raise WebError(message, hint=f"check its number, {BY_HAND}", status=200)
    return files
