"""The theory of docs/theory.md on the full flexible plant: the error that a slow load leaves.

λ k e + (λ + k) de + dde = (L/M_bar) [w dH − (c − 1) M_bar dddq − ½ (λ + k) M_bar ddq]

with w = 1 + α, 1 or 1 − α, c = 2 as Eq. (16) is printed and 1 centred, k the slope of the surface.
"""

from functools import cache

import numpy as np
import pytest
from support.overrides import SMOOTH, one_stroke

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import mae, rmse
from tendonrepro.simulation.stepper import simulate

L, M_BAR, LAM, BETA = 1e-3, 0.01, 8.0, 2.0
ALPHA = np.array([0.1, 0.2])
ETA_GAMMA = 1.5 * 1.1 * 0.2**-0.1, -1.5 * 0.1 * 0.2**-1.1  # eta gamma_1, eta gamma_2
STARTED = slice(1000, None)  # the first second holds the start, at which the acceleration jumps

LAWS = {  # run, reading of the weights, weight w of dH, slope of the surface fixed or of phi
    "interpolating": ("controller_1", "interpolating", 1.0 + ALPHA),
    "extrapolating": ("controller_1", "extrapolating", 1.0 - ALPHA),
    "tde": ("controller_2", "interpolating", np.ones(2)),
    "linear": ("controller_3", "interpolating", np.ones(2)),
}


@cache
def trace(law, period, differencing="lagging"):
    """One period of a raised cosine, 5 degrees of joint 2 and 20 degrees of joint 3."""
    run, weights, _ = LAWS[law]
    readings = f"control.readings.weights={weights}", f"control.readings.differencing={differencing}"
    found = load_config(None, "compare", overrides=(*SMOOTH, one_stroke(period), *readings))
    values = simulate(dict(build_loops(found.config, found.folder))[run])
    assert len(values["time"]) == round(period / L) + 1
    return values


def slope(law, e):
    """Slope of the chord of eta phi, or beta."""
    return BETA if law == "linear" else ETA_GAMMA[0] + ETA_GAMMA[1] * np.abs(e)


def rate(values):
    return np.gradient(values, L, axis=0)


def fitted(ours, theirs):
    """Factor between two error traces by least squares, per joint."""
    return (ours * theirs).sum(axis=0) / (theirs * theirs).sum(axis=0)


class TestErrorEquation:
    @staticmethod
    def sides(law, period, differencing="lagging", w=None, M_bar=M_BAR):
        """Both sides from one trace: H is the recorded one, e the tracking error."""
        values = trace(law, period, differencing)
        e, c = values["e"], 2 if differencing == "lagging" else 1
        k, w = slope(law, e), LAWS[law][2] if w is None else w
        de = rate(e)
        left = LAM * k * e + (LAM + k) * de + rate(de)
        own = (c - 1) * rate(values["ddq"]) + 0.5 * (LAM + k) * values["ddq"]
        right = L / M_BAR * (w * rate(values["H"]) - M_bar * own)
        # Derivatives at the very end are one-sided.
        return left[STARTED][:-2], right[STARTED][:-2]

    @pytest.mark.parametrize("law", sorted(LAWS))
    @pytest.mark.parametrize("differencing", ["lagging", "centred"])
    @pytest.mark.parametrize("period", [2.0, 4.0])
    def test_error_follows_its_equation(self, law, differencing, period):
        left, right = self.sides(law, period, differencing)
        # Left out is what is of second order in L: a few L of delay, 2 pi L/T each, of the whole.
        wrong = np.abs(left - right).max(axis=0)
        assert np.all(wrong <= 0.02 / period * np.abs(right).max(axis=0))

    @pytest.mark.parametrize("law", ["interpolating", "extrapolating"])
    def test_weight_of_plain_estimation_does_not_fit(self, law):
        left, right = self.sides(law, 4.0, w=1.0)
        assert np.all(np.abs(left - right).max(axis=0) > 0.05 * np.abs(right).max(axis=0))

    @pytest.mark.parametrize("law", sorted(LAWS))
    def test_terms_of_M_bar_cannot_be_left_out(self, law):
        left, right = self.sides(law, 4.0, M_bar=0.0)
        wrong = np.abs(left - right).max(axis=0) / np.abs(right).max(axis=0)
        assert wrong[1] > 0.015  # on joint 3, whose motor damping is the smaller


