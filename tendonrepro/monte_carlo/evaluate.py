"""Plants of an ensemble, run under all its cases: from their numbers to records."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes
from tendonrepro.monte_carlo.plan import EnsembleStudy, Piece
from tendonrepro.results.record_store import Records
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop

Simulate: TypeAlias = Callable[[Sequence[Loop]], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

_STUB = 64
"""Samples in which it shows whether a law can run."""


def evaluated(
    study: EnsembleStudy, piece: Piece, simulate: Simulate = simulate_batch
) -> tuple[Piece, Records]:
    """Records of the plants of a piece."""
    values = study.values(*piece)
    loops = [loop for of_plant in _loops(study, piece, values) for loop in of_plant]
    batch = simulate(loops)
    records = np.empty(len(values), study.record_of(piece.population))
    records["draws"] = values
    # What overflows single precision is of a diverged run, and infinite for every purpose.
    with np.errstate(over="ignore"):
        records["status"] = batch.status.reshape(len(values), -1)
        for name, numbers in batch.statistics.items():
            records[name] = numbers.reshape(records[name].shape)
    return piece, records


def _loops(study: EnsembleStudy, piece: Piece, values: Array) -> Iterator[list[Loop]]:
    """Loops of each plant, by case; an error names the plant."""
    population = study.populations[piece.population]
    drawn = population.loops(values, study.cases, study.laws)
    for plant, row in zip(piece.plants, values, strict=True):
        try:
            yield next(drawn)
        except TendonreproError as error:
            message = f"plant {plant} of {piece.population} cannot be run: {error.message}"
            raise TendonreproError(
                message, where=error.where, hint=json.dumps(population.named(row))
            ) from error


def refuse_alone(study: EnsembleStudy, law: UserLaw) -> None:
    """Refuse a law that cannot run on many arms together, before hours of work: its first samples show it."""
    (arms,) = study.populations.values()
    try:
        (loops,) = arms.loops(np.ones((1, len(arms.rows))), study.cases, [law])
        loop = stub_of(loops[study.lookup[law.name, PRINTED]])
        simulate_batch([loop])
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
