"""Claims of the paper and the verdicts on them, in a reader's words."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from tendonrepro.reporting.answer import percent
from tendonrepro.verdicts.report import number_in_words
from tendonrepro.verdicts.rules import VERDICTS

__all__ = ["MAIN", "VERDICTS", "named", "ours", "statements"]

MAIN = {
    "K1": "The coupling matrix S and its inverse are inverses of each other.",
    "K3": "Joint angles calculated from the motors agree with the encoders.",
    "C1": "All three controllers track stably.",
    "C2": "Controller 1 is better than 2, and 2 than 3, in MAE and RMSE on both joints.",
    "share.controller_1_of_2.mae.joint_2": "Controller 1's MAE on joint 2 is 90.3 % of Controller 2's.",
    "C3": "The advantage of Controller 1 is largest in rapid motion.",
    "C6": "Controller 1's torque is much smaller moving up, and lower and smoother overall.",
    "E1": "α can improve the estimate of the lumped uncertainty.",
    "E3": "Data from t − 2L reduce the overshoot that time-delay estimation causes.",
    "increase.with_load.mae.joint_2": "A payload of 0.2 kg raises Controller 1's MAE on joint 2 by 1.1 %.",
}
"""The ten claims of the first screen, in the order of the paper's argument, and what the paper says."""

_SHARE = "share of the box"
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
    "gamma_1": "γ₁",
    "gamma_2": "γ₂",
    "Omega": "Ω",
    "alpha": "α",
    "phi": "φ",
    "Delta": "Δ",
    "D_(in|n)": r"D \1",
}


def named(entry: Mapping[str, Any]) -> str:
    """What the paper says, in its words; of a number its name and value."""
    if "." not in entry["id"]:
        return in_words(entry["printed"])
    unit = {"%": " %", "deg": "°"}.get(entry["unit"], "")
    return in_words(f"{number_in_words(entry['id'])}: {entry['printed']}{unit}")


def ours(entry: Mapping[str, Any]) -> str:
    """What came out here."""
    evidence, value = entry["evidence"], entry["ours"]
    unit = {"%": " %", "deg": "°"}.get(entry["unit"], "")
    if evidence.get("missing"):
        return in_words(f"missing: {evidence['missing']}")
    if entry["unit"] == _SHARE and value is not None:
        favoured = ", by the measure that favours it most" if len(evidence.get("by_measure", ())) > 1 else ""
        return f"holds on {percent(value)} of {evidence['plants']:,} plants{favoured}"
    if box := evidence.get("box"):
        low, high = (f"{box[key]:.3g}".replace("-", "−") for key in ("low", "high"))
        return f"median {box['median']:.3g}{unit}, central 90 % {low} to {high}{unit}"
    if value is None:
        return "yes" if entry["verdict"] in {"exact", "reproduced"} else "–"
    return f"{value:.4g}{unit}"


def in_words(statement: str) -> str:
    """A statement with symbols and words in place of the names that the program has for them."""
    for name, word in _WORDS.items():
        statement = re.sub(rf"(?<![A-Za-z]){name}", word, statement)
    return statement


def statements(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The parts of a claim, each with the share of the plants on which it holds."""
    evidence = entry["evidence"]
    held = [
        *evidence.get("statements", ()),
        *filter(None, [evidence.get("direction"), evidence.get("opposite")]),
    ]
    return [(in_words(one["statement"]), percent(one["share"])) for one in held]
