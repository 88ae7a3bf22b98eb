"""Verdicts on made rows: what counts as a difference."""

from __future__ import annotations

import json
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest

from tendonrepro.files import to_json
from tendonrepro.tuning.laws import LAWS
from tendonrepro.tuning.report import FEWEST, QUESTIONS, comparisons, count_scattered, pairs_among
from tendonrepro.tuning.search import CAPS, CONDITIONS

DRAWS = 2 * FEWEST


def rows(ratio: float, spread: float = 0.0, scatter: float = 0.0, draws: int = DRAWS) -> list[dict[str, Any]]:
    """Law ``a`` errs `ratio` times as much as ``b``, give or take a spread; searches miss by `scatter`."""
    noise = spread * np.random.default_rng(0).standard_normal(draws)
    return [
        {"law": law, "knows": knows, "filtered": filtered, "cap": cap, "draw": draw, "stable": True}
        | {"error": size, "held_out_error": size, "errors": [np.log(size), np.log(size) + scatter, None]}
        for (knows, filtered), cap, draw in product(CONDITIONS, CAPS, range(draws))
        for law, size in (("a", ratio * float(np.exp(noise[draw]))), ("b", 1.0))
    ]


@pytest.mark.parametrize(
    ("made", "verdict"),
    [
        (rows(0.5), "smaller error"),
        (rows(2.0), "larger error"),
        (rows(0.98, spread=0.02), "no difference"),
        (rows(0.98, scatter=0.2), "no difference"),
        (rows(0.98, spread=0.5), "undecided"),
        (rows(0.8, scatter=0.5), "undecided"),
        (rows(0.7, scatter=0.2), "smaller error"),
        (rows(0.5, draws=FEWEST - 1), "too few plants"),
    ],
)
def test_verdict(made: list[dict[str, Any]], verdict: str) -> None:
    found = list(comparisons(made, [("a", "b")], 0))
    assert {one["verdict"] for one in found} == {verdict}
    assert len(found) == len(CONDITIONS) * len(CAPS)


@pytest.mark.parametrize(("ratio", "scatter", "share"), [(0.98, 0.2, 1), (0.98, 0.05, 0), (0.5, 0.2, 0)])
def test_cases_without_a_difference_that_their_searches_leave_open(
    ratio: float, scatter: float, share: int
) -> None:
    found = list(comparisons(rows(ratio, scatter=scatter), [("a", "b")], 0))
    cases = json.loads(to_json({"cases": count_scattered(found), "comparisons": found}))["cases"]
    assert cases == share * len(found)


@pytest.mark.parametrize(
    "chosen", [("ntsm", "pid"), ("alpha_free", "pid", "ntsm"), ("mine", "tdc"), ("mine", *LAWS)]
)
def test_chosen_laws_are_compared_each_with_each(chosen: tuple[str, ...]) -> None:
    pairs = pairs_among(dict.fromkeys(chosen).keys())
    together = {frozenset(pair) for pair in combinations(chosen, 2)}
    asked = {frozenset(pair) for pair in (*QUESTIONS, ("mine", "ntsm"), ("mine", "pid"))}
    assert len({frozenset(pair) for pair in pairs}) == len(pairs)
    assert {frozenset(pair) for pair in pairs} == (together & asked if "dob" in chosen else together)


def test_a_draw_without_gains_is_left_out() -> None:
    made = rows(0.5)
    for row in made:
        if row["draw"] == 0 and row["law"] == "a":
            row["stable"] = False
    found = next(comparisons(made, [("a", "b")], 0))
    assert found["draws"] == DRAWS - 1
    assert (found["ratio"], found["held_out"]) == pytest.approx((0.5, 0.5))


def test_the_interval_is_that_of_the_median() -> None:
    found = next(comparisons(rows(0.8, spread=0.2, draws=64), [("a", "b")], 0))
    # The median of 64 normal numbers has a standard error of 1.25 times that of the mean.
    width = np.log(found["high"] / found["low"])
    assert width == pytest.approx(2 * 1.96 * 1.25 * 0.2 / 8.0, rel=0.4)
    assert found["low"] < found["ratio"] < found["high"]
