"""What `reproduce` answers: of the paper's arm in few lines, of a user's own what its studies found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command import answer, run

import tendonrepro as tr
from tendonrepro.analysis.explain import steadied_by
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import published
from tendonrepro.experiments.loops import all_loops, growing
from tendonrepro.files import shipped
from tendonrepro.reporting import reproduction
from tendonrepro.reporting.contents import read_shown
from tendonrepro.verdicts.words import percent

MOTION = {"reference.periods": 1, "reference.rise": 0.8, "reference.hold": 0.2}
SHORT = [*(word for key, value in MOTION.items() for word in ("--set", f"{key}={value}")), "--no-figures"]
RUNS = FIRST, SECOND, _ = ("controller_1", "controller_2", "controller_3")


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
    assert (place / told["live"]).exists()
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
    assert reproduction.helps(rows) == helps


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
    monkeypatch.setattr(reproduction, "TUNED", {**reproduction.TUNED, **least})
    monkeypatch.setattr(reproduction, "AROUND", {**reproduction.AROUND, "jobs": 1})
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
    monkeypatch.setattr(reproduction, "TUNED", {**reproduction.TUNED, "plants": 1})
    monkeypatch.setattr("tendonrepro.tuning.bench.usable", lambda _: False)
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


def comparison(size: float, **more: Any) -> dict[str, Any]:
    table = {run: {"mae_deg": [size + k, 0.25], "rmse_deg": [2 * size, 0.5]} for k, run in enumerate(RUNS)}
    return {"joints": [2, 3], "status": dict.fromkeys(RUNS, "ok"), "table2": table, "files": []} | more


def printed() -> dict[str, Any]:
    def sizes(run: str, metric: str) -> list[float]:
        return [published().number(f"table2.{run}.{metric}.joint_{joint}") for joint in (2, 3)]

    return {
        "table2": {run: {f"{metric}_deg": sizes(run, metric) for metric in ("mae", "rmse")} for run in RUNS}
    }


def test_as_shipped_it_is_the_answer_table_2_and_four_files() -> None:
    files = [f"out/compare/figures/fig14.{suffix}" for suffix in ("pdf", "png")] + [
        "out/compare/tables/table2.md"
    ]
    compared = comparison(3.0, printed=printed(), files=files)
    decoupled = {"files": ["out/decouple/tables/table1.md"]}
    text = reproduction.ending(
        {"decouple": decoupled, "compare": compared, "closest": comparison(1.5)}, "out/live.html"
    )
    assert len(text.splitlines()) <= 20
    row = read_shown(shipped("docs/results")).box["printed"]
    for number in (
        "0.75",
        "0.90",
        percent(row["behind"]),
        "3.000 / 0.250",
        "1.500 / 0.250",
        "0.261 / 0.219",
        "0.436 / 0.349",
    ):
        assert number in text
    for file in ("out/live.html", files[1], files[2], "out/decouple/tables/table1.md"):
        assert file in text
    assert files[0] not in text


def test_of_changed_runs_nothing_of_the_stored_study_is_said() -> None:
    text = reproduction.ending({"compare": comparison(3.0)}, "live.html")
    assert "3.000 / 0.250" in text
    assert "%" not in text
    assert "0.261" not in text


@pytest.mark.slow
def test_all_tables_are_printed_where_verbose(tmp_path) -> None:
    words = ("reproduce", "--set", "sampling_period=2", "--no-figures")
    short, long = (run(*words, *more, cwd=tmp_path).stdout for more in ((), ("--verbose",)))
    assert "Table 3" not in short
    assert "Table 3" in long
    assert long.endswith(short)
