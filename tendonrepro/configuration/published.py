"""What the paper prints, as data: numbers with place, unit and digits, claims, and how each is judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import cache
from types import MappingProxyType
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, StrictInt, ValidationError

from tendonrepro.arrays import Array
from tendonrepro.configuration.fields.model import Model, Number
from tendonrepro.configuration.fields.strict_yaml import Document, load, read_text
from tendonrepro.configuration.messages import explain
from tendonrepro.errors import ConfigError
from tendonrepro.files import shipped
from tendonrepro.physics.kinematics import coupling_inverse, coupling_matrix

Interval: TypeAlias = tuple[Fraction, Fraction]
"""Lower and upper end, both included."""

SIGN = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
"""``c[p, q]`` of section 3.3."""

COMPARED = (2, 3)
"""Joints of the comparison; the paper prints gains and errors of these."""


class PrintedNumber(Model):
    """A number as printed; `decimals` counts the digits behind the point."""

    id: str
    kind: Literal["number"]
    where: str
    value: Number
    unit: str
    decimals: StrictInt

    @property
    def as_printed(self) -> str:
        """The number with its printed digits."""
        return f"{self.value:.{self.decimals}f}"


class PrintedRatio(Model):
    """A number printed as a fraction of two lengths in `unit`."""

    id: str
    kind: Literal["ratio"]
    where: str
    numerator: Number
    denominator: Number
    unit: str

    @property
    def value(self) -> float:
        """The fraction, dimensionless."""
        return self.numerator / self.denominator

    @property
    def as_printed(self) -> str:
        """The fraction without its unit."""
        return f"{self.numerator:g}/{self.denominator:g}"


class PrintedQuotient(Model):
    """A number that is not printed itself but follows from two that are, by their ids."""

    id: str
    kind: Literal["quotient"]
    where: str
    numerator: str
    denominator: str
    unit: Literal["1"] = "1"


class PrintedDose(Model):
    """What Controller 1 gains over Controller 2 on joint 3, ``1 - C1/C2``, over what it gains on joint 2."""

    id: str
    kind: Literal["dose"]
    where: str
    metric: Literal["mae", "rmse"]
    unit: Literal["1"] = "1"

    @property
    def parts(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Ids of both controllers' errors on joint 3, then on joint 2."""
        joint_3, joint_2 = (
            (f"table2.controller_1.{self.metric}.{joint}", f"table2.controller_2.{self.metric}.{joint}")
            for joint in ("joint_3", "joint_2")
        )
        return joint_3, joint_2


class PrintedText(Model):
    """A name as printed, or a claim: a statement of the paper in our words."""

    id: str
    kind: Literal["text", "claim"]
    where: str
    text: str


PrintedEntry: TypeAlias = PrintedNumber | PrintedRatio | PrintedQuotient | PrintedDose | PrintedText


class Judgement(Model):
    """By which rule of docs/verdicts.md entries are judged, and what their verdict hangs on.

    `ids` is the id of an entry, or a pattern with ``*`` for several; the rule ``input`` is none. What
    `repeats` something that is judged already is not counted again.
    """

    ids: str
    rule: str
    kind: Literal["arithmetic", "model", "ensemble", "measured", "input"]
    depends_on: tuple[str, ...]
    repeats: str | None = None


class _File(Model):
    schema_version: Literal[2]
    entries: tuple[Annotated[PrintedEntry, Field(discriminator="kind")], ...]
    judged: tuple[Judgement, ...]


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
        if isinstance(entry, PrintedText | PrintedQuotient | PrintedDose):
            raise KeyError(f"{identifier} is not printed as a number")
        return entry

    def digits(self, identifier: str) -> PrintedNumber:
        """Entry of a number that is printed with digits, not as a fraction."""
        entry = self.entries[identifier]
        assert isinstance(entry, PrintedNumber)
        return entry

    def interval(self, identifier: str) -> Interval:
        """Numbers that a printed number, ratio, quotient or dose of printed numbers may stand for.

        Raises
        ------
        KeyError
            When nothing of that id is printed, or it is a text.
        """
        entry = self.entries[identifier]
        if isinstance(entry, PrintedQuotient):
            return quotient(self.interval(entry.numerator), self.interval(entry.denominator))
        if isinstance(entry, PrintedDose):
            shares = [quotient(*map(self.interval, pair)) for pair in entry.parts]
            gains = [(1 - high, 1 - low) for low, high in shares]
            return quotient(gains[0], gains[1])
        return rounding(self.quantity(identifier))

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
    """Check and freeze a document; every id is used once and covered by exactly one judgement."""
    try:
        file = _File.model_validate(document.tree)
    except ValidationError as error:
        raise explain(error, document) from None
    entries: dict[str, PrintedEntry] = {}
    judgements: dict[str, Judgement] = {}
    for index, entry in enumerate(file.entries):
        fitting = [judgement for judgement in file.judged if fnmatchcase(entry.id, judgement.ids)]
        where = str(document.place(("entries", index)))
        if entry.id in entries:
            raise ConfigError(f"id {entry.id!r} is used twice", where=where)
        if len(fitting) != 1:
            message = f"{entry.id!r} is covered by {len(fitting)} judgements instead of one"
            raise ConfigError(message, where=where)
        entries[entry.id], judgements[entry.id] = entry, fitting[0]
    return Published(MappingProxyType(entries), MappingProxyType(judgements))


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


def quotient(numerator: Interval, denominator: Interval) -> Interval:
    """Interval of the quotient of two positive numbers."""
    return numerator[0] / denominator[1], numerator[1] / denominator[0]


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
