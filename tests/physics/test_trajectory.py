"""Reference motions: derivatives, ends, joints between strokes, and files."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tendonrepro.configuration.models.reference import read_samples
from tendonrepro.errors import ConfigError
from tendonrepro.physics.trajectory import (
    Motion,
    at_rest,
    late,
    minimum_jerk,
    motion,
    raised_cosine,
    ramp,
    sampled,
    smooth_sine,
    straight_lines,
    trapezoid_times,
    trapezoidal,
)

A = np.deg2rad(30.0)
KNOTS = np.linspace(0.0, 2.0, 21)

SHAPES = {
    "raised cosine": lambda: (raised_cosine(A, 4.0), 4.0),
    "minimum jerk": lambda: (minimum_jerk(A, 1.5, 0.5), 4.0),
    "minimum jerk, no hold": lambda: (minimum_jerk(-A, 2.0, 0.0), 4.0),
    "trapezoid": lambda: (trapezoidal(A, 0.5, 1.0, 0.4), 2.0 * (trapezoid_times(A, 0.5, 1.0)[1] + 0.4)),
    "triangle": lambda: (trapezoidal(-A, 5.0, 1.0, 0.3), 2.0 * (trapezoid_times(A, 5.0, 1.0)[1] + 0.3)),
    "sine": lambda: (smooth_sine(0.3, 0.2, 1.3, 0.9), 4.0),
    "sampled": lambda: (sampled(KNOTS, 0.4 * np.sin(KNOTS) ** 3), 2.0),
    "rest": lambda: (at_rest, 4.0),
}
"""Shapes with the time after which they are through; made in the test, where a planted fault is seen."""
SMOOTH = {"raised cosine", "sampled", "rest"}  # the others are put together from pieces
RETURNS = set(SHAPES) - {"sine", "sampled"}

every = pytest.mark.parametrize("name", sorted(SHAPES))
positive = st.floats(0.05, 5.0)
amplitudes = st.floats(-1.0, 1.0, allow_subnormal=False)


class TestEveryShape:
    @every
    def test_derivatives(self, name):
        shape, period = SHAPES[name]()
        h = 1e-5
        t = np.linspace(h, period - h, 4001)
        before, now, after = shape(t - h), shape(t), shape(t + h)
        for value, rate in ((0, 1), (1, 2)):
            difference = (after[value] - before[value]) / (2.0 * h)
            wrong = np.abs(difference - now[rate]) > 1e-6
            # At most 8 corners, each met by at most one of the times, which lie far more than h apart.
            assert wrong.sum() <= (0 if name in SMOOTH else 8), (rate, t[wrong])

    @every
    def test_starts_at_rest_at_zero(self, name):
        q, dq, _ = SHAPES[name]()[0](np.zeros(1))
        np.testing.assert_allclose([q, dq], 0.0, atol=1e-15)

    @pytest.mark.parametrize("name", sorted(RETURNS))
    def test_ends_at_rest_where_it_started(self, name):
        shape, period = SHAPES[name]()
        q, dq, _ = shape(np.array([period]))
        np.testing.assert_allclose([q, dq], 0.0, atol=1e-14)


class TestShapes:
    def test_minimum_jerk_peaks(self):
        """Textbook peaks of the quintic: velocity 1.875 A/T in the middle, acceleration 10/√3 A/T²."""
        q, dq, ddq = minimum_jerk(A, 1.5, 0.5)(1.5 * np.array([0.5, 0.5 - np.sqrt(3.0) / 6.0]))
        assert (q[0], dq[0]) == pytest.approx((0.5 * A, 1.875 * A / 1.5), rel=1e-12)
        assert ddq[1] == pytest.approx(10.0 / np.sqrt(3.0) * A / 1.5**2, rel=1e-11)

    def test_raised_cosine(self):
        q, _, ddq = raised_cosine(A, 4.0)(np.array([0.0, 1.0, 2.0]))
        np.testing.assert_allclose(q, [0.0, A / 2.0, A], atol=1e-15)
        np.testing.assert_allclose(ddq[[0, 2]], 0.5 * A * (np.pi / 2.0) ** 2 * np.array([1.0, -1.0]))

    @settings(max_examples=60, deadline=None)
    @given(amplitudes, positive, positive)
    def test_trapezoid_keeps_its_limits(self, amplitude, velocity, acceleration):
        ramp, rise = trapezoid_times(amplitude, velocity, acceleration)
        q, dq, ddq = trapezoidal(amplitude, velocity, acceleration, 0.1)(np.linspace(0.0, rise, 301))
        assert np.abs(dq).max() <= velocity * (1.0 + 1e-9)
        assert np.abs(ddq).max() <= acceleration * (1.0 + 1e-9)
        assert q[-1] == pytest.approx(amplitude, rel=1e-9, abs=1e-12)
        assert 2.0 * ramp <= rise * (1.0 + 1e-12)

    def test_trapezoid_times(self):
        # 1 s of ramp to 1 rad/s covers 0.5 rad; two ramps and 1 rad in between make 2 rad in 3 s.
        assert trapezoid_times(2.0, 1.0, 1.0) == pytest.approx((1.0, 3.0))
        # Too short for 1 rad/s: a triangle of 0.5 s up, 0.5 s down.
        assert trapezoid_times(0.25, 1.0, 1.0) == pytest.approx((0.5, 1.0))
        assert trapezoid_times(0.0, 1.0, 1.0) == (0.0, 0.0)

    def test_sine_after_its_start(self):
        t = np.linspace(1.0, 4.0, 50)
        q, dq, ddq = smooth_sine(0.3, 0.2, 1.3, 0.9)(t)
        w = 2.0 * np.pi / 1.3
        np.testing.assert_allclose(q, 0.2 + 0.3 * np.sin(w * t), atol=1e-15)
        np.testing.assert_allclose(dq, 0.3 * w * np.cos(w * t), atol=1e-14)
        np.testing.assert_allclose(ddq, -0.3 * w**2 * np.sin(w * t), atol=1e-13)

    @pytest.mark.parametrize("start", [0.0, 7.5])
    def test_spline_reproduces_a_quintic(self, start):
        """A minimum-jerk stroke is a quintic at rest at both ends, so the spline is that stroke."""
        knots = start + 2.0 * np.sort(np.r_[0.0, 1.0, np.random.default_rng(0).uniform(0.0, 1.0, 9)])
        stroke = minimum_jerk(0.7, 2.0, 1.0)
        t = np.linspace(0.0, 2.0, 401)
        for ours, exact in zip(sampled(knots, stroke(knots - start)[0])(t), stroke(t), strict=True):
            # Random knots lie as close as 0.01 s: rounding grows by its inverse square in the curvature.
            np.testing.assert_allclose(ours, exact, atol=1e-10)


class TestStraightLines:
    """A sample on a corner has the velocity after it, however its time was rounded."""

    RISE, HOLD = 2.07, 1.13

    def ramps(self):
        corners = np.cumsum([0.0, self.RISE, self.HOLD, self.RISE, self.HOLD])
        return {
            "ramp": ramp(A, self.RISE, self.HOLD),
            "samples": straight_lines(corners, A * np.array([0.0, 1.0, 1.0, 0.0, 0.0])),
            "samples that begin late": straight_lines(7.5 + corners, A * np.array([0.0, 1.0, 1.0, 0.0, 0.0])),
        }

    @pytest.mark.parametrize("name", ["ramp", "samples", "samples that begin late"])
    def test_velocity_steps_on_the_corners_and_no_acceleration(self, name):
        q, dq, ddq = self.ramps()[name](1e-3 * np.arange(6401))
        v = A / self.RISE
        np.testing.assert_allclose(dq, np.repeat([v, 0.0, -v, 0.0], [2070, 1130, 2070, 1131]), rtol=1e-12)
        np.testing.assert_allclose(np.diff(q), 1e-3 * dq[:-1], atol=1e-12)
        np.testing.assert_array_equal(ddq, 0.0)
        assert (q[0], q[-1]) == pytest.approx((0.0, 0.0), abs=1e-15)


class TestMotion:
    def test_turns_follow_one_another(self):
        up, period = minimum_jerk(A, 0.6, 0.4), 2.0
        first, second = Motion((up, at_rest), period), Motion((at_rest, up), period)
        assert first.duration == 4.0
        t = np.linspace(0.0, 4.0, 4001)
        q_d, dq_d, ddq_d = motion(t, [first, second])
        assert q_d.shape == dq_d.shape == ddq_d.shape == (4001, 2)
        np.testing.assert_array_equal(q_d[t > 2.0, 0], 0.0)
        np.testing.assert_array_equal(q_d[t < 2.0, 1], 0.0)
        np.testing.assert_allclose(q_d[2000:, 1], q_d[:2001, 0], atol=1e-12)

    def test_a_turn_begins_on_its_own_sample(self):
        """The sample at a turn's boundary belongs to the new turn, however its time was rounded."""
        marks = [lambda x, k=k: (np.full_like(x, k), 0.0 * x, 0.0 * x) for k in range(5)]
        for tenths in range(1, 50):
            samples = 100 * tenths
            t = 1e-3 * np.arange(5 * samples + 1)
            q_d, _, _ = motion(t, [Motion(tuple(marks), tenths / 10.0)])
            np.testing.assert_array_equal(q_d[:-1, 0], np.repeat(np.arange(5.0), samples))
            assert q_d[-1, 0] == 4.0

    def test_after_the_last_turn_a_joint_stays(self):
        q_d, dq_d, ddq_d = motion(
            np.array([1.0, 3.5, 9.0]), [Motion((smooth_sine(0.3, 0.2, 1.3, 0.9),), 3.0)]
        )
        end = smooth_sine(0.3, 0.2, 1.3, 0.9)(np.array([3.0]))[0][0]
        np.testing.assert_array_equal(q_d[1:, 0], end)
        np.testing.assert_array_equal(dq_d[1:, 0], 0.0)
        np.testing.assert_array_equal(ddq_d[1:, 0], 0.0)
        assert dq_d[0, 0] != 0.0


