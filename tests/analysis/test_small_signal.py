"""The theory of docs/theory.md on the full flexible plant: the error that a slow load leaves.

λ k e + (λ + k) de + dde = (L/M_bar) [w dH − (c − 1) M_bar dddq − ½ (λ + k) M_bar ddq]

with w = 1 + α, 1 or 1 − α, c = 2 as Eq. (16) is printed and 1 centred, k the slope of the surface.
"""

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


def trace(law, period, differencing):
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


@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("differencing", ["lagging", "centred"])
@pytest.mark.parametrize("period", [2.0, 4.0])
def test_error_follows_its_equation(law, differencing, period):
    """Both sides from one trace: H is the recorded one, e the tracking error."""
    values = trace(law, period, differencing)
    e, c = values["e"], 2 if differencing == "lagging" else 1
    k, w, de = slope(law, e), LAWS[law][2], rate(e)
    left = LAM * k * e + (LAM + k) * de + rate(de)
    own = (c - 1) * rate(values["ddq"]) + 0.5 * (LAM + k) * values["ddq"]
    right = L / M_BAR * (w * rate(values["H"]) - M_BAR * own)
    # Left out is what is of second order in L: a few L of delay, 2 pi L/T each, of the whole.
    # Derivatives at the very end are one-sided.
    wrong, whole = (np.abs(side[STARTED][:-2]).max(axis=0) for side in (left - right, right))
    assert np.all(wrong <= 0.02 / period * whole)
