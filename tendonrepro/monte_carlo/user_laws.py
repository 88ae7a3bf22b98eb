"""Whether a user's law can run on many plants together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes
from tendonrepro.monte_carlo.plan import EnsembleStudy
from tendonrepro.simulation.batch import Batch, Limits, simulate_batch
from tendonrepro.simulation.loop import Loop

Simulate: TypeAlias = Callable[[Sequence[Loop], Limits], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

_STUB = 64
"""Samples in which it shows whether a law can run."""


def refuse_alone(study: EnsembleStudy, law: UserLaw) -> None:
    """Refuse a law that cannot run on many arms together, before hours of work: its first samples show it."""
    (arms,) = study.populations.values()
    try:
        (loops,) = arms.loops(np.ones((1, len(arms.rows))), study.cases, [law])
        loop = stub_of(loops[study.lookup[law.name, PRINTED]])
        simulate_batch([loop], study.loaded.compare.status)
    except UsageError:
        raise
    except Exception as error:
        raise refused_on_lanes(law.name, error) from error
    refuse_memory(law, loop)


def stub_of(loop: Loop) -> Loop:
    """The first samples of a run."""
    names = ("time", "q_d", "dq_d", "ddq_d")
    start = {name: getattr(loop.reference, name)[:_STUB] for name in names}
    return replace(loop, reference=replace(loop.reference, **start))
