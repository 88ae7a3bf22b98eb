"""Verdicts on made rows: what counts as a difference."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
import pytest

from tendonrepro.tuning.bench import CONDITIONS
from tendonrepro.tuning.laws import LAWS
from tendonrepro.tuning.report import (
    FEWEST,
    QUESTIONS,
    alpha_rows,
    comparisons,
    lost_to_special_case,
    pairs_among,
    question_rows,
)
from tendonrepro.tuning.search import CAPS

DRAWS = 2 * FEWEST


def rows(
    ratio: float, alone: float | None = None, spread: float = 0.0, scatter: float = 0.0, draws: int = DRAWS
) -> list[dict[str, Any]]:
    """Law ``a`` errs `ratio` times as much as ``b``, give or take a spread; searches miss by `scatter`.

    Searched alone it errs `alone` times as much, else the same.
    """
    noise = np.exp(spread * np.random.default_rng(0).standard_normal(draws))
    ratios = {False: ratio, True: alone or ratio}
    return [
        {"law": law, "condition": condition, "alone": way, "cap": cap, "draw": draw, "stable": True}
        | {"error": size, "held_out_error": size, "errors": [np.log(size), np.log(size) + scatter, None]}
        for condition, cap, draw, way in product(CONDITIONS, CAPS, range(draws), ratios)
        for law, size in (("a", ratios[way] * float(noise[draw])), ("b", 1.0))
    ]


@pytest.mark.parametrize(
    ("made", "verdict"),
    [
        (rows(0.5), "smaller error"),
        (rows(2.0), "larger error"),
        (rows(0.98, spread=0.02), "alike"),
        (rows(0.98, scatter=0.2), "undecided"),
        (rows(0.98, spread=0.5), "undecided"),
        (rows(0.8, scatter=0.5), "undecided"),
        (rows(0.7, scatter=0.2), "smaller error"),
        (rows(0.5, draws=FEWEST - 1), "undecided"),
        (rows(0.5, alone=0.7), "smaller error"),
        (rows(0.5, alone=2.0), "undecided"),
        (rows(0.98, alone=0.85), "undecided"),
        (rows(0.98, alone=1.03, scatter=0.08), "alike"),
    ],
)
def test_verdict(made: list[dict[str, Any]], verdict: str) -> None:
    found = list(comparisons(made, [("a", "b")], 0))
    assert {one["verdict"] for one in found} == {verdict}
    assert len(found) == len(CONDITIONS) * len(CAPS)


def test_a_question_counts_its_cases_and_shows_its_widest_interval() -> None:
    found = list(comparisons(rows(0.98, alone=1.03, spread=0.02, scatter=0.08), [("a", "b")], 0))
    (asked,) = question_rows(found, {"a": "A", "b": "B"})
    assert asked["no_difference"] == asked["agree"] == len(found)
    assert asked["low"] < asked["median_ratio"] < asked["high"] < asked["alone_high"]


def test_tuned_alpha_and_whether_it_acts() -> None:
    """Under one cap α is 0, under another it changes nothing, elsewhere it halves the error."""
    made = rows(1.0)
    for row in made:
        row["law"] = {"a": "alpha_free", "b": "ntsm"}[row["law"]]
        row["gains"] = {"alpha": [0.0 if row["cap"] == "none" else 0.4] * 2}
        zeroed = {**row, "alpha": 0.0}
        if row["law"] == "alpha_free":
            made = [*made, zeroed]
            row["error"] = 0.5 if row["cap"] in ("1/10", "1/30") else 1.0
    for found in (every := [*alpha_rows(made)]):
        assert found["cases"] == DRAWS * len(CAPS)
        assert (found["share_zero"], found["share_without_effect"]) == (0.25, 0.5)
        assert (found["alpha_10"], found["alpha_median"], found["ratio_with_effect"]) == (0.0, 0.4, 0.5)
    assert len(every) == 2 * len(CONDITIONS)


@pytest.mark.parametrize(
    "chosen", [("ntsm", "pid"), ("alpha_free", "pid", "ntsm"), ("mine", "tdc"), ("mine", *LAWS)]
)
def test_chosen_laws_are_compared_each_with_each(chosen: tuple[str, ...]) -> None:
    pairs = pairs_among(dict.fromkeys(chosen).keys())
    together = {frozenset(pair) for pair in combinations(chosen, 2)}
    asked = {frozenset(pair) for pair in (*QUESTIONS, ("mine", "ntsm"), ("mine", "pid"))}
    assert len({frozenset(pair) for pair in pairs}) == len(pairs)
    assert {frozenset(pair) for pair in pairs} == (together & asked if "dob" in chosen else together)


def test_a_law_behind_its_own_special_case_is_told_unless_it_was_searched_alone() -> None:
    names = {"a": "ntsm", "b": "tsm"}
    behind, level = ([{**row, "law": names[row["law"]]} for row in rows(ratio)] for ratio in (1.5, 1.0))
    lost = [*lost_to_special_case(behind)]
    assert len(lost) == DRAWS * len(CONDITIONS) * len(CAPS)
    assert {(row["law"], row["to"], row["alone"]) for row in lost} == {("ntsm", "tsm", False)}
    assert not [*lost_to_special_case(level)]


def test_the_interval_is_that_of_the_median_over_draws_with_gains() -> None:
    made = rows(0.8, spread=0.2, draws=65)
    for row in made:
        row["stable"] = row["draw"] > 0 or row["law"] != "a"
    found = next(comparisons(made, [("a", "b")], 0))
    assert found["draws"] == 64
    assert found["held_out"] == pytest.approx(found["ratio"], rel=1e-3)
    # The median of 64 normal numbers has a standard error of 1.25 times that of the mean.
    width = np.log(found["high"] / found["low"])
    assert width == pytest.approx(2 * 1.96 * 1.25 * 0.2 / 8.0, rel=0.4)
    assert found["low"] < found["ratio"] < found["high"]
