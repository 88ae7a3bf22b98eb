"""Residuals of a rerun, what departs from its motion, and signs in what is told of a measurement."""

from dataclasses import replace

import numpy as np
import pytest
from support.measured_synthetic import measured_trace, with_runs
from support.synthetic import COUNT, make_compare_file, make_decouple_file

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.reference import read_samples
from tendonrepro.configuration.published import published
from tendonrepro.console import QUIET
from tendonrepro.dataset.motion import recorded, thinned
from tendonrepro.results.records import Trace
from tendonrepro.validation.validated import (
    aligned,
    comparison_rows,
    reruns,
    start_rows,
    write_compare,
    write_decouple,
)
from tendonrepro.verdicts.measurement import measurement_of

STEP = 0.005
MOVES = make_compare_file(step=STEP, source="measured")
"""SYNTHETIC: joints 2 and 3 move together, all runs alike."""
FIRST, SECOND = "controller_1", "controller_2"


class TestLag:
    """Of two encoders, one 5 ms behind the other."""

    LATE = 0.005

    def pair(self, amplitude, period):
        time = 0.001 * np.arange(10001)
        rate = 2.0 * np.pi / period

        def at(time):
            return np.repeat(amplitude * np.sin(rate * time)[:, np.newaxis], 2, axis=1)

        attributes = {"status": "ok"}
        model = {"q_encoder": COUNT * np.round(at(time) / COUNT)}
        ours = {"q_encoder": COUNT * np.round(at(time - self.LATE) / COUNT)}
        return Trace(FIRST, time, (2, 3), ours, attributes), Trace(FIRST, time, (2, 3), model, attributes)

    @pytest.mark.parametrize(("period", "amplitude_deg"), [(1.0, 30.0), (10.0, 5.0)])
    def test_slow_motion_on_an_encoders_steps_has_its_lag(self, period, amplitude_deg):
        ours, model = self.pair(np.deg2rad(amplitude_deg), period)
        for late, early in zip(comparison_rows(ours, model), comparison_rows(model, ours), strict=True):
            assert late["lag_s"] == pytest.approx(self.LATE, rel=0.05)
            assert early["lag_s"] == pytest.approx(-self.LATE, rel=0.05)

    def test_an_encoder_that_starts_elsewhere_is_not_late(self):
        """Over a part of a period the rate has a mean, and an offset would look like a lag."""
        ours, model = self.pair(np.deg2rad(10.0), 5.0)
        elsewhere = {"q_encoder": ours["q_encoder"][:1667] + np.deg2rad(1.0)}
        for row in comparison_rows(replace(ours, time=ours.time[:1667], variables=elsewhere), model):
            assert row["lag_s"] == pytest.approx(self.LATE, rel=0.05)


class TestSizes:
    """Of two runs that differ by known amounts."""

    TIME = 0.01 * np.arange(200.0)
    WAVE = np.column_stack([np.sin(TIME), np.cos(3.0 * TIME)])

    def run(self, **variables):
        return Trace(FIRST, self.TIME, (2, 3), variables, {"status": "ok"})

    def test_what_the_motors_say_is_compared_by_its_mean(self):
        apart = np.deg2rad([1.0, -2.0]) * (2.0 + self.WAVE)
        ours = self.run(q_encoder=self.WAVE, q_calculated=self.WAVE - apart)
        exact = self.run(q_encoder=self.WAVE, q_calculated=self.WAVE)
        for column, row in enumerate(comparison_rows(ours, exact)):
            size = np.rad2deg(np.abs(apart[:, column]).mean())
            assert row["measured_calculated_mae_deg"] == pytest.approx(size)
            assert row["simulated_calculated_mae_deg"] == 0.0

    def test_no_error_has_no_ratio_and_a_constant_one_no_correlation(self):
        ours, none = self.run(e=0.0 * self.WAVE + 0.1), self.run(e=0.0 * self.WAVE)
        for row in comparison_rows(ours, none):
            assert row["mae_ratio"] is row["e_correlation"] is None
        for row in comparison_rows(self.run(e=-1e-4 * self.WAVE), self.run(e=2e-4 * self.WAVE)):
            assert row["e_correlation"] == pytest.approx(-1.0)
            assert row["mae_ratio"] == pytest.approx(0.5)
            size = 1e-4 * np.rad2deg(np.abs(self.WAVE[:, row["joint"] - 2]).mean())
            assert row["measured_mae_deg"] == pytest.approx(size)
            assert row["simulated_mae_deg"] == pytest.approx(2.0 * size)

    @pytest.mark.parametrize("name", ["e", "q_encoder"])
    def test_they_are_mean_root_mean_square_and_largest(self, name):
        apart = np.deg2rad([1.0, 2.0]) * (1.0 + self.WAVE)
        rows = comparison_rows(self.run(**{name: self.WAVE + apart}), self.run(**{name: self.WAVE}))
        letter = name[0]
        for column, row in enumerate(rows):
            size = np.rad2deg(np.abs(apart[:, column]))
            assert row[f"{letter}_samples"] == 200
            assert row[f"{letter}_mae_deg"] == pytest.approx(size.mean())
            assert row[f"{letter}_rms_deg"] == pytest.approx(np.sqrt((size**2).mean()))
            assert row[f"{letter}_max_deg"] == pytest.approx(size.max())

    def test_what_only_one_of_them_recorded_is_left_out(self):
        for row in comparison_rows(self.run(e=self.WAVE, q_encoder=self.WAVE), self.run(q_d=self.WAVE)):
            assert row == {"run": FIRST, "joint": row["joint"], "status": "ok"}


