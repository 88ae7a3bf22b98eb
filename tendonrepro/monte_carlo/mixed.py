"""Runs on lanes, and beside them by SciPy those of a user's law that cannot run there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import run_status
from tendonrepro.monte_carlo.data import ShardArray
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import statistics
from tendonrepro.simulation.batch import Batch, Limits
from tendonrepro.simulation.loop import Loop, TimeDelayController
from tendonrepro.simulation.stepper import simulate
from tendonrepro.simulation.streaming import STATISTICS

Simulate: TypeAlias = Callable[[Sequence[Loop], Limits], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

MOST_DRAWS_ALONE = 64
"""Arms on which a law runs that cannot run on lanes: the fewest that an ensemble takes."""


def runs_alone(loop: Loop) -> bool:
    """Whether a user's law is called in Python, at each sample."""
    law = loop.controller
    return isinstance(law, TimeDelayController) and law.command is not None and not law.on_lanes


def simulate_mixed(loops: Sequence[Loop], config: CompareConfig, together: Simulate) -> Batch:
    """Run loops as `together` does, and by SciPy those that it cannot; what a trace does not tell is NaN."""
    alone = np.array([runs_alone(loop) for loop in loops])
    if not alone.any():
        return together(loops, config.status)
    batch = together([loops[place] for place in np.flatnonzero(~alone).tolist()], config.status)

    def placed(values: ShardArray, fill: float) -> ShardArray:
        """The values of `together` in the places of its loops."""
        whole = np.full((len(loops), *values.shape[1:]), fill, values.dtype)
        whole[~alone] = values
        return whole

    numbers = {name: placed(batch.statistics[name], np.nan) for name in STATISTICS}
    status, time = placed(batch.status, STATUSES.index("unresolved")), placed(batch.status_time, 0.0)
    for place in np.flatnonzero(alone).tolist():
        variables = _by_scipy(loops[place])
        if variables is not None:
            told, time[place] = run_status(loops[place], variables, config)
            status[place] = STATUSES.index(told)
            trace = Trace("alone", variables["time"], config.joints, variables, {})
            for name, values in statistics(trace).items():
                numbers[name][place] = values
    return Batch(numbers, status, time, placed(batch.steps, 0))


def _by_scipy(loop: Loop) -> dict[str, Array] | None:
    """Trace of one run; None where the plant is too stiff for its solver."""
    try:
        return simulate(loop)
    except TendonreproError as error:
        if error.where:  # in the user's law
            raise
        return None
