"""How printed numbers follow from each other; and those that the paper alone judges, in exact fractions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from operator import truediv
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import (
    COMPARED,
    SIGN,
    Interval,
    PrintedDose,
    PrintedNumber,
    PrintedQuotient,
    Published,
    exact,
    rounding,
    row_of,
    table_1,
)
from tendonrepro.physics.control import polynomial
from tendonrepro.physics.drive import coupling_inverse, coupling_matrix
from tendonrepro.results.summary import LOADS
from tendonrepro.verdicts.rules import Evidence, Ruling, Rulings, meets, of_arithmetic, of_model

NUMBERS = ("value", "shape", "joints", "dose", "ratio", "increase")
"""Rules of numbers that follow from these errors, or are one of them."""

INCREASES = "increase."
PERCENTAGES = ("share.", INCREASES)
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


FAR_LESS = 0.1
"""Motor 3 against motor 2 in claim K4."""
NEARLY = 0.1
"""Largest relative difference of angles that are nearly equal in claim K6."""
SMOOTH = 1e-12


def lengths(paper: Published, identifier: str) -> Ruling:
    """An entry of S_inv against Table 1 by Eq. (2), or the reverse."""
    if identifier.startswith("S_inv."):
        n, i = tuple(identifier.removeprefix("S_inv."))
        other = f"table1.D_{i}{n}_over_D_{n}"
    else:
        i, n = tuple(identifier.removeprefix("table1.D_").partition("_")[0])
        other = f"S_inv.{n}{i}"
    return _against(paper, identifier, rounding(paper.quantity(other)), other)


def inverse(paper: Published, identifier: str) -> Ruling:
    """An entry of S against the inverse of S_inv."""
    n, i = (int(digit) - 1 for digit in identifier.removeprefix("S."))
    ours = abs(inverse_of(printed_inverse(paper))[n][i])
    return _against(paper, identifier, (ours, ours), "S_inv")


def printed_inverse(paper: Published) -> list[list[Fraction]]:
    """``S_inv`` up to the diagonal, signed by Eq. (2) and section 3.3."""
    rows = []
    for n in range(3):
        row = [exact(paper.quantity(f"S_inv.{n + 1}{i + 1}")) for i in range(n + 1)]
        rows.append([(1 if i == n else -1) * int(SIGN[i, n]) * x for i, x in enumerate(row)])
    return rows


def inverse_of(lower: Sequence[Sequence[Fraction]]) -> list[list[Fraction]]:
    """Inverse of a lower-triangular matrix, by rows up to the diagonal."""
    rows: list[list[Fraction]] = []
    for n, row in enumerate(lower):
        before = [-sum((row[k] * rows[k][i] for k in range(i, n)), Fraction(0)) / row[n] for i in range(n)]
        rows.append([*before, 1 / row[n]])
    return rows


def inverses(paper: Published, _: str) -> Ruling:
    """K1: all entries of S."""
    names = [name for name in paper.entries if name.startswith("S.")]
    wrong = [name for name in names if inverse(paper, name).verdict != "exact"]
    return of_arithmetic(not wrong, evidence={"entries": names, "inconsistent": wrong})


def percentage(paper: Published, _: str) -> Ruling:
    """A1: percentages against what the rounding of the tables allows."""
    rows = [_percentage(paper, name) for name in paper.entries if name.startswith(PERCENTAGES)]
    wrong = [row["id"] for row in rows if not row["consistent"]]
    return of_arithmetic(not wrong, evidence={"percentages": rows, "inconsistent": wrong})


def _percentage(paper: Published, identifier: str) -> Evidence:
    printed, formula = paper.digits(identifier), formula_of(paper, identifier)
    part, whole = map(paper.digits, formula.names)
    value = formula.value(exact(part), exact(whole))
    (least, most), (low, high) = rounding(part), rounding(whole)
    allowed = formula.value(least, high), formula.value(most, low)
    return {
        "id": identifier,
        "printed": printed.as_printed,
        "from_digits": float(value),
        "allowed": [float(end) for end in allowed],
        "printed_is": cut(value, printed),
        "consistent": meets(allowed, rounding(printed)),
    }


def same_as(paper: Published, identifier: str) -> Ruling:
    """Table 3 without load against Table 2's Controller 1."""
    other = error_of(identifier).id
    return _against(paper, identifier, rounding(paper.quantity(other)), other)


def resolution(paper: Published, identifier: str) -> Ruling:
    """Encoder resolution against 360° over four counts a pulse."""
    ours = 90 / exact(paper.quantity("hardware.encoder_pulses"))
    return _against(paper, identifier, (ours, ours), "hardware.encoder_pulses")


