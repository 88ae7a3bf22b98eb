"""Experiments predicted on plausible plants: what no plant enters comes out as the law says."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from support.command import answer

import tendonrepro as tr
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.ensemble import load_ensemble, load_plants
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.control import FIRST, RUNS, SECOND, THIRD
from tendonrepro.configuration.models.experiment import CompareRun
from tendonrepro.configuration.models.readings import Reading, named_readings, parse_reading, under
from tendonrepro.configuration.quantity import Moving
from tendonrepro.console import QUIET
from tendonrepro.evidence import predict
from tendonrepro.evidence.figure_predictions import draw_predictions
from tendonrepro.evidence.predict import (
    DOUBLED_PERIOD,
    EXPERIMENTS,
    READINGS,
    default_readings_on,
    experiments_on,
    gaps_between,
    law_in,
    predict_result,
    prediction_tables,
    with_alpha,
)
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.figures.style import Drawing
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import COMPILED_STEPPER, TOLERANCE
from tendonrepro.simulation.stepper import simulate
from tendonrepro.simulation.streaming import STATISTICS

LOADED = load_ensemble(None, overrides=["base.manipulator.encoders.joint.resolution=0"])
COMPARE = LOADED.compare
READINGS_OF = COMPARE.control.readings
LOOPS = dict(build_loops(COMPARE, LOADED.base.folder))
SLOWER = under(parse_reading("sampling_period=2ms"), COMPARE, {})
LOOPS[DOUBLED_PERIOD] = dict(build_loops(SLOWER, LOADED.base.folder))[FIRST]
BY_NAME = {one.name: one for one in EXPERIMENTS}
BOX = population_of(LOADED)


@pytest.mark.parametrize(("reading", "is_one"), [("printed", True), ("eta_in_controller_2=dropped", False)])
def test_alpha_0_is_controller_2_while_that_keeps_eta(reading: str, is_one: bool) -> None:
    config = under(parse_reading(reading), COMPARE, {})
    loops = dict(build_loops(config, LOADED.base.folder))
    both = [with_alpha(0.0, loops, config.control.readings), loops[SECOND]]
    changed, beside = simulate_batch(both).statistics["mae"]
    assert (changed == beside).all() == is_one


def test_what_is_changed_and_nothing_else() -> None:
    def changed(name: str) -> object:
        return BY_NAME[name].change(LOOPS, READINGS_OF)

    first = LOOPS[FIRST]
    assert changed("controllers_1_2") is first
    slow, alone, doubled = (changed(name) for name in ("half_speed", "joint_3_alone", "period_doubled"))
    assert slow.reference.q_d[::2] == pytest.approx(first.reference.q_d, abs=1e-12)
    rate = np.gradient(slow.reference.q_d, slow.L, axis=0)
    assert slow.reference.dq_d[1:-1] == pytest.approx(rate[1:-1], abs=1e-4)
    assert slow.reference.dq_d[::2] == pytest.approx(0.5 * first.reference.dq_d, abs=1e-5)
    assert not alone.reference.q_d[:, 0].any()
    assert (alone.reference.q_d[:, 1] == first.reference.q_d[:, 1]).all()
    assert (doubled.L, law_in(doubled).L) == (0.002, 0.002)
    for alpha in (0.2, 0.5):
        assert law_in(changed(f"alpha_{alpha:g}")).weights == pytest.approx(
            np.array([[1 - alpha] * 2, [alpha] * 2])
        )
    flat = law_in(changed("same_slope"))
    assert flat.eta * 1.1 * 0.2**-0.1 == pytest.approx(law_in(LOOPS[THIRD]).beta)
    assert (flat.rate_gain == flat.eta).all()
    assert law_in(changed("other_encoders")).motor_side
    assert law_in(LOOPS[SECOND]).weights[1].tolist() == [0.0, 0.0]


def test_a_repeat_shows_where_it_started_and_nothing_else() -> None:
    """Runs from one start are equal to the last bit. Starts a degree apart show in the first period alone."""
    loaded = load_config("plain", "compare")
    compare, folder = loaded.config, loaded.folder
    assert isinstance(compare, CompareConfig)
    at_rest = dict(build_loops(compare, folder))
    together = BY_NAME["repeat"].change(at_rest, READINGS_OF)
    apart = compare.model_copy(update={"runs": {**compare.runs, SECOND: _beside(compare.runs[SECOND])}})
    loops = dict(build_loops(apart, folder))
    elsewhere = BY_NAME["repeat"].change(loops, READINGS_OF)
    found = simulate_batch([loops[FIRST], together, elsewhere]).statistics
    first, same, other = found["mae"]
    assert (same == first).all()
    assert (abs(other / first - 1.0) > 0.02).all()
    assert found["mae_settled"][2] == pytest.approx(found["mae_settled"][0], rel=0.01)


def _beside(run: CompareRun) -> CompareRun:
    offset = Moving.model_validate({"value": [-1.0, -1.0], "unit": "deg", "source": "assumed: a test"})
    return run.model_copy(update={"start_offset": offset})


def test_ramps_keep_their_corners_at_half_the_speed() -> None:
    changed = ["reference.kind=ramp", "reference.rise=2.3", "reference.hold=1.5"]
    loaded = load_config("plain", "compare", overrides=changed)
    loops = dict(build_loops(loaded.config, loaded.folder))
    slow, first = BY_NAME["half_speed"].change(loops, READINGS_OF), loops[FIRST]
    assert not slow.reference.ddq_d.any()
    assert set(np.unique(slow.reference.dq_d)) == set(np.unique(0.5 * first.reference.dq_d))
    steps = np.diff(slow.reference.q_d, axis=0) / slow.L
    assert slow.reference.dq_d[:-1] == pytest.approx(steps, abs=1e-9)


@pytest.mark.parametrize("words", [("--draws", "4"), ("--draws", "1000000000"), ("--readings", "nonsense")])
def test_what_cannot_be_asked_is_refused(tmp_path: Path, words: tuple[str, str]) -> None:
    answer("predict", *words, "--dry-run", cwd=tmp_path, code=2)


def test_on_an_arm_of_ones_own_it_names_its_joints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    init_arm(1, tmp_path / "one")
    init_arm(4, tmp_path / "four")
    loaded = [load_plants(tmp_path / name / "compare.yaml", 0.2) for name in ("one", "four")]
    one, four = ({held.name: held.about for held in experiments_on(each)} for each in loaded)
    assert "joint_3_alone" not in one
    assert "joint_3_alone" in four
    assert "repeat" not in four
    assert "starts=apart" not in default_readings_on(loaded[0])
    kept = [held for held in EXPERIMENTS if held.name in ("alpha_0.2", "inertia_up")]
    monkeypatch.setattr(predict, "EXPERIMENTS", kept)
    config = tmp_path / "one" / "compare.yaml"
    changed = ["reference.periods=1", "manipulator.encoders.joint.resolution=0"]
    found = tr.predict(
        20, config=config, set=changed, spread=0.2, readings="printed", out=tmp_path / "out", formats="png"
    ).data
    assert found["around"] == {"arm": "my arm", "spread": 0.2}
    ratios = {held["name"]: held["ratios"] for held in found["experiments"]}
    for name, expected in (("alpha_0.2", 1.2), ("inertia_up", 1.0 / 1.1)):
        (row,) = ratios[name]
        assert (row["joint"], row["plants"]) == (1, 20)
        assert row["median"] == pytest.approx(expected, rel=0.03)


def test_at_twice_the_period_an_arm_of_ones_own_follows_the_same_motion(tmp_path: Path) -> None:
    init_arm(1, tmp_path / "one")
    loaded = load_plants(tmp_path / "one" / "compare.yaml", 0.2)
    arm = population_of(loaded)
    slower = Reading(DOUBLED_PERIOD, (("sampling_period", "2ms"),))
    cases = [(FIRST, parse_reading("printed")), (FIRST, slower)]
    ((first, doubled),) = arm.loops(arm.sample(1, 0, 0, 1), cases)
    assert (first.L, doubled.L) == (0.001, 0.002)
    assert doubled.reference.time == pytest.approx(first.reference.time[::2])
    assert doubled.reference.q_d == pytest.approx(first.reference.q_d[::2], abs=1e-12)


def sized(loops: Sequence[Loop], **_: int) -> Batch:
    """Errors of a thousand, the run's place and some of the plant's; without the start twice that."""
    runs = len(RUNS) + len(predict.EXPERIMENTS)
    sizes = 1000.0 + np.arange(len(loops)) % runs + 0.01 * (np.arange(len(loops)) // runs)
    errors = np.stack([sizes, sizes], axis=1)
    statistics = dict.fromkeys(STATISTICS, errors) | {"mae_settled": 2.0 * errors + 1.0}
    status = np.where(np.arange(len(loops)) == 0, STATUSES.index("diverged"), 0).astype(np.int8)
    return Batch(statistics, status, np.ones(len(loops)), np.full(len(loops), 2), None)


def test_a_ratio_is_that_of_its_two_runs_on_plants_where_both_are_stable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the first plant of each batch the first run diverges."""
    monkeypatch.setattr(predict, "simulate_batch", sized)
    found = list(predict.predictions(LOADED, named_readings("printed,feedback=motor"), 32, QUIET))
    rows = {(row["reading"], row["experiment"]): row for row in found if row["joint"] == 3}
    plants = {name: rows["printed", name]["plants"] for name in ("inertia_up", "controllers_2_3")}
    assert plants == {"inertia_up": 30, "controllers_2_3": 32}
    names = [one.name for one in EXPERIMENTS]
    place, low = (
        len(RUNS) + names.index("controllers_2_3_late"),
        rows["printed", "controllers_2_3_late"]["low"],
    )
    third = RUNS.index(THIRD)
    assert (2001.0 + 2 * place) / (2001.3 + 2 * third) <= low <= (2001.3 + 2 * place) / (2001.0 + 2 * third)
    # A motor's error is told as one.
    whose = {key: row["errors_of"] for key, row in rows.items()}
    assert whose["printed", "alpha_0.2"] == "joints"
    assert whose["feedback=motor", "alpha_0.2"] == "motors"
    assert whose["printed", "other_encoders"] == "motors over joints"
    assert whose["feedback=motor", "other_encoders"] == "joints over motors"


