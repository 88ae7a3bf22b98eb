"""What the name of a column, sheet or file says: quantity, joint, unit, controller, payload.

A name is read word by word from ``words.yaml``. Nothing is inferred from what stands beside it. A word that
is not in the table, and words that change their meaning together, are handed on as `Meaning.unknown`: a
reader is asked about them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from tendonrepro.configuration.fields.strict_yaml import load, read_text

FACTORS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "angle": {"rad": 1.0, "deg": 0.017453292519943295, "mrad": 1e-3, "rev": 6.283185307179586},
    "rate": {"rad/s": 1.0, "deg/s": 0.017453292519943295},
    "torque": {"N m": 1.0, "mN m": 1e-3},
}
"""SI value of one of each unit, by kind of quantity."""

ROLES = frozenset({"desired", "measured", "calculated", "error"})
_QUANTITIES = ROLES | {"time", "angle", "rate", "torque", "surface", "estimate", "joint", "motor"}
_GREEK = {"α": " alpha ", "θ": " theta ", "τ": " tau ", "σ": " sigma ", "ĥ": " hhat ", "Ĥ": " hhat "}
_MASS = re.compile(r"(\d+(?:[.,p]\d+)?)\s*_?(kg|g)(?![a-zA-Z])")
_UNIT = re.compile(
    r"[(\[（【]\s*([^()\[\]（）【】]+?)\s*[)\]）】]\s*$|\s*/\s*([^\s/]+)\s*$|[\s_]([^\s_\d]+)$"
)
_WORD = re.compile(r"[^\W\d_]+|\d+|[^\w\s]")
_MARKS = frozenset("-–—_/()[]（）【】.,:;#&'\"|")


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    Attributes
    ----------
    says : frozenset of str
        Groups of ``words.yaml`` it has a word of.
    joint, controller : int or None
        Numbers.
    unit : str or None
        A key of `FACTORS`.
    payload : float or None
        kg; 0 without, NaN with one of unknown mass.
    unknown : tuple of str
        Words that nobody knows, and words that do not go together.
    """

    says: frozenset[str] = frozenset()
    joint: int | None = None
    unit: str | None = None
    controller: int | None = None
    payload: float | None = None
    unknown: tuple[str, ...] = ()


@cache
def _table() -> dict[str, Any]:
    path = Path(__file__).with_name("words.yaml")
    return dict(load(read_text(path), str(path)).tree)  # type: ignore[arg-type]


@cache
def _groups() -> dict[str, str]:
    """Group of every word."""
    return {
        word: group for group, words in _table().items() if group not in {"units", "short"} for word in words
    }


def plain_unit(text: str) -> str | None:
    """Key of `FACTORS` for a unit as people write it; None for others.

    >>> plain_unit("Degrees")
    'deg'
    """
    wanted = unicodedata.normalize("NFKC", text).replace("μ", "µ").casefold().strip(" ()[]")
    units: dict[str, list[str]] = _table()["units"]
    return next((unit for unit, words in units.items() if wanted in map(_folded, words)), None)


def _folded(word: str) -> str:
    return unicodedata.normalize("NFKC", word).replace("μ", "µ").casefold()


@cache
def meaning_of(name: str) -> Meaning:
    """Read a name.

    >>> meaning_of("q2_d (deg)").joint
    2
    """
    text = unicodedata.normalize("NFC", name)
    for letter, word in _GREEK.items():
        text = text.replace(letter, word)
    text, unit = _without_unit(unicodedata.normalize("NFKC", text))
    text, payload = _without_mass(text)
    text = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", text)
    text = re.sub(r"\bh_?hat(?=_|\d|\b)", "hhat", text.casefold()).replace("w/o", "without")
    meaning = _Reader(list(_words(text))).meaning(unit, payload)
    if re.search(r"\d\)?\s*[-–−+*]\s*\(?[a-z]\w*\d", text) and meaning.controller is None:
        return replace(meaning, unknown=(*meaning.unknown, "a sum or difference"))
    return meaning


def _without_unit(name: str) -> tuple[str, str | None]:
    found = _UNIT.search(name)
    if found:
        unit = plain_unit(next(filter(None, found.groups())))
        rest = name[: found.start()]
        alone = bool(found[3])
        # A trailing s may be the sliding variable.
        if unit and rest.strip() and not (alone and unit == "s" and not _says_time(rest)):
            return rest, unit
    return name, None


def _says_time(text: str) -> bool:
    return any(_groups().get(word) == "time" for word in _words(text.casefold()))


def _without_mass(text: str) -> tuple[str, float | None]:
    found = _MASS.search(text)
    if not found:
        return text, None
    mass = float(re.sub("[,p]", ".", found[1])) * (1.0 if found[2] == "kg" else 1e-3)
    return f"{text[: found.start()]} {text[found.end() :]}", mass


def _words(text: str) -> Iterator[str]:
    """Words of a name; what the table does not hold is cut into two words that it does hold."""
    short: dict[str, str] = _table()["short"]
    for token in _WORD.findall(text):
        if token in _groups() or token.isdigit():
            yield token
        elif token in short:
            yield from short[token].split()
        elif token not in _MARKS:
            yield from _cut(token)


def _cut(token: str) -> list[str]:
    """Pieces of a token that are all known, at least one of two letters or more; else the token."""
    groups = _groups()
    if re.search(r"[\u4e00-\u9fff]", token):
        return _cut_chinese(token)
    for place in range(1, len(token)):
        first, second = token[:place], token[place:]
        single = {first, second} & {"q", "e", "d", "m"}
        if (
            first in groups
            and second in groups
            and (len(token) > 2)
            and (min(place, len(second)) > 1 or single)
        ):
            return [first, second]
    return [token]


