"""A pack of experiments that share code, taken through time in slices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen.lanes import bundled, columns
from tendonrepro.simulation.codegen.machine import (
    LANES,
    Signal,
    TraceBuffer,
    assembled,
    callable_sweep,
    sweep_code,
)
from tendonrepro.simulation.loop import Loop, recorded_columns
from tendonrepro.simulation.parts import CompiledPart, is_noisy, noise_source, unit_noise
from tendonrepro.simulation.streaming import SUMS, Sums

SLICE = 500
"""Samples after which experiments that ended leave their lane to others."""


@dataclass(frozen=True)
class Ended:
    """What M experiments left behind: samples done, whether they diverged, sums, each (n, M).

    ``blocks`` (M, B, n) are errors summed over blocks of samples, ``trace`` (M, T, columns) the record.
    """

    count: NDArray[np.int64]
    diverged: NDArray[np.bool_]
    sums: Sums
    blocks: Array
    trace: Array


def run_pack(loops: Mapping[int, Loop], part: CompiledPart, block: int, *, record: bool) -> Ended:
    """Run experiments of one sampling period, by place in the batch, in blocks of so many samples."""
    first, count, named = next(iter(loops.values())), len(loops), part.rows.named
    n, samples = first.plant.preload.size, max(loop.reference.time.size for loop in loops.values())
    signals = Signals([*loops.values()])
    kept = {"block": TraceBuffer(named["block"], n, block)}
    if record:
        kept["trace"] = TraceBuffer(named["trace"], recorded_columns(first), 1)
    inputs = [Signal(named[name], 3 * n) for name in signals.names]
    (address,) = assembled(sweep_code(named["live"], inputs, [*kept.values()]), "sweep")
    sweep, codes = callable_sweep(address), (part.code["sample"], part.code["advance"])
    ended = {name: np.zeros((count, -(-samples // of.each), of.size)) for name, of in kept.items()}
    members, rows = np.arange(count), part.filled([*loops])
    left = np.empty((part.rows.count, count))
    slice_length = block * max(1, SLICE // block)
    for at in range(0, samples, slice_length):
        span = min(slice_length, samples - at)
        bundles = bundled(rows)
        starts = signals.starts(at, span)[:, _lanes(members)]
        records = {
            name: np.zeros((len(bundles), -(-span // of.each), of.size, LANES)) for name, of in kept.items()
        }
        for k, bundle in enumerate(bundles):
            sources = np.ascontiguousarray(starts[:, k])
            into = np.array([of[k].ctypes.data for of in records.values()])
            sweep(
                *codes,
                bundle.ctypes.data,
                at,
                at + span,
                first.L,
                sources.ctypes.data,
                into.ctypes.data,
            )
        rows = columns(bundles)[:, : members.size]
        for name, of in kept.items():
            recorded = np.moveaxis(records[name], 3, 1).reshape(-1, *records[name].shape[1:3])
            begin = at // of.each
            ended[name][members, begin : begin + recorded.shape[1]] = recorded[: members.size]
        left[:, members] = rows
        going = rows[named["live"]] > 0.0
        if not going.any():
            break
        members, rows = members[going], rows[:, going]
    sums = left[named["sums"] :][: len(SUMS) * n].reshape(len(SUMS), n, count)
    done, diverged = (left[named[name]] for name in ("count", "diverged"))
    trace = ended.get("trace", np.empty((count, 0, 0)))
    return Ended(
        done.astype(np.int64), diverged > 0.0, dict(zip(SUMS, sums, strict=True)), ended["block"], trace
    )


def _lanes(members: NDArray[np.int64]) -> NDArray[np.int64]:
    """Members of each bundle, (B, LANES); lanes to spare repeat the last."""
    return np.append(members, np.repeat(members[-1:], -members.size % LANES)).reshape(-1, LANES)


class Signals:
    """Desired motions and noises of a pack's experiments, each once."""

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._n = loops[0].plant.preload.size
        # The same motion may be fed to some laws late.
        key = [(id(loop.reference), loop.reference_lag) for loop in loops]
        motions = {name: loop.fed for name, loop in dict(zip(key, loops, strict=True)).items()}
        seeds = {noise_source(loop): loop for loop in loops if is_noisy(loop)}
        self._motions, self._noises = [*motions.values()], [unit_noise(loop) for loop in seeds.values()]
        number = {name: k for k, name in enumerate(motions)}
        self._motion = np.array([number[name] for name in key])
        # The last noise is none.
        place = {source: k for k, source in enumerate(seeds)}
        self._noise = np.array([place.get(noise_source(loop), len(place)) for loop in loops])
        self.names = ("desired", "noise") if seeds else ("desired",)

    def starts(self, first: int, span: int) -> NDArray[np.int64]:
        """Addresses of sample 0 by signal and experiment, (signals, M), of arrays that begin at `first`."""
        motions = np.zeros((len(self._motions), span, 3 * self._n))
        for kept, motion in zip(motions, self._motions, strict=True):
            for k, part in enumerate((motion.q_d, motion.dq_d, motion.ddq_d)):
                given = part[first : first + span]
                kept[: len(given), k * self._n : (k + 1) * self._n] = given
        silence = np.zeros((span, 3 * self._n))
        # Kept until the next slice: machine code reads them by their addresses.
        self._arrays = motions, np.stack([*(noise(span) for noise in self._noises), silence])
        both = zip(self._arrays, (self._motion, self._noise), strict=True)
        return np.stack([_starts(values, first)[places] for values, places in both])[: len(self.names)]


def _starts(values: Array, first: int) -> NDArray[np.int64]:
    """Address of sample 0 in each part of (parts, samples, columns) that begins at `first`."""
    starts = values.ctypes.data + values.strides[0] * np.arange(len(values))
    return np.asarray(starts - first * values.strides[1])
