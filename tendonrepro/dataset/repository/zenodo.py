"""A Zenodo record: what its JSON says, and how a user may name it."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import quote, urlsplit

from tendonrepro.dataset.repository.names import shown
from tendonrepro.errors import DataMissingError, UsageError

SITE = "https://zenodo.org"
UNQUOTED = "/!$&'()*+,;=:@"
"""Characters of a key that stand in an address as they are."""


class RemoteFile(NamedTuple):
    """One file of a record: its name, which may hold slashes, bytes, MD5 if the record gives one, address."""

    key: str
    size: int
    md5: str | None
    url: str


@dataclass(frozen=True)
class Record:
    """One version of a data set, by the number `record_id`.

    `access` is ``open``, ``restricted``, ``embargoed`` or another word; a record that is not open
    may show no `files`. `is_latest` is None where it does not say.
    """

    record_id: str
    doi: str | None
    concept_doi: str | None
    title: str | None
    version: str | None
    licence: str | None
    access: str
    embargo_date: str | None
    is_latest: bool | None
    files: tuple[RemoteFile, ...]


def record_number(text: str, site: str = SITE) -> str:
    """Read how a user names a record: by number, DOI, or an address at `site` or zenodo.org.

    >>> record_number("https://doi.org/10.5281/zenodo.19467931")
    '19467931'
    """
    name = text.strip()
    doi = r"(?:(?:doi:|https?://(?:dx\.)?doi\.org/)?10\.5281/zenodo\.)?([0-9]{1,12})"
    found = re.fullmatch(doi, name, re.IGNORECASE)
    with suppress(ValueError):
        parts = urlsplit(name)
        if parts.netloc.lower() in {"zenodo.org", "www.zenodo.org", urlsplit(site).netloc.lower()}:
            found = found or re.match(r"/(?:api/)?records?/([0-9]{1,12})(?:/|$)", parts.path)
    if found is None:
        message = f"{shown(text)} is not a record of {site}"
        hint = "give its number, as in 19467931, its DOI, as in 10.5281/zenodo.19467931, or its address"
        raise UsageError(message, hint=f"{hint}; another site needs --base-url")
    return str(int(found[1]))


def parse_record(data: object, site: str) -> Record:
    """Read the JSON of a record at `site` as Zenodo gives it; a DataMissingError if it is no record."""
    meta = at(data, "metadata")
    number = str(at(data, "id"))
    if not re.fullmatch("[0-9]{1,12}", number):
        raise _nonsense(number, "number")
    relations = at(meta, "relations", "version")
    is_last = at(relations[0], "is_last") if isinstance(relations, list) and relations else None
    return Record(
        record_id=number,
        doi=_line(at(data, "doi")),
        concept_doi=_line(at(data, "conceptdoi")),
        title=_line(at(meta, "title")),
        version=_line(at(meta, "version")),
        licence=_line(at(meta, "license", "id")),
        access=_line(at(meta, "access_right")) or "open",
        embargo_date=_line(at(meta, "embargo_date")),
        is_latest=is_last if isinstance(is_last, bool) else None,
        files=_files(at(data, "files"), f"{site}/api/records/{number}/files"),
    )


def _files(data: object, place: str) -> tuple[RemoteFile, ...]:
    """Files of a record at an address; none at all where it shows none."""
    if not isinstance(data, list | None):
        raise _nonsense(data, "files")
    files = tuple(_file(entry, place) for entry in data or ())
    for key, times in Counter(file.key for file in files).most_common(1):
        if times > 1:
            raise _nonsense(key, "a file named twice")
    return files


def _file(entry: object, place: str) -> RemoteFile:
    key, size = at(entry, "key"), at(entry, "size")
    if not isinstance(key, str) or not key:
        raise _nonsense(key, "name of a file")
    if not isinstance(size, int) or isinstance(size, bool) or not 0 <= size < 2**63:
        raise _nonsense(size, f"size of {shown(key)}")
    # A key may hold half a surrogate pair; its name is refused later, the address must not fail here.
    path = quote(key, safe=UNQUOTED, errors="replace")
    return RemoteFile(key, size, _md5(at(entry, "checksum"), key), f"{place}/{path}/content")


def _md5(checksum: object, key: str) -> str | None:
    """The digest of a file; None where there is none, or another kind of one."""
    if checksum is None:
        return None
    if isinstance(checksum, str):
        if found := re.fullmatch(r"(?:md5:)?([0-9a-f]{32})", checksum, re.IGNORECASE):
            return found[1].lower()
        if re.match(r"(?!md5:)[a-z0-9-]+:", checksum, re.IGNORECASE):
            return None
    raise _nonsense(checksum, f"checksum of {shown(key)}")


def at(tree: object, *keys: str) -> Any:
    """What stands at a place in a JSON tree; None where there is no such place."""
    for key in keys:
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree


def _line(value: object) -> str | None:
    """One line of printable text, so that a record cannot move the user's terminal about."""
    return (plain(value) or None) if isinstance(value, str) else None


def plain(text: str) -> str:
    """Printable letters only, on one line of at most 300."""
    return "".join(letter for letter in " ".join(text.split()) if letter.isprintable())[:300]


def _nonsense(value: object, what: str) -> DataMissingError:
    text = shown(value) if isinstance(value, str) else type(value).__name__ if value else str(value)
    message = f"the record makes no sense: {what}: {text}"
    hint = "see whether --base-url leads to Zenodo, or download the files in a browser"
    return DataMissingError(message, hint=hint)
