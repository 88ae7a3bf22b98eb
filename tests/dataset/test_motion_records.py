"""Which run a motion is taken from, and what two records of one motion tell of each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.measured_synthetic import measured_trace, moved, with_runs
from support.synthetic import COUNT, make_compare_file

from tendonrepro.dataset.motion.record import Recorded
from tendonrepro.dataset.motion.recover import recover, refined_shift, repeat_after, zero_of
from tendonrepro.errors import DataMissingError
from tendonrepro.results.records import Trace

STEP = 0.005
MOVES = make_compare_file(step=STEP, source="measured")
"""SYNTHETIC: joints 2 and 3 move together, all runs alike."""
FIRST, SECOND, THIRD = "controller_1", "controller_2", "controller_3"


def without(trace: Trace, joint: int) -> Trace:
    """The run with no desired angles of a joint."""
    q_d = trace["q_d"].copy()
    q_d[:, trace.joint.index(joint)] = np.nan
    return measured_trace(trace, q_d=q_d)


class TestRunOfTheReference:
    @pytest.mark.parametrize("joint", [2, 3])
    def test_a_run_without_a_joint_gives_way_to_one_with_both(self, joint: int) -> None:
        found = recover(with_runs(MOVES, controller_1=without(MOVES.runs[FIRST], joint)))
        assert found.run == SECOND
        assert found.record.joint == (2, 3)

    def test_so_does_a_run_of_one_joint(self) -> None:
        trace = MOVES.runs[FIRST]
        single = replace(trace, joint=(3,), variables={"q_d": trace["q_d"][:, 1:]})
        found = recover(with_runs(MOVES, controller_1=single))
        assert (found.run, found.record.joint) == (SECOND, (2, 3))
        assert recover(replace(MOVES, runs={FIRST: single})).record.joint == (3,)

    def test_so_does_a_run_at_rest_or_of_too_few_samples(self) -> None:
        first, second = MOVES.runs[FIRST], MOVES.runs[SECOND]
        few = np.where(np.arange(len(second.time))[:, np.newaxis] < 5, second["q_d"], np.nan)
        still = moved(first, 0.0 * first["q_d"])
        assert recover(with_runs(MOVES, controller_1=still, controller_2=moved(second, few))).run == THIRD
        with pytest.raises(DataMissingError, match="does not move"):
            recover(replace(MOVES, runs={FIRST: still, SECOND: moved(second, few)}))

    def test_the_first_controller_comes_before_a_load(self) -> None:
        backwards = dict(reversed(MOVES.runs.items()))
        assert next(iter(backwards)) == "controller_1_payload"
        assert recover(replace(MOVES, runs=backwards)).run == THIRD


class TestShift:
    """Of one motion in two records."""

    @staticmethod
    def record(late: float, apart: float, step: float = COUNT) -> Recorded:
        time = 0.002 * np.arange(3000.0)
        u = np.clip((time - 1.0 - late) / 4.0, 0.0, 1.0)[:, np.newaxis]
        q = np.deg2rad([30.0, -20.0]) * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5) + apart
        q = step * np.round(q / step)
        return Recorded(time, q - q[0], (2, 3), q[0], step, np.ones(len(time), bool))

    @pytest.mark.parametrize("late", [-0.3, 0.0, 0.0013, 0.2])
    @pytest.mark.parametrize("apart", [0.0, 0.49])
    def test_it_is_found_although_steps_hide_the_beginning(self, late: float, apart: float) -> None:
        ours, other = self.record(late, apart * COUNT), self.record(0.0, 0.0)
        assert refined_shift(ours, other, late + 0.05) == pytest.approx(late, abs=2e-4)

    def test_the_guess_stays_where_the_records_hardly_overlap_or_nothing_near_it_fits(self) -> None:
        ours, other = self.record(0.0, 0.0), self.record(1.9, 0.0)
        assert refined_shift(ours, other, 5.95) == 5.95
        assert refined_shift(ours, other, 0.0) == 0.0

    def test_a_motion_a_sample_later_is_not_taken_for_the_same_time(self) -> None:
        second = MOVES.runs[SECOND]
        late = moved(second, second["q_d"], 0.8 * STEP)
        assert zero_of(late, recover(MOVES)) == pytest.approx(0.8 * STEP, abs=2e-4)
        assert zero_of(second, recover(MOVES)) == 0.0


class TestRecorded:
    def test_a_flicker_of_one_rounding_step_is_no_motion(self) -> None:
        rounding = 0.01
        q = np.zeros((200, 1))
        q[20:40:2] = q[170:190:2] = rounding
        q[100:150, 0] = np.linspace(0.0, 1.0, 50)
        q[150:, 0] += 1.0
        record = Recorded(0.01 * np.arange(200.0), q, (2,), np.zeros(1), rounding, np.ones(200, bool))
        first, last = record.moving()
        assert 95 <= first <= 102
        assert 148 <= last <= 152

    @pytest.mark.parametrize("lag", [99.7, 100.0, 100.3])
    def test_a_period_between_two_samples_is_found(self, lag: float) -> None:
        q = np.sin(2.0 * np.pi * np.arange(400.0) / lag)[:, np.newaxis]
        record = Recorded(0.01 * np.arange(400.0), q, (2,), np.zeros(1), 0.0, np.ones(400, bool))
        assert repeat_after(record) == pytest.approx(0.01 * lag, abs=1e-4)
