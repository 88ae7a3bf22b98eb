"""What the paper prints, as data: numbers with place, unit and digits, claims, and how each is judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import cache
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.fields.strict_yaml import Document, Node, load, read_text
from tendonrepro.errors import ConfigError
from tendonrepro.files import shipped
from tendonrepro.physics.kinematics import coupling_inverse, coupling_matrix

SCHEMA_VERSION = 2

Interval: TypeAlias = tuple[Fraction, Fraction]
"""Lower and upper end, both included."""

SIGN = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
"""``c[p, q]`` of section 3.3."""

COMPARED = (2, 3)
"""Joints of the comparison; the paper prints gains and errors of these."""


@dataclass(frozen=True)
class PrintedNumber:
    """A number as printed; `decimals` counts the digits behind the point."""

    id: str
    where: str
    value: float
    unit: str
    decimals: int

    @property
    def as_printed(self) -> str:
        """The number with its printed digits."""
        return f"{self.value:.{self.decimals}f}"


@dataclass(frozen=True)
class PrintedRatio:
    """A number printed as a fraction of two lengths in `unit`."""

    id: str
    where: str
    numerator: float
    denominator: float
    unit: str

    @property
    def value(self) -> float:
        """The fraction, dimensionless."""
        return self.numerator / self.denominator

    @property
    def as_printed(self) -> str:
        """The fraction without its unit."""
        return f"{self.numerator:g}/{self.denominator:g}"


@dataclass(frozen=True)
class PrintedText:
    """A name as printed."""

    id: str
    where: str
    text: str


@dataclass(frozen=True)
class PrintedClaim(PrintedText):
    """A statement of the paper, in our words."""


@dataclass(frozen=True)
class Judgement:
    """How entries are judged.

    Parameters
    ----------
    ids : str
        Id of an entry, or a pattern with ``*`` for several.
    rule : str
        Name of a rule of docs/verdicts.md; ``input`` is none.
    kind : str
        One of `KINDS_OF_JUDGEMENT`.
    depends_on : tuple of str
        What the verdict hangs on.
    """

    ids: str
    rule: str
    kind: str
    depends_on: tuple[str, ...]


KINDS_OF_JUDGEMENT = ("arithmetic", "model", "ensemble", "measured", "input")

PrintedEntry: TypeAlias = PrintedNumber | PrintedRatio | PrintedText

# A kind added here, with its class, is all that a new sort of entry needs.
_KINDS: Mapping[str, type[PrintedEntry]] = {
    "number": PrintedNumber,
    "ratio": PrintedRatio,
    "text": PrintedText,
    "claim": PrintedClaim,
}
_ACCEPTED: Mapping[str, tuple[type, ...]] = {"str": (str,), "float": (int, float), "int": (int,)}


@dataclass(frozen=True)
class Published:
    """Everything printed, and how it is judged, by id."""

    entries: Mapping[str, PrintedEntry]
    judgements: Mapping[str, Judgement]

    def number(self, identifier: str) -> float:
        """Value of a printed number or ratio, in its printed unit.

        Raises
        ------
        KeyError
            When nothing of that id is printed, or it is a text.
        """
        return self.quantity(identifier).value

    def quantity(self, identifier: str) -> PrintedNumber | PrintedRatio:
        """Entry of a printed number or ratio.

        Raises
        ------
        KeyError
            When nothing of that id is printed, or it is a text.
        """
        entry = self.entries[identifier]
        if isinstance(entry, PrintedText):
            message = f"{identifier} is a text"
            raise KeyError(message)
        return entry

    def per_joint(self, identifier: str, joints: Iterable[int]) -> list[float]:
        """Values of ``<identifier>.joint_<number>``, in the order of `joints`; NaN where none is printed."""
        names = (f"{identifier}.joint_{joint}" for joint in joints)
        return [self.number(name) if name in self.entries else float("nan") for name in names]


@cache
def published() -> Published:
    """Return the shipped numbers, read once.

    Raises
    ------
    ConfigError
        When the shipped file was damaged.
    """
    path = shipped("data") / "published.yaml"
    return parse_published(load(read_text(path), str(path)))


def parse_published(document: Document) -> Published:
    """Check a document entry by entry, each covered by exactly one judgement, and freeze it."""
    listed = _lists(document)
    entries: dict[str, PrintedEntry] = {}
    for index, item in enumerate(listed["entries"]):
        where = document.where(("entries", index))
        entry = _entry(item, where)
        if entry.id in entries:
            message = f"id {entry.id!r} is used twice"
            raise ConfigError(message, where=where)
        entries[entry.id] = entry
    rules = [_judgement(item, document.where(("judged", k))) for k, item in enumerate(listed["judged"])]
    found = {name: _the_one(rules, name, document.name) for name in entries}
    return Published(MappingProxyType(entries), MappingProxyType(found))


def _lists(document: Document) -> dict[str, list[Node]]:
    tree = document.tree
    names = ("entries", "judged")
    listed = {name: tree.get(name) for name in names} if isinstance(tree, dict) else {}
    lists = {name: items for name, items in listed.items() if isinstance(items, list)}
    if not isinstance(tree, dict) or len(lists) != 2 or len(tree) != 3:
        message = "expected the keys schema_version, entries and judged, both lists"
        raise ConfigError(message, where=document.name)
    if tree.get("schema_version") != SCHEMA_VERSION:
        message = f"schema_version is not {SCHEMA_VERSION}"
        raise ConfigError(message, where=document.name)
    return lists


def _judgement(item: Node, where: str) -> Judgement:
    given = item if isinstance(item, dict) else {}
    texts, depends_on = [given.get(key) for key in ("ids", "rule", "kind")], given.get("depends_on")
    if (
        len(given) != 4
        or not all(isinstance(text, str) for text in texts)
        or not isinstance(depends_on, list)
        or not all(isinstance(text, str) for text in depends_on)
    ):
        message = "expected the keys ids, rule, kind, texts, and depends_on, a list of texts"
        raise ConfigError(message, where=where)
    ids, rule, kind = map(str, texts)
    if kind not in KINDS_OF_JUDGEMENT:
        message = f"kind {kind!r} is none of {', '.join(KINDS_OF_JUDGEMENT)}"
        raise ConfigError(message, where=where)
    return Judgement(ids, rule, kind, tuple(map(str, depends_on)))


def _the_one(rules: list[Judgement], name: str, where: str) -> Judgement:
    fitting = [rule for rule in rules if fnmatchcase(name, rule.ids)]
    if len(fitting) != 1:
        message = f"{name!r} is covered by {len(fitting)} judgements instead of one"
        raise ConfigError(message, where=where)
    return fitting[0]


def _entry(item: Node, where: str) -> PrintedEntry:
    kind = item.get("kind") if isinstance(item, dict) else None
    if not isinstance(item, dict) or not isinstance(kind, str) or kind not in _KINDS:
        message = f"expected an entry of kind {', '.join(_KINDS)}"
        raise ConfigError(message, where=where)
    wanted = {part.name: _ACCEPTED[str(part.type)] for part in fields(_KINDS[kind])}
    given = {key: value for key, value in item.items() if key != "kind"}
    wrong = sorted(wanted.keys() ^ given.keys())
    wrong += [key for key in wanted.keys() & given.keys() if not _is_a(given[key], wanted[key])]
    if wrong:
        message = f"missing, unknown or ill-typed keys: {', '.join(wrong)}"
        raise ConfigError(message, where=where)
    entry = _KINDS[kind](**given)  # type: ignore[arg-type]
    if isinstance(entry, PrintedNumber) and round(entry.value, entry.decimals) != entry.value:
        message = f"{entry.value} has more than {entry.decimals} decimals"
        raise ConfigError(message, where=where)
    return entry


def _is_a(value: Node, accepted: tuple[type, ...]) -> bool:
    return isinstance(value, accepted) and not isinstance(value, bool)


def exact(entry: PrintedNumber | PrintedRatio) -> Fraction:
    """The digits as printed, as a fraction."""
    if isinstance(entry, PrintedRatio):
        return Fraction(str(entry.numerator)) / Fraction(str(entry.denominator))
    return Fraction(entry.as_printed)


def rounding(entry: PrintedNumber | PrintedRatio) -> Interval:
    """Numbers that print like this one when rounded; a fraction of two lengths stands for itself."""
    value = exact(entry)
    half = Fraction(0) if isinstance(entry, PrintedRatio) else Fraction(1, 2 * 10**entry.decimals)
    return value - half, value + half


def table_1(paper: Published) -> Array:
    """Table 1, ``D[p, q] / D[q]``, (3, 3), zero below the diagonal."""
    ratio = np.zeros((3, 3))
    for p in range(3):
        for q in range(p, 3):
            ratio[p, q] = paper.number(f"table1.D_{p + 1}{q + 1}_over_D_{q + 1}")
    return ratio


def coupling_of(ratio: Array) -> tuple[Array, Array]:
    """``S`` and ``S_inv`` of Eq. (2) from `table_1`."""
    S_inv = coupling_inverse(np.ones(3), ratio, SIGN)
    return coupling_matrix(S_inv), S_inv
