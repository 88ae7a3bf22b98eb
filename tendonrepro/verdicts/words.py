"""Claims, numbers and verdicts in words, on every page and in the terminal."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from tendonrepro.configuration.published import published
from tendonrepro.configuration.shown import in_words
from tendonrepro.verdicts.ledger import SHARE, Verdict
from tendonrepro.verdicts.rules import VERDICTS

_NUMBERS = {
    "table1": "ratio of diameters",
    "table2": "error",
    "table3": "error",
    "S_inv": "inverse coupling matrix S⁻¹",
    "S": "coupling matrix S",
    "rmse_over_mae": "RMSE over MAE",
    "joints": "joint 3 over joint 2",
    "dose": "gain of Controller 1 on joint 3 over joint 2",
    "share": "error in per cent of another controller's",
    "increase": "change of Controller 1's error",
    "mae": "MAE",
    "rmse": "RMSE",
}

_UNITS = {"%": " %", "deg": "°"}
_WORDS = {
    "@sampling_period=([.0-9]+)ms": r" at L = \1 ms",
    "@M_bar=halved": " with half M̄",
    "(controller_1_|Controller 1 )payload": "Controller 1 with payload",
    "controller_": "Controller ",
    "is ok\\b": "is stable",
    "as printed": "as published",
    "t - 2L": "t − 2L",
    "epsilon": "ε",
    "H_hat": "Ĥ",
    "M_bar": "M̄",
    "gamma_": "γ",
    "Omega": "Ω",
    "alpha": "α",
    "phi": "φ",
    "Delta": "Δ",
    "D_(in|n)": r"D \1",
}
"""What stands in a claim or statement, and what a reader sees."""


def claim_in_words(identifier: str) -> str:
    """A claim in few words, or what a number is of."""
    return published().entries[identifier].short or number_in_words(identifier)


def number_in_words(identifier: str) -> str:
    """What a number is of: error, run and joint."""
    parts = identifier.split(".")
    words = [_NUMBERS.get(part) or part.replace("_over_", "/").replace("_", " ") for part in parts]
    return ", ".join(words).replace("controller", "Controller")


def two_digits(ratio: float | None) -> str:
    """A ratio, if there are plants.

    Examples
    --------
    >>> two_digits(1.1006), two_digits(math.nan)
    ('1.10', '–')
    """
    return "–" if ratio is None or math.isnan(ratio) else f"{ratio:.2f}"


def percent(share: float | None) -> str:
    """Share in per cent, two digits of a small one; only all of it is 100 %.

    Examples
    --------
    >>> percent(0.8917), percent(0.0085), percent(0.0), percent(None), percent(0.9997), percent(0.999999)
    ('89 %', '0.85 %', '0 %', '–', '99.97 %', 'over 99.99 %')
    """
    if share is None or math.isnan(share):
        return "–"
    value = 100.0 * share
    if 99.5 <= value < 100.0:
        texts = (f"{value:.{digits}g} %" for digits in (3, 4))
        return next((text for text in texts if text != "100 %"), "over 99.99 %")
    return f"{value:.0f} %" if value >= 10.0 or value == 0.0 else f"{value:.2g} %"


def named(judged: Verdict) -> str:
    """A claim in its words; a number by its name and value."""
    if "." not in judged.id:
        return statement_in_words(judged.printed)
    return statement_in_words(f"{number_in_words(judged.id)}: {judged.printed}{unit_of(judged)}")


def unit_of(judged: Verdict) -> str:
    """The unit as it follows a number; none of a share, a plain number, or a fraction of two lengths."""
    if judged.unit in {None, SHARE, "1"} or "/" in judged.printed:
        return ""
    return _UNITS.get(judged.unit or "", f" {judged.unit}")


def ours(judged: Verdict) -> str:
    """What came out here."""
    evidence, value, unit = judged.evidence, judged.ours, unit_of(judged)
    if evidence.get("missing"):
        return statement_in_words(f"missing: {evidence['missing']}")
    if judged.unit == SHARE and value is not None:
        return statement_in_words(_share_in_words(evidence, value))
    if box := evidence.get("box"):
        low, high = (f"{box[key]:.3g}".replace("-", "−") for key in ("low", "high"))
        return f"median {box['median']:.3g}{unit}, central 90 % {low} to {high}{unit}"
    if value is None:
        return "yes" if judged.verdict in {"exact", "reproduced"} else "–"
    return f"{value:.4g}{unit}"


def _share_in_words(evidence: Mapping[str, Any], share: float) -> str:
    """Say on how many plants a claim holds, by each measure; of none the most that it can be."""
    plants = f"of {evidence['plants']:,} plants"
    measured = evidence.get("by_measure", ())
    if len(measured) > 1:
        first, *others = (f"{percent(row['share'])} {{}}by {row['measure']}" for row in measured)
        return ", ".join([f"holds on {first.format(plants + ' ')}", *(other.format("") for other in others)])
    if share == 0.0:
        return f"holds on none {plants}, at most {percent(evidence['interval'][1])}"
    return f"holds on {percent(share)} {plants}"


def unless(judged: Verdict) -> str:
    """Motions and starts under which the verdict is another one, and which, for a reader."""
    return "; ".join(f"{in_words(choice.reading)}: {VERDICTS[choice.verdict]}" for choice in judged.unless)


def statement_in_words(statement: str) -> str:
    """A statement with symbols and words for the program's names."""
    for name, word in _WORDS.items():
        statement = re.sub(rf"(?<![A-Za-z]){name}", word, statement)
    return statement


def statements(judged: Verdict) -> list[tuple[str, str]]:
    """Parts of a claim, and the share of plants on which each holds, or whether it does on measured data."""
    evidence = judged.evidence
    parts = [*evidence.get("statements", ()), evidence.get("direction"), evidence.get("opposite")]
    return [(statement_in_words(part["statement"]), _holds_on(part)) for part in parts if part]


def _holds_on(part: Mapping[str, Any]) -> str:
    if "share" in part:
        return percent(part["share"])
    return "measured data" if part["holds"] else "not on measured data"
