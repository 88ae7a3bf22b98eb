"""What `reproduce` answers of a user's own arm, and that its parts are the results of the studies alone."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command import answer, run

import tendonrepro as tr
from tendonrepro.analysis.explain import steadied_by
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import all_loops, growing
from tendonrepro.reporting import own_arm
from tendonrepro.results.store import read_manifest

MOTION = {"reference.periods": 1, "reference.rise": 0.8, "reference.hold": 0.2}
SHORT = [*(word for key, value in MOTION.items() for word in ("--set", f"{key}={value}")), "--no-figures"]
FIRST, SECOND = "controller_1", "controller_2"


def made(folder: Path, joints: int = 2) -> Path:
    run("config", "init", "--joints", str(joints), "--out", "mine/my_arm.yaml", cwd=folder)
    return folder


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="module")
def told(place: Path) -> Any:
    return answer("reproduce", "--config", "mine/compare.yaml", *SHORT, cwd=place)


def test_it_says_what_its_studies_found(told: Any, place: Path) -> None:
    found = tr.open(place / "reports/own/compare"), tr.open(place / "reports/own/ensemble")
    table, pairs = found[0].data["table2"], found[1].tables["pairs"]
    own = pairs[(pairs["run"] == FIRST) & (pairs["over"] == SECOND)]
    assert own["arms"].tolist() == [64, 64]
    assert told["answer"] == {"unstable": [], "helps": "no"}
    # Around an arm whose values are known to 20 % it errs as on that arm.
    errors = (table[run]["mae_deg"] for run in (FIRST, SECOND))
    for first, second, ratio in zip(*errors, own["ratio"], strict=True):
        assert first / second == pytest.approx(ratio, abs=0.02)


def test_the_words_have_the_numbers_of_the_studies(told: Any, place: Path) -> None:
    words = run("reproduce", "--config", "mine/compare.yaml", *SHORT, cwd=place).stdout
    (arms,) = told["ensemble"]["populations"].values()
    table = told["compare"]["table2"]
    numbers = [
        f"{row['ratio_high']:.2f}" for row in arms["pairs"] if (row["run"], row["over"]) == (FIRST, SECOND)
    ]
    numbers += [f"{size:.3f}" for run in (FIRST, SECOND) for size in table[run]["mae_deg"]]
    numbers += [f"{min(modes['decay'] for modes in told['explain']['runs'].values()):.3g}"]
    assert [number for number in numbers if number not in words] == []


def test_each_part_is_made_again_by_its_own_command(told: Any, place: Path) -> None:
    for name in ("explain", "compare", "ensemble"):
        again = shlex.split(read_manifest(place / "reports/own" / name)["again"])
        assert again[1] == name
        assert answer(*again[1:], "--dry-run", cwd=place)["out"] == told[name]["out"]
    assert (place / told["live"]).exists()


@pytest.mark.parametrize(
    ("ends", "helps"),
    [
        ([(0.9, 0.95), (0.8, 0.99)], "yes"),
        ([(1.08, 1.12), (1.01, 1.3)], "no"),
        ([(1.08, 1.12), (0.9, 0.95)], "undecided"),
        ([(1.0, 1.0), (1.0, 1.0)], "undecided"),
        ([(0.9, 1.1)], "undecided"),
        ([(1.08, 1.12), None], "undecided"),
    ],
)
def test_it_helps_where_it_errs_less_on_nearly_all_arms(ends: Any, helps: str) -> None:
    """A controller with α = 0 is plain TDE: their ratio is one, and nobody errs more."""
    rows = [
        {"arms": 64, "ratio_low": end[0], "ratio_high": end[1]} if end else {"arms": 0, "ratio_low": None}
        for end in ends
    ]
    assert own_arm.helps(rows) == helps


def test_what_steadies_a_loop_is_the_first_step_that_does(place: Path) -> None:
    file, gain = str(place / "mine/compare.yaml"), "control.gains.M_bar"
    damping = float(load_config(file, "compare").config.manipulator.tendons.damping_factor.si)

    def grows(**factors: float) -> bool:
        changed = {gain: 0.1, "manipulator.tendons.damping_factor": damping}
        for key, factor in factors.items():
            changed[key] *= factor
        return bool(growing(all_loops(load_config(file, "compare", overrides=changed))))

    assert grows()
    found = steadied_by(load_config(file, "compare", overrides={gain: 0.1}))
    assert any(found.values())
    for key, factor in found.items():
        step = 0.5 if key == gain else 2.0
        last = 7 if factor is None else abs(round(np.log2(factor)))
        assert [grows(**{key: step**k}) for k in range(1, last + 1)] == [
            *[True] * (last - 1),
            factor is None,
        ]


@pytest.mark.slow
def test_an_unstable_arm_is_told_and_arms_around_it_are_not_asked(place: Path, tmp_path: Path) -> None:
    words = ["--config", str(place / "mine/compare.yaml"), *SHORT, "--set", "control.gains.M_bar=0.5"]
    done = answer("reproduce", *words, cwd=tmp_path, code=5)
    assert {FIRST, SECOND} <= {*done["answer"]["unstable"]}
    assert done["answer"]["steadied_by"]
    assert "ensemble" not in done


@pytest.mark.slow
def test_tuned_too(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    least = {"plants": 1, "searches": 2, "generations": 2, "population": 4, "jobs": 1}
    monkeypatch.setattr(own_arm, "TUNED", {**own_arm.TUNED, **least})
    monkeypatch.setattr(own_arm, "AROUND", {**own_arm.AROUND, "jobs": 1})
    monkeypatch.chdir(tmp_path)
    found = tr.reproduce(config=place / "mine/compare.yaml", tune=True, figures=False, set=MOTION)
    assert [*found] == ["answer", "explain", "compare", "ensemble", "tune"]
    (question,) = found["tune"].data["questions"]
    assert f"less under {question['smaller_error']}, more under {question['larger_error']}" in str(
        found["answer"]
    )
    assert found["tune"].data["plants"] == 1


def test_where_no_plant_can_be_tuned_the_rest_is_answered(
    told: Any, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(own_arm, "TUNED", {**own_arm.TUNED, "plants": 1})
    monkeypatch.setattr("tendonrepro.tuning.tuning.usable", lambda _: False)
    monkeypatch.chdir(place)
    found = tr.reproduce(config="mine/compare.yaml", tune=True, figures=False, set=MOTION, out="reports/own")
    assert [*found] == ["answer", "explain", "compare", "ensemble"]
    assert found["answer"].data == told["answer"]


def test_a_dry_run_tells_the_cost_of_all_and_writes_nothing(place: Path, tmp_path: Path) -> None:
    plan = answer("reproduce", "--config", str(place / "mine"), "--tune", "--dry-run", cwd=tmp_path)
    assert [name for name in plan if isinstance(plan[name], dict) and "out" in plan[name]] == [
        "explain",
        "compare",
        "decouple",
        "ensemble",
        "tune",
    ]
    assert all(plan[name]["cost"]["processor_hours"] > 0.0 for name in ("ensemble", "tune"))
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    "words",
    [
        "--config mine/decouple.yaml",
        "--config mine/nothing.yaml",
        "--config -",
        "--tune",
    ],
)
def test_what_is_no_comparison_is_refused(place: Path, words: str) -> None:
    before = {*place.iterdir()}
    error = answer("reproduce", *words.split(), cwd=place, code=2)["error"]
    assert error["where"]
    assert {*place.iterdir()} == before


def test_results_of_another_arm_are_not_replaced(told: Any, place: Path) -> None:
    words = ["--config", "mine/compare.yaml", *SHORT, "--set", "control.gains.lam=6"]
    answer("reproduce", *words, cwd=place, code=2)
    assert tr.open(place / "reports/own/compare").data["table2"] == told["compare"]["table2"]
