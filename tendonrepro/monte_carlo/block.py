"""One block of an ensemble: from its place in the plan to a finished shard."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import METRICS
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import run_status
from tendonrepro.monte_carlo.data import Block, Shard, ShardArray, shard_image
from tendonrepro.monte_carlo.plan import EnsembleStudy
from tendonrepro.monte_carlo.user_laws import Simulate, runs_alone, simulate_mixed
from tendonrepro.physics.instruments import Encoder
from tendonrepro.physics.metrics import STATUSES, mae, rmse
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.stepper import simulate

DRAWS_AT_ONCE = 32
"""Draws simulated together; more fill lanes and threads better; each has motions of some 3 MB."""

IDEAL = Encoder(resolution=0.0, noise=0.0)


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
        batches.append(simulate_mixed(list(chain.from_iterable(drawn)), study.loaded.compare, simulate))
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
        "check": [
            np.array(json.dumps(spot_check(study, block, drawn, simulate)))
            for block, drawn in zip(blocks, values, strict=True)
        ],
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


def spot_check(
    study: EnsembleStudy, block: Block, values: Array, simulate_together: Simulate = simulate_batch
) -> dict[str, float | int | str | None]:
    """Rerun one experiment of one block in ``check_every`` with the SciPy stepper and an ideal encoder.

    A hash chooses; other blocks give an empty answer. ``difference`` is the largest relative one of MAE and
    RMSE: 0 if both runs diverged or were not resolved, None where the steppers disagree on the status.
    """
    digest = hashlib.sha256(f"{study.identity} {block}".encode()).digest()
    chosen, place, at = (int.from_bytes(digest[k : k + 8], "big") for k in (0, 8, 16))
    if study.check_every == 0 or chosen % study.check_every:
        return {}
    place, at = place % len(study.cases), at % len(values)
    run, case = study.cases[place]
    (loops,) = loops_of(study, block, values[at : at + 1])
    if runs_alone(loops[place]):
        return {}  # it runs by SciPy already
    loop = replace(loops[place], joint_encoder=IDEAL)
    difference = _difference(loop, simulate_together([loop], study.loaded.compare.status), study)
    return {"run": run, "reading": case.name, "draw": at, "difference": difference}


def _difference(loop: Loop, batch: Batch, study: EnsembleStudy) -> float | None:
    """The ``difference`` of :func:`spot_check`."""
    status = STATUSES[int(batch.status[0])]
    if status == "unresolved":
        return 0.0
    try:
        variables = simulate(loop)
    except TendonreproError:
        return None
    if status != run_status(loop, variables, study.loaded.compare)[0]:
        return None
    if status == "diverged":
        return 0.0
    sizes = np.array([mae(variables["e"]), rmse(variables["e"])])
    ours = np.array([batch.statistics[name][0] for name in METRICS])
    return float(np.abs(ours / sizes - 1.0).max())
