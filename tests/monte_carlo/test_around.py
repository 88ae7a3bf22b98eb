"""Plants around a user's arm: how far its values move, and what follows what."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.fake_batch import fake_batch

from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.ensemble import load_plants
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.console import QUIET
from tendonrepro.errors import ConfigError, TendonreproError, UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.user_law import laws_of
from tendonrepro.monte_carlo.data import read_ensemble
from tendonrepro.monte_carlo.ensemble import ensemble_study, load_study
from tendonrepro.monte_carlo.figures import draw_pairs
from tendonrepro.monte_carlo.plan import evaluated
from tendonrepro.monte_carlo.population import Population, population_of
from tendonrepro.physics.control import command as physics_command
from tendonrepro.physics.control import estimator_weights
from tendonrepro.simulation.loop import TimeDelayController
from tendonrepro.studies.lifecycle import carry_out


@pytest.fixture(scope="module")
def compare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mine")
    init_arm(4, folder)
    path = folder / "compare.yaml"
    path.write_text(path.read_text().replace("[1, 2, 3, 4]", "[2, 3, 4]"), encoding="utf-8")
    return path


def around(path: Path, spread: float | None) -> Population:
    return population_of(load_plants(path, spread))


def draw(arm: Population, number: int) -> CompareConfig:
    return arm.configured(arm.sample(int(arm.loaded.config.seed.si), 0, number, 1)[0])


def test_values_stay_within_the_spread_and_inertias_follow(compare: Path) -> None:
    arm = around(compare, 0.2)
    own = arm.loaded.compare.manipulator
    drawn = [draw(arm, number).manipulator for number in range(8)]
    for name in ("length", "mass"):
        ratio = np.array([getattr(one.links, name).si for one in drawn]) / getattr(own.links, name).si
        assert (ratio[:, 0] == 1.0).all()  # joint 1 is held
        assert ratio[:, 1:].min() >= 1.0 / 1.2
        assert ratio[:, 1:].max() <= 1.2
        assert np.ptp(ratio[:, 1:], axis=0).min() > 0.1
        assert np.ptp(ratio[:, 1:], axis=1).min() > 0.0
    for one in drawn:
        share = one.links.inertia.si / (one.links.mass.si * one.links.length.si**2) / 0.098
        assert share.min() >= 1.0 / 1.2 - 1e-9
        assert share.max() <= 1.2 + 1e-9
        # Bearings and motors are alike at all joints, and what is off stays off.
        assert np.ptp(one.winches.viscous.si / own.winches.viscous.si) < 1e-12
        assert one.tensioner.force.si == 0.0
    assert {one.links.mass.source for one in drawn} == {
        "assumed: draw around my arm, each value within a factor of 1.2"
    }


def test_without_a_spread_the_shipped_ranges_are_relative(compare: Path) -> None:
    arm = around(compare, None)
    ends = {(one.key, one.joint): (one.low, one.high) for one in arm.rows}
    assert ends["links.mass", 2] == pytest.approx((0.25 / 0.47, 0.9 / 0.47))
    assert ends["links.mass", 4] == pytest.approx((0.10 / 0.22, 0.5 / 0.22))
    assert ends["winches.viscous", None] == pytest.approx((0.2, 5.0))
    assert ("links.mass", 1) not in ends


def test_a_range_of_a_key_replaces_the_spread(compare: Path) -> None:
    loaded = load_plants(compare, 0.2, ["links.mass=0.5,3", "links.length=1", "winches.viscous=2"])
    arm = population_of(loaded)
    ends = {factor.key: (factor.low, factor.high) for factor in arm.rows}
    assert ends["links.mass"] == (0.5, 3.0)
    assert ends["links.length"] == (1.0, 1.0)
    assert ends["tendons.axial_stiffness"] == pytest.approx((1 / 1.2, 1.2))
    own, drawn = loaded.compare.manipulator, [draw(arm, number).manipulator for number in range(8)]
    mass = np.array([one.links.mass.si / own.links.mass.si for one in drawn])[:, 1:]
    assert (mass.min() >= 0.5) & (mass.min() < 1 / 1.2) & (mass.max() > 1.2) & (mass.max() <= 3.0)
    for one in drawn:
        assert (one.links.length.si == own.links.length.si).all()
        assert one.winches.viscous.si == pytest.approx(2.0 * own.winches.viscous.si)
    assert loaded.around is not None
    assert loaded.around.as_data()["ranges"]["links.mass"] == [0.5, 3.0]
    given = load_plants(
        compare, 0.2, {"links.mass": (0.5, 3), "links.length": (1, 1), "winches.viscous": (2, 2)}
    )
    assert given.sha256 == loaded.sha256 != load_plants(compare, 0.2).sha256


@pytest.mark.parametrize(
    ("spread", "ranges"),
    [
        (0.0, []),
        (10.0, []),
        (float("nan"), []),
        (0.2, ["mass=0.5,2"]),
        (0.2, ["links.mass=2,0.5"]),
        (0.2, ["links.mass=0,2"]),
        (0.2, ["links.mass=0.5,2", "links.mass=0.9,1.1"]),
        (0.2, ["tensioner.force=0.5,2"]),  # off on this arm
    ],
)
def test_a_spread_or_a_range_that_is_none(compare: Path, spread: float, ranges: list[str]) -> None:
    with pytest.raises(UsageError):
        load_plants(compare, spread, ranges)


def test_an_impossible_arm_is_told(compare: Path) -> None:
    """A loss of 0.4 at each pulley, times up to 3, is more than all of the tension."""
    loaded = load_plants(
        compare, None, {"friction.per_pulley": (2.9, 3)}, overrides=["manipulator.friction.per_pulley=0.4"]
    )
    with pytest.raises(ConfigError):
        draw(population_of(loaded), 0)


def test_an_ensemble_around_an_arm(compare: Path, tmp_path: Path) -> None:
    """Its pairs follow from the stored errors; its loops are those of the drawn configuration."""
    older = ["control.readings.stored_torque=applied", "manipulator.actuator.output_delay=1"]
    study = load_study(compare, older, 5, "weights=extrapolating", 0.2)
    arm, row = study.population, study.values(np.array([11]))
    (loops,) = arm.loops(row, study.cases)
    own = dict(build_loops(arm.configured(row[0]), study.loaded.base.folder))
    for loop, (run, reading) in zip(loops, study.cases, strict=True):
        assert loop.plant.arm.a == pytest.approx(own[run].plant.arm.a)
        assert isinstance(loop.controller, TimeDelayController)
        assert (loop.controller.law.weights[1] < 0.0).any() == (reading.name != "printed")
    runnable = ensemble_study(
        study, 64, simulate=fake_batch, folder={"out": tmp_path / "out", "figures": False}
    )
    found = carry_out(replace(runnable, command="ensemble"), QUIET).value.data
    stored = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert not stored["of_paper"]
    assert (stored["around"]["arm"], stored["around"]["spread"]) == ("my arm", 0.2)
    population = stored["populations"]["arms"]
    assert population["joints"] == [2, 3, 4]
    # A sample of delay is in the age of both estimates, 1 ± 0.1 and 1.
    theory = [entry["theory"]["joint_3"] for entry in population["readings"]]
    assert theory == pytest.approx([2.1 / 2.0, 1.9 / 2.0])
    assert not any(
        "printed" in joint for joint in population["readings"][0]["ratio_c1_c2"]["all_ok"]["mae"].values()
    )
    data = read_ensemble(tmp_path / "out")
    first, second = (data.statistic(f"controller_{k}", "printed", "mae")[:, 1] for k in (1, 2))
    kept = (data.status("controller_1", "printed") == 0) & (data.status("controller_2", "printed") == 0)
    (pair,) = [
        row
        for row in population["pairs"]
        if (row["reading"], row["run"], row["over"], row["joint"])
        == ("printed", "controller_1", "controller_2", 3)
    ]
    assert pair["arms"] == kept.sum()
    assert pair["share_smaller"] == pytest.approx((first < second)[kept].mean())
    assert pair["ratio"] == pytest.approx(np.quantile((first / second)[kept], 0.5, method="inverted_cdf"))
    panels = draw_pairs(found["populations"]["arms"], found["around"]["told"]).axes
    assert len(panels) == 3
    assert sum(line.get_marker() == "o" for line in panels[0].lines) == 6
    assert sum(line.get_marker() == "x" for line in panels[0].lines) == 6


@pytest.mark.parametrize("readings", ["hardware=drawn", "starts=apart", "motion=ramp"])
def test_readings_that_this_arm_cannot_have(compare: Path, readings: str) -> None:
    with pytest.raises(UsageError):
        load_study(compare, None, None, readings, 0.2)


def test_runs_of_all_controllers_are_needed(compare: Path) -> None:
    with pytest.raises(ConfigError):
        load_study(compare, ["runs={controller_1: {law: controller_1, payload: 0}}"], None, "default")


def plain(*given: Any) -> Any:
    """The paper's own command as if it were a user's, with the α of the new arm's comparison."""
    *signals, law = given
    return physics_command(*signals, law._replace(weights=estimator_weights(np.array([0.1]))))


