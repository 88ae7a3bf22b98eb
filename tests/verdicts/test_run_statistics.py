"""The vectorised statistics are the streamed ones."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.synthetic import make_compare_file

from tendonrepro.dataset.motion import derivatives
from tendonrepro.physics.control import polynomial
from tendonrepro.simulation.streaming import Sample, Sums, add_sample, finished, thresholds
from tendonrepro.verdicts.measured import sliding_variable, statistics_of


class TestStatistics:
    """The vectorised statistics are the streamed ones."""

    def test_they_agree_with_the_sums(self):
        trace = make_compare_file(step=0.05, periods=1).runs["controller_2"]
        dq_d, ddq_d = derivatives(trace)
        phases = thresholds(dq_d, ddq_d, 0.05)
        n, count = 2, len(trace.time)
        sums = Sums(*(np.zeros(n) for _ in Sums._fields))
        e, s, tau, H_hat = (trace[name] for name in ("e", "s", "tau_m", "H_hat"))
        none = np.zeros(n)
        for k in range(count):
            before = tau[max(k - 1, 0)]
            sample = Sample(e[k], none, dq_d[k], ddq_d[k], s[k], tau[k], before, H_hat[k], none, none)
            sums = add_sample(sums, sample, 1.0, float(k), phases)
        expected = finished(sums, count, none)
        found = statistics_of(trace, (dq_d, ddq_d))
        sizes = product(("torque", "H_hat"), ("rms", "peak", "slow"), ("", "_up", "_down"))
        assert set(found) == {"s_rms", "s_slow_rms", "torque_step_rms", "mae_rapid", "mae_calm"} | {
            f"{signal}_{size}{phase}" for signal, size, phase in sizes
        }
        for name, values in found.items():
            assert values == pytest.approx(expected[name], rel=1e-12), name

    def test_missing_samples_are_left_out_one_by_one(self):
        trace = make_compare_file(step=0.05, periods=1).runs["controller_1"]
        holed = trace["H_hat"].copy()
        holed[10:20] = np.nan
        rates = derivatives(trace)
        up = rates[0] > 0.05 * np.abs(rates[0]).max(axis=0)
        up[10:20] = False
        found = statistics_of(replace(trace, variables={**trace.variables, "H_hat": holed}), rates)
        size = np.abs(trace["H_hat"])
        expected = [np.sqrt((size[up[:, i], i] ** 2).mean()) for i in range(2)]
        assert found["H_hat_rms_up"] == pytest.approx(expected, rel=1e-12)
        assert found["H_hat_peak_up"] == pytest.approx([size[up[:, i], i].max() for i in range(2)])
        assert np.isfinite(found["H_hat_slow_up"]).all(), "the low-pass goes on after a gap"

    @pytest.mark.parametrize(("name", "beta"), [("controller_1", None), ("controller_3", 2.0)])
    def test_s_follows_from_e_by_eq_11(self, name, beta):
        trace = make_compare_file(step=0.05, periods=1, without=("s",)).runs[name]
        e = trace["e"]
        gamma_1, gamma_2 = polynomial(0.9, 0.2)
        surface = beta * e if beta else 1.5 * (gamma_1 * e + gamma_2 * np.abs(e) * e)
        expected = (e[2:] - e[:-2]) / 0.1 + surface[1:-1]
        found = sliding_variable(trace)
        assert found is not None
        assert np.isnan(found[[0, -1]]).all()
        assert found[1:-1] == pytest.approx(expected, rel=1e-9, abs=1e-12)

    def test_one_sample_is_enough_for_a_mean_and_none_is_none(self):
        trace = make_compare_file(step=0.05, periods=1).runs["controller_1"]
        tau = np.full_like(trace["tau_m"], np.nan)
        tau[7, 0] = -2.0
        found = statistics_of(replace(trace, variables={"tau_m": tau}), None)
        assert found["torque_rms"].tolist() == pytest.approx([2.0, np.nan], nan_ok=True)
        for name in ("torque_peak", "torque_slow"):
            assert found[name].tolist() == pytest.approx([2.0, np.nan], nan_ok=True)
        assert np.isnan(found["torque_step_rms"]).all()
        assert not any(name.endswith(("_up", "_down")) for name in found), "no phases without rates"

    def test_s_needs_a_law_an_error_and_more_than_one_sample(self):
        trace = make_compare_file(step=0.05, periods=1, without=("s",)).runs["controller_2"]
        assert sliding_variable(replace(trace, name="decouple")) is None
        assert sliding_variable(replace(trace, variables={"q_d": trace["q_d"]})) is None
        alone = sliding_variable(replace(trace, time=trace.time[:1], variables={"e": trace["e"][:1]}))
        assert alone is not None
        assert np.isnan(alone).all()
