"""Claims of the paper and what came out here, in a reader's words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from tendonrepro.reporting.answer import percent
from tendonrepro.verdicts.judge import SHARE
from tendonrepro.verdicts.report import number_in_words

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


def named(entry: Mapping[str, Any]) -> str:
    """A claim in its words; a number by its name and value."""
    if "." not in entry["id"]:
        return in_words(entry["printed"])
    return in_words(f"{number_in_words(entry['id'])}: {entry['printed']}{_UNITS.get(entry['unit'], '')}")


def ours(entry: Mapping[str, Any]) -> str:
    """What came out here."""
    evidence, value, unit = entry["evidence"], entry["ours"], _UNITS.get(entry["unit"], "")
    if evidence.get("missing"):
        return in_words(f"missing: {evidence['missing']}")
    if entry["unit"] == SHARE and value is not None:
        favoured = ", by the measure that favours it most" if len(evidence.get("by_measure", ())) > 1 else ""
        return f"holds on {percent(value)} of {evidence['plants']:,} plants{favoured}"
    if box := evidence.get("box"):
        low, high = (f"{box[key]:.3g}".replace("-", "−") for key in ("low", "high"))
        return f"median {box['median']:.3g}{unit}, central 90 % {low} to {high}{unit}"
    if value is None:
        return "yes" if entry["verdict"] in {"exact", "reproduced"} else "–"
    return f"{value:.4g}{unit}"


def in_words(statement: str) -> str:
    """A statement with symbols and words for the program's names."""
    for name, word in _WORDS.items():
        statement = re.sub(rf"(?<![A-Za-z]){name}", word, statement)
    return statement


def statements(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Parts of a claim, and the share of plants on which each holds."""
    evidence = entry["evidence"]
    held = [*evidence.get("statements", ()), evidence.get("direction"), evidence.get("opposite")]
    return [(in_words(one["statement"]), percent(one["share"])) for one in held if one]
