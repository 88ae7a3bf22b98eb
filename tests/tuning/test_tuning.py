"""A small tuning from start to end, killed and taken up again; what it refuses; its verdicts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from itertools import combinations, product
from pathlib import Path
from statistics import fmean, median
from typing import Any, ClassVar

import numpy as np
import pytest

import tendonrepro as tr
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.ensemble import load_plants
from tendonrepro.errors import UsageError
from tendonrepro.physics import error_rate, time_delay_estimate
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.simulation.stepper import simulate
from tendonrepro.tuning import bench, tuning
from tendonrepro.tuning.bench import (
    CONDITIONS,
    LAWS,
    PUBLISHED,
    Candidate,
    Performance,
    TrialPlants,
    as_published,
    loops_of,
    measure,
    posed,
)
from tendonrepro.tuning.search import CAPS, TuningEffort, TuningTask
from tendonrepro.tuning.tuning import (
    FEWEST,
    QUESTIONS,
    alpha_rows,
    comparisons,
    law_rows,
    lost_to_special_case,
    pairs_among,
    question_rows,
)

SMALL: dict[str, Any] = {"plants": 2, "searches": 2, "generations": 2, "population": 4, "jobs": 1}


def surface(memory, q, q_d, dq_d, ddq_d, law):  # type: ignore[no-untyped-def]
    """A user's TDE with TSM."""
    e, de = q_d - q, error_rate(memory, q, q_d, dq_d, law)
    s, H_hat = de + law.beta * e, time_delay_estimate(memory, q, law)
    return law.M_bar * (ddq_d + law.beta * de + law.lam * s) + H_hat, H_hat, s, de


