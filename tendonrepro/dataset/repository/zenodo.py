"""A Zenodo record: what its JSON says, whichever of the shapes it has, and how a user may name it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, urlsplit

from tendonrepro.dataset.repository.names import shown
from tendonrepro.errors import DataMissingError, UsageError

SITE = "https://zenodo.org"
DOI = "10.5281/zenodo."
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
    """Read how a user names a record.

    Parameters
    ----------
    text : str
        Number, DOI with or without its address, or address of the record.
    site : str
        Where records are looked up; an address must lead there or to zenodo.org.

    Returns
    -------
    str
        The number.

    Raises
    ------
    UsageError
        If it is none of these.

    Examples
    --------
    >>> record_number("https://doi.org/10.5281/zenodo.19467931")
    '19467931'
    """
    name = text.strip()
    number = re.fullmatch(
        r"(?:(?:doi:|https?://(?:dx\.)?doi\.org/)?10\.5281/zenodo\.)?([0-9]{1,12})", name, re.I
    )
    if number:
        return str(int(number[1]))
    try:
        parts = urlsplit(name)
        there = parts.netloc.lower() in {"zenodo.org", "www.zenodo.org", urlsplit(site).netloc.lower()}
    except ValueError:
        there = False
    page = re.match(r"/(?:api/)?records?/([0-9]{1,12})(?:/|$)", parts.path) if there else None
    if page is None:
        message = f"{shown(text)} is not a record of {site}"
        hint = "give its number, as in 19467931, its DOI, as in 10.5281/zenodo.19467931, or its address"
        raise UsageError(message, hint=f"{hint}; another site needs --base-url")
    return str(int(page[1]))


def parse_record(data: object, site: str) -> Record:
    """Read the JSON of a record.

    Parameters
    ----------
    data : object
        As parsed from Zenodo's own shape, that of late 2023, or that of InvenioRDM.
    site : str
        Address of the site, for files that come without one.

    Returns
    -------
    Record

    Raises
    ------
    DataMissingError
        If it is not the JSON of a record.
    """
    tree = _dict(data, "the record")
    meta, pids, parent = (_dict(tree.get(key, {}), key) for key in ("metadata", "pids", "parent"))
    number = _number(tree.get("recid", tree.get("id")), "number")
    concept = tree.get("conceptrecid", parent.get("id"))
    access, embargo = _access(tree, meta)
    return Record(
        record_id=number,
        concept_id=None if concept is None else _number(concept, "concept number"),
        doi=_text(tree.get("doi") or meta.get("doi") or _doi_of(pids), "doi"),
        concept_doi=_text(
            tree.get("conceptdoi") or _doi_of(_dict(parent.get("pids", {}), "parent.pids")), "concept doi"
        ),
        title=_text(meta.get("title") or tree.get("title"), "title"),
        version=_text(meta.get("version"), "version"),
        licence=_licence(meta),
        access=access,
        embargo_date=embargo,
        is_latest=_latest(tree, meta),
        files=parse_files(tree.get("files"), number, site),
    )


def parse_files(data: object, number: str, site: str) -> tuple[RemoteFile, ...]:
    """Read a list of files: of a record, or the answer about a record's files.

    Parameters
    ----------
    data : object
        A list, or a mapping whose ``entries`` are a list or a mapping by key; nothing at all is no file.
    number : str
        Of the record.
    site : str

    Returns
    -------
    tuple of RemoteFile

    Raises
    ------
    DataMissingError
        If it is anything else, or a key comes twice.
    """
    if isinstance(data, dict):
        data = data.get("entries")
    if isinstance(data, dict):
        data = [{"key": key, **_dict(entry, "a file")} for key, entry in data.items()]
    if data is None:
        return ()
    if not isinstance(data, list):
        raise _nonsense(data, "files")
    files = tuple(_file(_dict(entry, "a file"), number, site) for entry in data)
    keys = [file.key for file in files]
    if len(set(keys)) < len(keys):
        raise _nonsense(max(keys, key=keys.count), "a file named twice")
    return files


def _file(entry: dict[str, Any], number: str, site: str) -> RemoteFile:
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
    given = list(_content_urls(_dict(entry.get("links", {}), f"links of {shown(key)}")))
    return RemoteFile(key, size, _md5(entry.get("checksum"), key), ((given or [built])[0], page))


def _content_urls(links: dict[str, Any]) -> Iterator[str]:
    """Addresses of the bytes; ``self`` may also be that of the description."""
    for key in ("content", "self", "download"):
        url = links.get(key)
        ends = ("/content",) if key == "self" else ("",)
        if isinstance(url, str) and re.match(r"https?://[!-~]+$", url) and url.endswith(ends):
            yield url


def _md5(checksum: object, key: str) -> str | None:
    if checksum is None:
        return None
    if isinstance(checksum, str):
        if match := re.fullmatch(r"(?:md5:)?([0-9a-f]{32})", checksum, re.I):
            return match[1].lower()
        if re.match(r"(?!md5:)[a-z0-9-]+:", checksum, re.I):
            return None
    raise _nonsense(checksum, f"checksum of {shown(key)}")


def _access(tree: dict[str, Any], meta: dict[str, Any]) -> tuple[str, str | None]:
    if isinstance(rights := tree.get("access"), dict):
        embargo = _dict(rights.get("embargo", {}), "embargo")
        word = rights.get("status") or {"public": "open"}.get(str(rights.get("files")), rights.get("files"))
        return _text(word, "access") or "open", _text(embargo.get("until"), "end of the embargo")
    return (
        _text(meta.get("access_right"), "access right") or "open",
        _text(meta.get("embargo_date"), "embargo date"),
    )


def _licence(meta: dict[str, Any]) -> str | None:
    found = meta.get("license", meta.get("rights"))
    entries = found if isinstance(found, list) else [found]
    names = [entry.get("id") or entry.get("title") if isinstance(entry, dict) else entry for entry in entries]
    # InvenioRDM gives titles by language.
    texts = [next(iter(name.values()), None) if isinstance(name, dict) else name for name in names]
    return ", ".join(filter(None, (_text(text, "licence") for text in texts))) or None


def _latest(tree: dict[str, Any], meta: dict[str, Any]) -> bool | None:
    versions = tree.get("versions")
    relations = meta.get("relations")
    listed = relations.get("version") if isinstance(relations, dict) else None
    if isinstance(listed, list) and listed and isinstance(listed[0], dict):
        found = listed[0].get("is_last")
    else:
        found = versions.get("is_latest") if isinstance(versions, dict) else None
    return found if isinstance(found, bool) else None


def _doi_of(pids: dict[str, Any]) -> object:
    return _dict(pids.get("doi", {}), "doi").get("identifier")


def _number(value: object, what: str) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if not isinstance(text, str) or not re.fullmatch(r"[0-9]{1,12}", text):
        raise _nonsense(value, what)
    return text


def _dict(value: object, what: str) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise _nonsense(value, what)
    return value


def _text(value: object, what: str) -> str | None:
    """One line of printable text, so that a record cannot move the user's terminal about."""
    if value is None:
        return None
    if not isinstance(value, str):
        raise _nonsense(value, what)
    return plain(value) or None


def plain(text: str) -> str:
    """Printable letters only, on one line of at most 300."""
    return "".join(letter for letter in " ".join(text.split()) if letter.isprintable())[:300]


def _nonsense(value: object, what: str) -> DataMissingError:
    message = f"the record makes no sense: {what}: {shown(str(value))}"
    hint = "see whether --base-url leads to Zenodo, or download the files in a browser and use --from-dir DIR"
    return DataMissingError(message, hint=hint)
