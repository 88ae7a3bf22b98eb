"""What the paper prints, as data, and how each entry is judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from fractions import Fraction
from functools import cache
from itertools import combinations_with_replacement
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, StrictInt

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import LOADED
from tendonrepro.configuration.strict_model import Model, Number
from tendonrepro.configuration.strict_yaml import load, read_text
from tendonrepro.files import shipped
from tendonrepro.physics.drive import coupling_inverse, coupling_matrix

Interval: TypeAlias = tuple[Fraction, Fraction]
"""Lower and upper end, both included."""

SIGN = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
"""``c[p, q]`` of section 3.3."""

METRICS = ("mae", "rmse")
"""What Tables 2 and 3 print of every error."""

COMPARED = (2, 3)
"""Joints of the comparison; the paper prints gains and errors of these."""


class _Entry(Model):
    """What all have; `short` is a few words for it."""

    id: str
    where: str
    short: str | None = None


class PrintedNumber(_Entry):
    """A number as printed; `decimals` counts the digits behind the point."""

    kind: Literal["number"]
    value: Number
    unit: str
    decimals: StrictInt

    @property
    def as_printed(self) -> str:
        """With the printed digits."""
        return f"{self.value:.{self.decimals}f}"


class PrintedRatio(_Entry):
    """A number printed as a fraction of two lengths in `unit`."""

    kind: Literal["ratio"]
    numerator: Number
    denominator: Number
    unit: str

    @property
    def value(self) -> float:
        """Dimensionless."""
        return self.numerator / self.denominator

    @property
    def as_printed(self) -> str:
        """Without its unit."""
        return f"{self.numerator:g}/{self.denominator:g}"


class PrintedQuotient(_Entry):
    """Follows from two printed numbers, by their ids."""

    kind: Literal["quotient"]
    numerator: str
    denominator: str
    unit: Literal["1"] = "1"


class PrintedDose(_Entry):
    """What Controller 1 gains over Controller 2, ``1 - C1/C2``, on joint 3 over joint 2."""

    kind: Literal["dose"]
    metric: Literal["mae", "rmse"]
    unit: Literal["1"] = "1"

    @property
    def parts(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Ids of both controllers' errors on joint 3, then 2."""
        first, second = (f"table2.controller_{number}.{self.metric}.joint_" for number in (1, 2))
        return (first + "3", second + "3"), (first + "2", second + "2")


class PrintedText(_Entry):
    """A name as printed, or a claim of the paper in our words."""

    kind: Literal["text", "claim"]
    text: str


PrintedEntry: TypeAlias = PrintedNumber | PrintedRatio | PrintedQuotient | PrintedDose | PrintedText


class Judgement(Model):
    """By which rule of docs/verdicts.md entries are judged, and what their verdict depends on.

    `ids` is an id, or a pattern with ``*``. What `repeats` another is not counted.
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
        """Of a printed number or ratio, in its printed unit."""
        return self.quantity(identifier).value

    def quantity(self, identifier: str) -> PrintedNumber | PrintedRatio:
        """Entry of a printed number or ratio."""
        entry = self.entries[identifier]
        assert isinstance(entry, PrintedNumber | PrintedRatio)
        return entry

    def digits(self, identifier: str) -> PrintedNumber:
        """Entry of a number printed with digits."""
        entry = self.entries[identifier]
        assert isinstance(entry, PrintedNumber)
        return entry

    def interval(self, identifier: str) -> Interval:
        """Numbers that an entry may stand for."""
        entry = self.entries[identifier]
        if isinstance(entry, PrintedQuotient):
            return quotient(self.interval(entry.numerator), self.interval(entry.denominator))
        if isinstance(entry, PrintedDose):
            shares = (quotient(*map(self.interval, pair)) for pair in entry.parts)
            return quotient(*((1 - high, 1 - low) for low, high in shares))
        return rounding(self.quantity(identifier))

    def with_numbers(self, values: Mapping[str, float], decimals: int | None = None) -> Published:
        """The same print with other values, by id, rounded to the printed digits or to so many `decimals`."""
        changed = {}
        for name, value in values.items():
            digits = self.digits(name).decimals if decimals is None else decimals
            update = {"value": round(float(value), digits), "decimals": digits}
            changed[name] = self.digits(name).model_copy(update=update)
        return replace(self, entries={**self.entries, **changed})

    def per_joint(self, identifier: str, joints: Iterable[int]) -> list[float]:
        """Values of ``<identifier>.joint_<number>``; NaN where none is."""
        names = (f"{identifier}.joint_{joint}" for joint in joints)
        return [self.number(name) if name in self.entries else float("nan") for name in names]


@cache
def published() -> Published:
    """The shipped numbers, read once."""
    path = shipped("data") / "published.yaml"
    file = _File.model_validate(load(read_text(path), str(path)))
    entries = {entry.id: entry for entry in file.entries}
    judgements = {name: next(rule for rule in file.judged if fnmatchcase(name, rule.ids)) for name in entries}
    return Published(entries, judgements)


def row_of(run: str) -> str:
    """How the ids of a run's errors begin; what Table 3 repeats of Table 2 is found there."""
    return "table3.with_load" if run == LOADED else f"table2.{run}"


def exact(entry: PrintedNumber | PrintedRatio) -> Fraction:
    """The printed digits as a fraction."""
    if isinstance(entry, PrintedRatio):
        return Fraction(str(entry.numerator)) / Fraction(str(entry.denominator))
    return Fraction(entry.as_printed)


def rounding(entry: PrintedNumber | PrintedRatio) -> Interval:
    """Numbers that print like this one; a ratio stands for itself."""
    value = exact(entry)
    half = Fraction(0) if isinstance(entry, PrintedRatio) else Fraction(1, 2 * 10**entry.decimals)
    return value - half, value + half


def quotient(numerator: Interval, denominator: Interval) -> Interval:
    """Of two positive numbers."""
    return numerator[0] / denominator[1], numerator[1] / denominator[0]


def table_1(paper: Published) -> Array:
    """``D[p, q] / D[q]``, (3, 3), zero below the diagonal."""
    ratio = np.zeros((3, 3))
    for p, q in combinations_with_replacement(range(3), 2):
        ratio[p, q] = paper.number(f"table1.D_{p + 1}{q + 1}_over_D_{q + 1}")
    return ratio


def coupling_of(ratio: Array) -> tuple[Array, Array]:
    """``S`` and ``S_inv`` of Eq. (2)."""
    S_inv = coupling_inverse(np.ones(3), ratio, SIGN)
    return coupling_matrix(S_inv), S_inv
