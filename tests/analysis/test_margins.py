"""Margins against the loops they speak of: closed with the factor, the loop is on its limit."""

from functools import cache

import numpy as np
import pytest
from support.overrides import SMOOTH, one_stroke

from tendonrepro.analysis.margins import channel, channel_margins, disk_margin, response, scaled_norm
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_law, build_loops
from tendonrepro.experiments.rig import build_plant
from tendonrepro.physics.control import error_ratio
from tendonrepro.physics.linear_loop import open_loop, spectral_radius
from tendonrepro.simulation.stepper import simulate

L = 1e-3
POSTURE = np.deg2rad([30.0, 30.0])
CASES = [
    ("controller_1", 0.0, 0, False),
    ("controller_1", 0.2, 0, False),
    ("controller_3", 0.0, 1, False),
    ("controller_2", 0.0, 1, True),
    ("controller_2", 0.2, 2, False),
]


@cache
def config(*overrides):
    return load_config("plain", "compare", overrides=overrides).config


@cache
def cut(name, payload, delay, applied):
    plant, law = build_plant(config(), payload), build_law(config(), name)
    return open_loop(POSTURE, plant, law._replace(stores_applied=applied), delay)


def radius(single, factor):
    A, b, c = single
    return spectral_radius(A + factor * b @ c)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("joint", [0, 1])
def test_loop_is_lost_at_its_margins_and_not_before(case, joint):
    """Each margin is of a gain, or of a lag or lead."""
    single, found = channel(cut(*case), joint), channel_margins(cut(*case), joint, L)
    A, b, c = single
    gain, lag = found.gain_margin, np.deg2rad(found.phase_margin_deg)
    assert max(radius(single, x) for x in np.geomspace(1.0, 1.0 + 0.999 * (gain - 1.0), 60)) < 1.0
    assert radius(single, 1.0 + 1.001 * (gain - 1.0)) > 1.0
    z = np.linalg.eigvals(A + gain * b @ c)
    assert np.abs(z - np.exp(2j * np.pi * found.gain_margin_hz * L)).min() < 1e-6
    both = np.array([1.0j, -1.0j])
    inside = np.exp(np.outer(np.linspace(0.0, 0.999 * lag, 40), both)).ravel()
    assert max(radius(single, factor) for factor in inside) < 1.0
    assert max(radius(single, factor) for factor in np.exp(1.001 * lag * both)) > 1.0
    G = response(single, 2.0 * np.pi * L * np.array([found.crossover_hz]))
    assert np.abs(G) == pytest.approx(1.0, rel=1e-8)
    # The shortest delay of all places where the gain is 1.
    angles = np.union1d(np.geomspace(1e-4, np.pi, 20001), np.pi - np.geomspace(1e-7, 1.0, 2001))
    G = response(single, angles)[:, 0, 0]
    unity = np.flatnonzero(np.diff(np.abs(G) > 1.0))
    delays = np.mod(np.angle(G[unity]), 2.0 * np.pi) / angles[unity] * L
    assert found.delay_margin_s == pytest.approx(delays.min(), rel=1e-2)


class TestKnownLoop:
    """Closed forms: an integrator under proportional feedback."""

    @pytest.mark.parametrize("k", [0.1, 0.7, 1.6])
    def test_margins(self, k):
        loop = np.eye(1), np.eye(1), np.array([[-k]])
        found = channel_margins(loop, 0, L)
        crossover = 2.0 * np.arcsin(0.5 * k)
        assert found.gain_margin == pytest.approx(2.0 / k, rel=1e-9)
        assert found.gain_margin_hz == pytest.approx(500.0)
        lag = 0.5 * np.pi - 0.5 * crossover
        assert found.phase_margin_deg == pytest.approx(np.rad2deg(lag), rel=1e-8)
        assert found.delay_margin_s == pytest.approx(lag / crossover * L, rel=1e-8)
        assert found.loop_gain == pytest.approx(k / (2.0 * np.sin(np.pi * 0.1 * L)), rel=1e-9)
        margin, hertz = disk_margin(loop, L)
        assert margin == pytest.approx(2.0 * (2.0 - k) / (2.0 + k), rel=1e-6)
        assert hertz == pytest.approx(500.0)

    @pytest.mark.parametrize("k", [0.3, -0.3])
    def test_a_resonance_may_be_lost_by_a_lag_or_a_lead(self, k):
        """The response has the lag where k is positive, and the lead where it is negative."""
        turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
        loop = 0.9 * turn, np.array([[0.0], [1.0]]), np.array([[k, 0.0]])
        margin = np.deg2rad(channel_margins(loop, 0, L).phase_margin_deg)
        inside = margin * np.linspace(-0.999, 0.999, 81)
        assert max(radius(loop, np.exp(1j * phase)) for phase in inside) < 1.0
        assert max(radius(loop, np.exp(1j * phase)) for phase in (1.001 * margin, -1.001 * margin)) > 1.0

    def test_growing_loop_has_none(self):
        loop = np.eye(1), np.eye(1), np.array([[-2.1]])
        found = channel_margins(loop, 0, L)
        assert not found.stable
        assert np.isnan([found.gain_margin, found.phase_margin_deg, found.delay_margin_s]).all()
        assert np.isnan(disk_margin(loop, L)).all()


