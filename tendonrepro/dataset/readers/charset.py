"""Encodings of text files: Unicode, Chinese, or that of Western Windows."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress

BYTE_ORDER_MARKS: Mapping[bytes, str] = {
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe\x00\x00": "utf-32",
    b"\x00\x00\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
"""First bytes of a text -> its encoding; the longer of two marks that begin alike comes first."""
_SAMPLE = 65536
_LATIN = "cp1252"
# First-level characters, and symbols such as the degree sign.
_COMMON_CHINESE = re.compile(rb"[\xa1-\xa9\xb0-\xd7][\xa1-\xff]")
_MOST_COMMON = 0.6


def decoded(raw: bytes) -> tuple[str, str]:
    """Decode everything in a file; returns the text without a byte order mark, and its encoding.

    Bytes that do not fit are replaced, never refused: numbers are ASCII in every encoding, so at worst a name
    is spoilt.
    """
    encoding = _encoding(raw)
    return raw.decode(encoding, "replace").removeprefix("\ufeff"), encoding


def _encoding(raw: bytes) -> str:
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return encoding
    with suppress(UnicodeDecodeError):
        raw.decode("utf-8")
        return "utf-8"
    # The lines that tell encodings apart; the guess then takes the same time for any size of file.
    foreign = b"\n".join(line for line in raw[: 64 * _SAMPLE].splitlines() if not line.isascii())[:_SAMPLE]
    return "gb18030" if _is_chinese(foreign) else _LATIN


def _is_chinese(raw: bytes) -> bool:
    """Whether bytes decode to common Chinese characters; accented letters decode too, but to rare ones."""
    try:
        text = raw.decode("gb18030")
    except UnicodeDecodeError:
        return False
    foreign = [character.encode("gb18030") for character in text if not character.isascii()]
    common = sum(_COMMON_CHINESE.fullmatch(code) is not None for code in foreign)
    return bool(foreign) and common >= _MOST_COMMON * len(foreign)