class TestRatios:
    @pytest.mark.parametrize(
        "period", [4.0, 8.0, *(pytest.param(period, marks=pytest.mark.slow) for period in (16.0, 32.0))]
    )
    def test_ratios_need_no_plant(self, period):
        """Ratios of controllers, with tolerances that shrink as the motion slows down."""
        e = {law: trace(law, period)["e"][STARTED] for law in LAWS}
        ddq = trace("tde", period)["ddq"][STARTED]
        k = slope("tde", 0.0)
        for law in ("interpolating", "extrapolating"):
            w = LAWS[law][2]
            # Common to all laws, so not part of the ratio: L ½ (λ + k) ddq of the velocity's delay.
            common = (w - 1.0) * L * 0.5 * (LAM + k) * ddq / (LAM * k)
            # The plant answers the error itself, D_m de and G' e, which is of the order of 1/T.
            np.testing.assert_allclose(fitted(e[law] - common, e["tde"]), w, atol=0.025 / period)
            # With that common part it is off by up to 6 % of w - 1: ½ (λ + k) M_bar beside D_m of joint 3.
            np.testing.assert_allclose(fitted(e[law], e["tde"]), w, atol=0.025 / period + 0.06 * 0.2)
        # Error sizes of 1 degree bend phi by 1 %; poles at k and lam answer by 1/T.
        np.testing.assert_allclose(fitted(e["tde"], e["linear"]), BETA / ETA_GAMMA[0], atol=0.06 / period)

    def test_prediction(self):
        """Worse by alpha than plain estimation; Controller 3 the best by 3 %: opposite to Table 2."""
        assert BETA / ETA_GAMMA[0] == pytest.approx(1.032, abs=5e-4)
        errors = {law: mae(trace(law, 8.0)["e"]) for law in LAWS}
        assert np.all(errors["interpolating"] > errors["tde"])
        assert np.all(errors["tde"] > errors["linear"])
        assert np.all(errors["linear"] > errors["extrapolating"])


class TestAbsoluteSize:
    @pytest.mark.slow
    @pytest.mark.parametrize("law", sorted(LAWS))
    def test_quasi_static_formula(self, law):
        """e = w L dH / (M_bar λ k): what it leaves out, (1/λ + 1/k) de, halves when the pace does."""
        shares = []
        for period in (16.0, 32.0):
            values = trace(law, period)
            e = values["e"]
            formula = LAWS[law][2] * L * rate(values["H"]) / (M_BAR * LAM * slope(law, e))
            wrong = (e - formula)[STARTED][:-2]
            shares.append(rmse(wrong) / rmse(e[STARTED]))
            # The load holds second harmonics too, hence the half on top of 2 pi/T.
            assert np.all(shares[-1] <= 1.5 * (1.0 / LAM + 1.0 / BETA) * 2.0 * np.pi / period)
        # The terms of M_bar, 2.5 % on joint 3, do not shrink as fast.
        assert np.all(shares[1] < 0.6 * shares[0])


class TestShippedComparison:
    """What is left of it with friction of the joints, encoder counts and the shipped motion."""

    @pytest.mark.slow
    def test_ranking(self):
        found = load_config(None, "compare")
        traces = {
            name: simulate(loop)["e"]
            for name, loop in build_loops(found.config, found.folder)
            if not name.endswith("payload")
        }
        for size in (mae, rmse):
            c1, c2, c3 = (size(traces[f"controller_{i}"]) for i in (1, 2, 3))
            # Friction that holds the arm makes all laws alike, so ratios may only be nearer to one.
            np.testing.assert_allclose(c1 / c2, 1.0 + ALPHA, atol=0.03)
            assert np.all(c2 / c3 > 0.995)
            assert np.all(c2 / c3 < 1.04)
