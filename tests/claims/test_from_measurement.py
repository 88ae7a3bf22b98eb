"""Claims on a measurement: the definitions are the ensemble's, and every verdict can go both ways."""

from dataclasses import replace

import numpy as np
import pytest
from support import ROOT
from support.measured_synthetic import LOADED, measured_trace, printed_file
from support.synthetic import PERIOD, make_compare_file, make_decouple_file

from tendonrepro.claims.command import run_claims
from tendonrepro.claims.from_measurement import (
    AGREES,
    LEAST_RANGE,
    TINY,
    Measured,
    OneArm,
    decoupling,
    judge_measured,
    measured_of,
    motor_angles,
)
from tendonrepro.claims.judge import Sources, judge_all
from tendonrepro.claims.report import table_text
from tendonrepro.claims.run_statistics import sliding_variable, statistics_of
from tendonrepro.config.models.readings import PRINTED
from tendonrepro.config.published import published
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import read_measured
from tendonrepro.dataset.motion.windows import SPREAD, PrintedTables, Timing, try_windows
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.traces import write_traces


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
    return judge_measured(Measured(file, tables, None), paper)


def with_joint_1(trace):
    """The run with the encoder of joint 1 too, and of nothing else."""
    gap, rest = np.full((len(trace.time), 1), np.nan), np.zeros((len(trace.time), 1))
    variables = {
        name: np.hstack([rest if name == "q_encoder" else gap, values])
        for name, values in trace.variables.items()
    }
    return replace(trace, joint=(1, *trace.joint), variables=variables)


def verdict(file, claim):
    return judged(file)[claim].decision.verdict


EMPTY = PrintedTables((), {}, 0.0)
GROWING = {"controller_1": 1.0, "controller_2": 1.2, "controller_3": 1.5, LOADED: 1.1}


