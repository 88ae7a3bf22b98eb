"""One block of an ensemble: from its place in the plan to a finished shard."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.monte_carlo.data import Block, Shard, ShardArray, shard_image
from tendonrepro.monte_carlo.plan import EnsembleStudy
from tendonrepro.monte_carlo.user_laws import Simulate
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop

DRAWS_AT_ONCE = 32
"""Draws simulated together; more fill lanes and threads better; each has motions of some 3 MB."""


def make_blocks(
    study: EnsembleStudy, blocks: Sequence[Block], simulate: Simulate = simulate_batch
) -> list[tuple[Block, bytes]]:
    """Compute blocks of one population as they are stored."""
    computed = compute_blocks(study, blocks, simulate)
    return [(block, shard_image(arrays)) for block, arrays in zip(blocks, computed, strict=True)]


def compute_blocks(
    study: EnsembleStudy, blocks: Sequence[Block], simulate: Simulate = simulate_batch
) -> list[Shard]:
    """Simulate every case of every draw of blocks of one population, across blocks together."""
    drawn_from, most = study.populations[blocks[0].population], DRAWS_AT_ONCE
    values = [drawn_from.sample(study.seed, block.replicate, block.first, block.count) for block in blocks]
    pieces = [
        (block, rows)
        for block, drawn in zip(blocks, values, strict=True)
        for rows in np.split(drawn, range(most, len(drawn), most))
    ]
    batches = []
    for together in _filled(pieces, most):
        drawn = [draw for block, rows in together for draw in loops_of(study, block, rows)]
        batches.append(simulate([*chain.from_iterable(drawn)], study.loaded.compare.status))
    edges = np.cumsum([block.count for block in blocks])[:-1]

    def by_case(parts: Sequence[ShardArray], kind: type) -> list[ShardArray]:
        """Batches go draw by draw; a reader asks block by block, and case by case."""
        # What overflows single precision is of a diverged run, and infinite for every purpose.
        with np.errstate(over="ignore"):
            joined: ShardArray = np.concatenate(parts).astype(kind)
        cases = joined.reshape(-1, len(study.cases), *joined.shape[1:]).swapaxes(0, 1)
        return np.split(cases, edges, axis=1)

    stored: Mapping[str, Sequence[ShardArray]] = {
        "draws": values,
        "status": by_case([batch.status for batch in batches], np.int8),
    } | {
        name: by_case([batch.statistics[name] for batch in batches], np.float32)
        for name in batches[0].statistics
    }
    return [{name: of_block[k] for name, of_block in stored.items()} for k in range(len(blocks))]


def _filled(pieces: Sequence[tuple[Block, Array]], most: int) -> Iterator[list[tuple[Block, Array]]]:
    """Yield pieces that follow each other, of so many draws at most together."""
    together: list[tuple[Block, Array]] = []
    for block, rows in pieces:
        if sum(len(part) for _, part in together) + len(rows) > most:
            yield together
            together = []
        together.append((block, rows))
    yield together


def loops_of(study: EnsembleStudy, block: Block, rows: Array) -> list[list[Loop]]:
    """Loops of draws (N, P), by draw and case; what readings leave alone is shared."""
    drawn_from, loops = study.populations[block.population], []
    drawn = drawn_from.loops(rows, study.cases, study.laws)
    for row in rows:
        try:
            loops.append(next(drawn))
        except TendonreproError as error:
            message = f"a draw of {block} cannot be run: {error.message}"
            raise TendonreproError(
                message, where=error.where, hint=json.dumps(drawn_from.named(row))
            ) from error
    return loops
