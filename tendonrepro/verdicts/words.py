"""The paper's claims in at most eight words, and the verdicts on them in a reader's words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tendonrepro.verdicts.judge import Verdict

CLAIMS_IN_WORDS: Mapping[str, str] = {
    "K1": "S and its inverse are inverses",
    "K3": "calculated joint angles agree with the encoders",
    "C1": "all three controllers track stably",
    "C2": "Controller 1 beats 2, and 2 beats 3",
    "share.controller_1_of_2.mae.joint_2": "Controller 1's error is 90.3 % of 2's",
    "C3": "Controller 1's lead is largest in rapid motion",
    "C6": "Controller 1's torque is smaller and smoother",
    "E1": "α improves the estimate",
    "E3": "the older estimate reduces overshoot",
    "increase.with_load.mae.joint_2": "0.2 kg raises Controller 1's error by 1.1 %",
    "K2": "tendon 1 alone moves joint 2",
    "K2a": "joint 2 then turns the opposite way",
    "K2b": "link 2 then only translates",
    "K4": "motor 3 turns far less than motor 2",
    "K5": "motor angles agree with the desired ones",
    "K6": "coupling falls with D_n, rises with D_in",
    "T1": "every tendon stays tense",
    "C4": "the three sliding surfaces are similar",
    "C5": "Controller 1's estimate is smaller moving up",
    "F1": "RMSE/MAE rises from Controller 1 to 3",
    "F2": "joint 3 errs nearly as much as 2",
    "P1": "a payload changes Controller 1's errors little",
    "E1a": "α improves the robustness",
    "E2": "a shorter sampling period improves the estimate",
    "E2a": "a small M̄ makes the torque smoother",
    "L1": "errors stay within the bounds of section 4.3",
    "A1": "the percentages follow from Tables 2 and 3",
    "eq13": "both branches of φ meet smoothly",
}
"""Claims in the order of the paper's argument, the ten main ones first; of two, their main number."""

MAIN = tuple(CLAIMS_IN_WORDS)[:10]

VERDICTS: Mapping[str, str] = {
    "exact": "follows, to the published digits",
    "reproduced": "follows from the equations",
    "compatible": "agrees",
    "no_power": "agrees, but so would most values",
    "direction_only": "agrees in direction, not in size",
    "depends_on_plant": "depends on the plant",
    "not_met": "holds on almost no plant",
    "contradicted": "the equations say the opposite",
    "outside_model": "outside the range of the plants",
    "not_reproduced": "does not follow from the equations",
    "not_testable": "not testable",
}
"""What each verdict of `claims` means."""

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
    return CLAIMS_IN_WORDS.get(identifier) or number_in_words(identifier)


def number_in_words(identifier: str) -> str:
    """What a number is of: which error, run and joint."""
    parts = identifier.split(".")
    words = [_NUMBERS.get(part) or part.replace("_over_", "/").replace("_", " ") for part in parts]
    return ", ".join(words).replace("controller", "Controller")


def main_first(verdicts: Sequence[Verdict]) -> list[Verdict]:
    """The main claims in the order of the argument, then the others as the paper has them."""
    place = {name: number for number, name in enumerate(MAIN)}
    return sorted(verdicts, key=lambda verdict: place.get(verdict.id, len(place)))