class TestComparison:
    def test_the_order_holds_and_fails_when_reversed(self):
        assert verdict(comparison(GROWING), "C2") == "reproduced"
        reverse = GROWING | {"controller_1": 1.5, "controller_3": 1.0}
        found = judged(comparison(reverse))["C2"]
        assert found.decision.verdict == "not_reproduced"
        assert sum(not row["holds"] for row in found.evidence["statements"]) == 8

    def test_stability_is_the_status_of_the_runs(self):
        assert verdict(comparison(), "C1") == "reproduced"
        assert verdict(comparison(diverged={"controller_3": 7.0}), "C1") == "not_reproduced"

    def test_laws_that_are_not_ok_are_not_compared(self):
        found = judged(comparison(diverged={"controller_3": 7.0}))["C2"]
        assert found.decision.verdict == "not_testable"
        assert "controller_3" in found.evidence["missing"]
        assert "diverged" in found.evidence["missing"]

    @pytest.mark.parametrize(("claim", "variable"), [("C5", "H_hat"), ("C6", "tau_m")])
    def test_a_signal_that_was_not_recorded_is_named(self, claim, variable):
        assert verdict(comparison(), claim) in {"reproduced", "not_reproduced"}
        found = judged(comparison(without=(variable,)))[claim]
        assert found.decision.verdict == "not_testable"
        assert variable in found.evidence["missing"]

    def test_what_no_run_recorded_is_said_of_all(self):
        missing = judged(comparison(without=("H_hat",)))["C5"].evidence["missing"]
        assert missing == "H_hat of the runs controller_1, controller_2, controller_3"

    def test_what_one_run_recorded_too_little_of_is_said_of_it(self):
        file = comparison()
        few = {name: file.runs["controller_2"][name].copy() for name in ("q_d", "dq_d", "ddq_d")}
        for values in few.values():
            values[5:] = np.nan
        runs = dict(file.runs) | {"controller_2": measured_trace(file.runs["controller_2"], **few)}
        missing = judged(replace(file, runs=runs))["C5"].evidence["missing"]
        assert missing == "q_d of the run controller_2"

    def test_what_a_surface_is_computed_from_is_named_where_it_lacks(self):
        file = comparison()
        one = file.runs["controller_3"]
        kept = {name: values for name, values in one.variables.items() if name not in ("s", "e")}
        arm = OneArm(
            Measured(replace(file, runs={**file.runs, one.name: replace(one, variables=kept)}), EMPTY, None)
        )
        with pytest.raises(DataMissingError, match=r"^s of all controllers"):
            arm.statistic(one.name, PRINTED, "s_rms")
        bare = {
            name: replace(trace, variables={k: v for k, v in trace.variables.items() if k != "s"})
            for name, trace in file.runs.items()
        }
        bare[one.name] = replace(one, variables=kept)
        arm = OneArm(Measured(replace(file, runs=bare), EMPTY, None))
        with pytest.raises(DataMissingError, match=r"^s or e of the run controller_3$"):
            arm.statistic(one.name, PRINTED, "s_rms")

    def test_the_numbers_behind_the_statements_are_kept(self):
        found = judged(comparison(GROWING))["C2"].evidence["statistics"]
        first, second = found["controller_1"]["mae"], found["controller_2"]["mae"]
        assert second == pytest.approx(1.2 * np.array(first))
        assert len(first) == 2

    @pytest.mark.parametrize("claim", ["C3", "C5", "C6"])
    def test_phases_need_the_desired_angles(self, claim):
        found = judged(comparison(without=("q_d", "dq_d", "ddq_d")))
        assert found[claim].evidence["missing"].startswith("q_d of the run")
        assert found["C2"].decision.verdict != "not_testable"

    def test_joint_1_at_rest_without_a_desired_angle_changes_nothing(self):
        file = replace(comparison(GROWING), plant=make_decouple_file().plant)
        runs = {name: with_joint_1(trace) for name, trace in file.runs.items()}
        two, three = judged(file), judged(replace(file, runs=runs))
        assert two["K5"].decision.verdict != "not_testable"
        assert {name: one.decision.verdict for name, one in three.items()} == {
            name: one.decision.verdict for name, one in two.items()
        }
        assert three["C5"].evidence["statements"] == two["C5"].evidence["statements"]

    def test_the_payload_claim_is_about_its_own_runs(self):
        found = judged(comparison(diverged={"controller_2": 7.0}))["P1"]
        assert found.decision.verdict != "not_testable"
        found = judged(comparison(diverged={"controller_2": 7.0, LOADED: 7.0}))["P1"]
        assert f"a run of {LOADED} that is ok" in found.evidence["missing"]

    @pytest.mark.parametrize("joint", [2, 3])
    @pytest.mark.parametrize("claim", ["C1", "C2", "C3", "C4", "C5", "C6", "P1"])
    def test_a_joint_that_was_not_recorded_is_no_failure(self, claim, joint):
        """All compare numbers, and what is missing is smaller than none."""
        variable = {"C4": "s", "C5": "H_hat", "C6": "tau_m"}.get(claim, "e")
        file = comparison(GROWING)
        name = LOADED if claim == "P1" else "controller_2"
        gone = file.runs[name][variable].copy()
        gone[:, joint - 2] = np.nan
        runs = dict(file.runs) | {name: measured_trace(file.runs[name], **{variable: gone})}
        found = judged(replace(file, runs=runs))[claim]
        assert found.decision.verdict == "not_testable"
        assert name in found.evidence["missing"]
        assert found.evidence["missing"].startswith((variable, "the measured error", "the tracking error"))

    def test_a_joint_alone_still_has_its_numbers(self):
        file = printed_file(lambda time: time >= 0.0)
        runs = {}
        for name, trace in file.runs.items():
            e = trace["e"].copy()
            e[:, 1] = np.nan
            runs[name] = measured_trace(trace, e=e)
        found = judged(replace(file, runs=runs))
        assert found["table2.controller_1.mae.joint_2"].decision.verdict == "reproduced"
        assert found["table2.controller_1.mae.joint_3"].decision.verdict == "not_testable"
        tables = try_windows(replace(file, runs=runs), published(), dict.fromkeys(runs, Timing(0.0, 0.0)))
        assert tables.compared == 8
        assert tables.winner is not None

    def test_recorded_and_computed_surfaces_are_not_mixed(self):
        file = comparison(GROWING)
        trace = file.runs["controller_3"]
        bare = replace(trace, variables={k: v for k, v in trace.variables.items() if k != "s"})
        found = judged(replace(file, runs=dict(file.runs) | {"controller_3": bare}))["C4"]
        assert found.decision.verdict == "not_testable"
        assert "computed" in found.evidence["missing"]

    @pytest.mark.parametrize("step", [0.001, 0.01])
    def test_a_computed_surface_is_that_of_the_error_and_not_of_the_encoder(self, step):
        """Errors three and ten times as large are no similar surfaces, whatever the sampling."""
        time = step * np.arange(round(12.0 / step))
        wave = np.deg2rad(0.3) * np.sin(2.0 * np.pi * 0.4 * time)[:, np.newaxis] * np.ones(2)
        count = np.deg2rad(0.022)
        sizes = []
        for factor in (1.0, 3.0, 10.0):
            e = count * np.round(factor * wave / count)
            run = make_compare_file(runs=("controller_2",)).runs["controller_2"]
            bare = replace(measured_trace(run), time=time, variables={"e": e})
            sizes.append(statistics_of(bare, None)["s_rms"])
        assert sizes[1] / sizes[0] == pytest.approx(3.0, rel=0.05)
        assert sizes[2] / sizes[0] == pytest.approx(10.0, rel=0.05)

    @pytest.mark.parametrize("step", [0.001, 0.008, 0.01, 0.015, 0.025])
    def test_its_rate_is_taken_over_the_same_time_whatever_the_sampling(self, step):
        time = step * np.arange(round(3.0 / step))
        e = 0.01 * np.sin(7.0 * time)[:, np.newaxis] * np.ones(2)
        run = make_compare_file(runs=("controller_3",)).runs["controller_3"]
        found = sliding_variable(replace(measured_trace(run), time=time, variables={"e": e}))
        assert found is not None
        rate = found - 2.0 * e
        expected = 0.01 * (np.sin(7.0 * (time + 0.025)) - np.sin(7.0 * (time - 0.025))) / 0.05
        inside = (time > 0.03) & (time < time[-1] - 0.03)
        assert np.abs(rate[inside, 0] - expected[inside]).max() < 0.01 * 0.07
        assert np.isnan(found[[0, -1]]).all()

    def test_a_run_that_was_not_recorded_is_named(self):
        found = judged(comparison(runs=("controller_1", "controller_2")))
        assert found["C4"].evidence["missing"] == "a measured run controller_3"
        assert found["P1"].evidence["missing"].endswith(LOADED)
        assert "controller_3" in found["table2.controller_3.mae.joint_2"].evidence["missing"]

    def test_a_smaller_rival_torque_turns_c6(self):
        file = comparison()
        plain = {name: trace["tau_m"] for name, trace in file.runs.items()}
        wave = plain["controller_1"]
        larger = {name: measured_trace(file.runs[name], tau_m=size * wave) for name, size in GROWING.items()}
        smaller = larger | {"controller_2": measured_trace(file.runs["controller_2"], tau_m=0.5 * wave)}
        assert verdict(replace(file, runs=larger), "C6") == "reproduced"
        assert verdict(replace(file, runs=smaller), "C6") == "not_reproduced"

    def test_steps_of_the_torque_are_compared_between_equal_samplings_alone(self):
        file = comparison()
        one = file.runs["controller_2"]
        thin = replace(one, time=one.time[::2], variables={k: v[::2] for k, v in one.variables.items()})
        found = judged(replace(file, runs={**file.runs, "controller_2": thin}))
        assert "sampled alike" in found["C6"].evidence["missing"]
        assert found["C2"].decision.verdict != "not_testable"
        for stretch, alike in ((1.005, True), (1.1, False)):
            slow = replace(one, time=stretch * one.time)
            found = judged(replace(file, runs={**file.runs, "controller_2": slow}))
            assert ("missing" not in found["C6"].evidence) is alike
            assert "missing" not in found["C5"].evidence

    def test_a_pause_in_a_record_is_no_other_sampling(self):
        file = comparison()
        one = file.runs["controller_2"]
        paused = replace(one, time=one.time + np.where(np.arange(len(one.time)) < 100, 0.0, 0.5))
        found = judged(replace(file, runs={**file.runs, "controller_2": paused}))
        assert "missing" not in found["C6"].evidence

    def test_nothing_is_a_percentage_of_zero(self):
        found = judged(comparison(GROWING | {"controller_1": 0.0}))
        for metric in ("mae", "rmse"):
            one = found[f"increase.with_load.{metric}.joint_2"]
            assert one.decision.verdict == "not_testable"
            assert one.evidence["missing"] == "an error of controller_1, joint 2 that is not zero"

    def test_a_run_of_one_joint_or_without_its_error_says_nothing_of_stability(self):
        file = comparison()
        one = file.runs["controller_2"]
        single = replace(one, joint=(2,), variables={name: v[:, :1] for name, v in one.variables.items()})
        bare = replace(one, variables={"q_d": one["q_d"]})
        for run, joint in ((single, 3), (bare, 2)):
            found = judged(replace(file, runs={**file.runs, "controller_2": run}))["C1"]
            assert found.evidence["missing"] == f"the measured error of controller_2, joint {joint}"

    def test_the_row_without_load_is_controller_1(self):
        found = judged(comparison(runs=("controller_2",)))
        for name in ("table3.no_load.mae.joint_2", "share.controller_1_of_2.mae.joint_2"):
            assert found[name].evidence["missing"] == "the measured errors of controller_1, joint 2"

    def test_a_gap_in_an_error_says_nothing_against_stability(self):
        file = comparison()
        e = file.runs["controller_2"]["e"].copy()
        e[40:60] = np.nan
        holed = measured_trace(file.runs["controller_2"], e=e)
        assert verdict(replace(file, runs={**file.runs, "controller_2": holed}), "C1") == "reproduced"

    def test_the_window_is_named_where_the_tables_decide(self):
        found = judged(comparison(GROWING))
        claims = ("C1", "C2", "C3", "C4", "C5", "C6", "P1")
        assert {name for name in claims if "window" in found[name].evidence} == {"C2", "P1"}

    def test_surfaces_computed_from_e_are_said_to_be(self):
        same = dict.fromkeys(GROWING, 1.0)
        assert verdict(comparison(same), "C4") in {"reproduced", "not_reproduced"}
        found = judged(comparison(same, without=("s",)))["C4"]
        assert found.decision.verdict != "not_testable"
        assert "Eq. (11)" in found.evidence["remarks"][0]
        assert "over 50 ms" in found.evidence["remarks"][0]

    def test_the_payload_is_its_percentages(self):
        found = judged(comparison(GROWING))["P1"]
        assert found.decision.verdict == "not_reproduced"
        assert all(row["holds"] for row in found.evidence["statements"])
        assert set(found.evidence["percentages"].values()) == {"not_reproduced"}

    def test_the_payload_needs_controller_1_alone(self):
        whole = printed_file(lambda time: time < np.inf)
        kept = {name: whole.runs[name] for name in ("controller_1", LOADED)}
        assert verdict(replace(whole, runs=kept), "P1") == "reproduced"
        stopped = dict(kept[LOADED].attributes) | {"status": "ringing"}
        kept[LOADED] = replace(kept[LOADED], attributes=stopped)
        found = judged(replace(whole, runs=kept))["P1"]
        assert "ringing" in found.evidence["missing"]


