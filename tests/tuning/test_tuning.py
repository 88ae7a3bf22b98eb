"""A small tuning from start to end: what it writes, killed and taken up again, and what it refuses."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest

import tendonrepro as tr
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.ensemble import load_plants
from tendonrepro.errors import UsageError
from tendonrepro.physics import error_rate, time_delay_estimate
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.tuning import bench, report, search, tuning
from tendonrepro.tuning.bench import (
    PUBLISHED,
    Candidate,
    Performance,
    TrialPlants,
    as_published,
    loops_of,
    measure,
    posed,
)
from tendonrepro.tuning.laws import LAWS

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
    monkeypatch.setattr(report, "QUESTIONS", (("ntsm", "tsm"), ("tsm", "pid")))
    for module in (search, report):
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
        looked.append(len(candidates))
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
    # Each plant's cap is measured again, and what the kill left out; no candidate of a search twice.
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
    # What is kept of a plant is what its gains give.
    for row in found["by_plant"]:
        if row["stable"] and row["cap"] in search.CAPS:
            assert row["roughness"] > 0.0
            least = min(error for error in row["errors"] if error is not None)
            assert least == pytest.approx(math.log(row["error"]), abs=0.02)


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