def test_the_estimates_age_and_the_inertia_set_the_ratios(monkeypatch: pytest.MonkeyPatch) -> None:
    """e = w L dH / (M_bar lam k): no plant enters."""
    expected = {f"alpha_{alpha:g}": (1.0 + alpha, 0.03) for alpha in (0.1, 0.3)}
    expected |= {"inertia_up": (1.0 / 1.1, 0.02), "same_slope": (1.0, 0.01)}
    monkeypatch.setattr(predict, "EXPERIMENTS", [BY_NAME[name] for name in expected])
    monkeypatch.setattr(predict, "LEAST", 5)
    found = list(predict.predictions(LOADED, named_readings("encoder=ideal"), 16, QUIET))
    assert len(found) == 2 * len(expected)
    for row in found:
        ratio, tolerance = expected[row["experiment"]]
        assert row["median"] == pytest.approx(ratio, rel=tolerance)


def test_a_ratio_is_that_of_scipys_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the other integrator, with errors from traces; two of five plants do not diverge."""
    monkeypatch.setattr(predict, "EXPERIMENTS", [BY_NAME["controllers_2_3_late"]])
    monkeypatch.setattr(predict, "LEAST", 2)
    rows = list(predict.predictions(LOADED, named_readings("encoder=ideal"), 5, QUIET))
    ratios = []
    for plant in BOX.sample(int(LOADED.config.seed.si), 0, 0, 5):
        config = under(parse_reading("encoder=ideal"), BOX.configured(plant), BOX.named(plant))
        loops = dict(build_loops(config, LOADED.base.folder))
        errors = [simulate(loops[run])["e"] for run in (SECOND, THIRD)]
        if all(len(e) == len(loops[SECOND].reference.time) for e in errors):
            ratios.append(np.divide(*(np.abs(e[2000:]).mean(axis=0) for e in errors)))
    low, high = np.sort(ratios, axis=0)
    expected = np.stack([0.5 * (low + high), 0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high], axis=1)
    assert [row["plants"] for row in rows] == [2, 2]
    np.testing.assert_allclose(
        [[row[name] for name in ("median", "low", "high")] for row in rows], expected, rtol=5e-4
    )


def test_killed_among_the_plants_it_goes_on_and_ends_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []

    def counting(loops: Sequence[Loop], **_: int) -> Batch:
        calls.append(len(loops))
        if len(calls) == deadly:
            raise KeyboardInterrupt
        return sized(loops)

    deadly = 0
    monkeypatch.setattr(predict, "simulate_batch", counting)
    asked = {"readings": "printed,weights=extrapolating", "figures": False}
    manifest = tr.predict(32, out=tmp_path / "whole", **asked).manifest
    assert manifest["solver"] == {"name": COMPILED_STEPPER, "tolerance": TOLERANCE}
    calls[:], deadly = [], 4
    with pytest.raises(KeyboardInterrupt):
        tr.predict(32, out=tmp_path / "killed", **asked)
    assert not (tmp_path / "killed" / "predict.json").exists()
    tr.predict(32, out=tmp_path / "killed", **asked)
    assert len(calls) == 5
    whole, killed = ((tmp_path / name / "predict.json").read_bytes() for name in ("whole", "killed"))
    assert whole == killed


def test_readings_are_told_apart_by_ranges_that_do_not_meet() -> None:
    def row(reading: str, joint: int, low: float, high: float) -> dict[str, object]:
        return {"reading": reading, "joint": joint, "low": low, "high": high}

    rows = [row("a", 2, 1.0, 1.2), row("b", 2, 1.1, 1.3), row("c", 2, 1.25, 1.4)]
    gaps = gaps_between(rows, ["a", "b", "c"])
    assert gaps == pytest.approx({("a", "b"): -0.1, ("a", "c"): 0.05, ("b", "c"): -0.05})
    other_joint = [row("a", 3, 1.0, 1.2), row("c", 3, 1.4, 1.5)]
    assert gaps_between([rows[0], rows[2], *other_joint], ["a", "c"])["a", "c"] == pytest.approx(0.2)
    unknown = gaps_between([rows[0], row("b", 2, np.nan, np.nan), rows[2]], ["a", "b", "c"])
    assert [*unknown] == [("a", "c")]


def test_tables_say_what_is_told_apart_and_nothing_where_too_few_plants_are_stable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(predict, "simulate_batch", sized)
    readings = named_readings("printed,weights=extrapolating")
    found = predict_result(LOADED, 32, readings, QUIET).data
    assert found["never_told_apart"] == [["printed", "weights=extrapolating"]]
    monkeypatch.setattr(predict, "LEAST", 40)
    found = predict_result(LOADED, 32, readings, QUIET).data
    assert found["never_told_apart"] == []
    (experiments,) = (
        table for table in prediction_tables(found) if getattr(table, "name", "") == "experiments"
    )
    assert {value for row in experiments.rows for key, value in row.items() if key != "experiment"} == {None}


def drawn_of(names: Sequence[str], joints: Sequence[int] = (2,)) -> Drawing:
    ratios = [
        {"reading": name, "joint": joint, "low": 0.3 * joint, "median": 0.4 * joint, "high": 0.45 * joint}
        for name in names
        for joint in joints
    ]
    return draw_predictions([{"about": one.about, "ratios": ratios} for one in EXPERIMENTS], names, joints)


def test_the_picture_shows_each_joint_and_tells_interpretations_and_experiments_apart() -> None:
    names = READINGS.split(",")
    drawn = drawn_of(names, (2, 3))
    (legend,) = drawn.figure.legends
    # A caption fits below it on a page of A4, and no code of an interpretation is left.
    assert drawn.figure.get_size_inches()[1] * 25.4 <= 245.0
    assert not [text.get_text() for text in legend.get_texts() if re.search(r"\w=|_", text.get_text())]
    for panel, joint in zip(drawn.axes, (2, 3), strict=True):
        _, span, middle = (list(line.get_xdata()) for line in panel.lines[:3])
        assert [*span, *middle] == pytest.approx([0.3 * joint, 0.45 * joint, 0.4 * joint])
    shown = drawn.axes[0].lines[1 : 1 + 2 * len(names)]
    for lines in (legend.get_lines(), shown[1::2]):
        looks = {(line.get_color(), line.get_marker(), line.get_markerfacecolor()) for line in lines}
        assert len(looks) == len(names)
    alone = drawn_of(["printed"])
    alone.figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in alone.axes[0].get_yticklabels()]
    assert not [pair for pair in itertools.pairwise(boxes) if pair[0].overlaps(pair[1])]
