"""Names that came from elsewhere, turned into paths that stay below a folder on every system."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable
from pathlib import PurePosixPath

LONGEST = 200
"""Most bytes of one part of a path: file systems take 255, and working files get a longer name."""

RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
PART, LABEL, LOCK = ".part", ".part.json", ".lock"
"""Our own working files: the bytes of a download so far and whose they are, and the lock of a folder."""
UNSEEN = {"Cc": "a control character", "Cf": "an invisible character", "Cs": "half a character"}
UNSEEN |= {"Zl": "a line separator", "Zp": "a paragraph separator"}


def safe_relative(name: str) -> PurePosixPath:
    """Turn a foreign name into a path below a folder; a slash makes a sub-folder.

    Parameters
    ----------
    name : str
        Key of a file in a record, or member of an archive.

    Returns
    -------
    PurePosixPath
        Relative, without ``..``.

    Raises
    ------
    ValueError
        If the name would leave the folder, cannot exist on some system, or is one of our own working files;
        the message is the reason.

    Examples
    --------
    >>> safe_relative("run 1/joint2.mat")
    PurePosixPath('run 1/joint2.mat')
    >>> safe_relative("../joint2.mat")
    Traceback (most recent call last):
    ...
    ValueError: leads out of the folder by '..'
    """
    reason = _why_not(name)
    if reason is None:
        parts = name.split("/")
        reason = next((found for part in parts if (found := _why_not_part(part))), None)
    if reason is not None:
        raise ValueError(reason)
    return PurePosixPath(name)


def safe_paths(names: Iterable[str]) -> dict[str, PurePosixPath]:
    """Turn names into paths that do not meet, even where upper and lower case are the same.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    dict of PurePosixPath
        By name, in the order given.

    Raises
    ------
    ValueError
        If a name is not safe, or two of them would be the same file, or one the folder of another; the
        message starts with the name.
    """
    paths: dict[str, PurePosixPath] = {}
    files: dict[str, str] = {}
    folders: dict[str, str] = {}
    for name in names:
        try:
            path = safe_relative(name)
        except ValueError as error:
            message = f"{shown(name)} {error}"
            raise ValueError(message) from error
        mine = _folded(path)
        above = [_folded(parent) for parent in path.parents]
        rivals = [folders.get(mine), *(files.get(place) for place in (mine, *above))]
        rival = next((found for found in rivals if found is not None), None)
        if rival is not None:
            message = f"{shown(name)} and {shown(rival)} would be the same file on some systems"
            raise ValueError(message)
        paths[name] = path
        files[mine] = name
        folders |= dict.fromkeys(above, name)
    return paths


def is_ours(name: str) -> bool:
    """Whether a file is one of our own working files.

    Parameters
    ----------
    name : str
        Without its folders.
    """
    # Some systems take upper and lower case for the same.
    folded = name.lower()
    return folded == LOCK or folded.endswith((PART, LABEL))


def printable(name: str) -> str:
    """A name on disk, which need not be text, with a mark in the place of what is none."""
    return os.fsencode(name).decode(errors="replace")


class Numbered:
    """Names in use; one that comes again gets a number: ``q``, ``q (2)``, ``q (3)``."""

    def __init__(self) -> None:
        self._used: set[str] = set()
        self._next: dict[str, int] = {}

    def unused(self, name: str) -> str:
        """The name, or the first one with a number that is not in use."""
        # Thousands may have one name, so the search goes on where it ended.
        number = self._next.get(name, 1)
        while (unused := name if number == 1 else f"{name} ({number})") in self._used:
            number += 1
        self._next[name] = number
        return unused

    def take(self, name: str) -> str:
        """As `unused`; the answer is in use from now on."""
        taken = self.unused(name)
        self._used.add(taken)
        return taken


def shown(name: str) -> str:
    """Quote a foreign name for a message: nothing invisible, not too long."""
    text = ascii(name) if any(unicodedata.category(letter) in UNSEEN for letter in name) else repr(name)
    return text if len(text) <= 100 else f"{text[:97]}..."


def _folded(path: PurePosixPath) -> str:
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", str(path)).casefold())


def _why_not(name: str) -> str | None:
    """Reason against the whole name."""
    if not name:
        return "is empty"
    for letter in name:
        if (kind := unicodedata.category(letter)) in UNSEEN:
            return f"contains {UNSEEN[kind]}"
    if "\\" in name:
        return "contains a backslash, which some systems take for a folder"
    if name.startswith("/"):
        return "is an absolute path"
    if re.match(r"[A-Za-z]:", name):
        return "starts with a drive letter"
    return None


def _why_not_part(part: str) -> str | None:
    """Reason against what stands between two slashes."""
    forbidden = sorted(set(part) & set('<>:"|?*')) if os.name == "nt" else []
    dropped = part != part.strip(" ") or part != part.rstrip(".")
    reasons = (
        (part == "..", "leads out of the folder by '..'"),
        (part in {"", "."}, "has an empty part between its slashes"),
        (dropped, "begins or ends with a space, or ends with a dot, which some systems drop"),
        (RESERVED.fullmatch(part), "is a name Windows keeps for a device"),
        (is_ours(part), "is a name tendonrepro keeps for its own working files"),
        (len(part.encode()) > LONGEST, f"is longer than {LONGEST} bytes"),
        (forbidden, f"contains {''.join(forbidden)}, which Windows does not allow"),
    )
    return next((reason for holds, reason in reasons if holds), None)
