"""Experiments that share code, each a thread of a device, taken through time in slices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.device import Device
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.pack import Ended, Signals
from tendonrepro.simulation.parts import ThreadPart
from tendonrepro.simulation.streaming import SUMS

SLICE = 2000
"""Samples of a launch: motions and noises need memory for so many at a time."""

FEWEST = 32
"""Experiments that must fit into the device's memory; with fewer a GPU is slower than a processor."""


def run_crowd(loops: Mapping[int, Loop], part: ThreadPart, block: int, device: Device) -> list[Ended]:
    """Run experiments of one sampling period, by place in the batch, as `run_pack`.

    Where the device's memory does not hold them all, one half runs after the other.

    Returns
    -------
    list of Ended
        What the experiments left, in their order, in one part or more.

    Raises
    ------
    TendonreproError
        If the device's memory does not hold a few.
    """
    try:
        return [_run(loops, part, block, device)]
    except MemoryError as error:
        places = [*loops]
        half = len(places) // 2
        if half < FEWEST:
            message = f"the GPU's memory does not hold {len(places)} experiments"
            raise TendonreproError(
                message, hint="other programs may use it; --device cpu needs none"
            ) from error
        halves = ({place: loops[place] for place in part_of} for part_of in (places[:half], places[half:]))
        return [ended for members in halves for ended in run_crowd(members, part, block, device)]


def _run(loops: Mapping[int, Loop], part: ThreadPart, block: int, device: Device) -> Ended:
    first, count, named = next(iter(loops.values())), len(loops), part.rows.named
    n, samples = first.plant.preload.size, max(loop.reference.time.size for loop in loops.values())
    entry, signals = device.compiled(part.source), Signals([*loops.values()])
    rows, of_each = device.array(part.numbers([*loops])), [device.array(which) for which in signals.of_each]
    blocks = np.zeros((count, -(-samples // block), n))
    length = block * max(1, SLICE // block)
    for at in range(0, samples, length):
        span = min(length, samples - at)
        motions, noises = (device.array(values) for values in signals.slices(at, span))
        kept = device.zeros((-(-span // block), n, count))
        limits = np.int64(at), np.int64(at + span), np.float64(first.L), np.int64(count)
        given = motions, of_each[0], noises, of_each[1]
        device.launch(entry, count, (*limits, rows, *given, np.int64(block), kept))
        summed = np.moveaxis(device.fetched(kept), 2, 0)
        blocks[:, at // block : at // block + summed.shape[1]] = summed
        if not (device.fetched(rows[named["live"]]) > 0.0).any():
            break
    return _ended(device.fetched(rows), named, n, blocks)


def _ended(rows: Array, named: Mapping[str, int], n: int, blocks: Array) -> Ended:
    count = rows.shape[1]
    sums = rows[named["sums"] :][: len(SUMS) * n].reshape(len(SUMS), n, count)
    return Ended(
        rows[named["count"]].astype(np.int64),
        rows[named["diverged"]] > 0.0,
        dict(zip(SUMS, sums, strict=True)),
        blocks,
        np.empty((count, 0, 0)),
    )
