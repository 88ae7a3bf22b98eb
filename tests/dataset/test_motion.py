"""The desired motion behind a record: when it begins and repeats, and samples that do not shake."""

from dataclasses import replace

import numpy as np
import pytest

from tendonrepro.dataset import motion
from tendonrepro.dataset.motion import recorded, recover_reference
from tendonrepro.errors import DataMissingError
from tendonrepro.physics import trajectory
from tendonrepro.physics.trajectory import Motion
from tendonrepro.results.records import PlantRecord, Trace, TraceFile

COUNT = float(np.deg2rad(0.022))
AMPLITUDE = np.deg2rad([20.0, 30.0])
SHAPES = {
    "raised_cosine": lambda a: trajectory.raised_cosine(a, 6.0),
    "minimum_jerk": lambda a: trajectory.minimum_jerk(a, 2.5, 1.0),
}
CYCLE = {"raised_cosine": 6.0, "minimum_jerk": 7.0}


def trace(time, q, name="controller_1"):
    attributes = {"law": "measured", "reference_period": 0.0, "status": "ok", "payload_mass": 0.0}
    return Trace(name, time, (2, 3), {"q_d": q, "e": 0.0 * q}, attributes)


def file_of(*runs):
    named = {run.name: run for run in runs}
    return TraceFile("compare", "measured", "SYNTHETIC", named, PlantRecord({}, {}), "", "", {})


def course(kind, time):
    return trajectory.motion(time, [Motion((SHAPES[kind](size),) * 2, CYCLE[kind]) for size in AMPLITUDE])


def made(kind, step=0.01, delay=0.0, rounded=False):
    """Two periods from a start that is not zero, on a time axis that does not begin at zero."""
    time = step * np.arange(round((2 * CYCLE[kind] + delay) / step) + 1)
    q = course(kind, time - delay)[0] + np.deg2rad([12.0, -5.0])
    return trace(time + 3.0, np.round(q / COUNT) * COUNT if rounded else q)


@pytest.mark.parametrize("kind", CYCLE)
@pytest.mark.parametrize(("step", "delay"), [(0.001, 1.234), (0.01, 0.5), (0.01, 2.0)])
@pytest.mark.parametrize("rounded", [False, True])
def test_begin_and_period_are_recovered(kind, step, delay, rounded):
    found = recover_reference(file_of(made(kind, step, delay, rounded)))
    assert found.begin == pytest.approx(delay, abs=0.1 if rounded else 0.02)
    assert found.period == pytest.approx(CYCLE[kind], abs=0.02 if rounded else 2e-3)
    assert found.record.start_angle == pytest.approx(np.deg2rad([12.0, -5.0]), abs=COUNT)
    assert found.knots.deviation <= 1.2 * found.knots.tolerance


def test_the_onset_of_a_power_is_exact():
    time = 0.01 * np.arange(501.0)
    for power in (2, 3):
        q = np.repeat(np.clip(time - 1.5, 0.0, None)[:, np.newaxis] ** power, 2, axis=1)
        assert motion.onset(recorded(trace(time, q))) == pytest.approx(1.5, abs=2e-3)


def test_a_period_between_two_samples_is_told():
    time = 0.01 * np.arange(1801.0)
    q = np.repeat(1.0 - np.cos(2.0 * np.pi * time / 6.0037)[:, np.newaxis], 2, axis=1)
    assert motion.repeat_after(recorded(trace(time, q))) == pytest.approx(6.0037, abs=5e-4)


def stroke(time, size, rise):
    return trajectory.minimum_jerk(size, rise, 99.0)(np.clip(time, 0.0, None))[0]


def test_a_stroke_a_growing_cycle_and_a_rest_like_an_earlier_one_have_no_period():
    time = 0.01 * np.arange(1101.0)
    grows = np.where(time < 6.0, 1.0, 1.15) * (1.0 - np.cos(np.pi * time / 3.0))
    dips = stroke(time, 1.0, 2.0) - stroke(time - 6.0, 0.9, 0.5) + stroke(time - 6.5, 0.9, 0.5)
    rests = dips + 0.01 * np.sin(3.0 * np.clip(time - 7.0, 0.0, None))
    for q in (stroke(time, 0.5, 2.0), grows, rests):
        assert motion.repeat_after(recorded(trace(time, np.repeat(q[:, np.newaxis], 2, axis=1)))) == 0.0


def test_a_count_that_flickers_at_rest_is_no_motion():
    time = 0.01 * np.arange(1901.0)
    q = 5.0 * COUNT * np.round(course("minimum_jerk", np.clip(time - 2.0, 0.0, None))[0] / (5.0 * COUNT))
    q[[10, -10]] += 5.0 * COUNT
    first, last = recorded(trace(time, q)).moving()
    assert (time[first], time[last]) == pytest.approx((2.0, 15.0), abs=0.4)


