"""Errors of the reference itself, by law: with an ideal estimate they know no plant.

Then ``dde = ddq_d - feed_forward ddq_d - feedback(e, de)``: what the law is not told, and what it feeds back.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import phi, surface_and_feedback
from tendonrepro.physics.trajectory import late

LAMBDA, BETA = 8.0, 2.0
LAWS = ("controller_1", "controller_3")


def law(name):
    return build_law(load_config("plain", "compare").config, name)


def area(name, e, de=0.0, acceleration=0.0):
    """Area under the surface's function of the error, rad, and the error at its end, rad."""
    held = law(name)

    def derivative(_, x):
        surface = surface_and_feedback(x[0], 0.0, held, 0)[0]
        return x[1], acceleration - surface_and_feedback(x[0], x[1], held, 0)[1], surface

    found = solve_ivp(derivative, (0.0, 40.0), [e, de, 0.0], rtol=1e-10, atol=1e-14)
    return found.y[2, -1], found.y[0, -1]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("step", [0.09, -0.02])
def test_a_step_of_velocity_leaves_an_area_of_the_step_over_lambda(name, step):
    assert area(name, 0.0, step)[0] == pytest.approx(step / LAMBDA, rel=1e-7)


@pytest.mark.parametrize("offset", [0.02, -0.005])
def test_an_offset_leaves_the_area_of_two_time_constants(offset):
    expected = offset * (LAMBDA + BETA) / LAMBDA  # times beta, the slope of the surface
    assert area("controller_3", offset)[0] == pytest.approx(expected, rel=1e-7)


def test_an_offset_on_the_terminal_surface():
    held, offset = law("controller_1"), 0.02
    expected = offset + held.eta[0] * phi(offset, held, 0) / LAMBDA
    assert area("controller_1", offset)[0] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("acceleration", [0.2, -0.05])
def test_an_acceleration_that_is_not_fed_forward_leaves_an_error(acceleration):
    end = area("controller_3", 0.0, acceleration=acceleration)[1]
    assert end == pytest.approx(acceleration / (LAMBDA * BETA), rel=1e-7)
    held, end = law("controller_1"), area("controller_1", 0.0, acceleration=acceleration)[1]
    assert held.eta[0] * phi(end, held, 0) == pytest.approx(acceleration / LAMBDA, rel=1e-7)


def test_only_the_reading_takes_the_acceleration_away():
    for word, share in (("fed_forward", 1.0), ("absent", 0.0), ("late", 1.0)):
        changed = [f"control.readings.reference_acceleration={word}"]
        config = load_config("plain", "compare", overrides=changed).config
        assert build_law(config, "controller_1").feed_forward == share


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
