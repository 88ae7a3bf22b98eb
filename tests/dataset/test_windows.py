"""Tables 2 and 3 over every averaging window: which one was found, and how easily by chance."""

from dataclasses import replace

import numpy as np
import pytest
from support.measured_synthetic import CONTROLLERS, LOADED, measured_trace, printed_file
from support.synthetic import PERIOD, make_compare_file

from tendonrepro.configuration.published import published
from tendonrepro.dataset.windows import (
    NUMBERS,
    Timing,
    chance_of_at_least,
    spans,
    try_windows,
)

TIMING = dict.fromkeys((*CONTROLLERS, LOADED), Timing(0.0, PERIOD))


@pytest.mark.parametrize(
    ("window", "first", "last"),
    [("whole", 0.0, np.inf), ("after_first_period", PERIOD, np.inf), ("period_1", 0.0, PERIOD)],
)
def test_the_one_window_with_the_printed_numbers_is_found(window, first, last):
    file = printed_file(lambda time: (time >= first - 1e-9) & (time < last - 1e-9))
    found = try_windows(file, published(), TIMING)
    assert found.compared == NUMBERS == 16
    assert found.winner.name == window
    assert found.chance < 1e-14
    assert all(len(one.agree) < NUMBERS for one in found.tried if one is not found.winner)


def test_a_constant_offset_is_found_to_have_been_taken_off():
    file = printed_file(lambda time: time < np.inf, centred=True)
    runs = {name: measured_trace(trace, e=trace["e"] + 0.01) for name, trace in file.runs.items()}
    found = try_windows(replace(file, runs=runs), published(), TIMING)
    assert found.winner.name == "whole, offset removed"


def test_windows_that_keep_the_same_samples_count_once():
    names = [one.window for one in try_windows(make_compare_file(), published(), TIMING).tried]
    assert len(names) == 2 * len(set(names))
    assert set(names) == {"whole", "after_first_period", "period_1"}
    single = TIMING | {"controller_2": Timing(0.0, 0.0)}
    found = try_windows(make_compare_file(), published(), single)
    assert {one.window for one in found.tried} == {"whole"}


def test_an_incomplete_last_period_and_a_late_start_are_told_apart():
    time = 0.01 * np.arange(2501)
    found = spans(time, Timing(1.0, 10.0))
    assert found["whole"] == slice(100, 2501)
    assert found["with_standstill"] == slice(0, 2501)
    assert found["whole_periods"] == slice(100, 2100)
    assert found["after_first_period"] == slice(1100, 2501)
    assert found["period_2"] == slice(1100, 2100)
    assert list(spans(time, Timing(0.0, 0.0))) == ["whole", "with_standstill"]
    assert spans(time, Timing(99.0, 10.0)) == spans(time, Timing(0.0, 10.0))


@pytest.mark.parametrize(("start", "first"), [(3.004, 100), (3.0055, 101), (3.006, 101)])
def test_a_motion_begins_at_the_nearest_sample(start, first):
    found = spans(2.0 + 0.01 * np.arange(2501.0), Timing(start, 10.0))
    assert found["whole_periods"] == slice(first, first + 2000)


def test_the_chance_counts_every_try():
    whole = printed_file(lambda time: time < np.inf)
    found = try_windows(
        replace(whole, runs={"controller_2": whole.runs["controller_2"]}), published(), TIMING
    )
    assert found.chance == pytest.approx(
        len(found.tried) * chance_of_at_least(published(), found.tried[0].sizes, 4)
    )
    nothing = try_windows(replace(whole, runs={}), published(), {})
    assert (nothing.winner, nothing.window) == (None, None)


def test_missing_samples_are_left_out_and_counted():
    """Those of which one joint is missing, too."""
    file = printed_file(lambda time: time < np.inf)
    trace = file.runs["controller_2"]
    e = trace["e"].copy()
    e[500:600] = e[10:15, 0] = e[20:22, 1] = np.nan
    holed = replace(file, runs={**file.runs, "controller_2": measured_trace(trace, e=e)})
    found = try_windows(holed, published(), TIMING)
    size = found.tried[0].sizes["table2.controller_2.mae.joint_2"]
    assert size == pytest.approx(np.nanmean(np.abs(np.rad2deg(e[:, 0]))), rel=1e-12)
    assert found.left_out == {**dict.fromkeys(file.runs, 0), "controller_2": 107}


def test_the_chance_of_agreement_is_that_of_independent_numbers():
    # 0.375 and 0.292 printed to 0.001: shares of a fifth of each are 1/75 and 5/292.
    names = dict.fromkeys(("table2.controller_2.rmse.joint_2", "table2.controller_2.rmse.joint_3"), 0.0)
    one, other = 1.0 / 75.0, 5.0 / 292.0
    assert chance_of_at_least(published(), names, 0) == pytest.approx(1.0)
    assert chance_of_at_least(published(), names, 1) == pytest.approx(one + other - one * other)
    assert chance_of_at_least(published(), names, 2) == pytest.approx(one * other)
