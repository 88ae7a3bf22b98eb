"""How printed numbers follow from the errors of Tables 2 and 3."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from operator import truediv
from typing import Any, NamedTuple

from tendonrepro.configuration.models.control import FIRST
from tendonrepro.configuration.published import (
    PrintedDose,
    PrintedNumber,
    PrintedQuotient,
    Published,
    exact,
    row_of,
)
from tendonrepro.results.summary import LOADS

NUMBERS = ("value", "shape", "joints", "dose", "ratio", "increase")
"""Rules of numbers that follow from these errors, or are one of them."""

PERCENTAGES = ("share.", "increase.")
"""How the ids of the percentages of sections 5.3 and 5.4 begin."""


class ErrorOf(NamedTuple):
    """An error of Table 2 or 3."""

    run: str
    metric: str
    joint: int

    @property
    def id(self) -> str:
        """Id in ``published.yaml``; Table 3 without load is Controller 1 of Table 2."""
        return f"{row_of(self.run)}.{self.metric}.joint_{self.joint}"

    def __str__(self) -> str:
        return f"{self.run}, joint {self.joint}"


def error_of(identifier: str) -> ErrorOf:
    """Read an id of Table 2 or 3."""
    table, row, metric, place = identifier.split(".")
    return ErrorOf(LOADS[row] if table == "table3" else row, metric, int(place.removeprefix("joint_")))


class Formula(NamedTuple):
    """Ids of errors, and how a number follows from these."""

    names: tuple[str, ...]
    value: Callable[..., Any]

    @property
    def errors(self) -> list[ErrorOf]:
        """Errors that `names` are of."""
        return [error_of(name) for name in self.names]


def formula_of(paper: Published, identifier: str) -> Formula:
    """How a number follows from Tables 2 and 3."""
    entry = paper.entries[identifier]
    if isinstance(entry, PrintedQuotient):
        return Formula((entry.numerator, entry.denominator), truediv)
    if isinstance(entry, PrintedDose):
        on_joint_3, on_joint_2 = entry.parts
        # What Controller 1 gains over Controller 2 on joint 3, over what it gains on joint 2.
        return Formula(
            (*on_joint_3, *on_joint_2), lambda c1_3, c2_3, c1_2, c2_2: (1 - c1_3 / c2_3) / (1 - c1_2 / c2_2)
        )
    family, what, *rest = identifier.split(".", 2)
    if family == "share":
        rival = what.removeprefix("controller_1_of_")
        names = f"table2.{FIRST}.{rest[0]}", f"table2.controller_{rival}.{rest[0]}"
        return Formula(names, lambda part, whole: 100 * part / whole)
    if family == "increase":
        names = f"table3.with_load.{rest[0]}", f"table3.no_load.{rest[0]}"
        return Formula(names, lambda after, before: 100 * after / before - 100)
    return Formula((identifier,), lambda error: error)


def cut(value: Fraction, printed: PrintedNumber) -> str:
    """How a value became the printed number."""
    scale = 10**printed.decimals
    goal = exact(printed) * scale
    ways = {"rounded": math.floor(value * scale + Fraction(1, 2)), "cut off": math.trunc(value * scale)}
    return " or ".join(way for way, digits in ways.items() if digits == goal) or "neither"
