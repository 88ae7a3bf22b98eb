"""The compiled steps against SciPy's own integrator, an independent program."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy
from scipy.integrate import ode
from support.oracles import FEATURES, PAPER, random_plant, random_state

from tendonrepro.physics.dynamics import rest_state
from tendonrepro.simulation.codegen import compiled, dop853

# Long enough for plants of some hundred hertz to have most steps refused at first.
L = 0.05
# SciPy below 1.17 shortens a rejected step by its error, SciPy 1.17 always to SMALLEST.
THE_SAME = tuple(map(int, scipy.__version__.split(".")[:2])) >= (1, 17)


def by_scipy(code, start, end, state, tau_m, p, rtol, atol, max_step):
    times, result = [], np.empty_like(state)

    def derivative(t, x):
        times.append(t)
        compiled.derivative(code, t, x, tau_m, p, result)
        return result

    options = {"max_step": max_step, "first_step": 0.5 * max_step, "nsteps": 5000}
    problem = ode(derivative).set_integrator("dop853", rtol=rtol, atol=atol, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        reached = problem.set_initial_value(state, start).integrate(end)
    return reached, problem.successful(), times


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("features", [frozenset(), PAPER, FEATURES], ids=["none", "paper", "all"])
def test_steps_are_those_of_scipy(n, features):
    rng = np.random.default_rng(n)
    evaluations = []
    for seed in range(20):
        plant = random_plant(n, seed, features).plant
        code, p = compiled.compiled_plant(plant)
        state = rest_state(np.zeros(n), plant) + 10.0 ** rng.uniform(-6, 0) * random_state(n, rng)
        given = code, 0.3, 0.3 + L, state, rng.uniform(-5.0, 5.0, n), p, 1e-5, 1e-7, L
        (ours, reached), (scipys, successful, times) = compiled.advance(*given), by_scipy(*given)
        assert reached
        assert successful
        evaluations.append(len(times))
        if THE_SAME:
            np.testing.assert_array_equal(ours, scipys)
        else:
            np.testing.assert_allclose(ours, scipys, rtol=1e-4, atol=1e-6)
    assert max(evaluations) > 50, "steps were rejected"


def test_order_of_the_method():
    """Steps of one length: half of it leaves a 256th of the error."""
    plant = random_plant(2, 3, frozenset()).plant
    code, p = compiled.compiled_plant(plant)
    state = rest_state(np.zeros(2), plant) + 1e-2

    def after(step):
        reached, slopes, tau_m = state, np.empty((dop853.STAGES, state.size)), np.zeros(2)
        for t in np.arange(0.0, 0.128, step):
            compiled.derivative(code, t, reached, tau_m, p, slopes[0])
            reached, _ = dop853._step(code, t, step, reached, tau_m, p, 1.0, 1.0, slopes)
        return reached

    exact = after(2e-3)
    errors = [np.abs(after(step) - exact).max() for step in (32e-3, 16e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=0.5)