@pytest.mark.parametrize("noise", [0.0, 2e-3])
@pytest.mark.parametrize(("cycles", "period"), [(2, 5.0), (4, 5.0), (6, 2.5)])
def test_a_sine_that_is_blended_in_repeats_after_one_period(cycles, period, noise):
    time = 0.01 * np.arange(round(cycles * period / 0.01) + 1.0)
    sines = [Motion((trajectory.smooth_sine(size, 0.0, period, 2.5),), 2.0 * time[-1]) for size in (0.5, 0.3)]
    q = trajectory.motion(time, sines)[0] + noise * np.random.default_rng(1).standard_normal((len(time), 2))
    assert motion.repeat_after(recorded(trace(time, q))) == pytest.approx(period, abs=0.02)


@pytest.mark.parametrize("count", [100, 19])
def test_a_motionless_or_hardly_recorded_reference_is_missing(count):
    q = np.where(np.arange(100)[:, np.newaxis] < count, np.zeros((100, 2)), np.nan)
    with pytest.raises(DataMissingError):
        recover_reference(file_of(trace(0.01 * np.arange(100), q)))


def test_a_record_that_pauses_or_begins_in_mid_motion_is_refused():
    time = 0.001 * np.arange(2000.0)
    for speed in (1.0, 0.2):
        q = np.repeat(np.sin(time + np.arccos(speed))[:, np.newaxis], 2, axis=1)
        with pytest.raises(DataMissingError, match="mid-motion"):
            recover_reference(file_of(trace(time, q)))
    time[1000:] += 1e9
    with pytest.raises(DataMissingError, match="pauses"):
        recover_reference(file_of(trace(time, q)))


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_trajectory_does_not_turn_rounding_into_acceleration(step):
    rough = recorded(made("minimum_jerk", step, rounded=True))
    truth = course("minimum_jerk", rough.time)[2]
    peak = np.abs(truth).max()
    assert np.abs(motion.smoothed(rough)[0](rough.time, 2) - truth).max() < 0.35 * peak
    # What the rule is for: a spline through every sample shakes far beyond the motion itself.
    assert np.abs(np.diff(rough.q, 2, axis=0) / step**2).max() > 5.0 * peak


def test_a_record_that_ends_in_mid_motion_is_brought_to_rest():
    whole = made("raised_cosine")
    knots = motion.thinned(recorded(trace(whole.time[:410], whole["q_d"][:410])))
    assert knots.braked
    assert knots.time[-1] > whole.time[409] - whole.time[0]
    assert knots.deviation <= knots.tolerance
    steps = np.abs(np.diff(knots.angle[-11:], axis=0))
    assert (steps[-1] < 0.05 * steps[0]).all()


def test_a_run_that_starts_later_is_timed_by_its_own_start():
    early = made("minimum_jerk", delay=0.5)
    late = replace(made("minimum_jerk", delay=1.5), name="controller_2")
    file = file_of(early, late)
    timing = motion.timing_of(file, recover_reference(file))
    assert timing["controller_1"].start == pytest.approx(3.5, abs=0.02)
    assert timing["controller_2"].start - timing["controller_1"].start == pytest.approx(1.0, abs=1e-3)
    assert timing["controller_2"].period == pytest.approx(7.0, abs=2e-3)
    assert recover_reference(file_of(replace(late, name="controller_1_payload"), early)).run == "controller_1"
    stated = replace(late, attributes={**late.attributes, "reference_period": 3.5})
    told = file_of(early, stated)
    assert motion.timing_of(told, recover_reference(told))["controller_2"].period == 3.5


def test_recorded_derivatives_are_taken_and_others_made():
    plain = made("minimum_jerk", 0.001)
    _, dq, ddq = course("minimum_jerk", plain.time - plain.time[0])
    found = motion.derivatives(plain)
    assert np.abs(found[0] - dq).max() < 0.02 * np.abs(dq).max()
    assert np.abs(found[1] - ddq).max() < 0.2 * np.abs(ddq).max()
    given = Trace(plain.name, plain.time, (2, 3), {**plain.variables, "dq_d": 2.0 * dq, "ddq_d": ddq}, {})
    assert motion.derivatives(given)[0] is given["dq_d"]


def test_a_step_is_found_from_few_values_and_not_from_uneven_ones():
    rng = np.random.default_rng(3)
    whole = np.floor(rng.uniform(0.0, 2000.0, 500))
    assert motion.rounding_step(COUNT * whole) == pytest.approx(COUNT, rel=1e-6)
    assert motion.rounding_step(COUNT * whole + 0.7) == pytest.approx(COUNT, rel=1e-6)
    assert motion.rounding_step(COUNT * np.arange(30.0)) == 0.0
    assert motion.rounding_step(COUNT * (whole + rng.uniform(-0.2, 0.2, 500))) == 0.0