class TestLate:
    L, LAG = 1e-3, 12e-3

    def test_answer_to_a_step_is_exponential(self):
        found = late(np.ones((200, 2)), self.L, self.LAG)
        time = self.L * np.arange(1, 201)  # the first sample is already on its way
        np.testing.assert_allclose(found, np.tile(1.0 - np.exp(-time / self.LAG), (2, 1)).T, rtol=1e-12)

    def test_a_slow_motion_is_late_by_the_time_constant(self):
        time = self.L * np.arange(4000)
        found = late(np.sin(2.0 * time)[:, np.newaxis], self.L, self.LAG)[1000:, 0]
        delay = self.LAG - 0.5 * self.L  # as it holds the newest value
        np.testing.assert_allclose(found, np.sin(2.0 * (time[1000:] - delay)), atol=1e-3)

    def test_no_lag_changes_nothing(self):
        rates = np.random.default_rng(1).normal(size=(30, 2))
        assert late(rates, self.L, 0.0) is rates


ROWS = tuple(f"{0.5 * k},{3 * k},{-k}" for k in range(8))


class TestFile:
    def write(self, tmp_path, *lines):
        path = tmp_path / "motion.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def test_columns(self, tmp_path):
        time, angles = read_samples(self.write(tmp_path, "time_s,q2_deg,q3_deg", *ROWS))
        np.testing.assert_array_equal(time, 0.5 * np.arange(8))
        assert sorted(angles) == [2, 3]
        np.testing.assert_allclose(angles[2], np.deg2rad(3.0 * np.arange(8)), rtol=1e-15)
        np.testing.assert_allclose(angles[3], np.deg2rad(-1.0 * np.arange(8)), rtol=1e-15)

    @pytest.mark.parametrize(
        "header",
        ["t,q2_deg", "time_s,q2_deg,speed", "time_s,q2_deg,q2_deg"],
    )
    def test_header(self, tmp_path, header):
        path = self.write(tmp_path, header, *ROWS)
        with pytest.raises(ConfigError) as caught:
            read_samples(path)
        assert caught.value.where == f"{path}:1"

    @pytest.mark.parametrize(
        ("rows", "line"),
        [
            ((*ROWS[:5], "", "# pause", *ROWS[4:]), ":9"),
            (ROWS[:5], ""),
            ((*ROWS, "9,nan,0"), ""),
            ((*ROWS, "9,1"), ""),
        ],
    )
    def test_rows(self, tmp_path, rows, line):
        path = self.write(tmp_path, "time_s,q2_deg,q3_deg", *rows)
        with pytest.raises(ConfigError) as caught:
            read_samples(path)
        assert caught.value.where.startswith(f"{path}{line}")