def branching(*given: Any) -> Any:
    """The paper's own command, and a question about a number."""
    _, q, q_d, *_ = given
    assert bool(q_d[0] > q[0]) in {True, False}
    return plain(*given)


def broken(*given: Any) -> Any:
    raise ValueError(len(given))


def test_a_law_runs_on_the_same_arms(tmp_path: Path) -> None:
    """With the paper's own command, gains and weights, errors are those of Controller 1."""
    init_arm(1, tmp_path)
    config, short = (
        tmp_path / "compare.yaml",
        ["reference.rise=0.5", "reference.hold=0", "reference.periods=1"],
    )
    study = load_study(config, short, None, "default", 0.2, laws=laws_of({"plain": plain}))
    assert study.runs[-2:] == ("plain", "plain_payload")
    _, found = evaluated(study, np.arange(2))
    for own, other in (("controller_1", "plain"), ("controller_1_payload", "plain_payload")):
        places = [study.lookup[run, "printed"] for run in (own, other)]
        errors = found["mae"][:, places].swapaxes(0, 1)
        assert (errors[0] == errors[1]).all()
        assert (errors > 0.0).all()


@pytest.mark.parametrize("laws", [{"broken": broken}, {"branching": branching}, {"controller_2": plain}])
def test_a_law_that_cannot_run(compare: Path, laws: dict[str, Any]) -> None:
    with pytest.raises(TendonreproError):
        load_study(compare, None, None, "default", 0.2, laws=laws_of(laws))


def test_a_law_needs_an_arm_of_ones_own() -> None:
    with pytest.raises(UsageError):
        load_study(None, None, None, "default", laws=laws_of({"plain": plain}))
