"""Encodings of text files, from instruments and from Chinese and European office programs."""

from __future__ import annotations

import re
from collections.abc import Mapping

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
# What remains once Unicode and Chinese are ruled out.
_OTHERS = [_LATIN, "cp1250", "cp1251", "big5", "shift_jis", "euc_kr", "gb18030"]
_COMMON_CHINESE = 0.6
_LATIN_SIGNS = set(map(chr, range(128))) | set("°·µ²³±äöüÄÖÜßàâçèéêëîïñòóôùûÅåæøØ")


def decoded(raw: bytes) -> tuple[str, str]:
    """Text of bytes and the encoding it was in.

    Parameters
    ----------
    raw : bytes
        Everything in the file.

    Returns
    -------
    text : str
        Without a byte order mark. Bytes that do not fit are replaced, never refused: numbers are ASCII in
        every encoding tried, so at worst a name is spoilt.
    encoding : str
        Python's name of the encoding.
    """
    encoding = _encoding(raw)
    text = raw.decode(encoding, "replace")
    return text.removeprefix("\ufeff"), encoding


def _encoding(raw: bytes) -> str:
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return encoding
    plain = unmarked_utf16(raw) or ("utf-8" if _fits(raw, "utf-8") else None)
    if plain:
        return plain
    foreign = _lines_beyond_ascii(raw)
    if _is_latin(foreign):
        return _LATIN
    return "gb18030" if _is_chinese(foreign) else _best_guess(foreign)


def unmarked_utf16(raw: bytes) -> str | None:
    """Name of the UTF-16 without a mark that bytes are in, by the zeros in every other one; None for none."""
    head = raw[:1024]
    even, odd = head[0::2], head[1::2]
    for high, low, encoding in ((odd, even, "utf-16-le"), (even, odd, "utf-16-be")):
        if 2 * high.count(0) > len(high) > 1 and 0 not in low:
            return encoding
    return None


def _fits(raw: bytes, encoding: str) -> bool:
    try:
        raw.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _lines_beyond_ascii(raw: bytes) -> bytes:
    """The lines that tell encodings apart; the guess then takes the same time for any size of file."""
    lines = [line for line in raw[: 64 * _SAMPLE].splitlines() if not line.isascii()]
    return b"\n".join(lines)[:_SAMPLE]


def _is_latin(raw: bytes) -> bool:
    """Whether single accented letters and signs stand amid ASCII; Chinese characters take two bytes."""
    return re.search(rb"[\x80-\xff]{2}", raw) is None and set(raw.decode("latin-1")) <= _LATIN_SIGNS


def _is_chinese(raw: bytes) -> bool:
    """Whether it decodes as Chinese and its characters are common ones.

    Accented Latin letters decode as Chinese too, but into rare characters.
    """
    try:
        text = raw.decode("gb18030")
    except UnicodeDecodeError:
        return False
    foreign = [character.encode("gb18030") for character in text if not character.isascii()]
    # First-level characters and symbols such as the degree sign, each of two high bytes.
    common = sum(
        len(code) == 2 and code[1] >= 0xA1 and (0xA1 <= code[0] <= 0xA9 or 0xB0 <= code[0] <= 0xD7)
        for code in foreign
    )
    return bool(foreign) and common >= _COMMON_CHINESE * len(foreign)


def _best_guess(raw: bytes) -> str:
    from charset_normalizer import from_bytes

    best = from_bytes(raw, cp_isolation=_OTHERS).best()
    return best.encoding if best else _LATIN