def test_a_run_starts_with_the_error_that_it_has_when_its_motion_begins():
    """Whatever it did before, and also where a sample is missing."""
    e = np.deg2rad([[9.0, 9.0], [1.5, -0.5], [np.nan, -0.25], [7.0, 7.0]])
    run = Trace(FIRST, np.array([0.0, 0.1, 0.2, 0.3]), (2, 3), {"e": e}, {})
    assert [(row["joint"], row["error_deg"]) for row in start_rows(run, 0.21)] == [
        (2, pytest.approx(1.5)),
        (3, pytest.approx(-0.25)),
    ]
    assert [row["error_deg"] for row in start_rows(run, -1.0)] == [None, None]
    assert [*start_rows(replace(run, variables={}), 0.2)] == []


@pytest.fixture(scope="module", name="measured")
def _measured():
    return measurement_of(MOVES, published())


def test_only_what_the_simulation_reached_is_compared():
    model = make_compare_file(step=0.01, diverged={FIRST: 5.0}).runs[FIRST]
    (row, _) = comparison_rows(measured_trace(make_compare_file(step=0.01).runs[FIRST]), model)
    assert row["q_samples"] == len(model.time)
    assert row["status"] == "diverged"


def test_what_was_not_measured_is_not_moved():
    trace = MOVES.runs[FIRST]
    start = trace["q_d"] + np.array([0.2, np.nan])
    single = replace(trace, joint=(2,), variables={"q_d": start[:, :1]})
    for ours in (measured_trace(trace, q_d=start), single):
        found = aligned(trace, ours, 3.0)
        assert found.time[0] == 3.0
        for name in ("q_d", "q_encoder"):
            np.testing.assert_allclose(found[name] - trace[name], [[0.2, 0.0]] * len(trace.time), atol=1e-12)
        np.testing.assert_array_equal(found["e"], trace["e"])
    bare = aligned(trace, measured_trace(replace(trace, variables={"e": trace["e"]})), 0.0)
    np.testing.assert_array_equal(bare["q_d"], trace["q_d"])


def test_a_mass_that_is_the_configurations_keeps_its_source(measured, tmp_path):
    base, second = load_config(None, "compare"), MOVES.runs[SECOND]
    heavy = replace(second, attributes=dict(second.attributes) | {"payload_mass": 0.25})
    write_compare(
        replace(measured, file=with_runs(MOVES, controller_2=heavy)), base, "SYNTHETIC.h5", tmp_path
    )
    runs, found = (
        dict(one.tree["runs"]) for one in (base, load_config(tmp_path / "compare.yaml", "compare"))
    )
    changed = found.pop(SECOND)["payload"]
    assert changed["value"] == 0.25
    assert "SYNTHETIC.h5" in changed["source"]
    assert runs.pop(SECOND)
    assert found == runs


def test_why_there_is_no_rerun_is_said(tmp_path):
    def missing_of(file):
        measured, base = measurement_of(file, published()), load_config(None, "compare")
        return reruns(measured, base, "SYNTHETIC.h5", tmp_path, QUIET)[1]

    trace = MOVES.runs[FIRST]
    for factor, why in ((0.0, "q_d does not move"), (-4.0, "deg")):
        file = replace(MOVES, runs={FIRST: measured_trace(trace, q_d=factor * trace["q_d"])})
        assert [why in text for text in missing_of(file)] == [True]


@pytest.mark.parametrize(("drives", "variable"), [("motors", "q_motor_encoder"), ("joints", "q_encoder")])
def test_the_decoupling_motion_is_that_of_what_was_recorded(drives, variable, tmp_path):
    file = make_decouple_file(step=0.2, source="measured")
    trace = file.runs["decouple"]
    kept = {name: trace[name] for name in ("q_encoder", variable)}
    measured = measurement_of(with_runs(file, decouple=replace(trace, variables=kept)), published())
    changed = ["manipulator.gravity=9.7", "seed=5", "reference.periods=2"]
    base = load_config(None, "compare", overrides=changed)
    write_decouple(measured, base, "SYNTHETIC.h5", tmp_path)
    knots = thinned(recorded(trace, variable))
    time, angles = read_samples(tmp_path / "decouple_reference.csv")
    for place, joint in enumerate(trace.joint):
        assert angles[joint] == pytest.approx(knots.angle[:, place], abs=1e-8)
    assert time == pytest.approx(knots.time, abs=1e-8)
    tree = load_config(tmp_path / "decouple.yaml", "decouple").tree
    assert (tree["manipulator"]["gravity"]["value"], tree["seed"]["value"]) == (9.7, 5)
    (found,) = tree["runs"].values()
    assert found["drives"] == drives
    assert found["reference"] == {"kind": "sampled", "file": "decouple_reference.csv"}
    assert found["payload"] == load_config(None, "decouple").tree["runs"]["decouple"]["payload"]
