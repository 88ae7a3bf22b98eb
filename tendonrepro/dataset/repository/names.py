"""Names that came from elsewhere, turned into paths that stay below a folder on every system."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import PurePosixPath
from typing import Any

LONGEST = 200
"""Most bytes of one part of a path: file systems take 255, and working files get a longer name."""
LONGEST_NAME, MOST_PARTS, MOST_FILES = 1000, 50, 10_000
"""Most letters of a whole name, most parts between its slashes, and most files of a record."""

RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
PART, LABEL, LOCK = ".part", ".part.json", ".lock"
"""Our own working files: the bytes of a download so far and whose they are, and the lock of a folder."""
UNSEEN = {"Cc": "a control character", "Cf": "an invisible character", "Cs": "half a character"}
UNSEEN |= {"Zl": "a line separator", "Zp": "a paragraph separator"}


def safe_relative(name: str) -> PurePosixPath:
    """Turn a foreign name into a path below a folder; the reason against it is a ValueError.

    >>> safe_relative("run 1/joint2.mat")
    PurePosixPath('run 1/joint2.mat')
    >>> safe_relative("../joint2.mat")
    Traceback (most recent call last):
    ...
    ValueError: leads out of the folder by '..'
    """
    reasons = chain(_about_name(name), chain.from_iterable(map(_about_part, name.split("/", MOST_PARTS))))
    for against, reason in reasons:
        if against:
            raise ValueError(reason)
    return PurePosixPath(name)


def _about_name(name: str) -> Iterator[tuple[object, str]]:
    """Whether something speaks against the whole name, and what."""
    yield len(name) > LONGEST_NAME, f"is longer than {LONGEST_NAME} letters"
    yield not name, "is empty"
    unseen = next((kind for kind in map(unicodedata.category, name) if kind in UNSEEN), None)
    yield unseen, f"contains {UNSEEN.get(unseen or '')}"
    yield "\\" in name, "contains a backslash, which some systems take for a folder"
    yield name.startswith("/"), "is an absolute path"
    yield re.match(r"[A-Za-z]:", name), "starts with a drive letter"
    yield name.count("/") >= MOST_PARTS, f"has more than {MOST_PARTS} parts between its slashes"


def _about_part(part: str) -> Iterator[tuple[object, str]]:
    """The same of what stands between two slashes."""
    yield part == "..", "leads out of the folder by '..'"
    yield part in {"", "."}, "has an empty part between its slashes"
    dropped = part != part.strip(" ") or part != part.rstrip(".")
    yield dropped, "begins or ends with a space, or ends with a dot, which some systems drop"
    yield RESERVED.fullmatch(part), "is a name Windows keeps for a device"
    yield is_ours(part), "is a name tendonrepro keeps for its own working files"
    yield len(part.encode()) > LONGEST, f"is longer than {LONGEST} bytes"
    forbidden = sorted(set(part) & set('<>:"|?*')) if os.name == "nt" else []
    yield forbidden, f"contains {''.join(forbidden)}, which Windows does not allow"


def safe_paths(names: Iterable[str]) -> dict[str, PurePosixPath]:
    """Turn names into paths that do not meet, even where upper and lower case are the same.

    A ValueError names the one that is not safe, or the two that would be one file, or file and folder.
    """
    paths: dict[str, PurePosixPath] = {}
    top: dict[str, Any] = {}  # by folded part: the name of a file, or such a tree again
    for name in names:
        if len(paths) == MOST_FILES:
            raise ValueError(f"there are more than {MOST_FILES} files")
        try:
            paths[name] = safe_relative(name)
        except ValueError as error:
            raise ValueError(f"{shown(name)} {error}") from error
        tree, (*folders, file) = top, map(_folded, name.split("/"))
        for folder in folders:
            tree = tree.setdefault(folder, {})
            if isinstance(tree, str):
                raise _meeting(name, tree)
        if file in tree:
            raise _meeting(name, tree[file])
        tree[file] = name
    return paths


def _folded(part: str) -> str:
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", part).casefold())


def _meeting(name: str, rival: Any) -> ValueError:
    while not isinstance(rival, str):
        rival = next(iter(rival.values()))
    return ValueError(f"{shown(name)} and {shown(rival)} would be the same file on some systems")


def is_ours(name: str) -> bool:
    """Whether a file, named without its folders, is one of our own working files."""
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
    head = name[:100]
    text = ascii(head) if any(unicodedata.category(letter) in UNSEEN for letter in head) else repr(head)
    return text if head == name and len(text) <= 100 else f"{text[:97]}..."
