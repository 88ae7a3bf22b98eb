"""A pack of experiments taken through time in slices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.simulation.codegen.lanes import bundled, columns
from tendonrepro.simulation.codegen.machine import LANES, sweep
from tendonrepro.simulation.kernel import sample_rows
from tendonrepro.simulation.loop import Loop, recorded_columns
from tendonrepro.simulation.parts import CompiledPart, is_noisy, unit_noise
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


def run_pack(
    loops: Mapping[int, Loop],
    controllers: Mapping[int, CompiledPart],
    plants: Mapping[int, CompiledPart],
    block: int,
    *,
    record: bool,
) -> Ended:
    """Run experiments of one sampling period, by place in the batch, in blocks of so many samples."""
    first, count = next(iter(loops.values())), len(loops)
    n, samples = first.plant.preload.size, max(loop.reference.time.size for loop in loops.values())
    # The last experiment of each is one that lanes to spare write to.
    blocks = np.zeros((count + 1, -(-samples // block), n))
    trace = np.empty((count + 1, samples if record else 0, recorded_columns(first)))
    signals, shared = _Signals([*loops.values()]), sample_rows(n)
    laws, moving = _bundles(loops, controllers), _bundles(loops, plants, idle=True)
    left, going = np.empty((shared.count, count)), np.ones(count, dtype=np.bool_)
    for at in range(0, samples, SLICE):
        span = min(SLICE, samples - at)
        own, nobodys = np.zeros(count + 1, dtype=np.int64), np.zeros((laws[0].rows.shape[1], LANES))
        for bundles in moving:
            own[bundles.members] = bundles.seats()
        own[-1] = nobodys.ctypes.data
        desired, noise = signals.slice(at, span)
        pointers = {
            "plant": own,
            "desired": _starts(desired, at)[signals.motion],
            "noise": _starts(noise, at)[signals.noise],
            "blocks": _starts(blocks),
            "trace": _starts(trace),
        }
        for bundles in laws:
            bundles.point({shared.named[name]: places for name, places in pointers.items()})
        sweep([(bundles.code, rows) for bundles in (*laws, *moving) for rows in bundles.rows], at, at + span)
        for bundles in laws:
            left[:, bundles.members] = columns(bundles.rows)[: shared.count, : bundles.members.size]
        going = left[shared.named["live"]] > 0.0
        if not going.any():
            break
        laws = [bundles.staying(going) for bundles in laws if going[bundles.members].any()]
        moving = [bundles.staying(going, idle=True) for bundles in moving if going[bundles.members].any()]
    sums = dict(zip(SUMS, left[shared.named["sums"] :].reshape(len(SUMS), n, count), strict=True))
    done, diverged = (left[shared.named[name]] for name in ("count", "diverged"))
    return Ended(done.astype(np.int64), diverged > 0.0, sums, blocks[:-1], trace[:-1])


@dataclass(frozen=True)
class _Bundles:
    """Bundles (B, rows, lanes) of experiments that share code, and their places in the pack, (M,).

    Lanes to spare are last: idle ones are zero, others repeat the last experiment.
    """

    code: int
    rows: Array
    members: NDArray[np.int64]

    def staying(self, going: NDArray[np.bool_], *, idle: bool = False) -> _Bundles:
        """Only experiments that go on, closed up."""
        stay = np.flatnonzero(going[self.members])
        return _bundled(self.code, columns(self.rows)[:, stay], self.members[stay], idle=idle)

    def seats(self) -> NDArray[np.int64]:
        """Address of each experiment's first number."""
        bundle, lane = divmod(np.arange(self.members.size), LANES)
        found: NDArray[np.int64] = self.rows.ctypes.data + bundle * self.rows[0].nbytes + lane * 8
        return found

    def point(self, pointers: Mapping[int, NDArray[np.int64]]) -> None:
        """Fill rows of pointers, given for each place; the last is for idle lanes."""
        experiments = np.full(len(self.rows) * LANES, -1)
        experiments[: self.members.size] = self.members
        for row, places in pointers.items():
            self.rows.view(np.int64)[:, row] = places[experiments].reshape(-1, LANES)


def _bundled(code: int, values: Array, members: NDArray[np.int64], *, idle: bool) -> _Bundles:
    return _Bundles(code, bundled(values, np.zeros((len(values), 1)) if idle else None), members)


def _bundles(
    loops: Mapping[int, Loop], parts: Mapping[int, CompiledPart], *, idle: bool = False
) -> list[_Bundles]:
    found = []
    for part in {id(parts[place]): parts[place] for place in loops}.values():
        members = {k: place for k, place in enumerate(loops) if parts[place] is part}
        values = part.filled([*members.values()])
        found.append(_bundled(part.code.run, values, np.array([*members]), idle=idle))
    return found


def _starts(values: Array, first: int = 0) -> NDArray[np.int64]:
    """Address of sample 0 in each part of (parts, samples, columns) that begins at `first`."""
    starts = values.ctypes.data + values.strides[0] * np.arange(len(values))
    return np.asarray(starts - first * values.strides[1])


class _Signals:
    """Desired motions and noises, each once; ``motion`` and ``noise`` are places, the last of idle lanes."""

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._n = loops[0].plant.preload.size
        # The same motion may be fed to some laws late.
        key = [(id(loop.reference), loop.reference_lag) for loop in loops]
        motions = {name: loop.fed for name, loop in dict(zip(key, loops, strict=True)).items()}
        seeds = {loop.seed: loop for loop in loops if is_noisy(loop)}
        self._motions, self._noises = [*motions.values()], [unit_noise(loop) for loop in seeds.values()]
        order, sources = list(motions), list(seeds)
        self.motion = np.array([*(order.index(name) for name in key), 0])
        self.noise = np.array([*(sources.index(loop.seed) if is_noisy(loop) else -1 for loop in loops), -1])

    def slice(self, first: int, span: int) -> tuple[Array, Array]:
        """Motions (R, span, 3 n), zero after their end, and unit noises (Q, span, 3 n), the last none."""
        motions = np.zeros((len(self._motions), span, 3 * self._n))
        for kept, motion in zip(motions, self._motions, strict=True):
            found = [part[first : first + span] for part in (motion.q_d, motion.dq_d, motion.ddq_d)]
            kept[: len(found[0])] = np.hstack(found)
        return motions, np.stack([*(noise(span) for noise in self._noises), np.zeros((span, 3 * self._n))])
