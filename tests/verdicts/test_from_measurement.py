"""Claims on a measurement: the definitions are the ensemble's, and every verdict can go both ways."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.measured_synthetic import LOADED, measured_trace, printed_file
from support.synthetic import PERIOD, make_compare_file, make_decouple_file

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import published
from tendonrepro.dataset.windows import PrintedTables, Timing, try_windows
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.control import polynomial
from tendonrepro.verdicts.judge import judge_all
from tendonrepro.verdicts.measurement import (
    Measurement,
    decoupling,
    judge_measured,
    motor_angles,
    with_surface,
)
from tendonrepro.verdicts.statements import Plants
from tendonrepro.verdicts.words import statements


def comparison(sizes=None, **options):
    """SYNTHETIC comparison whose errors are one signal times a size a run."""
    file = make_compare_file(step=0.02, source="measured", **options)
    runs = {}
    for name, trace in file.runs.items():
        e = trace["e"] if sizes is None else sizes[name] * file.runs["controller_1"]["e"]
        runs[name] = measured_trace(trace, e=e)
    return replace(file, runs=runs)


def judged(file):
    """Without recovering the reference, which the tests of its own module do."""
    timing = {name: Timing(0.0, PERIOD) for name in file.part("compare").runs}
    paper = published()
    tables = try_windows(file.part("compare"), paper, timing)
    return judge_measured(Measurement(file, tables, None), paper)


def with_joint_1(trace):
    """The run with the encoder of joint 1 too, and of nothing else."""
    gap, rest = np.full((len(trace.time), 1), np.nan), np.zeros((len(trace.time), 1))
    variables = {
        name: np.hstack([rest if name == "q_encoder" else gap, values])
        for name, values in trace.variables.items()
    }
    return replace(trace, joint=(1, *trace.joint), variables=variables)


def with_run(file, run):
    return replace(file, runs={**file.runs, run.name: run})


def with_values(file, name, **variables):
    return with_run(file, measured_trace(file.runs[name], **variables))


def without(trace, *names):
    return replace(trace, variables={name: v for name, v in trace.variables.items() if name not in names})


def verdict(file, claim):
    return judged(file)[claim].verdict


DECOUPLE_FILE = make_decouple_file(source="measured")
DECOUPLED = DECOUPLE_FILE.runs["decouple"]
EMPTY = PrintedTables((), {}, 0.0)
RUNS = ("controller_1", "controller_2", "controller_3")
NO_MOTION = {"without": ("q_d", "dq_d", "ddq_d")}
NO_ERRORS = "the measured errors of controller_1, joint 2"
NOT_ZERO = "an error of controller_1, joint 2 that is not zero"
GROWING = {"controller_1": 1.0, "controller_2": 1.2, "controller_3": 1.5, LOADED: 1.1}
NO_ERROR = {"sizes": GROWING | {"controller_1": 0.0}}


class TestComparison:
    def test_the_order_holds_and_fails_when_reversed(self):
        assert verdict(comparison(GROWING), "C2") == "reproduced"
        reverse = GROWING | {"controller_1": 1.5, "controller_3": 1.0}
        found = judged(comparison(reverse))["C2"]
        assert found.verdict == "not_reproduced"
        assert sum(not row["holds"] for row in found.evidence["statements"]) == 8

    def test_stability_is_the_status_of_the_runs(self):
        assert verdict(comparison(), "C1") == "reproduced"
        found = judged(comparison(diverged={"controller_3": 7.0}))["C1"]
        assert found.verdict == "not_reproduced"
        (remark,) = found.evidence["remarks"]
        assert "controller_3" in remark

    @pytest.mark.parametrize(
        ("claim", "options", "missing"),
        [
            ("C2", {"diverged": {"controller_3": 7.0}}, ".*controller_3.*diverged.*"),
            ("C5", {"without": ("H_hat",)}, "H_hat of the run controller_1.*"),
            ("C6", {"without": ("tau_m",)}, ".*tau_m.*"),
            ("C3", NO_MOTION, ".*q_d"),
            ("P1", {"diverged": {LOADED: 7.0}}, f".*a run of {LOADED} that is ok.*"),
            ("C4", {"runs": RUNS[:2]}, "a measured run controller_3"),
            # The row without load is Controller 1.
            ("table3.no_load.mae.joint_2", {"runs": RUNS[1:2]}, NO_ERRORS),
            ("share.controller_1_of_2.mae.joint_2", {"runs": RUNS[1:2]}, NO_ERRORS),
            ("rmse_over_mae.controller_1.joint_2", NO_ERROR, NOT_ZERO),
            ("increase.with_load.mae.joint_2", NO_ERROR, NOT_ZERO),
        ],
    )
    def test_what_lacks_is_named(self, claim, options, missing):
        found = judged(comparison(**options))[claim]
        assert found.verdict == "not_testable"
        assert re.fullmatch(missing, found.evidence["missing"])

    def test_a_surface_that_is_computed_is_not_compared_with_one_that_was_recorded(self):
        file = comparison()
        lacking = without(file.runs["controller_3"], "s", "e")
        bare = replace(file, runs={name: without(trace, "s") for name, trace in file.runs.items()})
        for held, message in ((file, "^s of all controllers"), (bare, "^s or e of the run controller_3")):
            arm = Plants(Measurement(with_run(held, lacking), EMPTY, None), PRINTED)
            with pytest.raises(DataMissingError, match=message):
                arm["controller_3", "s_rms"]

    def test_joint_1_at_rest_without_a_desired_angle_changes_nothing(self):
        file = replace(comparison(GROWING), plant=make_decouple_file().plant)
        runs = {name: with_joint_1(trace) for name, trace in file.runs.items()}
        two, three = judged(file), judged(replace(file, runs=runs))
        assert two["K5"].verdict != "not_testable"
        assert all(one.verdict == two[name].verdict for name, one in three.items())
        assert three["C5"].evidence["statements"] == two["C5"].evidence["statements"]

    @pytest.mark.parametrize(("claim", "joint"), [("C1", 2), ("C2", 3), ("C4", 3), ("C6", 3), ("P1", 2)])
    def test_a_joint_that_was_not_recorded_is_no_failure(self, claim, joint):
        """All compare numbers, and what is missing is smaller than none."""
        variable = {"C4": "s", "C6": "tau_m"}.get(claim, "e")
        file = comparison(GROWING)
        name = LOADED if claim == "P1" else "controller_2"
        gone = file.runs[name][variable].copy()
        gone[:, joint - 2] = np.nan
        found = judged(with_values(file, name, **{variable: gone}))[claim]
        assert found.verdict == "not_testable"
        assert f"of the run {name}, joint {joint}" in found.evidence["missing"]
        assert found.evidence["missing"].startswith(variable)

    @pytest.mark.parametrize(("factor", "alike"), [(1.005, True), (1.1, False)])
    def test_steps_of_the_torque_are_compared_between_equal_samplings_alone(self, factor, alike):
        file = comparison()
        one = file.runs["controller_2"]
        found = judged(with_run(file, replace(one, time=factor * one.time)))
        assert ("missing" not in found["C6"].evidence) is alike
        assert "missing" not in found["C5"].evidence

    def test_a_run_of_one_joint_or_without_its_error_says_nothing_of_stability(self):
        file = comparison()
        one = file.runs["controller_2"]
        single = replace(one, joint=(2,), variables={name: v[:, :1] for name, v in one.variables.items()})
        bare = replace(one, variables={"q_d": one["q_d"]})
        for run in (single, bare):
            found = judged(with_run(file, run))["C1"]
            assert "of the run controller_2" in found.evidence["missing"]

    def test_the_payload_is_its_percentages_and_needs_controller_1_alone(self):
        found = judged(comparison(GROWING))["P1"]
        assert found.verdict == "not_reproduced"
        assert all(row["holds"] for row in found.evidence["statements"])
        assert set(found.evidence["percentages"].values()) == {"not_reproduced"}
        whole = printed_file(lambda time: time < np.inf)
        kept = {name: whole.runs[name] for name in ("controller_1", LOADED)}
        assert verdict(replace(whole, runs=kept), "P1") == "reproduced"


def test_the_printed_numbers_are_reproduced_with_all_percentages():
    file = printed_file(lambda time: time < np.inf)
    found = judged(file)
    families = ("table2.", "table3.", "rmse_over_mae.", "share.", "increase.")
    numbers = {name: one.verdict for name, one in found.items() if name.startswith(families)}
    assert len(numbers) == 40
    assert set(numbers.values()) == {"reproduced"}
    assert {found[name].verdict for name in ("P1", "C2", "F1")} == {"reproduced"}
    assert found["C2"].evidence["window"] == "whole"
    assert found["C2"].evidence["statistics"]["controller_1"]["mae_deg"] == pytest.approx(
        [0.261, 0.219], abs=5e-4
    )
    for factor in (0.9, 1.1):
        runs = {name: measured_trace(trace, e=factor * trace["e"]) for name, trace in file.runs.items()}
        assert verdict(replace(file, runs=runs), "table2.controller_1.mae.joint_2") == "not_reproduced"


def decoupled(trace=DECOUPLED, **variables):
    return replace(DECOUPLE_FILE, runs={"decouple": measured_trace(trace, **variables)})


class TestAngles:
    @pytest.mark.parametrize(("desired", "measured"), [(1.0, np.nan), (0.0, 0.0)], ids=["lost", "still"])
    def test_k3_and_k5_need_samples_of_what_moves(self, desired, measured):
        file = make_compare_file(step=0.02, source="measured", runs=("controller_2",))
        trace = file.runs["controller_2"]
        run = measured_trace(trace, q_d=desired * trace["q_d"], q_encoder=measured * trace["q_d"])
        with pytest.raises(DataMissingError):
            motor_angles(replace(file, runs={"controller_2": run}))
        still = decoupled(q_encoder=0.0 * DECOUPLED["q"])
        for runs in ({}, still.runs):
            with pytest.raises(DataMissingError):
                decoupling(replace(still, runs=runs))

    def on_ranges(self, sizes_deg, ranges_deg):
        """SYNTHETIC decoupling run with an MAE and a range of a size a joint, at angles far from zero."""
        moves = DECOUPLED["q_encoder"] / np.ptp(DECOUPLED["q_encoder"], axis=0)
        encoder = np.deg2rad(ranges_deg) * moves + np.deg2rad([100.0, -150.0, 50.0])
        apart = np.deg2rad(sizes_deg) * (DECOUPLED.time > 0.1)[:, np.newaxis]
        encoder[7, 1] = apart[8, 2] = np.nan
        return decoupled(q_encoder=encoder, q_calculated=encoder + apart)

    @pytest.mark.parametrize("share", [0.049, 0.051])
    def test_k5_is_the_mae_of_each_motor_over_the_largest_range(self, share):
        file = make_compare_file(step=0.02, source="measured", runs=("controller_2",))
        trace = file.runs["controller_2"]
        S_inv = file.plant.matrix("S_inv", trace.joint)
        apart = np.ptp(trace["q_d"] @ S_inv.T, axis=0).max() * np.array([0.5 * share, -share])
        q_encoder = trace["q_d"] + apart @ np.linalg.inv(S_inv).T
        q_encoder[8:10, 1] = np.nan
        run = measured_trace(trace, q_encoder=q_encoder)
        rows = motor_angles(replace(file, runs={"controller_2": run})).evidence["statements"]
        assert [row["share_of_range"] for row in rows] == pytest.approx([0.5 * share, share], rel=1e-9)
        assert [row["mae_deg"] for row in rows] == pytest.approx(np.rad2deg(np.abs(apart)), rel=1e-9)
        assert [row["holds"] for row in rows] == [True, share < 0.05]

    @pytest.mark.parametrize(
        ("sizes_deg", "held"),
        [
            ((0.39, 0.3, 0.9), [True, True, True]),
            ((0.30, 0.9, 0.5), [False, True, True]),
            ((0.42, 0.5, 0.9), [True, False, True]),
            ((0.30, 1.1, 1.2), [True, True, False]),
            ((0.30, 0.5, 3.1), [True, True, False]),
        ],
    )
    def test_k3_is_the_mae_over_the_range_of_each_joint(self, sizes_deg, held):
        ranges_deg = (40.0, 20.0, 60.0)
        judgement = decoupling(self.on_ranges(sizes_deg, ranges_deg))
        assert judgement.verdict == ("reproduced" if all(held) else "not_reproduced")
        found = judgement.evidence
        assert found["mae_deg"] == pytest.approx(sizes_deg, rel=5e-3)
        assert found["share_of_range"] == pytest.approx(np.divide(sizes_deg, ranges_deg), rel=5e-3)
        assert [row["holds"] for row in found["statements"]] == held

    def test_the_start_offset_is_the_median_of_the_first_tenth_of_a_second(self):
        apart = np.deg2rad([0.1, 0.2, 0.4]) * (2.0 + np.sin(DECOUPLED.time))[:, np.newaxis]
        level = np.median(apart[DECOUPLED.time <= 0.1], axis=0)
        found = decoupling(decoupled(q_calculated=DECOUPLED["q_encoder"] + apart)).evidence
        # Those that nobody recorded follow from the motors.
        bare = decoupled(without(DECOUPLED, "q_calculated"))
        assert decoupling(bare).evidence == decoupling(DECOUPLE_FILE).evidence
        assert found["mae_deg"] == pytest.approx(np.rad2deg(np.abs(apart - level).mean(axis=0)), rel=1e-9)


def test_k3_and_k5_take_the_measured_verdict_and_others_keep_theirs():
    compare = comparison(GROWING)
    both = replace(compare, experiment="both", runs={**compare.runs, "decouple": DECOUPLED})
    only = ["K3", "K5", "C2", "table2.controller_1.mae.joint_2", "K1"]
    found = {one.id: one for one in judge_all(measured=both, only=only)}
    assert {found["K3"].verdict, found["K5"].verdict} <= {"reproduced", "not_reproduced"}
    assert found["C2"].verdict == "not_testable"
    assert found["C2"].evidence["measured"]["verdict"] == "reproduced"
    assert found["table2.controller_1.mae.joint_2"].evidence["measured"]["window"] == "whole"
    assert "measured" not in found["K1"].evidence
    # The report shows each part of a claim that measured data alone decide.
    for name in ("K3", "K5"):
        shown = [on.startswith("not") for _, on in statements(found[name])]
        assert shown == [not part["holds"] for part in found[name].evidence["statements"]]
        assert shown


class TestSurface:
    """The sliding variable of a measured run, where it was not recorded."""

    def bare(self, run, time, e):
        """A run of which nothing but the error was recorded."""
        trace = make_compare_file(step=0.05, periods=1).runs[run]
        return replace(trace, time=time, variables={"e": e})

    @pytest.mark.parametrize(("name", "beta"), [("controller_1", None), ("controller_3", 2.0)])
    def test_it_follows_from_the_error_by_eq_11(self, name, beta):
        trace = make_compare_file(step=0.05, periods=1).runs[name]
        e = trace["e"]
        gamma_1, gamma_2 = polynomial(0.9, 0.2)
        surface = beta * e if beta else 1.5 * (gamma_1 * e + gamma_2 * np.abs(e) * e)
        expected = (e[2:] - e[:-2]) / 0.1 + surface[1:-1]
        found = with_surface(self.bare(name, trace.time, e))["s"]
        assert np.isnan(found[[0, -1]]).all()
        assert found[1:-1] == pytest.approx(expected, rel=1e-9, abs=1e-12)
        assert np.isnan(with_surface(self.bare(name, trace.time[:1], e[:1]))["s"]).all()

    @pytest.mark.parametrize("step", [0.001, 0.008, 0.015, 0.025])
    def test_its_rate_is_taken_over_the_same_time_whatever_the_sampling(self, step):
        time = step * np.arange(round(3.0 / step))
        e = 0.01 * np.sin(7.0 * time)[:, np.newaxis] * np.ones(2)
        rate = with_surface(self.bare("controller_3", time, e))["s"] - 2.0 * e
        expected = 0.01 * (np.sin(7.0 * (time + 0.025)) - np.sin(7.0 * (time - 0.025))) / 0.05
        inside = (time > 0.03) & (time < time[-1] - 0.03)
        assert np.abs(rate[inside, 0] - expected[inside]).max() < 0.01 * 0.07
