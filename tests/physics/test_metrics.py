from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from tendonrepro.physics.metrics import (
    mae,
    max_abs,
    periodogram,
    rmse,
    start_level,
    status_of,
    window_mean,
    windows,
)

Array = NDArray[np.float64]
STEP = 1e-3

ERRORS = arrays(
    np.float64,
    st.tuples(st.integers(1, 40), st.integers(1, 3)),
    # The square of anything below 1e-154 underflows.
    elements=st.floats(-1e6, 1e6).map(lambda x: x if abs(x) > 1e-100 else 0.0),
)


def column(*values: float) -> Array:
    return np.array(values)[:, None]


def test_the_start_level_is_that_of_the_first_tenth_of_a_second() -> None:
    time = 5.0 + 0.01 * np.arange(100)
    x = np.stack([np.where(time <= 5.105, 3.0, 9.0), np.full(100, -1.0)], axis=1)
    x[0] = 1e9
    assert start_level(time, x).tolist() == [3.0, -1.0]


class TestSizes:
    @given(ERRORS)
    def test_they_agree_with_the_definition_written_out(self, e: Array) -> None:
        for joint in range(e.shape[1]):
            values = e[:, joint].tolist()
            assert mae(e)[joint] == pytest.approx(math.fsum(abs(x) for x in values) / len(values))
            square = math.fsum(x * x for x in values) / len(values)
            assert rmse(e)[joint] == pytest.approx(math.sqrt(square), rel=1e-12)
            assert max_abs(e)[joint] == max(abs(x) for x in values)

    def test_samples_that_are_outside_or_not_finite_do_not_count(self) -> None:
        e = np.array([[1.0, 1.0], [-3.0, math.nan], [9.0, 9.0], [math.nan, 5.0]])
        inside = np.array([[True, False], [True, True], [False, False], [True, False]])
        sizes = [size(e, inside) for size in (mae, rmse, max_abs)]
        expected = [[2.0, math.nan], [math.sqrt(5.0), math.nan], [3.0, math.nan]]
        np.testing.assert_allclose(sizes, expected, rtol=1e-15)


class TestWindows:
    def test_two_periods_recorded_with_both_ends(self) -> None:
        found = windows(np.arange(18001) * STEP, 9.0)
        assert found == {
            "whole": slice(0, 18001),
            "after_first_period": slice(9000, 18001),
            "period_1": slice(0, 9000),
            "period_2": slice(9000, 18001),
        }

    def test_a_run_that_ends_early_keeps_what_it_reached(self) -> None:
        found = windows(np.arange(12000) * STEP, 9.0)
        assert found["after_first_period"] == slice(9000, 12000)
        assert set(found) == {"whole", "after_first_period", "period_1"}
        assert set(windows(np.arange(8999) * STEP, 9.0)) == {"whole"}

    @pytest.mark.parametrize("period", [0.0, -1.0])
    def test_without_a_period_only_the_whole_remains(self, period: float) -> None:
        assert windows(np.arange(100) * STEP, period) == {"whole": slice(0, 100)}

    @given(st.integers(2, 60), st.integers(1, 5), st.integers(0, 59), st.sampled_from([1e-3, 0.1, 1.0 / 3.0]))
    def test_periods_follow_one_another_whatever_the_rounding(
        self, samples: int, periods: int, rest: int, step: float
    ) -> None:
        count = samples * periods + min(rest, samples - 1)
        found = windows(np.cumsum(np.full(count, step)), samples * step)
        starts = [found[f"period_{k + 1}"].start for k in range(periods)]
        assert starts == [k * samples for k in range(periods)]
        assert f"period_{periods + 1}" not in found
        stops = [found[f"period_{k + 1}"].stop for k in range(periods)]
        lone_end = count == samples * periods + 1
        assert stops == [*starts[1:], samples * periods + lone_end]


class TestPeriodogram:
    @given(ERRORS)
    def test_parseval(self, e: Array) -> None:
        _, power = periodogram(e, STEP)
        scale = float(np.max(np.abs(e))) ** 2
        assert power.sum(axis=0) == pytest.approx(np.mean(e**2, axis=0), rel=1e-9, abs=1e-12 * scale)

    @pytest.mark.parametrize("count", [1000, 1001])
    def test_a_sine_is_one_line_of_half_its_amplitude_squared(self, count: int) -> None:
        time = np.arange(count) * STEP
        line = 7
        x = 3.0 * np.sin(2.0 * np.pi * line * time / (count * STEP))[:, None] + 2.0
        frequency, power = periodogram(x, STEP)
        expected = np.zeros(count // 2 + 1)
        expected[0], expected[line] = 4.0, 4.5
        assert power[:, 0] == pytest.approx(expected, abs=1e-12)
        assert frequency[line] == pytest.approx(line / (count * STEP))


class TestStatus:
    time = np.arange(2000) * STEP

    def judge(self, e: Array) -> tuple[str, float]:
        return status_of(self.time[: len(e)], e, np.deg2rad(10.0), 3.0, 0.5)

    def wave(self, frequency: float, amplitude: float = 1e-3) -> Array:
        return amplitude * np.sin(2.0 * np.pi * frequency * self.time)[:, None]

    def test_a_fast_error_rings_on_whichever_joint(self) -> None:
        both = np.hstack([self.wave(1.0), self.wave(5.0)])
        assert self.judge(both) == ("ringing", self.time[-1])
        assert self.judge(both[:, ::-1])[0] == "ringing"

    def test_the_share_is_of_each_joints_own_power(self) -> None:
        slow, fast = self.wave(1.0), self.wave(5.0)
        # 0.39 of either joint's power is fast; both together would be 0.78 of one.
        assert self.judge(np.hstack([slow + 0.8 * fast, slow + 0.8 * fast]))[0] == "ok"
        # A joint that rings stays one beside a slow joint with a hundred times its power.
        assert self.judge(np.hstack([10.0 * slow, fast]))[0] == "ringing"

    @pytest.mark.parametrize("value", [0.1746, -0.1746, math.nan, math.inf, -math.inf])
    def test_the_first_sample_out_of_bounds_is_the_end(self, value: float) -> None:
        e = np.zeros((2000, 2))
        e[700, 1] = value
        e[900, 0] = 1.0
        assert self.judge(e) == ("diverged", self.time[700])

    def test_a_lone_sample_cannot_ring(self) -> None:
        assert self.judge(np.full((1, 1), 1e-3)) == ("ok", 0.0)

    def test_the_limit_itself_is_within_bounds(self) -> None:
        e = np.full((2000, 1), np.deg2rad(10.0))
        assert self.judge(e)[0] == "ok"
        e[5] = np.nextafter(np.deg2rad(10.0), 1.0)
        assert self.judge(e) == ("diverged", self.time[5])


class TestWindowMean:
    @given(ERRORS, st.integers(1, 50))
    def test_it_is_the_mean_of_the_samples_in_reach(self, x: Array, samples: int) -> None:
        half = samples // 2
        expected = [x[max(k - half, 0) : k + half + 1].mean(axis=0) for k in range(len(x))]
        # Differences of running sums keep the rounding of the largest sum.
        slack = 1e-12 * (1.0 + float(np.abs(x).sum()))
        assert window_mean(x, samples) == pytest.approx(np.array(expected), rel=1e-9, abs=slack)