surface.bounds = {"M_bar": (1e-4, 0.1), "lam": (2.0, 200.0), "beta": (1.0, 100.0)}  # type: ignore[attr-defined]


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three laws under one condition, so that a tuning takes seconds."""
    monkeypatch.setattr(tuning, "LAWS", {name: LAWS[name] for name in ("pid", "tsm", "ntsm")})
    monkeypatch.setattr(tuning, "QUESTIONS", (("ntsm", "tsm"), ("tsm", "pid")))
    for module in (bench, tuning):
        monkeypatch.setattr(module, "CONDITIONS", (PUBLISHED,))


def run(folder: Path, **options: Any) -> dict[str, Any]:
    return tr.tune(out=folder, **{**SMALL, **options}).data


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_killed_in_the_middle_of_a_plant_it_goes_on_and_ends_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[int] = []

    def counting(plants: TrialPlants, candidates: Sequence[Candidate], *runs: int) -> Performance:
        looked.append(0 if runs else len(candidates))
        if len(looked) == deadly:
            raise KeyboardInterrupt
        return measure(plants, candidates, *runs)

    deadly = 0
    monkeypatch.setattr(bench, "measure", counting)
    whole = run(tmp_path / "whole", any_plant=True)
    every, looked[:], deadly = [*looked], [], len(looked) - 4
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed", any_plant=True)
    assert not (tmp_path / "killed" / "tune.json").exists()
    looked[:], deadly = [], 0
    again = run(tmp_path / "killed", any_plant=True)
    # Each plant's cap and best gains are measured again, and what the kill left out; nothing else.
    assert sum(looked) <= sum(every[-5:]) + 2
    assert all(again[key] == whole[key] for key in ("laws", "by_plant"))
    assert not list((tmp_path / "killed").rglob("*.npy"))


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_what_it_writes(tmp_path: Path) -> None:
    found = run(tmp_path / "tune", laws={"surface": surface})
    stored = json.loads((tmp_path / "tune" / "tune.json").read_text("utf-8"))
    assert stored["lost_to_special_case"] == []
    assert {row["law"] for row in stored["laws"]} >= {"pid", "surface", "controller_1"}
    tables = {"questions", "comparisons", "alpha", "laws"}
    assert {path.stem for path in (tmp_path / "tune" / "tables").glob("*.csv")} == tables
    assert (tmp_path / "tune" / "figures" / "tune.pdf").exists()
    # With the same bounds and the same law, the user's finds what the package's own finds.
    errors = {
        name: [row["error"] for row in found["by_plant"] if row["law"] == name and row["cap"] == "none"]
        for name in ("surface", "tsm")
    }
    assert errors["surface"] == pytest.approx(errors["tsm"], rel=0.6)
    # What is kept of a plant is what its gains give, also by SciPy.
    kept = [row for row in found["by_plant"] if row["stable"] and row["cap"] in CAPS]
    for row in kept:
        least = min(error for error in row["errors"] if error is not None)
        assert least == pytest.approx(math.log(row["error"]), abs=0.02)
    own = [row for row in kept if (row["law"], row["cap"], row["alone"]) == ("tsm", "none", False)]
    task = TuningTask(load_plants(None), LAWS, TuningEffort(2, 2, 4), 0)
    for row in own:
        gains = {name: np.array(value) for name, value in row["gains"].items()}
        loops = loops_of(task.draw(row["draw"]), Candidate(LAWS["tsm"], PUBLISHED, gains), 2)
        errors = [np.abs(simulate(loop)["e"]).mean(axis=0) for loop in loops]
        assert row["error"] == pytest.approx(math.exp(fmean(np.log(errors).ravel())), rel=0.02)
    stored_row = {"law": "tsm", "condition": PUBLISHED, "alone": False, "cap": "none"}
    (at_best,) = (row for row in stored["laws"] if stored_row.items() <= row.items())
    assert at_best["error_deg"] == pytest.approx(math.degrees(median(row["error"] for row in own)))


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_around_an_arm_of_ones_own(tmp_path: Path) -> None:
    """With one joint, only what was asked for is tuned, and everything says whose ranges these are."""
    init_arm(1, tmp_path / "mine")
    config = tmp_path / "mine" / "compare.yaml"
    found = run(tmp_path / "out", config=config, formats="png", spread=0.2, only="tsm,pid")
    assert found["around"] == {"arm": "my arm", "spread": 0.2}
    assert found["joints"] == [1]
    assert {row["law"] for row in found["laws"] if row["cap"] == "none"} == {"tsm", "pid"}
    assert {(row["law"], row["over"]) for row in found["comparisons"]} == {("tsm", "pid")}
    assert len(found["questions"]) == 1
    tuned = [row["error"] for row in found["by_plant"] if row["law"] == "pid" and row["cap"] == "none"]
    published = [
        row["error"] for row in found["by_plant"] if row["law"] == "controller_2" and not row.get("alpha")
    ]
    assert max(tuned) < min(published)


def test_untuned_controllers_are_those_of_the_comparison(tmp_path: Path) -> None:
    """With its readings; ``errors_from`` is beyond the end of the motion of the tuning, not of its own."""
    init_arm(1, tmp_path)
    asked = ["control.readings.weights=extrapolating", "errors_from=3"]
    loaded = load_plants(tmp_path / "compare.yaml", overrides=asked)
    plants = posed(loaded.compare)
    (loop,) = loops_of(plants, as_published(plants)["controller_1"], 1)
    assert isinstance(loop.controller, TimeDelayController)
    assert loop.controller.law.weights[:, 0] == pytest.approx([1.1, -0.1])


def branching(*given: Any) -> tuple[Any, ...]:
    _, q, q_d, _, _, law = given
    e = q_d - q
    tau = law.K_p * e if e[0] > 0.0 else 2.0 * law.K_p * e
    return tau, tau, e, e


branching.bounds = {"K_p": (1.0, 10.0)}  # type: ignore[attr-defined]


class Counting:
    """Its gain grows from call to call, which a record of one call cannot hold."""

    bounds: ClassVar = {"K_p": (1.0, 10.0)}
    calls = 0

    def __call__(self, *given: Any) -> Any:
        self.calls += 1
        return self.calls * given[-1].K_p * (given[2] - given[1])


@pytest.mark.parametrize(
    "options",
    [
        {"searches": 1},
        {"only": "ntsm,alpha_tde"},
        {"laws": {"branching": branching}},
        {"laws": {"counting": Counting()}},
        {"laws": {"pid": surface}},
    ],
)
def test_what_it_refuses(tmp_path: Path, options: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        run(tmp_path / "tune", **options)
    assert not any(tmp_path.iterdir())


DRAWS = 2 * FEWEST


def made_rows(
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
        (made_rows(0.5), "smaller error"),
        (made_rows(2.0), "larger error"),
        (made_rows(0.98, spread=0.02), "alike"),
        (made_rows(0.98, spread=0.5), "undecided"),
        (made_rows(0.8, scatter=0.5), "undecided"),
        (made_rows(0.7, scatter=0.2), "smaller error"),
        (made_rows(0.5, draws=FEWEST - 1), "undecided"),
        (made_rows(0.5, alone=0.7), "smaller error"),
        (made_rows(0.5, alone=2.0), "undecided"),
        (made_rows(0.98, alone=0.85), "undecided"),
        (made_rows(0.98, alone=1.03, scatter=0.08), "alike"),
    ],
)
def test_verdict(made: list[dict[str, Any]], verdict: str) -> None:
    found = list(comparisons(made, [("a", "b")], 0))
    assert {one["verdict"] for one in found} == {verdict}
    assert len(found) == len(CONDITIONS) * len(CAPS)


def test_a_question_counts_its_cases_and_shows_its_widest_interval() -> None:
    found = list(comparisons(made_rows(0.98, alone=1.03, spread=0.02, scatter=0.08), [("a", "b")], 0))
    (asked,) = question_rows(found, {"a": "A", "b": "B"})
    assert asked["no_difference"] == asked["agree"] == len(found)
    assert asked["low"] < asked["median_ratio"] < asked["high"] < asked["alone_high"]


def test_tuned_alpha_and_whether_it_acts() -> None:
    """Under one cap α is 0, under another it changes nothing, elsewhere it halves the error."""
    made = made_rows(1.0)
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
    behind, level = ([{**row, "law": names[row["law"]]} for row in made_rows(ratio)] for ratio in (1.5, 1.0))
    lost = [*lost_to_special_case(behind)]
    assert len(lost) == DRAWS * len(CONDITIONS) * len(CAPS)
    assert {(row["law"], row["to"], row["alone"]) for row in lost} == {("ntsm", "tsm", False)}
    assert not [*lost_to_special_case(level)]


def test_the_interval_is_that_of_the_median_over_draws_with_gains() -> None:
    made = made_rows(0.8, spread=0.2, draws=65)
    for row in made:
        row["stable"] = row["draw"] > 0 or row["law"] != "a"
    found = next(comparisons(made, [("a", "b")], 0))
    assert found["draws"] == 64
    assert found["held_out"] == pytest.approx(found["ratio"], rel=1e-3)
    # The median of 64 normal numbers has a standard error of 1.25 times that of the mean.
    width = np.log(found["high"] / found["low"])
    assert width == pytest.approx(2 * 1.96 * 1.25 * 0.2 / 8.0, rel=0.4)
    assert found["low"] < found["ratio"] < found["high"]


def test_a_law_in_numbers() -> None:
    """Medians over the plants on which it is stable, of errors without and with payload together."""
    keys = {"law": "a", "condition": PUBLISHED, "alone": False, "cap": "none"}
    errors = [[[0.01, 0.02], [0.03, 0.04]], [[0.02, 0.06], [0.02, 0.08]]]
    made = [
        keys | {"stable": True, "mae": mae, "error": size, "roughness": size}
        for mae, size in zip(errors, (0.1, 0.3), strict=True)
    ]
    (row,) = law_rows([*made, keys | {"stable": False}], (2, 3))
    assert row["share_stable"] == 2 / 3
    assert row["mae_joint_2_deg"] == pytest.approx(math.degrees(0.02))
    assert row["mae_joint_3_deg"] == pytest.approx(math.degrees(0.05))
    assert row["mae_joint_3_deg_90"] == pytest.approx(math.degrees(0.074))
    assert (row["error_deg"], row["roughness_Nm"]) == pytest.approx((math.degrees(0.2), 0.2))
