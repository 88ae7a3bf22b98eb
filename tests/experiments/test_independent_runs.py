"""Ramps and starts beside the reference, against a table that another program made.

Its author had its own plant and laws, written from the published equations, and the plain arm.
"""

from __future__ import annotations

import numpy as np
import pytest

from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch

TABLE = {  # MAE and RMSE of joints 2 and 3, deg
    "controller_1": ((0.321, 0.216), (0.381, 0.258)),
    "controller_2": ((0.347, 0.237), (0.430, 0.292)),
    "controller_3": ((0.365, 0.258), (0.488, 0.351)),
    "controller_1_payload": ((0.328, 0.221), (0.382, 0.259)),
}
ON_THE_REFERENCE = {
    "controller_1": (0.321, 0.216),
    "controller_2": (0.310, 0.214),
    "controller_3": (0.301, 0.207),
}
OFFSETS = {"controller_2": [-0.75, -0.48], "controller_3": [-1.33, -1.07]}


def quantity(value: object, unit: str) -> str:
    return f"{{value: {value}, unit: '{unit}', source: 'assumed: test'}}"


def errors(offsets: dict[str, list[float]]) -> dict[str, np.ndarray]:
    """MAE and RMSE of every run on ramps of 10.8 degrees, deg, (2, 2)."""
    times = f"rise: {quantity(2.07, 's')}, hold: {quantity(1.13, 's')}, periods: {quantity(2, '1')}"
    changes = [
        f"reference={{kind: ramp, amplitude: {quantity([10.8, 10.8], 'deg')}, {times}}}",
        *(f"runs.{run}.start_offset={quantity(offset, 'deg')}" for run, offset in offsets.items()),
    ]
    loaded = load_config("plain", "compare", overrides=changes)
    assert isinstance(loaded.config, CompareConfig)
    loops = dict(build_loops(loaded.config, loaded.folder))
    batch = simulate_batch([*loops.values()])
    assert (batch.status == STATUSES.index("ok")).all()
    sizes = np.rad2deg([batch.statistics["mae"], batch.statistics["rmse"]])
    return {run: sizes[:, place] for place, run in enumerate(loops)}


def test_runs_that_start_apart() -> None:
    for run, found in errors(OFFSETS).items():
        np.testing.assert_allclose(found[0], TABLE[run][0], atol=0.0007, err_msg=run)
        # Encoder steps make two programs part, and the largest errors are at the start.
        np.testing.assert_allclose(found[1], TABLE[run][1], atol=0.0025, err_msg=run)


@pytest.mark.slow
def test_runs_that_start_on_their_reference() -> None:
    found = errors({})
    for run, mae in ON_THE_REFERENCE.items():
        np.testing.assert_allclose(found[run][0], mae, atol=0.0007, err_msg=run)
