"""A recorded motion is smoothed without its noise, from its first sample to its last."""

from __future__ import annotations

import numpy as np
import pytest

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.fit import HALF_COUNT, limit
from tendonrepro.dataset.motion.knots import thinned
from tendonrepro.dataset.motion.record import Recorded, noise, recorded
from tendonrepro.dataset.motion.recover import derivatives, recover_run
from tendonrepro.physics.trajectory import Motion, Shape, minimum_jerk, motion, raised_cosine
from tendonrepro.results.records import Trace
from tendonrepro.simulation.streaming import thresholds

AMPLITUDE = np.deg2rad([20.0, 30.0])
COUNT = np.deg2rad(0.022)
CYCLE = {"raised_cosine": 6.0, "minimum_jerk": 7.0}
SEEDS = range(4)


def trace(time: Array, q: Array) -> Trace:
    attributes = {"law": "measured", "reference_period": 0.0, "status": "ok", "payload_mass": 0.0}
    return Trace("controller_1", time, (2, 3), {"q_d": q, "e": 0.0 * q}, attributes)


def shape(kind: str, size: float) -> Shape:
    return raised_cosine(size, 6.0) if kind == "raised_cosine" else minimum_jerk(size, 2.5, 1.0)


def truth(kind: str, step: float) -> tuple[Array, tuple[Array, Array, Array]]:
    """Two cycles."""
    time = step * np.arange(round(2.0 * CYCLE[kind] / step) + 1)
    return time, motion(time, [Motion((shape(kind, size),) * 2, CYCLE[kind]) for size in AMPLITUDE])


def noisy(q: Array, noise_deg: float, seed: int = 0) -> Array:
    return q + np.deg2rad(noise_deg) * np.random.default_rng(seed).standard_normal(q.shape)


def rapid(dq: Array, ddq: Array) -> Array:
    """Share of rapid samples, as claim C3 counts them."""
    return (np.abs(ddq) > thresholds(dq, ddq, 1e-3).acceleration).mean(axis=0)


def cases(step: float) -> list[tuple[float, int]]:
    """Noise, deg, and seed; one at the fine step, which takes longer."""
    return [(0.0, 0), *((size, seed) for size in (0.005, 0.05) for seed in range(5 if step == 0.01 else 1))]


@pytest.mark.parametrize("kind", ["raised_cosine", "minimum_jerk"])
@pytest.mark.parametrize("step", [0.001, 0.01])
def test_noise_is_not_turned_into_acceleration(kind: str, step: float) -> None:
    time, (q, dq, ddq) = truth(kind, step)
    peak = np.abs(ddq).max(axis=0)
    for noise_deg, seed in cases(step):
        found = derivatives(trace(time, noisy(q, noise_deg, seed)))
        assert np.abs(found[1]).max(axis=0) == pytest.approx(peak, rel=0.2), (noise_deg, seed)
        assert np.abs(found[0] - dq).max() < 0.1 * np.abs(dq).max(), (noise_deg, seed)
        assert rapid(*found) == pytest.approx(rapid(dq, ddq), abs=0.08), (noise_deg, seed)


@pytest.mark.parametrize("noise_deg", [0.0, 0.005, 0.05])
def test_the_trajectory_file_does_not_shake(noise_deg: float) -> None:
    time, (q, _, ddq) = truth("minimum_jerk", 0.01)
    for seed in SEEDS:
        knots = thinned(recorded(trace(time, noisy(q, noise_deg, seed))))
        assert (knots.angle[0] == 0.0).all()
        assert knots.faded == 0.0
        assert knots.deviation <= knots.tolerance
        assert np.abs(knots.curve(time)[2]).max() < 1.3 * np.abs(ddq).max()


def cropped(rounded: bool, noise_deg: float = 0.0) -> tuple[Recorded, Trace]:
    time, (q, _, _) = truth("raised_cosine", 0.002)
    q, time = noisy(q[850:], noise_deg), time[850:] - time[850]
    found = trace(time, np.round(q / COUNT) * COUNT if rounded else q)
    return recorded(found), found


@pytest.mark.parametrize(("rounded", "noise_deg"), [(False, 0.0), (True, 0.0), (False, 0.05)])
def test_a_start_in_mid_motion_is_no_jerk(rounded: bool, noise_deg: float) -> None:
    record, run = cropped(rounded, noise_deg)
    dq, ddq = derivatives(run)
    peak = 0.5 * AMPLITUDE * (np.pi / 3.0) ** 2
    assert np.abs(ddq).max(axis=0) == pytest.approx(peak, rel=0.2)
    assert rapid(dq, ddq) == pytest.approx([2.0 / 3.0] * 2, abs=0.08)
    knots = thinned(record)
    assert 0.0 < knots.faded < 0.1 * record.time[-1]
    assert knots.deviation <= knots.tolerance
    q, rate, bend = knots.curve(record.time)
    assert np.abs(rate[0]).max() < 1e-9
    late = record.time >= knots.faded
    assert np.abs(bend[late]).max() < 1.6 * peak.max()
    # A fade of x = v t by a stroke of duration T bends by 4.6 v/T.
    assert np.abs(bend).max() < 6.0 * np.abs(dq).max() / knots.faded
    assert np.abs(q - record.q)[~late].max() < 0.5 * np.abs(dq).max() * knots.faded


def test_a_sine_from_zero_is_faded_in_and_says_so() -> None:
    time = 0.01 * np.arange(1201)
    q = AMPLITUDE * np.sin(2.0 * np.pi / 6.0 * time)[:, np.newaxis]
    found = recover_run(trace(time, q)).as_dict()
    assert found["faded_in_s"] > 0.0
    assert found["brought_to_rest"]
    ddq = derivatives(trace(time, q))[1]
    assert np.abs(ddq).max(axis=0) == pytest.approx(AMPLITUDE * (np.pi / 3.0) ** 2, rel=0.05)
    time, (q, _, _) = truth("raised_cosine", 0.01)
    assert thinned(recorded(trace(time, q))).faded == 0.0


@pytest.mark.parametrize("step", [0.001, 0.01])
def test_the_noise_is_told_from_the_motion(step: float) -> None:
    time, (q, _, _) = truth("minimum_jerk", step)
    clean, rough = recorded(trace(time, q)), recorded(trace(time, noisy(q, 0.05)))
    assert noise(clean) < 0.01 * HALF_COUNT
    assert noise(rough) == pytest.approx(np.deg2rad(0.05), rel=0.1)
    assert limit(clean) == pytest.approx(HALF_COUNT, rel=0.1)
    assert np.deg2rad(0.2) < limit(rough) < np.deg2rad(0.4)
