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
    found = load_config("plain", "compare", overrides=(*SMOOTH, one_stroke(period), *readings))
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
    def sides(law, period, differencing="lagging", w=None):
        """Both sides from one trace: H is the recorded one, e the tracking error."""
        values = trace(law, period, differencing)
        e, c = values["e"], 2 if differencing == "lagging" else 1
        k, w = slope(law, e), LAWS[law][2] if w is None else w
        de = rate(e)
        left = LAM * k * e + (LAM + k) * de + rate(de)
        own = (c - 1) * rate(values["ddq"]) + 0.5 * (LAM + k) * values["ddq"]
        right = L / M_BAR * (w * rate(values["H"]) - M_BAR * own)
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
