"""The closed form of slow errors at printed gains; the linear loop and whole runs stand in tests/explain."""

import numpy as np

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import error_ratio, estimate_age, stiffness


def law(name, *overrides):
    return build_law(load_config("plain", "compare", overrides=overrides).config, name)


def test_printed_gains():
    c1, c2, c3 = (law(f"controller_{k}") for k in (1, 2, 3))
    np.testing.assert_allclose(error_ratio(c1, c2, 1e-3), [1.1, 1.2])
    np.testing.assert_allclose(error_ratio(c2, c3, 1e-9), 1.032, atol=5e-4)
    np.testing.assert_allclose(estimate_age(c1), [1.1, 1.2])
    np.testing.assert_allclose(estimate_age(c1, 1), [1.1, 1.2])
    np.testing.assert_allclose(estimate_age(c1._replace(stores_applied=True), 1), [2.1, 2.2])
    np.testing.assert_allclose(stiffness(c3, 0.01), 16.0)
    np.testing.assert_allclose(error_ratio(law("tdc"), c3, 0.01), 1.0)
    np.testing.assert_allclose(error_ratio(c3._replace(M_bar=0.5 * c3.M_bar), c3, 0.01), 2.0)
    inside = law("controller_2", "control.readings.phi_branch=power")
    np.testing.assert_allclose(stiffness(inside, 0.005), 8.0 * 1.5 * 0.005**-0.1)


def test_what_makes_an_estimate_older():
    c1 = law("controller_1")
    two_periods = law("controller_1", "control.readings.delay_time=two_periods")
    np.testing.assert_allclose(estimate_age(two_periods), 2.0 * estimate_age(c1))
    half, quarter = (c1._replace(estimate_filter=newest) for newest in (0.5, 0.25))
    np.testing.assert_allclose(estimate_age(half) - estimate_age(c1), 1.0)
    np.testing.assert_allclose(estimate_age(quarter) - estimate_age(c1), 3.0)


def test_error_grows_with_the_period_and_with_the_age_of_the_estimate():
    c1, c2 = law("controller_1"), law("controller_2")
    np.testing.assert_allclose(error_ratio(c2._replace(L=2.0 * c2.L), c2, 1e-3), 2.0)
    applied = c1._replace(stores_applied=True)
    np.testing.assert_allclose(error_ratio(applied, c1, 1e-3), 1.0)
    np.testing.assert_allclose(error_ratio(applied, c1, 1e-3, 2), [3.1 / 1.1, 3.2 / 1.2])