class TestDiskMargin:
    @staticmethod
    def closed(loop, d):
        A, B, C = loop
        return spectral_radius(A + B @ np.diag((2.0 + d) / (2.0 - d)) @ C)

    @pytest.mark.parametrize("case", CASES[:3])
    def test_nothing_inside_is_lost(self, case):
        loop = cut(*case)
        margin, _ = disk_margin(loop, L)
        rng = np.random.default_rng(7)
        for _ in range(300):
            d = 0.999 * margin * np.sqrt(rng.uniform(0.5, 1.0, 2)) * np.exp(2j * np.pi * rng.uniform(size=2))
            assert self.closed(loop, d) < 1.0

    @pytest.mark.parametrize("case", CASES[:3])
    def test_border_is_lost(self, case):
        """For every phase of the first factor the second that loses the loop; the nearest is on the disk."""
        loop = cut(*case)
        margin, hertz = disk_margin(loop, L)
        G = response(loop, 2.0 * np.pi * L * np.array([hertz]))[0]
        d1 = margin * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 20001))
        f1 = (2.0 + d1) / (2.0 - d1)
        left = 1.0 - G[0, 0] * f1
        f2 = left / (G[1, 1] * left + G[0, 1] * G[1, 0] * f1)
        d2 = 2.0 * (f2 - 1.0) / (f2 + 1.0)
        best = np.abs(d2).argmin()
        assert np.abs(d2[best]) == pytest.approx(margin, rel=1e-3)
        assert self.closed(loop, 1.01 * np.array([d1[best], d2[best]])) > 1.0

    def test_bound_for_three_lies_between_its_own_bounds(self):
        rng = np.random.default_rng(5)
        M = rng.normal(size=(50, 3, 3)) + 1j * rng.normal(size=(50, 3, 3))
        phases = np.exp(2j * np.pi * rng.uniform(size=(400, 3)))
        turned = np.abs(np.linalg.eigvals(phases[None, :, :, None] * M[:, None])).max(axis=(1, 2))
        bound = scaled_norm(M)
        assert np.all(bound >= turned * (1.0 - 1e-9))
        assert np.all(bound <= np.linalg.norm(M, 2, axis=(1, 2)) * 1.05)


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize(
    "reading",
    [
        "weights=interpolating",
        "weights=extrapolating",
        "weights=swapped",
        "stored_torque=applied",
        "delay_time=two_periods",
        "estimate_filter=estimate",
        "estimate_filter=acceleration",
    ],
)
def test_ratio_under_a_slow_load_is_the_inverse_of_loop_gains(reading, delay):
    """The linear loop, frequency towards zero, says the same as the closed form."""
    changed, plant = config(f"control.readings.{reading}"), build_plant(config(), 0.0)
    laws = [build_law(changed, f"controller_{k}") for k in (1, 2, 3)]
    angle = 2.0 * np.pi * L * np.array([2e-4])
    gains = [
        [
            np.abs(response(channel(open_loop(POSTURE, plant, law, delay), joint), angle)).item()
            for joint in (0, 1)
        ]
        for law in laws
    ]
    for a, b in ((0, 1), (1, 2)):
        predicted = error_ratio(laws[a], laws[b], 1e-7, delay)
        np.testing.assert_allclose(np.divide(gains[b], gains[a]), predicted, rtol=1e-3)


def test_ratio_at_the_size_of_errors_on_a_bent_surface():
    """One slow stroke of the full plant with an ideal encoder and viscous friction."""
    changes = (*SMOOTH, "control.readings.phi_branch=power", one_stroke(8))
    found = load_config("plain", "compare", overrides=changes, controllers=(2, 3))
    loops = dict(build_loops(found.config, found.folder))
    a, b = (simulate(loops[f"controller_{k}"])["e"][1000:] for k in (2, 3))
    sizes, fitted = np.sqrt((b * b).mean(axis=0)), (a * b).sum(axis=0) / (b * b).sum(axis=0)
    laws = [build_law(found.config, f"controller_{k}") for k in (2, 3)]
    predicted = [error_ratio(*laws, float(size))[i] for i, size in enumerate(sizes)]
    np.testing.assert_allclose(fitted, predicted, atol=0.02)
    assert np.all(np.abs(fitted - 1.0) > 0.06)
