"""The paper's claims and numbers in a few words, the main ones first."""

from __future__ import annotations

from collections.abc import Sequence

from tendonrepro.configuration.published import published
from tendonrepro.verdicts.judge import Verdict

MAIN = (
    "K1",
    "K3",
    "C1",
    "C2",
    "share.controller_1_of_2.mae.joint_2",
    "C3",
    "C6",
    "E1",
    "E3",
    "increase.with_load.mae.joint_2",
)
"""The main claims in the order of the paper's argument; of two, their main number."""

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


def in_words(identifier: str) -> str:
    """A claim in at most eight words, or what a number is of."""
    return published().entries[identifier].short or number_in_words(identifier)


def number_in_words(identifier: str) -> str:
    """What a number is of: which error, run and joint."""
    parts = identifier.split(".")
    words = [_NUMBERS.get(part) or part.replace("_over_", "/").replace("_", " ") for part in parts]
    return ", ".join(words).replace("controller", "Controller")


def main_first(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """The main claims in the order of the argument, then the others as the paper has them."""
    return sorted(verdicts, key=lambda one: MAIN.index(one.id) if one.id in MAIN else len(MAIN))
