"""Statistics of a trace are those that the batch stepper sums up sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import all_loops
from tendonrepro.results.records import Trace
from tendonrepro.results.statistics import saturated, statistics
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.streaming import STATISTICS

WHOLE_RUN = [name for name in STATISTICS if not name.endswith("_late")]
"""What is after the first period is a window of the table, and ``rate_max`` is of the encoder's own steps."""


def test_a_trace_has_the_statistics_of_the_batch() -> None:
    loaded = load_config(None, "compare", overrides=["manipulator.actuator.torque_limit=[4, 4, 4]"])
    name, loop = next(iter(all_loops(loaded).items()))
    batch = simulate_batch([loop], loaded.config.status, record=True)
    assert batch.traces is not None
    variables = dict(batch.traces[0] or {})
    trace = Trace(name, variables.pop("time"), loaded.config.joints, variables, {})
    found = statistics(trace)
    found["saturated"] = saturated(trace, loop.plant.drive.S, loop.actuator.limit)
    shared = set(WHOLE_RUN) & found.keys()
    assert len(shared) == 30
    for statistic in shared:
        # The batch takes the spectrum of the error block by block.
        near = 2e-2 if statistic == "fast_share" else 1e-9
        np.testing.assert_allclose(
            found[statistic], batch.statistics[statistic][0], rtol=near, err_msg=statistic
        )


def test_without_a_motion_there_are_no_phases() -> None:
    time = np.arange(50) * 1e-3
    trace = Trace("mine", time, (2, 3), {"tau_m": np.ones((50, 2))}, {})
    found = statistics(trace)
    assert "torque_rms" in found
    assert not [name for name in found if name.endswith(("_up", "_down"))]
    rates = np.ones((50, 2)), np.zeros((50, 2))
    moving = statistics(replace(trace), rates)
    np.testing.assert_allclose(moving["torque_rms_up"], 1.0)
    assert np.isnan(moving["torque_rms_down"]).all()


@pytest.mark.parametrize("joint", [0, 1])
def test_overshoot_is_past_the_target_in_the_direction_of_the_stroke(joint: int) -> None:
    dq_d = np.zeros((6, 2))
    dq_d[1:3, joint] = -1.0
    e = np.zeros((6, 2))
    e[4, joint] = 0.25
    variables = {"e": e, "dq_d": dq_d, "ddq_d": np.ones((6, 2))}
    found = statistics(Trace("mine", np.arange(6.0), (2, 3), variables, {}))
    assert found["overshoot"][joint] == pytest.approx(0.25)
