"""The sampled control law against the paper's equations, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import (
    DEGREES_PER_RADIAN,
    Law,
    Memory,
    Surface,
    command,
    error_rate,
    error_ratio,
    estimate_age,
    estimator_weights,
    phi,
    phi_slope,
    polynomial,
    remember,
    start_memory,
    stiffness,
    surface_and_feedback,
    time_delay_estimate,
)

N = 2
L = 2.0**-10  # close to 1 ms, and exact in binary: second differences of dyadic numbers do not round
M_BAR, LAM, ETA, B, DELTA, BETA = 0.01, 8.0, 1.5, 0.9, 0.2, 2.0
ALPHA = np.array([0.1, 0.2])

errors = st.floats(-1.0, 1.0)
rates = st.floats(-5.0, 5.0)
exponents = st.floats(0.05, 0.95)
boundaries = st.floats(0.01, 0.5)
scales = st.sampled_from([1.0, DEGREES_PER_RADIAN])
properties = settings(max_examples=100, deadline=None)


def make_law(alpha=ALPHA, weights="interpolating", **changes):
    gains = {"M_bar": M_BAR, "lam": LAM, "eta": ETA, "b": B, "Delta": DELTA, "beta": BETA}
    fields = {name: np.full(N, value) for name, value in gains.items()} | {
        "L": L,
        "K_d": np.full(N, BETA + LAM),
        "K_p": np.full(N, BETA * LAM),
        "weights": estimator_weights(alpha, weights),
        "power_floor": 1e-4,
        "rate_gain": np.full(N, ETA),
        "to_joint": np.eye(N),
        "from_joint": np.eye(N),
    }
    return Law(**(fields | changes))


def random_memory(seed):
    rng = np.random.default_rng(seed)
    q, tau = rng.normal(0.0, 0.1, (4, N)), rng.normal(0.0, 2.0, (2, N))
    ddq = (q[1:2] - 2.0 * q[2:3] + q[3:4]) / (L * L)
    return Memory(q[:3], tau, rng.normal(0.0, 0.5, N), np.zeros(N), ddq, np.zeros(N))


def after(memory, q, de=None, tau=None, law=None):
    """Memory one sample later."""
    still = np.zeros(N)
    law = law or make_law()
    return remember(memory, q, still, still if de is None else de, still, still if tau is None else tau, law)


class TestPhi:
    @properties
    @given(errors, exponents, boundaries, scales, st.booleans())
    def test_slope_is_the_derivative(self, e, b, Delta, scale, odd):
        law = make_law(b=np.full(N, b), Delta=np.full(N, Delta), angle_scale=scale, phi_is_odd=odd)
        h = 1e-7
        assume(odd or abs(e + Delta / scale) > 2.0 * h)  # the printed polynomial jumps there
        difference = (phi(e + h, law, 0) - phi(e - h, law, 0)) / (2.0 * h)
        # Across the boundary the second derivative jumps by at most 4 Delta^(b-2) scale.
        bend = 4.0 * h * scale * Delta ** (b - 2.0)
        assert phi_slope(e, law, 0) == pytest.approx(difference, rel=1e-6, abs=bend + 1e-8)

    @pytest.mark.parametrize("scale", [1.0, DEGREES_PER_RADIAN])
    def test_power_branch_everywhere(self, scale):
        law = make_law(power_inside=True, angle_scale=scale)
        e = 0.3 * DELTA / scale
        assert phi(e, law, 0) * scale == pytest.approx((0.3 * DELTA) ** B, rel=1e-14)
        difference = (phi(e * (1 + 1e-6), law, 0) - phi(e * (1 - 1e-6), law, 0)) / (2e-6 * e)
        assert phi_slope(e, law, 0) == pytest.approx(difference, rel=1e-8)
        # The slope grows without bound towards zero and is held below the floor.
        assert phi_slope(0.0, law, 0) == phi_slope(0.5 * law.power_floor / scale, law, 0)
        assert phi_slope(0.0, law, 0) == pytest.approx(B * law.power_floor ** (B - 1.0), rel=1e-14)

    @properties
    @given(exponents, boundaries)
    def test_print_is_discontinuous_for_negative_errors(self, b, Delta):
        law = make_law(b=np.full(N, b), Delta=np.full(N, Delta), phi_is_odd=False)
        outside, inside = phi(-Delta, law, 0), phi(np.nextafter(-Delta, 0.0), law, 0)
        # gamma_1 (-Delta) + gamma_2 Delta^2 = -(3 - 2b) Delta^b, beside -Delta^b: not monotone either.
        assert inside - outside == pytest.approx(-2.0 * (1.0 - b) * Delta**b, rel=1e-12)
        assert phi(Delta, law, 0) == pytest.approx(phi(np.nextafter(Delta, 0.0), law, 0), rel=1e-14)
        # Slopes just inside: gamma_1 - 2 gamma_2 Delta and gamma_1 + 2 gamma_2 Delta.
        power = Delta ** (b - 1.0)
        slopes = [phi_slope(side * np.nextafter(Delta, 0.0), law, 0) for side in (-1.0, 1.0)]
        assert slopes == pytest.approx([(4.0 - 3.0 * b) * power, b * power], rel=1e-12)
        # At the jump itself value and slope are those of the power branch.
        assert outside == pytest.approx(-(Delta**b), rel=1e-14)
        assert phi_slope(-Delta, law, 0) == pytest.approx(b * power, rel=1e-14)

    def test_printed_gains(self):
        gamma_1, gamma_2 = polynomial(B, DELTA)
        assert gamma_1 == pytest.approx(1.2921, abs=5e-5)
        assert gamma_2 == pytest.approx(-0.5873, abs=5e-5)
        # Inside Delta, where every printed error lies, Controller 3's surface is the stiffer one.
        assert ETA * phi_slope(0.0, make_law(), 0) == pytest.approx(1.94, abs=5e-3)
        assert ETA * phi_slope(0.0, make_law(), 0) < BETA


class TestErrorRate:
    def test_difference_of_the_error_is_half_a_period_of_acceleration_away(self):
        a, memory = np.array([0.8, -0.3]), start_memory(np.zeros(N), np.zeros(N))
        law = make_law(error_differenced=True)
        t, q = 0.2, np.array([0.011, 0.012])
        memory = memory._replace(q_d=0.5 * a * (t - L) ** 2, q=np.tile([0.01, 0.015], (3, 1)))
        de = error_rate(memory, q, 0.5 * a * t**2, np.full(N, np.nan), law)
        e, e_before = 0.5 * a * t**2 - q, memory.q_d - memory.q[0]
        np.testing.assert_allclose(de, (e - e_before) / L, rtol=1e-12)
        plain = error_rate(memory, q, 0.5 * a * t**2, a * t, make_law())
        np.testing.assert_allclose(plain - de, 0.5 * L * a, rtol=1e-9)

    def test_low_pass_follows_a_ramp_by_its_step_response(self):
        law = make_law(rate_filter=0.25)
        memory = start_memory(np.zeros(N), np.zeros(N))
        for k in range(1, 12):
            q = np.full(N, 3.0 * k * L)
            de = error_rate(memory, q, np.zeros(N), np.full(N, 5.0), law)
            np.testing.assert_allclose(de, 2.0 * (1.0 - 0.75**k), rtol=1e-13)
            memory = after(memory, q, de)


class TestEstimate:
    @pytest.mark.parametrize("newest", [1, 0])
    @pytest.mark.parametrize("lag", [1, 2, 4])
    @pytest.mark.parametrize("weights", ["interpolating", "extrapolating", "swapped"])
    def test_second_term_is_the_first_one_delay_time_earlier(self, newest, lag, weights):
        """Eqs. (15) and (16) written out on the record of angles and torques, (16) with a low-pass."""
        rng = np.random.default_rng(2)
        q, tau = rng.normal(0.0, 1e-3, (30, N)), rng.normal(0.0, 2.0, (30, N))
        law = make_law(weights=weights, newest=newest, lag=lag, ddq_filter=0.25)
        memory = start_memory(q[0], tau[0], lag)
        for k in range(29):
            memory = after(memory, q[k], tau=tau[k], law=law)
        ddq = [np.zeros(N)]
        for k in range(1, 30):
            one, two, three = (q[max(k - (newest + back) * lag, 0)] for back in range(3))
            ddq.append(0.75 * ddq[-1] + 0.25 * (one - 2.0 * two + three) / (lag * L) ** 2)
        first, second = (tau[29 - back * lag] - M_BAR * ddq[29 + lag - back * lag] for back in (1, 2))
        w = {"interpolating": ALPHA, "extrapolating": -ALPHA, "swapped": 1.0 - ALPHA}[weights]
        # Accelerations of some 1e5 rad/s^2 times M_bar cancel to the estimate.
        wanted = (1.0 - w) * first + w * second
        np.testing.assert_allclose(time_delay_estimate(memory, q[29], law), wanted, rtol=1e-11)

    def test_low_pass_keeps_what_is_constant_and_forgets_at_its_pace(self):
        """The step response of a first-order filter."""
        law = make_law(np.zeros(N), estimate_filter=0.25, newest=0)
        # From rest on, an acceleration of 3 rad/s^2 and a torque of 5 N m, both seen at once.
        q = np.tile(np.array([[3.0], [1.0], [0.0], [0.0]]) * 3.0 * L * L, (1, N))
        memory = start_memory(np.zeros(N), np.zeros(N))._replace(q=q[1:], tau=np.full((2, N), 5.0))
        for k in range(1, 12):
            H_hat = time_delay_estimate(memory, q[0], law)
            np.testing.assert_allclose(H_hat, (5.0 - M_BAR * 3.0) * (1.0 - 0.75**k), rtol=1e-9)
            memory = memory._replace(H_hat=H_hat)


class TestCommand:
    @properties
    @given(errors, rates, st.integers(0, 1))
    def test_feedback_as_printed(self, e, de, i):
        """Eqs. (9), (11), (12), (18) and Controller 3, written out once more."""
        if abs(e) < DELTA:
            gamma_1, gamma_2 = 1.1 * DELTA**-0.1, -0.1 * DELTA**-1.1
            value, slope = gamma_1 * e + gamma_2 * e * abs(e), gamma_1 + 2.0 * gamma_2 * abs(e)
        else:
            value, slope = np.sign(e) * abs(e) ** 0.9, 0.9 * abs(e) ** -0.1
        s = de + 1.5 * value
        ntsm = surface_and_feedback(e, de, make_law(), i)
        assert ntsm == pytest.approx((s, 1.5 * slope * de + 8.0 * s), rel=1e-12, abs=1e-13)
        s = de + 2.0 * e
        tsm = surface_and_feedback(e, de, make_law(surface=int(Surface.TSM)), i)
        assert tsm == pytest.approx((s, 2.0 * de + 8.0 * s), rel=1e-12, abs=1e-13)
        pd = surface_and_feedback(e, de, make_law(surface=int(Surface.PD)), i)
        assert pd == pytest.approx((de + 1.6 * e, 10.0 * de + 16.0 * e), rel=1e-12, abs=1e-13)
        assert pd[1] == pytest.approx(tsm[1], rel=1e-12, abs=1e-13)

    def test_dropped_eta_changes_the_damping_only(self):
        kept, dropped = make_law(), make_law(rate_gain=np.ones(N))
        e, de = 0.07, -0.3
        s, with_eta = surface_and_feedback(e, de, kept, 0)
        s_dropped, without = surface_and_feedback(e, de, dropped, 0)
        assert s == s_dropped
        assert with_eta - without == pytest.approx(0.5 * phi_slope(e, kept, 0) * de, rel=1e-12)
        assert surface_and_feedback(e, 0.0, kept, 0) == surface_and_feedback(e, 0.0, dropped, 0)

    def test_gains_in_degrees(self):
        """The law fed with degrees and giving N m, against the law in radians with scaled gains."""
        memory, q = random_memory(3), np.array([0.02, -0.01])
        desired = np.array([0.021, 0.3]), np.array([0.1, -0.1]), np.array([1.0, 2.0])
        in_degrees = command(
            memory._replace(**{name: np.rad2deg(getattr(memory, name)) for name in ("q", "de", "ddq")}),
            np.rad2deg(q),
            *map(np.rad2deg, desired),
            make_law(),
        )
        scaled = make_law(angle_scale=DEGREES_PER_RADIAN, M_bar=np.full(N, M_BAR * DEGREES_PER_RADIAN))
        ours = command(memory, q, *desired, scaled)
        np.testing.assert_allclose(ours[0], in_degrees[0], rtol=1e-12)
        np.testing.assert_allclose(ours[1], in_degrees[1], rtol=1e-12)
        np.testing.assert_allclose(np.rad2deg(ours[2]), in_degrees[2], rtol=1e-12)

    def test_law_in_other_torque_coordinates(self):
        """Its torque and history are mapped at the edge, its angles are not."""
        T, law = np.array([[2.0, -0.9], [0.0, 1.5]]), make_law(estimate_filter=0.3)
        memory = random_memory(4)._replace(H_hat=np.array([300.0, -200.0]))
        at = np.zeros(N), np.array([0.1, 0.2]), np.zeros(N), np.zeros(N)
        mapped = command(memory, *at, law._replace(to_joint=T, from_joint=np.linalg.inv(T)))
        tau, H_hat = np.linalg.solve(T, memory.tau.T).T, np.linalg.solve(T, memory.H_hat)
        plain = command(memory._replace(tau=tau, H_hat=H_hat), *at, law)
        np.testing.assert_allclose(mapped[0], T @ plain[0], rtol=1e-13)
        np.testing.assert_allclose(mapped[1], T @ plain[1], rtol=1e-13)
        np.testing.assert_array_equal(mapped[2], plain[2])


def test_with_an_exact_estimate_the_surface_decays_at_lambda():
    """With Ĥ = H and true derivatives Eq. (19) is left, whatever the arm; Δ is crossed on the way."""

    def surfaces(x):
        return np.array([surface_and_feedback(x[i], x[N + i], make_law(), i) for i in range(N)]).T

    t = np.linspace(0.0, 1.0, 101)
    path = solve_ivp(
        lambda _, x: np.concatenate([x[N:], -surfaces(x)[1]]),
        (0.0, 1.0), [0.5, -0.6, -0.5, 1.0], "DOP853", t, rtol=1e-11, atol=1e-12,
    )  # fmt: skip
    s = np.array([surfaces(x)[0] for x in path.y.T])
    # Integration at 1e-11 leaves far less than the last value, s0 exp(-8).
    np.testing.assert_allclose(s, s[0] * np.exp(-LAM * t[:, np.newaxis]), atol=1e-8)


def shipped_law(name, *overrides):
    return build_law(load_config("plain", "compare", overrides=overrides).config, name)


# ---- Slow errors: the closed form; the linear loop and whole runs stand in tests/analysis ------------------


def test_ratios_of_slow_errors_at_printed_gains():
    c1, c2, c3 = (shipped_law(f"controller_{k}") for k in (1, 2, 3))
    np.testing.assert_allclose(error_ratio(c1, c2, 1e-3), [1.1, 1.2])
    np.testing.assert_allclose(error_ratio(c2, c3, 1e-9), 1.032, atol=5e-4)
    np.testing.assert_allclose(estimate_age(c1), [1.1, 1.2])
    np.testing.assert_allclose(estimate_age(c1, 1), [1.1, 1.2])
    np.testing.assert_allclose(estimate_age(c1._replace(stores_applied=True), 1), [2.1, 2.2])
    np.testing.assert_allclose(stiffness(c3, 0.01), 16.0)
    np.testing.assert_allclose(error_ratio(shipped_law("tdc"), c3, 0.01), 1.0)
    np.testing.assert_allclose(error_ratio(c3._replace(M_bar=0.5 * c3.M_bar), c3, 0.01), 2.0)
    inside = shipped_law("controller_2", "control.readings.phi_branch=power")
    np.testing.assert_allclose(stiffness(inside, 0.005), 8.0 * 1.5 * 0.005**-0.1)


def test_what_makes_an_estimate_older():
    c1 = shipped_law("controller_1")
    two_periods = shipped_law("controller_1", "control.readings.delay_time=two_periods")
    np.testing.assert_allclose(estimate_age(two_periods), 2.0 * estimate_age(c1))
    half, quarter = (c1._replace(estimate_filter=newest) for newest in (0.5, 0.25))
    np.testing.assert_allclose(estimate_age(half) - estimate_age(c1), 1.0)
    np.testing.assert_allclose(estimate_age(quarter) - estimate_age(c1), 3.0)


def test_error_grows_with_the_period_and_with_the_age_of_the_estimate():
    c1, c2 = shipped_law("controller_1"), shipped_law("controller_2")
    np.testing.assert_allclose(error_ratio(c2._replace(L=2.0 * c2.L), c2, 1e-3), 2.0)
    applied = c1._replace(stores_applied=True)
    np.testing.assert_allclose(error_ratio(applied, c1, 1e-3), 1.0)
    np.testing.assert_allclose(error_ratio(applied, c1, 1e-3, 2), [3.1 / 1.1, 3.2 / 1.2])
