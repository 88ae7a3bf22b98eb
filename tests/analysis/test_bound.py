"""Controller 3's error is that of Controller 2 through (s + η γ₁)/(s + β): docs/theory.md, "A bound".

Two ways: a filter on the errors of simulated runs, and the sampled loop of an arm.
"""

from functools import cache

import numpy as np
import pytest
from scipy.signal import dlsim
from support.overrides import SMOOTH, one_stroke

from tendonrepro.analysis.explain import ratio_range
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops, run_views
from tendonrepro.simulation.stepper import simulate

LAM, BETA = 8.0, 2.0
K = 1.5 * (2.0 - 0.9) * 0.2 ** (0.9 - 1.0)  # eta gamma_1 of the printed gains, s⁻¹
L = 1e-3


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


@cache
def errors(*overrides):
    """Errors (T, n) of Controllers 2 and 3 on the plain arm."""
    loaded = load_config("plain", "compare", overrides=overrides, controllers=(2, 3))
    loops = dict(build_loops(loaded.config, loaded.folder))
    return [simulate(loops[f"controller_{k}"])["e"] for k in (2, 3)]


def through(of_2, k):
    """Errors of Controller 2 through ``(s + k)/(s + beta)``, by Tustin's rule."""
    b, a = np.array([2.0 / L + k, k - 2.0 / L]), np.array([2.0 / L + BETA, BETA - 2.0 / L])
    return np.stack([dlsim((b, a, L), column)[1][:, 0] for column in of_2.T], axis=1)


RUNS = {
    "cosine": (*SMOOTH, one_stroke(4.0)),
    "payload": (*SMOOTH, one_stroke(4.0), "runs.controller_2.payload=0.2", "runs.controller_3.payload=0.2"),
    "no acceleration": (*SMOOTH, one_stroke(4.0), "control.readings.reference_acceleration=absent"),
}


class TestRuns:
    @pytest.mark.parametrize("name", RUNS)
    def test_its_error_is_that_of_2_through_the_filter(self, name):
        of_2, of_3 = errors(*RUNS[name])
        left = {k: rms(through(of_2, k) - of_3) / rms(of_3) for k in (K, BETA, 0.97 * K)}
        assert (left[K] < 0.008).all()
        # Another constant does not do: neither the same surface, nor one softer by 3 %.
        assert (left[BETA] > 3.0 * left[K]).all()
        assert (left[0.97 * K] > 2.0 * left[K]).all()


class TestSampledLoop:
    @staticmethod
    def found(a, b, *overrides):
        views = run_views(load_config("plain", "compare", overrides=overrides).config)
        return ratio_range(views[f"controller_{a}"], views[f"controller_{b}"], np.zeros((1, 2)), 3.0)

    def test_range_of_controllers_3_and_2_is_that_of_the_filter(self):
        found = self.found(3, 2)
        # At rest K / beta, and no more than 1 but for what the arm gives back.
        np.testing.assert_allclose(found.of_joints[0], K / BETA, rtol=1e-3)
        assert 1.0 < found.all_joints[1] < 1.006
        swapped = self.found(2, 3)
        np.testing.assert_allclose(swapped.all_joints, 1.0 / found.all_joints[::-1], rtol=1e-9)

    @pytest.mark.parametrize("reading", ["Delta_unit=deg", "phi_branch=power"])
    def test_a_steeper_surface_breaks_it(self, reading):
        assert (self.found(3, 2, f"control.readings.{reading}").of_joints[1] > 1.2).all()

    def test_turned_weights_do_not(self):
        assert self.found(3, 2, "control.readings.weights=extrapolating").all_joints[1] < 1.006

    def test_age_of_the_estimate_is_the_slow_end_alone(self):
        found = self.found(1, 2)
        np.testing.assert_allclose(found.of_joints[1], [1.1, 1.2], rtol=0.01)
        assert found.of_joints[0, 0] < 1.05

    def test_a_loop_that_grows_has_none(self):
        assert self.found(3, 2, "control.readings.gain_unit=law_in_degrees") is None