def _cut_chinese(token: str) -> list[str]:
    """Longest known words from the left; what is between them stays as it is."""
    pieces, rest = [""], token
    while rest:
        length = next((n for n in range(len(rest), 0, -1) if rest[:n] in _groups()), 0)
        pieces += [rest[:length], ""] if length else []
        pieces[-1] += "" if length else rest[0]
        rest = rest[length or 1 :]
    return [piece for piece in pieces if piece]


class _Reader:
    """Words of one name on their way to a meaning."""

    def __init__(self, words: list[str]) -> None:
        self.words = words
        self.says: set[str] = set()
        self.joints: list[int] = []
        self.controllers: list[int] = []
        self.unknown: list[str] = []
        self.unloaded = False

    def meaning(self, unit: str | None, payload: float | None) -> Meaning:
        for place, word in enumerate(self.words):
            before = self.words[place - 1] if place else ""
            after = self.words[place + 1] if place + 1 < len(self.words) else ""
            if word.isdigit():
                self._number(int(word), before, after)
            else:
                self._word(word, before, after)
        self._controller()
        self._load()
        if len(set(self.joints)) > 1:
            self.unknown.append(" or ".join(map(str, dict.fromkeys(self.joints))))
        if "load" in self.says:
            payload = float("nan") if payload is None else payload
        return Meaning(
            says=frozenset(self.says),
            joint=self.joints[0] if self.joints else None,
            unit=unit,
            controller=self.controllers[0] if self.controllers else None,
            payload=0.0 if self.unloaded else payload,
            unknown=tuple(self.unknown),
        )

    def _word(self, word: str, before: str, after: str) -> None:
        group = _groups().get(word)
        # Letters that say something only with a number, or beside a word that they belong to.
        lonely = (word == "c" and not after.isdigit()) or (
            word == "s" and len(self.words) > 1 and not after.isdigit()
        )
        if group is None or lonely:
            self.unknown.append(word)
        elif (word == "a" and not {"tde", "ntsm"} & set(self.words)) or (word == "m" and before == "tau"):
            return
        elif group == "load" and _groups().get(before) == "without":
            self.says.discard("load")
            self.unloaded = True
        elif group == "unloaded":
            self.unloaded = True
        elif group == "alpha" and _groups().get(before) == "without":
            self.says.add("ntsm")
        elif group == "without":
            if _groups().get(after) not in {"load", "alpha"}:
                self.unknown.append(word)
        else:
            self.says.add(group)

    def _number(self, number: int, before: str, after: str) -> None:
        group = _groups().get(before)
        if group == "controller":
            self.controllers.append(number)
        elif group == "load":
            self.unloaded = number == 0
            self.says.discard("load")
            if number:
                self.unknown.append(f"{before} {number}")
        elif group in _QUANTITIES or (not before and _groups().get(after) in _QUANTITIES):
            self.joints.append(number)
        elif group != "silent" and before and not before.isdigit():
            self.unknown.append(str(number))

    def _controller(self) -> None:
        named = None
        if "ntsm" in self.says or self.says >= {"alpha", "tde"}:
            named = 1 if "alpha" in self.says else 2
        elif "tsm" in self.says:
            named = 3
        elif "alpha" in self.says:
            named = 1
        if named is not None:
            self.controllers.append(named)
        if len(set(self.controllers)) > 1:
            self.unknown.append(" or ".join(f"controller {number}" for number in set(self.controllers)))
        if self.controllers and "decouple" in self.says:
            # The title of the paper has both.
            self.controllers.clear()
            self.says.discard("decouple")

    def _load(self) -> None:
        if "load" in self.says and self.says & (_QUANTITIES - {"joint"}):
            self.unknown.append("load")


def variable_of(says: frozenset[str]) -> tuple[str | None, str]:
    """Variable of a trace that a name means, and what is to be checked about it.

    >>> variable_of(frozenset({"angle", "desired"}))
    ('q_d', '')
    """
    roles = says & ROLES
    kinds = says & {"time", "torque", "surface", "estimate", "rate"}
    if len(kinds) > 1 or len(roles) > 1 or (kinds and roles - {"measured", "desired"}):
        return None, "words that do not go together"
    if kinds:
        return _of_kind(next(iter(kinds)), says)
    if "motor" in says:
        if roles <= {"measured"}:
            return "q_motor_encoder", "angle of the winch? before the reducer: * 0.01"
        return None, "desired or calculated angle of a motor"
    if roles:
        return _OF_ROLE[next(iter(roles))]
    return ("q_encoder" if says & {"angle", "joint"} else None), ("" if "angle" in says else "measured?")


_OF_ROLE = {
    "desired": ("q_d", ""),
    "measured": ("q_encoder", ""),
    "calculated": ("q_calculated", ""),
    "error": ("e", "desired less measured? else * -1"),
}


def _of_kind(kind: str, says: frozenset[str]) -> tuple[str | None, str]:
    if kind == "time":
        return "time", ""
    if kind == "rate":
        return ("dq_d" if "desired" in says else "dq"), ""
    if "desired" in says or (kind == "torque" and "motor" in says and "angle" in says):
        return None, f"desired {kind}"
    if kind == "torque":
        return "tau_m", "at the winch or at the joint?" if "motor" in says else ""
    return {"surface": "s", "estimate": "H_hat"}[kind], ""