def _against(paper: Published, identifier: str, allowed: Interval, origin: str) -> Ruling:
    """Judge an entry by the interval that follows from another one; ours is its middle."""
    consistent = meets(allowed, rounding(paper.quantity(identifier)))
    return of_arithmetic(consistent, float(sum(allowed) / 2), {"from": [origin]})


TURNS: Mapping[str, Callable[[float], bool]] = {
    "tendon_1_moves_joint_2": lambda turn: turn != 0.0,
    "opposite_direction": lambda turn: turn < 0.0,
    "pure_translation": lambda turn: abs(turn + 1.0) < NEARLY,
}
"""K2, K2a and K2b, by the turn of joint 2 over that of joint 1 when tendon 1 alone is pulled."""


OTHER_SIGNS = "signs=c12=-1,c13=+1"
"""Name of a reading: the signs c12 and c13 of section 3.3 turned round."""


def turn_of_joint_2(paper: Published, identifier: str) -> Rulings:
    """K2, K2a, K2b: that turn, as published and with c12 and c13 turned round."""
    turns = []
    for flip in (1.0, -1.0):
        sign = SIGN * np.array([[1.0, flip, flip], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
        S = coupling_matrix(coupling_inverse(np.ones(3), table_1(paper), sign))
        turns.append(float(S[1, 0] / S[0, 0]))
    holds = TURNS[paper.judgements[identifier].rule]
    remark = "joint 2 over joint 1; a pure translation of link 2, as Fig. 6 is described, would need -1"
    evidence: Evidence = {"with_other_signs": turns[1], "remarks": [remark]}
    return {
        PRINTED: of_model(holds(turns[0]), turns[0], evidence),
        OTHER_SIGNS: of_model(holds(turns[1]), turns[1]),
    }


def motor_3_turns_less(paper: Published, _: str) -> Ruling:
    """K4: motor 3 over motor 2 when joints 2 and 3 turn alike."""
    turns = coupling_inverse(np.ones(3), table_1(paper), SIGN) @ np.array([0.0, 1.0, 1.0])
    ours = float(abs(turns[2] / turns[1]))
    return of_model(ours < FAR_LESS, ours, {"motor_over_joint": turns.tolist()})


def coupling_terms(paper: Published, _: str) -> Ruling:
    """K6: terms fall with the winch and rise with the pulley."""
    ratio = table_1(paper)
    winch, pulley = slopes_of_coupling(ratio)
    ours = float(ratio[1, 2])
    holds = bool((winch < 0.0).all() and (pulley > 0.0).all()) and abs(ours - 1.0) < NEARLY
    evidence = {"larger_winch": winch.tolist(), "larger_pulley": pulley.tolist()}
    return of_model(holds, ours, evidence)


def slopes_of_coupling(ratio: Array) -> tuple[Array, Array]:
    """Change of entries 21, 31 and 32 of ``|S_inv|`` with winches, and pulleys, 1 % larger."""
    below = np.tril_indices(3, -1)
    sizes = [
        np.abs(coupling_inverse(np.full(3, winch), ratio * pulley, SIGN)[below])
        for winch, pulley in ((1.0, 1.0), (1.01, 1.0), (1.0, 1.01))
    ]
    return sizes[1] - sizes[0], sizes[2] - sizes[0]


def smooth_branch(paper: Published, _: str) -> Ruling:
    """Eq. (13): both branches of phi agree at Delta, in value and slope."""
    apart = []
    for joint in COMPARED:
        b, Delta = (paper.number(f"gain.{name}.joint_{joint}") for name in ("b", "Delta"))
        gamma_1, gamma_2 = polynomial(b, Delta)
        apart += [
            abs(gamma_1 * Delta + gamma_2 * Delta**2 - Delta**b),
            abs(gamma_1 + 2.0 * gamma_2 * Delta - b * Delta ** (b - 1.0)),
        ]
    return of_model(max(apart) < SMOOTH, evidence={"differences": apart})


FROM_THE_PRINT: Mapping[str, Callable[[Published, str], Ruling]] = {
    rule.__name__: rule
    for rule in (
        *(lengths, inverse, inverses, percentage, same_as, resolution),
        *(motor_3_turns_less, coupling_terms, smooth_branch),
    )
}
"""Rules that need nothing but the paper, by name; those of `TURNS` need no more."""


def judge_print(paper: Published, identifier: str) -> Rulings:
    """Judge by the paper alone."""
    rule = paper.judgements[identifier].rule
    if rule in TURNS:
        return turn_of_joint_2(paper, identifier)
    return {PRINTED: FROM_THE_PRINT[rule](paper, identifier)}
