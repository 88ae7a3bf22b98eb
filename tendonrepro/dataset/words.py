"""What names of columns, sheets and files say, by ``words.yaml``; what is unknown or ambiguous is asked."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tendonrepro.configuration.strict_yaml import Tree, load, read_text

_FILE = Path(__file__).with_name("words.yaml")
_TABLE: Tree = load(read_text(_FILE), str(_FILE))
_GROUPS = {word: group for group, words in _TABLE["words"].items() for word in words}
"""Group of each word."""
_CUTS = re.compile(f"({'|'.join(sorted(_GROUPS, key=len, reverse=True))})")
FACTORS: Mapping[str, Mapping[str, float]] = {
    kind: {unit: words[0] for unit, words in units.items()} for kind, units in _TABLE["units"].items()
}
"""SI value of one of each unit, by kind of quantity."""
_WRITTEN = {
    word: unit for units in _TABLE["units"].values() for unit, words in units.items() for word in words[1:]
}
"""Unit by how people write it."""
KINDS = frozenset({"time", "rate", "torque", "surface", "estimate"})
ROLES = frozenset({"desired", "measured", "calculated", "error"})
_COUNTED = KINDS | ROLES | {"angle", "joint", "motor"}
"""Groups behind which a number is that of a joint."""
_OTHER = "other"
"""Group of the words, and of the units, of quantities that are not guessed."""
_SYMBOLS = {"d", "e", "m"}
"""Letters that mean something only as an index of a symbol, or with a unit."""
_MASS = re.compile(r"(\d+(?:[.,p]\d+)?)\s*_?(kg|g)(?![a-zA-Z])")
_UNITS = (
    re.compile(r"[(\[（【]\s*([^()\[\]（）【】]+?)\s*[)\]）】]\s*$"),
    re.compile(r"[\s_/]\s*([^\s_/()]+/[^\s/()]+)$"),
    re.compile(r"\s*/\s*([^\s/()]+)\s*$"),
    re.compile(r"[\s_]([^\s_\d]+)$"),
)
"""Units behind a name: in brackets, one of two units, behind a stroke, or as the last word."""
_WORD = re.compile(r"[^\W\d_]+|\d+|[^\w\s]")
_MARKS = frozenset("-–—_/()[]（）【】.,:;#&'\"|")


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    `says` are groups of ``words.yaml``; `unit` is a key of `FACTORS`, or as written one that no variable has.
    `payload` is in kg, NaN if of unknown mass. `unknown` are words that are not there or do not go together.
    """

    says: frozenset[str]
    joint: int | None
    unit: str | None
    controller: int | None
    payload: float | None
    unknown: tuple[str, ...]


def plain_unit(text: str) -> str | None:
    """Key of `FACTORS` for a unit as people write it, or None.

    >>> plain_unit("Degrees")
    'deg'
    """
    return _WRITTEN.get(_plain(text).casefold().strip(" ()[]"))


def is_other_unit(text: str) -> bool:
    """Whether a text is a unit of quantities that no variable holds, or made of two units.

    >>> is_other_unit("m/s"), is_other_unit("rad/s"), is_other_unit("V")
    (True, False, True)
    """
    wanted = _plain(text).casefold().strip(" ()[]")
    if plain_unit(wanted):
        return False
    others: list[str] = _TABLE["other_units"]
    above, stroke, below = wanted.partition("/")
    if not stroke:
        return wanted in others
    simple = above.strip(), re.sub(r"-?[1-9]$", "", below.strip())
    return all(plain_unit(part) or part in ("1", *others) for part in simple)


def is_known(word: str) -> bool:
    """Whether ``words.yaml`` has a word."""
    return word.casefold() in _GROUPS