def test_the_printed_numbers_are_reproduced_with_all_percentages():
    found = judged(printed_file(lambda time: time < np.inf))
    families = ("table2.", "table3.", "share.", "increase.")
    numbers = {name: one.decision.verdict for name, one in found.items() if name.startswith(families)}
    assert len(numbers) == 32
    assert set(numbers.values()) == {"reproduced"}
    assert found["P1"].decision.verdict == found["C2"].decision.verdict == "reproduced"
    assert found["C2"].evidence["window"] == "whole"


class TestAngles:
    def file(self, *sizes, start=0.0):
        """SYNTHETIC decoupling run with an error of a size a joint, as a share of its range."""
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        encoder = trace["q_encoder"]
        calculated = encoder + np.array(sizes) * np.abs(encoder) + start
        run = measured_trace(trace, q_calculated=calculated)
        return replace(file, runs={"decouple": run})

    def test_k3_holds_and_fails_by_each_statement(self):
        assert decoupling(self.file(0.005, 0.02, 0.04)).decision.verdict == "reproduced"
        for sizes in [(0.005, 0.04, 0.02), (0.03, 0.02, 0.04), (0.05, 0.06, 0.07), (0.005, 0.1, 0.4)]:
            assert decoupling(self.file(*sizes)).decision.verdict == "not_reproduced", sizes

    def test_a_start_offset_is_taken_off_and_said(self):
        found = decoupling(self.file(0.005, 0.02, 0.04, start=0.1))
        assert found.decision.verdict == "reproduced"
        assert found.evidence["remarks"]
        assert found.evidence["as_recorded"]["mae_deg"][0] > np.rad2deg(0.1) * 0.99
        assert not decoupling(self.file(0.005, 0.02, 0.04)).evidence["remarks"]

    def test_one_spoilt_sample_at_the_start_is_no_offset(self):
        file = self.file(0.005, 0.02, 0.04)
        trace = file.runs["decouple"]
        spoilt = trace["q_encoder"].copy()
        spoilt[0] += np.deg2rad([0.5, 0.0, 1.0])
        runs = {"decouple": replace(trace, variables=dict(trace.variables) | {"q_encoder": spoilt})}
        assert decoupling(replace(file, runs=runs)).decision.verdict == "reproduced"

    def test_calculated_angles_follow_from_the_motors(self):
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        kept = {name: value for name, value in trace.variables.items() if name != "q_calculated"}
        bare = replace(file, runs={"decouple": replace(trace, variables=kept)})
        assert decoupling(bare).evidence == decoupling(file).evidence

    def test_k3_names_what_is_missing(self):
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        still = measured_trace(trace, q_encoder=np.zeros_like(trace["q"]))
        for runs, word in [({}, "decouple"), ({"decouple": still}, "all move")]:
            with pytest.raises(DataMissingError, match=word):
                decoupling(replace(file, runs=runs))

    def test_k5_holds_and_fails(self):
        file = make_compare_file(step=0.02, source="measured")
        close, far = (
            replace(
                file,
                runs={
                    name: measured_trace(trace, q_encoder=(1.0 + share) * trace["q_d"])
                    for name, trace in file.runs.items()
                },
            )
            for share in (0.01, 0.2)
        )
        assert motor_angles(close).decision.verdict == "reproduced"
        found = motor_angles(far)
        assert found.decision.verdict == "not_reproduced"
        assert len(found.evidence["statements"]) == 6

    def test_k5_measures_a_motor_that_hardly_turns_by_the_other(self):
        """Joint 3 turns by just what keeps motor 3 at rest; its error is then larger than its range."""
        file = make_compare_file(step=0.02, source="measured", runs=("controller_2",))
        trace = file.runs["controller_2"]
        q_d = trace["q_d"][:, :1] * np.array([1.0, 35.0 / 37.0])
        measured = q_d + np.deg2rad([0.3, 0.0])
        found = motor_angles(
            replace(file, runs={"controller_2": measured_trace(trace, q_d=q_d, q_encoder=measured)})
        )
        assert found.decision.verdict == "reproduced"
        shares = [row["share_of_range"] for row in found.evidence["statements"]]
        assert shares[0] / shares[1] == pytest.approx(77.0 / 35.0)

    @pytest.mark.parametrize(("desired", "measured"), [(1.0, np.nan), (0.0, 0.0)], ids=["lost", "still"])
    def test_k5_needs_samples_of_motors_that_move(self, desired, measured):
        file = make_compare_file(step=0.02, source="measured", runs=("controller_2",))
        trace = file.runs["controller_2"]
        run = measured_trace(trace, q_d=desired * trace["q_d"], q_encoder=measured * trace["q_d"])
        with pytest.raises(DataMissingError, match="motors move"):
            motor_angles(replace(file, runs={"controller_2": run}))

    def on_ranges(self, sizes_deg, ranges_deg):
        """SYNTHETIC decoupling run with an MAE and a range of a size a joint, at angles far from zero."""
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        moves = trace["q_encoder"] / np.ptp(trace["q_encoder"], axis=0)
        encoder = np.deg2rad(ranges_deg) * moves + np.deg2rad([100.0, -150.0, 50.0])
        apart = np.deg2rad(sizes_deg) * (trace.time > 0.1)[:, np.newaxis]
        encoder[7, 1] = apart[8, 2] = np.nan
        run = measured_trace(trace, q_encoder=encoder, q_calculated=encoder + apart)
        return replace(file, runs={"decouple": run})

    @pytest.mark.parametrize("joint", [1, 2, 3])
    def test_a_degree_is_the_least_motion(self, joint):
        small, enough = (
            tuple(size if number == joint else 40.0 for number in (1, 2, 3)) for size in (0.9, 1.1)
        )
        assert decoupling(self.on_ranges((0.1, 0.2, 0.3), enough)).evidence
        with pytest.raises(DataMissingError, match="all move"):
            decoupling(self.on_ranges((0.1, 0.2, 0.3), small))

    @pytest.mark.parametrize("joint", [1, 2, 3])
    def test_k3_needs_all_joints(self, joint):
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        kept = [place for place, number in enumerate(trace.joint) if number != joint]
        variables = {name: trace[name][:, kept] for name in ("q_encoder", "q_calculated")}
        fewer = replace(trace, joint=tuple(trace.joint[place] for place in kept), variables=variables)
        with pytest.raises(DataMissingError, match="all of joints 1 to 3"):
            decoupling(replace(file, runs={"decouple": fewer}))

    @pytest.mark.parametrize("share", [0.049, 0.051])
    def test_k5_is_the_mae_of_each_motor_over_the_largest_range(self, share):
        file = make_compare_file(step=0.02, source="measured", runs=("controller_2",))
        trace = file.runs["controller_2"]
        S_inv = file.plant.matrix("S_inv", trace.joint)
        q_d = trace["q_d"].copy()
        reach = np.ptp(q_d @ S_inv.T, axis=0).max()
        apart = reach * np.array([0.5 * share, -share])
        shaken = np.where(np.arange(len(q_d)) % 2, 0.5, 1.5)[:, np.newaxis] * apart
        q_encoder = q_d + shaken @ np.linalg.inv(S_inv).T
        q_d[5:7] = q_encoder[8:10, 1] = np.nan
        q_d, q_encoder = q_d[: len(q_d) // 2 * 2], q_encoder[: len(q_d) // 2 * 2]
        variables = {"q_d": q_d, "q_encoder": q_encoder}
        run = replace(measured_trace(trace), time=trace.time[: len(q_d)], variables=variables)
        rows = motor_angles(replace(file, runs={"controller_2": run})).evidence["statements"]
        assert [row["share_of_range"] for row in rows] == pytest.approx([0.5 * share, share], rel=1e-9)
        assert [row["mae_deg"] for row in rows] == pytest.approx(np.rad2deg(np.abs(apart)), rel=1e-9)
        assert [row["holds"] for row in rows] == [True, share < 0.05]
        assert all("below 5 % of the largest range" in row["statement"] for row in rows)

    @pytest.mark.parametrize(
        ("sizes_deg", "held"),
        [
            ((0.39, 0.5, 0.9), [True, True, True, True]),
            ((0.30, 0.9, 0.5), [False, True, True, True]),
            ((0.50, 0.4, 0.9), [True, False, False, True]),
            ((0.42, 0.5, 0.9), [True, True, False, True]),
            ((0.30, 1.1, 1.2), [True, True, True, False]),
            ((0.30, 0.5, 3.1), [True, True, True, False]),
        ],
    )
    def test_k3_is_the_mae_over_the_range_of_each_joint(self, sizes_deg, held):
        ranges_deg = (40.0, 20.0, 60.0)
        found = decoupling(self.on_ranges(sizes_deg, ranges_deg)).evidence["start_offset_removed"]
        assert found["mae_deg"] == pytest.approx(sizes_deg, rel=5e-3)
        assert found["share_of_range"] == pytest.approx(np.divide(sizes_deg, ranges_deg), rel=5e-3)
        assert [row["holds"] for row in found["statements"]] == held
        assert "below 1 % of its range" in found["statements"][2]["statement"]
        assert "below 5 % of the joint's range" in found["statements"][3]["statement"]

    def test_the_start_offset_is_the_median_of_the_first_tenth_of_a_second(self):
        file = make_decouple_file(source="measured")
        trace = file.runs["decouple"]
        apart = np.deg2rad([0.1, 0.2, 0.4]) * (2.0 + np.sin(trace.time))[:, np.newaxis]
        level = np.median(apart[trace.time <= 0.1], axis=0)
        run = measured_trace(trace, q_calculated=trace["q_encoder"] + apart)
        found = decoupling(replace(file, runs={"decouple": run})).evidence
        for name, first in (("start_offset_removed", level), ("as_recorded", 0.0)):
            expected = np.rad2deg(np.abs(apart - first).mean(axis=0))
            assert found[name]["mae_deg"] == pytest.approx(expected, rel=1e-9)


PAGE = ROOT / "docs" / "verdicts.md"


@pytest.mark.skipif(not PAGE.is_file(), reason="no docs folder beside the package")
def test_the_page_says_what_the_code_does():
    text = " ".join(PAGE.read_text(encoding="utf-8").partition("## On the measurement")[2].split())
    assert f"on joint 1 below {100 * TINY:g} %" in text
    assert f"on every joint below {100 * AGREES:g} %" in text
    assert f"MAE of each motor below {100 * AGREES:g} % of the desired range" in text
    assert f"moves less than {np.rad2deg(LEAST_RANGE):.0f}°" in text
    assert f"spread evenly within {100 * SPREAD:g} % of the print" in text


class TestLedger:
    def both(self):
        compare, decouple = comparison(GROWING), make_decouple_file(source="measured")
        return replace(compare, experiment="both", runs={**compare.runs, **decouple.runs})

    def test_k3_and_k5_take_the_measured_verdict_and_others_keep_theirs(self):
        only = ["K3", "K5", "C2", "table2.controller_1.mae.joint_2", "K1"]
        without = {one.id: one for one in judge_all(Sources(), only=only)}
        found = {one.id: one for one in judge_all(Sources(measured=self.both()), only=only)}
        assert {found["K3"].verdict, found["K5"].verdict} <= {"reproduced", "not_reproduced"}
        assert found["K3"].kind == "measured"
        assert without["K3"].evidence["run"].startswith("tendonrepro fetch")
        assert found["C2"].verdict == without["C2"].verdict == "not_testable"
        assert found["C2"].evidence["measured"]["verdict"] == "reproduced"
        assert found["table2.controller_1.mae.joint_2"].evidence["measured"]["window"] == "whole"
        assert "measured" not in found["K1"].evidence
        assert "on the measurement" in table_text(list(found.values()))
        assert "on the measurement" not in table_text(list(without.values()))

    def test_the_command_reads_the_measured_file(self, tmp_path):
        path = tmp_path / "SYNTHETIC.h5"
        write_traces(path, self.both())
        ledger = run_claims(tmp_path, ["C2"], None, Talk(quiet=True), path)
        assert ledger.verdicts[0].evidence["measured"]["verdict"] == "reproduced"
        assert "measured" not in run_claims(tmp_path, ["C2"], None, Talk(quiet=True)).verdicts[0].evidence

    def test_simulated_and_absent_files_are_refused(self, tmp_path):
        path = tmp_path / "SYNTHETIC.h5"
        with pytest.raises(DataMissingError, match="no measured") as caught:
            read_measured(path)
        assert "fetch" in str(caught.value)
        assert "ingest" in str(caught.value)
        write_traces(path, make_decouple_file())
        with pytest.raises(UsageError, match="simulated"):
            read_measured(path)

    def test_the_reference_is_recovered_once_for_all(self):
        found = measured_of(comparison(), published())
        assert found.reference is not None
        assert found.reference.period == pytest.approx(PERIOD, abs=1e-3)
