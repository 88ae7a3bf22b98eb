"""A recorded reference is recovered: its shape, its period, and a trajectory file that does not shake."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tendonrepro.arrays import Array
from tendonrepro.config.fields.strict_yaml import dump
from tendonrepro.config.load import CompareConfig, load_config
from tendonrepro.config.trajectory_file import read_samples
from tendonrepro.dataset.motion.fit import limit, turns_of
from tendonrepro.dataset.motion.knots import thinned
from tendonrepro.dataset.motion.record import Recorded, recorded, rounding_step
from tendonrepro.dataset.motion.recover import (
    Reference,
    derivatives,
    recover,
    recover_run,
    repeat_after,
    timing_of,
)
from tendonrepro.errors import DataMissingError
from tendonrepro.experiments import loops as runs
from tendonrepro.physics.trajectory import (
    Motion,
    at_rest,
    minimum_jerk,
    motion,
    raised_cosine,
    smooth_sine,
    trapezoid_times,
    trapezoidal,
)
from tendonrepro.results.records import PlantRecord, Trace, TraceFile
from tendonrepro.validation.rerun import FILE, config_tree, csv_text, runnable

COUNT = float(np.deg2rad(0.022))
AMPLITUDE = np.deg2rad([20.0, 30.0])
LIMITS = np.deg2rad(20.0), np.deg2rad(40.0)
LONGEST = trapezoid_times(AMPLITUDE[1], *LIMITS)[1]
CYCLE = {"raised_cosine": 6.0, "minimum_jerk": 7.0, "trapezoidal": 2.0 * (LONGEST + 0.75), "sine": 5.0}
PARAMETERS = {
    "raised_cosine": {"amplitude": [20.0, 30.0], "period": 6.0},
    "minimum_jerk": {"amplitude": [20.0, 30.0], "rise": 2.5, "hold": 1.0},
    "trapezoidal": {"amplitude": [20.0, 30.0], "velocity": 20.0, "acceleration": 40.0, "hold": 0.75},
    "sine": {"amplitude": [10.0, 15.0], "offset": [10.0, 15.0], "period": 5.0, "blend": 2.5},
}


def shape(kind: str, amplitude: float):
    if kind == "raised_cosine":
        return raised_cosine(amplitude, 6.0)
    if kind == "minimum_jerk":
        return minimum_jerk(amplitude, 2.5, 1.0)
    if kind == "sine":
        return smooth_sine(amplitude / 2.0, amplitude / 2.0, 5.0, 2.5)
    return trapezoidal(amplitude, *LIMITS, 0.75 + LONGEST - trapezoid_times(amplitude, *LIMITS)[1])


def trace(time: Array, q: Array, name: str = "controller_1") -> Trace:
    attributes = {"law": "measured", "reference_period": 0.0, "status": "ok", "payload_mass": 0.0}
    return Trace(name, time, (2, 3), {"q_d": q, "e": 0.0 * q}, attributes)


def made(
    kind: str, step: float = 0.01, delay: float = 0.0, rounded: bool = False, turns: bool = False
) -> Trace:
    """Two periods from a start that is not zero, on a time axis that does not begin at zero."""
    cycle = CYCLE[kind]
    if turns:
        plan = [(shape(kind, AMPLITUDE[0]), at_rest) * 2, (at_rest, shape(kind, AMPLITUDE[1])) * 2]
    else:
        plan = [(shape(kind, size),) * (1 if kind == "sine" else 2) for size in AMPLITUDE]
    motions = [Motion(shapes, 1000.0 if kind == "sine" else cycle) for shapes in plan]
    time = step * np.arange(round(((4 if turns else 2) * cycle + delay) / step) + 1)
    q = motion(time - delay, motions)[0] + np.deg2rad([12.0, -5.0])
    return trace(time + 3.0, np.round(q / COUNT) * COUNT if rounded else q)


@pytest.mark.parametrize(
    ("kind", "step", "delay", "rounded", "turns"),
    [
        ("raised_cosine", 0.001, 0.0, True, False),
        ("raised_cosine", 0.01, 1.234, False, True),
        ("minimum_jerk", 0.001, 1.234, True, True),
        ("minimum_jerk", 0.01, 0.0, True, False),
        ("trapezoidal", 0.001, 0.5, False, False),
        ("trapezoidal", 0.01, 0.0, True, True),
        ("sine", 0.001, 0.5, False, False),
        ("sine", 0.01, 1.234, True, False),
    ],
)
def test_every_shape_is_recovered(kind: str, step: float, delay: float, rounded: bool, turns: bool) -> None:
    found = recover_run(made(kind, step, delay, rounded, turns))
    assert found.shape.kind == kind
    loose = 0.03 if rounded else 1e-6
    assert found.period == pytest.approx(CYCLE[kind] * (2 if turns else 1), abs=0.003 if rounded else 1e-6)
    assert found.delay == pytest.approx(delay, abs=0.003 if rounded else 1e-6)
    assert found.as_dict()["periods"] == 2
    assert found.record.start_angle == pytest.approx(np.deg2rad([12.0, -5.0]), abs=COUNT)
    assert found.shape.parameters() == {
        name: pytest.approx(value, rel=0.005 if rounded else 1e-6, abs=loose)
        for name, value in PARAMETERS[kind].items()
    }
    assert (found.turns.pattern() if found.turns else None) == (
        None if kind == "sine" else (((0,), (1,)), 2) if turns else (((0, 1),), 2)
    )


def test_a_shape_nobody_has_is_sampled_and_its_period_found() -> None:
    time = 0.01 * np.arange(2101)
    wave = np.sin(2.0 * np.pi * time / 7.0) ** 2 * (1.0 + 0.3 * np.sin(6.0 * np.pi * time / 7.0))
    found = recover_run(trace(time, 0.5 * wave[:, np.newaxis] * np.array([1.0, 0.5])))
    assert found.shape is None
    assert found.as_dict()["kind"] == "sampled"
    assert found.period == pytest.approx(7.0, abs=0.02)
    assert found.knots.deviation <= found.knots.tolerance


def test_a_single_stroke_has_no_period() -> None:
    time = 0.01 * np.arange(601)
    q = np.repeat(minimum_jerk(0.5, 2.0, 99.0)(time)[0][:, np.newaxis], 2, axis=1)
    assert repeat_after(recorded(trace(time, q))) == 0.0


@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize("step", [0.001, 0.01])
@pytest.mark.parametrize(("cycles", "period"), [(2, 5.0), (3, 5.0), (4, 5.0), (6, 2.5)])
def test_a_sine_that_is_blended_in_repeats_after_one_period(
    cycles: int, period: float, step: float, noise: float
) -> None:
    time = step * np.arange(round(cycles * period / step) + 1.0)
    sines = [Motion((smooth_sine(size, 0.0, period, 2.5),), 2.0 * time[-1]) for size in (0.5, 0.3)]
    q = motion(time, sines)[0] + noise * np.random.default_rng(1).standard_normal((len(time), 2))
    assert repeat_after(recorded(trace(time, q))) == pytest.approx(period, abs=0.005)


@pytest.mark.parametrize(
    ("count", "message"),
    [(100, "does not move"), (20, "does not move"), (19, "holds 19 samples of q_d, 20 are needed")],
)
def test_a_motionless_or_hardly_recorded_reference_is_missing(count: int, message: str) -> None:
    q = np.where(np.arange(100)[:, np.newaxis] < count, np.zeros((100, 2)), np.nan)
    with pytest.raises(DataMissingError, match=message):
        recover_run(trace(0.01 * np.arange(100), q))


def test_a_record_that_pauses_for_most_of_its_time_is_refused() -> None:
    time = 0.001 * np.arange(2000.0)
    time[1000:] += 1e9
    q = np.repeat(np.sin(time)[:, np.newaxis], 2, axis=1)
    with pytest.raises(DataMissingError, match=r"2000 samples of q_d in 1e\+09 s, 0\.001 s apart") as caught:
        recover_run(trace(time, q))
    assert "from_s" in str(caught.value.hint)


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_trajectory_does_not_turn_rounding_into_acceleration(step: float) -> None:
    smooth, rough = (recorded(made("minimum_jerk", step, rounded=rounded)) for rounded in (False, True))
    knots = thinned(rough)
    truth = motion(rough.time, [Motion((shape("minimum_jerk", a),) * 2, 7.0) for a in AMPLITUDE])[2]
    peak = np.abs(truth).max()
    assert knots.deviation <= knots.tolerance == pytest.approx(COUNT, rel=1e-6)
    assert np.abs(knots.curve(rough.time)[2] - truth).max() < 0.35 * peak
    assert thinned(smooth).deviation < thinned(smooth).tolerance
    # What the rule is for: a spline through every sample shakes far beyond the motion itself.
    second = np.diff(rough.q, 2, axis=0) / step**2
    assert np.abs(second).max() > 5.0 * peak


def test_a_record_that_ends_in_mid_motion_is_brought_to_rest() -> None:
    whole = made("raised_cosine")
    knots = thinned(recorded(trace(whole.time[:410], whole["q_d"][:410])))
    assert knots.braked
    assert knots.time[-1] > whole.time[409] - whole.time[0]
    assert np.abs(knots.curve(knots.time[-1:])[1]).max() < 1e-9
    assert knots.deviation <= knots.tolerance


def test_the_trajectory_file_starts_at_zero_and_is_read_back(tmp_path: Path) -> None:
    found = recover_run(made("trapezoidal", rounded=True))
    path = tmp_path / FILE
    path.write_text(csv_text(found.knots, (2, 3)), encoding="utf-8")
    time, angles = read_samples(path)
    assert sorted(angles) == [2, 3]
    assert time[0] == angles[2][0] == angles[3][0] == 0.0
    assert angles[3] == pytest.approx(found.knots.angle[:, 1], abs=1e-8)


def built(reference: Reference, folder: Path) -> runs.Reference:
    """The motion that the written configuration runs."""
    base = load_config(None, "compare")
    (folder / FILE).write_text(csv_text(reference.knots, reference.record.joint), encoding="utf-8")
    path = folder / "SYNTHETIC.yaml"
    path.write_text(dump(config_tree(base.tree, reference, "SYNTHETIC.h5")), encoding="utf-8")
    loaded = load_config(path, "compare")
    assert isinstance(loaded.config, CompareConfig)
    assert "SYNTHETIC.h5" in loaded.config.title
    return runs.build_reference(loaded.config.reference, loaded.config, folder)


@pytest.mark.parametrize(("kind", "turns"), [("minimum_jerk", True), ("trapezoidal", False), ("sine", False)])
def test_the_written_configuration_runs_the_recovered_motion(kind: str, turns: bool, tmp_path: Path) -> None:
    reference = recover_run(made(kind, turns=turns))
    record, ran = reference.record, built(reference, tmp_path)
    again = np.column_stack([np.interp(record.time, ran.time, column) for column in ran.q_d.T])
    assert np.abs(again - record.q).max() < np.deg2rad(1e-3)


@pytest.mark.parametrize("step", [0.001, 0.01])
@pytest.mark.parametrize("drift", [0.0, 3e-5])
def test_a_cycle_of_no_whole_samples_still_runs_as_its_shape(
    step: float, drift: float, tmp_path: Path
) -> None:
    """A (1 - cos t) lasts 2 pi seconds, and a clock that is fast a little more than whole ones."""
    time = step * np.arange(round(4.0 * np.pi / step) + 1)
    course = 0.5 * (1.0 - np.cos(time * (1.0 + drift)))[:, np.newaxis]
    found = recover_run(trace(time, AMPLITUDE * course))
    assert found.shape.kind == "raised_cosine"
    written = runnable(found, 0.001)
    assert written.period == pytest.approx(6.283, abs=1e-9)
    assert written.shape.largest < limit(found.record)
    again = built(written, tmp_path)
    assert (
        np.abs(np.interp(time, again.time, again.q_d[:, 1]) - AMPLITUDE[1] * course[:, 0])[:-2].max() < 2e-4
    )


def test_a_shape_that_may_not_give_way_runs_as_samples(tmp_path: Path) -> None:
    """Forty periods of 1.0004 s are 16 ms too long for 40 s."""
    time = 0.001 * np.arange(40017)
    q = AMPLITUDE * 0.5 * (1.0 - np.cos(2.0 * np.pi * time / 1.0004))[:, np.newaxis]
    found = recover_run(trace(time, q))
    assert found.shape is not None
    assert runnable(found, 0.0004).shape is not None
    written = runnable(found, 0.3)
    assert written.shape is None
    again = built(written, tmp_path)
    inside = time <= again.time[-1]
    assert np.abs(np.interp(time, again.time, again.q_d[:, 1]) - q[:, 1])[inside].max() < np.deg2rad(0.05)


def test_whole_cycles_stay_as_they_are() -> None:
    found = recover_run(made("trapezoidal"))
    assert runnable(found, 0.001) is found
    sampled = replace(found, fitted=())
    assert runnable(sampled, 0.3) is sampled


def test_a_run_that_starts_later_is_timed_by_its_own_start() -> None:
    early = made("minimum_jerk", delay=0.5)
    late = replace(made("minimum_jerk", delay=1.5), name="controller_2")
    runs = {early.name: early, late.name: late}
    file = TraceFile("compare", "measured", "SYNTHETIC", runs, PlantRecord({}, {}), "", "", "{}", "", "0")
    timing = timing_of(file, recover(file))
    assert timing["controller_1"].start == pytest.approx(3.5, abs=1e-6)
    assert timing["controller_2"].start == pytest.approx(4.5, abs=1e-6)
    assert timing["controller_2"].period == pytest.approx(7.0, abs=1e-6)
    stated = replace(late, attributes={**late.attributes, "reference_period": 3.5})
    told = replace(file, runs={early.name: early, late.name: stated})
    assert timing_of(told, recover(told))["controller_2"].period == 3.5


def test_recorded_derivatives_are_taken_and_others_made() -> None:
    plain = made("minimum_jerk", 0.001)
    time = plain.time - plain.time[0]
    _, dq, ddq = motion(time, [Motion((shape("minimum_jerk", a),) * 2, 7.0) for a in AMPLITUDE])
    found = derivatives(plain)
    assert np.abs(found[0] - dq).max() < 0.02 * np.abs(dq).max()
    assert np.abs(found[1] - ddq).max() < 0.2 * np.abs(ddq).max()
    given = Trace(plain.name, plain.time, (2, 3), {**plain.variables, "dq_d": 2.0 * dq, "ddq_d": ddq}, {})
    assert derivatives(given)[0] is given["dq_d"]


def made_of(q: Array, step: float = 0.001) -> Recorded:
    return Recorded(
        step * np.arange(float(len(q))), q, (2, 3), np.zeros(q.shape[1]), 0.0, np.ones(len(q), bool)
    )


class TestGrid:
    def test_a_step_is_found_from_few_values_and_not_from_uneven_ones(self) -> None:
        rng = np.random.default_rng(3)
        whole = np.floor(rng.uniform(0.0, 2000.0, 500))
        assert rounding_step(COUNT * whole) == pytest.approx(COUNT, rel=1e-6)
        assert rounding_step(COUNT * whole + 0.7) == pytest.approx(COUNT, rel=1e-6)
        assert rounding_step(COUNT * (whole + rng.uniform(-0.2, 0.2, 500))) == 0.0
        assert rounding_step(COUNT * np.arange(20.0)) == 0.0

    def test_rest_before_and_after_is_left_out_and_a_leap_to_the_other_side_is_no_turn(self) -> None:
        time = 0.01 * np.arange(1001.0)
        moves = made_of(np.outer(np.interp(time, [2, 4, 5, 7], [0, 1, 1, 0]), [0.4, -0.2]), 0.01)
        assert moves.moving() == pytest.approx((200, 700), abs=2)
        assert turns_of(moves).joints == ((0, 1),)
        leap = replace(moves, q=moves.q * np.where((time < 4.2)[:, np.newaxis], 1.0, [1.0, -1.0]))
        rest = replace(moves, q=0.0 * moves.q)
        assert (turns_of(leap), turns_of(rest), rest.moving()) == (None, None, (0, 1000))
