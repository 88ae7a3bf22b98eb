"""Plants of an ensemble, run under all its cases: from their numbers to records."""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.console import Talk
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes
from tendonrepro.monte_carlo.plan import EnsembleStudy, Piece
from tendonrepro.results.record_store import Records, RecordStore
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop

Simulate: TypeAlias = Callable[[Sequence[Loop]], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

Stores: TypeAlias = Mapping[str, RecordStore]
"""A file of records for each population."""

_STUB = 64
"""Samples in which it shows whether a law can run."""


def evaluated(
    study: EnsembleStudy, piece: Piece, simulate: Simulate = simulate_batch
) -> tuple[Piece, Records]:
    """Records of the plants of a piece."""
    values = study.values(*piece)
    loops = [loop for of_plant in _loops(study, piece, values) for loop in of_plant]
    records = np.empty(len(values), study.record_of(piece.population))
    records["draws"] = values
    record(simulate(loops), records)
    return piece, records


def record(batch: Batch, records: Records) -> None:
    """Write what became of runs, plant by plant, into the fields that records have for it."""
    records["status"] = batch.status.reshape(records["status"].shape)
    # What overflows single precision is of a diverged run, and infinite for every purpose.
    with np.errstate(over="ignore"):
        for name in batch.statistics.keys() & {*(records.dtype.names or ())}:
            records[name] = batch.statistics[name].reshape(records[name].shape)


def still_missing(pieces: Sequence[Piece], stores: Stores) -> list[Piece]:
    """Pieces with a plant of which a store has no record; they are run whole."""
    missing = {name: store.missing() for name, store in stores.items()}
    return [piece for piece in pieces if np.isin(piece.plants, missing[piece.population]).any()]


def fill(
    stores: Stores,
    pieces: Sequence[Piece],
    stream: Generator[tuple[Piece, Records], None, None],
    talk: Talk,
) -> None:
    """Store the records of pieces as they come; this process is the only writer."""
    with talk.bar("simulating", len(pieces)) as progress, closing(stream):
        for piece, records in stream:
            stores[piece.population].put(piece.plants, records)
            progress(1)


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
    """Refuse a law that cannot run on many arms together, before hours of work."""
    (arms,) = study.populations.values()
    (loops,) = arms.loops(np.ones((1, len(arms.rows))), study.cases, [law])
    refuse_on_lanes(law, loops[study.lookup[law.name, PRINTED]])


def refuse_on_lanes(law: UserLaw, loop: Loop, trial: Callable[[Loop], object] = lambda _: None) -> None:
    """Raise a UsageError for a law that cannot run on many plants together: the first samples show it.

    So does a `trial` of them that fails.
    """
    stub = stub_of(loop)
    try:
        simulate_batch([stub])
        trial(stub)
    except Exception as error:
        raise refused_on_lanes(law.name, error) from error
    refuse_memory(law, stub)


def stub_of(loop: Loop) -> Loop:
    """The first samples of a run."""
    names = ("time", "q_d", "dq_d", "ddq_d")
    start = {name: getattr(loop.reference, name)[:_STUB] for name in names}
    return replace(loop, reference=replace(loop.reference, **start))
