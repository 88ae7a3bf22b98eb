"""Runs of a user's law on lanes, or beside the others by SciPy where it cannot run there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import run_status
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes
from tendonrepro.monte_carlo.data import ShardArray
from tendonrepro.monte_carlo.plan import EnsembleStudy
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.records import Trace
from tendonrepro.results.statistics import statistics
from tendonrepro.simulation.batch import Batch, Limits, simulate_batch
from tendonrepro.simulation.loop import Loop, TimeDelayController
from tendonrepro.simulation.stepper import simulate
from tendonrepro.simulation.streaming import STATISTICS

Simulate: TypeAlias = Callable[[Sequence[Loop], Limits], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

MOST_DRAWS_ALONE = 64
"""Arms on which a law runs that cannot run on lanes: the fewest that an ensemble takes."""

_STUB = 64
"""Samples in which it shows whether a law can run."""


def tried(study: EnsembleStudy, law: UserLaw) -> UserLaw:
    """A law as it can run: on many arms together, else alone; an error where neither goes."""
    try:
        loop = _start_of(study, law)
        simulate_batch([loop], study.loaded.compare.status)
        refuse_memory(law, loop)
    except Exception as error:
        refusal = error if isinstance(error, UsageError) else refused_on_lanes(law.name, error)
        alone = replace(law, alone=refusal.message)
        simulate(_start_of(study, alone))
        return alone
    return law


def _start_of(study: EnsembleStudy, law: UserLaw) -> Loop:
    """The first samples of a law on the arm itself."""
    study = replace(study, laws=(law,))
    (arms,) = study.populations.values()
    (loops,) = arms.loops(np.ones((1, len(arms.rows))), study.cases, study.laws)
    return stub_of(loops[study.lookup[law.name, PRINTED]])


def stub_of(loop: Loop) -> Loop:
    """The first samples of a run."""
    names = ("time", "q_d", "dq_d", "ddq_d")
    start = {name: getattr(loop.reference, name)[:_STUB] for name in names}
    return replace(loop, reference=replace(loop.reference, **start))


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
