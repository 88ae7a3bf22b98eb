"""A Zenodo record: what its JSON says, whichever of the shapes it has, and how a user may name it."""

from __future__ import annotations

import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlsplit

from tendonrepro.dataset.repository.names import shown
from tendonrepro.errors import DataMissingError, UsageError

SITE = "https://zenodo.org"
UNQUOTED = "/!$&'()*+,;=:@"
"""Characters of a key that stand in an address as they are."""


@dataclass(frozen=True)
class RemoteFile:
    """One file of a record.

    Attributes
    ----------
    key : str
        Its name; may hold slashes.
    size : int
        Bytes.
    md5 : str or None
        32 lower-case hexadecimal digits; None where the record gives none.
    urls : tuple of str
        Where to get it, best first.
    """

    key: str
    size: int
    md5: str | None
    urls: tuple[str, ...]


@dataclass(frozen=True)
class Record:
    """One version of a data set.

    Attributes
    ----------
    record_id, concept_id : str
        Number of this version, and of all versions together; the latter may be unknown.
    doi, concept_doi : str or None
    title, version, licence : str or None
    access : str
        ``open``, ``restricted``, ``embargoed`` or another word of the repository.
    embargo_date : str or None
    is_latest : bool or None
        Whether no later version was there; None where the record does not say.
    files : tuple of RemoteFile
        Empty where the record does not show them.
    """

    record_id: str
    concept_id: str | None
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
    """Read the JSON of a record: Zenodo's own shape, that of late 2023, or that of InvenioRDM.

    `site` is for files that come without an address. Raises a DataMissingError if it is no record.
    """
    meta, parent, rights = at(data, "metadata"), at(data, "parent"), at(data, "access", "files")
    number = _number(at(data, "recid") or at(data, "id"), "number")
    concept = at(data, "conceptrecid") or at(parent, "id")
    access = at(meta, "access_right") or at(data, "access", "status") or rights
    relations = at(meta, "relations", "version")
    first = relations[0] if isinstance(relations, list) and relations else None
    latest = [at(first, "is_last"), at(data, "versions", "is_latest")]
    return Record(
        record_id=number,
        concept_id=None if concept is None else _number(concept, "concept number"),
        doi=_line(at(data, "doi") or at(meta, "doi") or at(data, "pids", "doi", "identifier")),
        concept_doi=_line(at(data, "conceptdoi") or at(parent, "pids", "doi", "identifier")),
        title=_line(at(meta, "title") or at(data, "title")),
        version=_line(at(meta, "version")),
        licence=_licence(meta),
        access="open" if access in (None, "public") else _line(access) or "open",
        embargo_date=_line(at(meta, "embargo_date") or at(data, "access", "embargo", "until")),
        is_latest=next((found for found in latest if isinstance(found, bool)), None),
        files=parse_files(at(data, "files"), number, site),
    )


def parse_files(data: object, number: str, site: str) -> tuple[RemoteFile, ...]:
    """Read a list of files: of record `number`, or the answer about its files; nothing at all is no file.

    It is a list, or has ``entries`` which are a list or a mapping by key. Raises a DataMissingError if it is
    anything else, or a key comes twice.
    """
    if isinstance(data, dict):
        data = data.get("entries")
    if isinstance(data, dict):
        data = [{"key": key, **entry} if isinstance(entry, dict) else entry for key, entry in data.items()]
    if not isinstance(data, list | None):
        raise _nonsense(data, "files")
    files = tuple(_file(entry, number, site) for entry in data or ())
    for key, times in Counter(file.key for file in files).most_common(1):
        if times > 1:
            raise _nonsense(key, "a file named twice")
    return files


def _file(entry: object, number: str, site: str) -> RemoteFile:
    if not isinstance(entry, dict):
        raise _nonsense(entry, "a file")
    key = entry.get("key", entry.get("filename"))
    if not isinstance(key, str) or not key:
        raise _nonsense(key, "name of a file")
    size = entry.get("size", entry.get("filesize"))
    if not isinstance(size, int) or isinstance(size, bool) or not 0 <= size < 2**63:
        raise _nonsense(size, f"size of {shown(key)}")
    # A key may hold half a surrogate pair; its name is refused later, the address must not fail here.
    path = quote(key, safe=UNQUOTED, errors="replace")
    built = f"{site}/api/records/{number}/files/{path}/content"
    page = f"{site}/records/{number}/files/{path}?download=1"
    # `self` may also be the address of the description.
    given = [(name, at(entry, "links", name)) for name in ("content", "self", "download")]
    good = [url for name, url in given if _is_address(url) and (name != "self" or url.endswith("/content"))]
    return RemoteFile(key, size, _md5(entry.get("checksum"), key), ((good or [built])[0], page))


def _is_address(url: object) -> bool:
    try:
        return isinstance(url, str) and bool(re.fullmatch("https?://[!-~]+", url) and urlsplit(url).hostname)
    except ValueError:
        return False


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


def _licence(meta: object) -> str | None:
    found = at(meta, "license") or at(meta, "rights")
    entries = found if isinstance(found, list) else [found]
    names = [at(entry, "id") or at(entry, "title") or entry for entry in entries]
    # InvenioRDM gives titles by language.
    texts = [_line(next(iter(name.values()), None) if isinstance(name, dict) else name) for name in names]
    return ", ".join(text for text in texts if text) or None


def at(tree: object, *keys: str) -> Any:
    """What stands at a place in a JSON tree; None where there is no such place."""
    for key in keys:
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree


def _number(value: object, what: str) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if not isinstance(text, str) or not re.fullmatch("[0-9]{1,12}", text):
        raise _nonsense(value, what)
    return text


def _line(value: object) -> str | None:
    """One line of printable text, so that a record cannot move the user's terminal about."""
    return (plain(value) or None) if isinstance(value, str) else None


def plain(text: str) -> str:
    """Printable letters only, on one line of at most 300."""
    return "".join(letter for letter in " ".join(text.split()) if letter.isprintable())[:300]


def _nonsense(value: object, what: str) -> DataMissingError:
    text = shown(value) if isinstance(value, str) else type(value).__name__ if value else str(value)
    message = f"the record makes no sense: {what}: {text}"
    hint = "see whether --base-url leads to Zenodo, or download the files in a browser and use --from-dir DIR"
    return DataMissingError(message, hint=hint)
