"""The sliding variable of a measured run, where it was not recorded."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import make_compare_file

from tendonrepro.physics.control import polynomial
from tendonrepro.verdicts.measurement import with_surface


def bare(run, time, e):
    """A run of which nothing but the error was recorded."""
    trace = make_compare_file(step=0.05, periods=1).runs[run]
    return replace(trace, time=time, variables={"e": e})


@pytest.mark.parametrize(("name", "beta"), [("controller_1", None), ("controller_3", 2.0)])
def test_it_follows_from_the_error_by_eq_11(name, beta):
    trace = make_compare_file(step=0.05, periods=1).runs[name]
    e = trace["e"]
    gamma_1, gamma_2 = polynomial(0.9, 0.2)
    surface = beta * e if beta else 1.5 * (gamma_1 * e + gamma_2 * np.abs(e) * e)
    expected = (e[2:] - e[:-2]) / 0.1 + surface[1:-1]
    found = with_surface(bare(name, trace.time, e))["s"]
    assert np.isnan(found[[0, -1]]).all()
    assert found[1:-1] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_it_needs_an_error_and_more_than_one_sample():
    trace = make_compare_file(step=0.05, periods=1, without=("s",)).runs["controller_2"]
    assert "s" not in with_surface(replace(trace, variables={"q_d": trace["q_d"]}))
    assert np.isnan(with_surface(bare("controller_2", trace.time[:1], trace["e"][:1]))["s"]).all()


@pytest.mark.parametrize("step", [0.001, 0.008, 0.01, 0.015, 0.025])
def test_its_rate_is_taken_over_the_same_time_whatever_the_sampling(step):
    time = step * np.arange(round(3.0 / step))
    e = 0.01 * np.sin(7.0 * time)[:, np.newaxis] * np.ones(2)
    found = with_surface(bare("controller_3", time, e))["s"]
    rate = found - 2.0 * e
    expected = 0.01 * (np.sin(7.0 * (time + 0.025)) - np.sin(7.0 * (time - 0.025))) / 0.05
    inside = (time > 0.03) & (time < time[-1] - 0.03)
    assert np.abs(rate[inside, 0] - expected[inside]).max() < 0.01 * 0.07
    assert np.isnan(found[[0, -1]]).all()