@cache
def meaning_of(name: str, *, around: bool = False) -> Meaning:
    """Read a name of a column, or of a table, file or folder `around` it.

    There a letter means an index only beside the symbol of an angle, or with a unit: ``mat_3d`` is no desired
    angle.

    >>> meaning_of("q2_d (deg)").joint
    2
    """
    text, unit = _without_unit(_plain(name), around=around)
    text, payload = _without_mass(text)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", text).casefold()
    for pattern, words in _TABLE["phrases"].items():
        text = re.sub(pattern, words, text)
    words = list(_words(text))
    says = {_GROUPS[word] for word in words if word in _GROUPS}
    if around and unit is None and "angle" not in says:
        words = [word for word in words if word not in _SYMBOLS]
        says = {_GROUPS[word] for word in words if word in _GROUPS}
    if unit and plain_unit(unit) is None:
        says.add(_OTHER)
    unknown = [word for word in words if word not in _GROUPS and not word.isdigit()]
    joints, controllers, others = _numbers(words)
    named = _controller_of(says)
    controllers |= {named} if named else set()
    if len(joints) > 1 or len(controllers) > 1:
        others.append("more than one number")
    if re.search(r"\d\)?\s*[-–+*]\s*\(?[a-z]\w*\d", text) and not controllers:
        others.append("a sum or difference")
    if "load" in says:
        payload = float("nan") if payload is None else payload
        is_of_run = controllers or not math.isnan(payload)
        others += ["load"] if says & (_COUNTED - {"joint"}) and not is_of_run else []
    if controllers and "decouple" in says:
        # The title of the paper has both.
        controllers, says = set(), says - {"decouple"}
    return Meaning(
        says=frozenset(says),
        joint=min(joints, default=None),
        unit=unit,
        controller=min(controllers, default=None),
        payload=0.0 if "unloaded" in says else payload,
        unknown=(*unknown, *others),
    )


def _plain(text: str) -> str:
    """Letters that look alike in one form, without marks of LaTeX; an ordinal or ring is a degree."""
    return unicodedata.normalize("NFKC", re.sub(r"[\\{}$^]", "", text).replace("º", "°").replace("˚", "°"))


def _without_unit(name: str, *, around: bool) -> tuple[str, str | None]:
    for pattern in _UNITS:
        match = pattern.search(name)
        if not match or not name[: match.start()].strip():
            continue
        unit, rest = plain_unit(match[1]), name[: match.start()]
        is_last_word = pattern is _UNITS[-1]
        # A trailing s may be the sliding variable, and another letter a run, or an index.
        is_sliding = is_last_word and unit == "s"
        is_sliding = is_sliding and "time" not in map(_GROUPS.get, _words(rest.casefold()))
        is_letter = is_last_word and len(match[1]) == 1 and (around or match[1].islower())
        if unit and not is_sliding:
            return rest, unit
        if unit is None and is_other_unit(match[1]) and not is_letter:
            return rest, match[1]
    return name, None


def _without_mass(text: str) -> tuple[str, float | None]:
    match = _MASS.search(text)
    if not match:
        return text, None
    mass = float(re.sub("[,p]", ".", match[1])) * (1.0 if match[2] == "kg" else 1e-3)
    return f"{text[: match.start()]} {text[match.end() :]}", mass


def _words(text: str) -> Iterator[str]:
    """Words and numbers; unknown words are cut into known ones."""
    for token in _WORD.findall(text):
        if token in _GROUPS or token.isdigit():
            yield token
        elif token not in _MARKS:
            yield from _cut(token)


def _cut(token: str) -> list[str]:
    """Longest known words from the left; of Latin letters only if nothing else is left."""
    pieces = [piece for piece in _CUTS.split(token) if piece]
    is_cut = all(piece in _GROUPS and (len(piece) > 1 or piece in "qedm") for piece in pieces)
    is_chinese = re.search(r"[\u4e00-\u9fff]", token)
    return pieces if is_chinese or (is_cut and max(map(len, pieces)) > 1) else [token]


def _numbers(words: list[str]) -> tuple[set[int], set[int], list[str]]:
    """Joints, controllers, and numbers that are neither."""
    joints, controllers, others = set(), set(), []
    groups = ["", *(None if word.isdigit() else _GROUPS.get(word, "unknown") for word in words), ""]
    for word, before, after in zip(words, groups, groups[2:], strict=False):
        if not word.isdigit():
            continue
        if before == "controller":
            controllers.add(int(word))
        elif before in _COUNTED or (not before and after in _COUNTED):
            joints.add(int(word))
        elif before not in ("", None, "silent", _OTHER):
            others.append(word)
    return joints, controllers, others


def _controller_of(says: set[str]) -> int | None:
    if "ntsm" in says or says >= {"alpha", "tde"}:
        return 1 if "alpha" in says else 2
    return 3 if "tsm" in says else 1 if "alpha" in says else None


def variable_of(says: frozenset[str]) -> str | None:
    """Variable of a trace that a name means; None where its words do not say or go together.

    >>> variable_of(frozenset({"angle", "desired"}))
    'q_d'
    """
    told = says & (_COUNTED | {_OTHER})
    # A joint may be named beside anything.
    told = told - {"joint"} or told
    rows = ((variable, {*needed}, {*beside}) for variable, needed, beside in _TABLE["variables"])
    return next((variable for variable, needed, beside in rows if needed <= told <= needed | beside), None)
