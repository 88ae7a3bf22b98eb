"""Plants of an ensemble, run under all its cases: from their numbers to records."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.monte_carlo.plan import EnsembleStudy, Piece
from tendonrepro.monte_carlo.user_laws import Simulate
from tendonrepro.results.record_store import Records
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop


def evaluated(
    study: EnsembleStudy, piece: Piece, simulate: Simulate = simulate_batch
) -> tuple[Piece, Records]:
    """Records of the plants of a piece."""
    values = study.values(*piece)
    loops = [loop for of_plant in _loops(study, piece, values) for loop in of_plant]
    batch = simulate(loops, study.loaded.compare.status)
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
