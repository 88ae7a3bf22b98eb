"""The linear loop that a result gives: its poles are those of `explain`, and small motions follow it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pytest
from scipy.signal import dlsim, dlti
from support.overrides import SMOOTH, quantity

import tendonrepro as tr
from tendonrepro.errors import UsageError
from tendonrepro.physics.linear_loop import SampledLoop

At = Literal["start", "middle", "far"]
SMALL = (
    *SMOOTH,
    "manipulator.friction.link.viscous=[0, 0, 0]",
    f"reference={{kind: raised_cosine, amplitude: {quantity([0.01, 0.02], 'deg')}, "
    f"period: {quantity(1, 's')}, periods: {quantity(1, '1')}}}",
)


@pytest.fixture(scope="module")
def small() -> tr.Result:
    return tr.compare("plain", set=SMALL)


def with_load(loop: SampledLoop, run: str, found: tr.Result) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of the linear loop and of the run, (T, 2 n)."""
    trace = found[run]
    q_d, dq_d, ddq_d, torque = (trace[name].values for name in ("q_d", "dq_d", "ddq_d", "tau_m"))
    inputs = np.hstack([np.zeros_like(q_d), q_d - q_d[0], dq_d, ddq_d])
    _, outputs, _ = dlsim(dlti(*loop[:4], dt=loop.dt), inputs)
    # The acceleration jumps at the first sample, and the torque from that of rest with it.
    rest = torque[0] - outputs[0, torque.shape[1] :]
    return outputs, np.hstack([trace["e"].values, torque - rest])


@pytest.mark.parametrize("run", ["controller_1", "controller_2", "controller_3", "controller_1_payload"])
def test_a_small_motion_follows_the_linear_loop(small: tr.Result, run: str) -> None:
    linear, real = with_load(small.loop(run), run, small)
    # What is left out is of second order in angles of a hundredth of a degree.
    assert (np.abs(linear - real).max(axis=0) <= 1e-3 * np.abs(real).max(axis=0)).all()


def test_poles_are_those_of_explain(tmp_path: Path) -> None:
    changes = {
        "reference.periods": 1,
        "manipulator.actuator.output_delay": 1,
        "control.readings.feedback": "motor",
    }
    found = tr.compare(set=changes, controllers=[1])
    radius = tr.explain(set=changes, controllers=[1]).data["spectral_radius"]["controller_1"]
    stored = tr.open(found.save(tmp_path / "stored", figures=False))
    for result in (found, stored):
        radii = [np.abs(np.linalg.eigvals(result.loop("controller_1", at).A)).max() for at in get_args(At)]
        assert max(radii) == pytest.approx(radius, abs=1e-12)


def test_a_constant_load_moves_the_joint_the_way_it_pulls(small: tr.Result) -> None:
    loop = small.loop("controller_2")
    n = loop.D.shape[0] // 2
    settled = loop.C @ np.linalg.solve(np.eye(len(loop.A)) - loop.A, loop.B) + loop.D
    # The motors come to bear the whole load, and time-delay estimation leaves no error.
    np.testing.assert_allclose(settled[n:, :n], np.eye(n), atol=1e-6)
    np.testing.assert_allclose(settled[:n, :n], 0.0, atol=1e-8)


def test_a_run_without_a_controller_of_the_package_has_no_loop() -> None:
    def still(*sample: np.ndarray) -> np.ndarray:
        return 0.0 * sample[1]

    found = tr.compare(laws={"still": still}, controllers=[1], set={"reference.periods": 1})
    assert found["still"].sizes["time"] > 0
    for run, at in (("still", "start"), ("controller_1", "nowhere"), ("controller_9", "start")):
        with pytest.raises(UsageError):
            found.loop(run, at)  # type: ignore[arg-type]
    with pytest.raises(UsageError):
        tr.statics().loop("controller_1")
