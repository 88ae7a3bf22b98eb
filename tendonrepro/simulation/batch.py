"""Many closed loops at once, by the compiled stepper.

One lane is one experiment, law and plant. Neighbours and threads do not change a bit. What acts in no loop of
a batch is left out of its code, so beside loops with more a run moves by some 1e-15.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.control import Law, Surface
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import bundled, columns
from tendonrepro.simulation.codegen.machine import (
    LANES,
    Signal,
    TraceBuffer,
    assembled,
    callable_sweep,
    sweep_code,
)
from tendonrepro.simulation.kernel import CompiledPart, experiment_part
from tendonrepro.simulation.loop import Loop, TimeDelayController
from tendonrepro.simulation.resolution import TOLERANCE, PreparedLoop, prepared_loops

PACK = 1536
"""Most experiments in a pack: the more, the fuller the lanes when some have ended.

The processor's cache sets no limit, for a bundle of lanes goes through a slice of time alone.
"""

SLICE = 500
"""Samples after which experiments that ended leave their lane to others."""


@dataclass(frozen=True)
class Batch:
    """Results of N runs.

    Attributes
    ----------
    statistics
        By the names of `STATISTICS`, (N, n), SI; NaN where not defined. Of a diverged run, up to its end.
    status
        Index into `STATUSES`.
    status_time
        Time of the last sample, s.
    steps
        Integration steps per sample; 0 where unresolved.
    traces
        As from `stepper.simulate`; None for an unresolved run.
    """

    statistics: Mapping[str, Array]
    status: NDArray[np.int8]
    status_time: Array
    steps: NDArray[np.int64]
    traces: list[dict[str, Array] | None] | None = None


def simulate_batch(
    loops: Sequence[Loop],
    *,
    progress: Callable[[int], None] | None = None,
    threads: int = 1,
    record: bool = False,
    tolerance: float = TOLERANCE,
) -> Batch:
    """Run many closed loops.

    Parameters
    ----------
    loops
        With the same number of joints.
    progress
        Called with the number of runs done since its last call.
    record
        Keep the traces.
    tolerance
        The default leaves q mostly within 1e-6 rad of the truth, and within a tenth of an encoder count as
        long as no count differs. With ideal encoders 1e-8 gives 1e-9 rad.

    Raises
    ------
    TendonreproError
        If there is no loop, or a law does not run on lanes.
    """
    _refuse_others(loops)
    report = progress or (lambda _: None)

    def run(pack: Pack) -> int:
        _keep(batch, pack.loops, run_pack(pack, record=record))
        return len(pack.loops)

    size = LANES if record else max(LANES, min(PACK, len(loops) // (4 * threads)))
    ready = prepared_loops(loops, tolerance)
    batch = _unresolved(loops, np.array([loop.steps for loop in ready]), record=record)
    packs = [pack for alike in _alike(ready) for pack in _packs(alike, size, record=record)]
    with ThreadPoolExecutor(threads) as pool:
        for done in pool.map(run, packs):
            report(done)
    return batch


def _refuse_others(loops: Sequence[Loop]) -> None:
    if not loops:
        message = "there are no loops to run"
        raise TendonreproError(message)
    for loop in loops:
        controller = loop.controller
        own = isinstance(controller, TimeDelayController) and controller.command is None
        if not own and not getattr(controller, "on_lanes", False):
            message = "only the paper's own control laws run on lanes"
            raise TendonreproError(message, hint="use the SciPy stepper, --solver scipy")


def _alike(ready: Sequence[PreparedLoop]) -> Iterable[dict[int, PreparedLoop]]:
    """Loops that share code, by place."""
    alike: dict[Hashable, dict[int, PreparedLoop]] = {}
    for place, loop in enumerate(ready):
        alike.setdefault(_branches(loop.loop), {})[place] = loop
    return alike.values()


def _branches(loop: Loop) -> Hashable:
    """What loops of a pack have in common, besides what all of a batch have."""
    law = loop.controller.law
    linear = isinstance(law, Law) and law.surface == Surface.PD
    code = loop.plant.disturbance.omega.size, loop.controller.command, linear
    return *code, loop.L, loop.ringing_frequency


class Pack(NamedTuple):
    """Loops by their places in a batch, and where they stand in the part that they share."""

    loops: dict[int, Loop]
    part: CompiledPart
    columns: list[int]


def _packs(alike: Mapping[int, PreparedLoop], size: int, *, record: bool) -> Iterator[Pack]:
    """Packs of loops that share code, sorted by motion and steps."""
    part, loops = experiment_part([*alike.values()], record=record), [*alike.items()]
    columns = [k for k, (_, ready) in enumerate(loops) if (ready.steps > 0).all()]
    columns.sort(key=lambda k: (id(loops[k][1].loop.reference), *loops[k][1].steps[::-1]))
    for start in range(0, len(columns), size):
        chosen = columns[start : start + size]
        yield Pack({loops[k][0]: loops[k][1].loop for k in chosen}, part, chosen)


def _unresolved(loops: Sequence[Loop], steps: NDArray[np.int64], *, record: bool) -> Batch:
    count, n = len(loops), loops[0].plant.preload.size
    return Batch(
        statistics={name: np.full((count, n), np.nan) for name in streaming.STATISTICS},
        status=np.full(count, STATUSES.index("unresolved"), dtype=np.int8),
        status_time=np.zeros(count),
        steps=np.where((steps > 0).all(axis=1), steps.max(axis=1), 0),
        traces=[None] * count if record else None,
    )


def _keep(batch: Batch, loops: Mapping[int, Loop], ended: Ended) -> None:
    places, first = list(loops), next(iter(loops.values()))
    fast = _fast_shares(ended, first.block, first.L, first.ringing_frequency)
    for name, values in streaming.finished(ended.sums, ended.count, fast).items():
        batch.statistics[name][places] = values.T
    ringing = (fast > np.array([loop.ringing_share for loop in loops.values()])).any(axis=0)
    codes = [STATUSES.index(name) for name in ("diverged", "ringing", "ok")]
    batch.status[places] = np.select([ended.diverged, ringing], codes[:2], codes[2])
    for (place, loop), count, trace in zip(loops.items(), ended.count, ended.trace, strict=True):
        batch.status_time[place] = loop.reference.time[count - 1]
        if batch.traces is not None:
            batch.traces[place] = loop.trace(trace[:count])


def _fast_shares(ended: Ended, block: int, L: float, frequency: float) -> Array:
    """Share of the error's power above a frequency, (n, M): all of it less the slow lines of its spectrum.

    What blocks do to a line is divided out. A last block is filled up with zeros.
    """
    slow = np.empty_like(ended.sums["rmse"])
    for samples in np.unique(ended.count):
        alike = ended.count == samples
        blocks = np.moveaxis(ended.blocks[alike, : -(-samples // block)], 0, -1)
        count = block * len(blocks)
        lines = np.arange(min(int(frequency * (1.0 + 1e-9) * count * L), len(blocks) // 2) + 1)
        half = np.pi * np.maximum(lines, 1e-9) / count
        response = np.sin(block * half) / (block * np.sin(half))
        spectrum = np.fft.rfft(blocks, axis=0)[: lines.size] / response[:, np.newaxis, np.newaxis]
        power = np.abs(spectrum) ** 2 / count
        power[1:] *= 2.0
        slow[:, alike] = power.sum(axis=0)
    total = ended.sums["rmse"]
    share = np.divide(slow, total, out=np.ones_like(total), where=total > 0.0)
    return np.asarray(np.maximum(1.0 - share, 0.0))


@dataclass(frozen=True)
class Ended:
    """What M experiments left behind: samples done, whether they diverged, sums, each (n, M).

    ``blocks`` (M, B, n) are errors summed over blocks of samples, ``trace`` (M, T, columns) the record.
    """

    count: NDArray[np.int64]
    diverged: NDArray[np.bool_]
    sums: streaming.Sums
    blocks: Array
    trace: Array


def run_pack(pack: Pack, *, record: bool) -> Ended:
    """Run experiments."""
    loops, part, named = [*pack.loops.values()], pack.part, pack.part.rows.named
    first, count, block = loops[0], len(loops), loops[0].block
    n, samples = first.plant.preload.size, max(loop.reference.time.size for loop in loops)
    signals = Signals(loops)
    kept = {"block": TraceBuffer(named["block"], n, block)}
    if record:
        kept["trace"] = TraceBuffer(named["trace"], first.recorded_columns, 1)
    inputs = [Signal(named[name], 3 * n) for name in signals.names]
    (address,) = assembled(sweep_code(named["live"], inputs, [*kept.values()]), "sweep")
    sweep, codes = callable_sweep(address), (part.code["sample"], part.code["advance"])
    ended = {name: np.zeros((count, -(-samples // of.each), of.size)) for name, of in kept.items()}
    members, rows = np.arange(count), part.filled(pack.columns)
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
            entries = np.moveaxis(records[name], 3, 1).reshape(-1, *records[name].shape[1:3])
            begin = at // of.each
            ended[name][members, begin : begin + entries.shape[1]] = entries[: members.size]
        left[:, members] = rows
        going = rows[named["live"]] > 0.0
        if not going.any():
            break
        members, rows = members[going], rows[:, going]
    sums = left[named["sums"] :][: len(streaming.SUMS) * n].reshape(len(streaming.SUMS), n, count)
    return Ended(
        count=left[named["count"]].astype(np.int64),
        diverged=left[named["diverged"]] > 0.0,
        sums=dict(zip(streaming.SUMS, sums, strict=True)),
        blocks=ended["block"],
        trace=ended.get("trace", np.empty((count, 0, 0))),
    )


def _lanes(members: NDArray[np.int64]) -> NDArray[np.int64]:
    """Members of each bundle, (B, LANES); lanes to spare repeat the last."""
    return np.append(members, np.repeat(members[-1:], -members.size % LANES)).reshape(-1, LANES)


class Signals:
    """Desired motions and noises of a pack's experiments, each once."""

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._n = loops[0].plant.preload.size
        # The same motion may be fed to some laws late.
        motions = {(id(loop.reference), loop.reference_lag): loop for loop in loops}
        noises = {loop.noise_source: loop for loop in loops}
        self._motions = [loop.fed for loop in motions.values()]
        self._noises = [loop.unit_noise() for loop in noises.values()]
        motion, noise = ({name: k for k, name in enumerate(names)} for names in (motions, noises))
        self._motion = np.array([motion[id(loop.reference), loop.reference_lag] for loop in loops])
        self._noise = np.array([noise[loop.noise_source] for loop in loops])
        self.names = ("desired", "noise") if any(loop.is_noisy for loop in loops) else ("desired",)

    def starts(self, first: int, span: int) -> NDArray[np.int64]:
        """Addresses of sample 0 by signal and experiment, (signals, M), of arrays that begin at `first`."""
        motions = np.zeros((len(self._motions), span, 3 * self._n))
        for kept, motion in zip(motions, self._motions, strict=True):
            for k, part in enumerate((motion.q_d, motion.dq_d, motion.ddq_d)):
                given = part[first : first + span]
                kept[: len(given), k * self._n : (k + 1) * self._n] = given
        # Kept until the next slice: machine code reads them by their addresses.
        self._arrays = motions, np.stack([noise(span) for noise in self._noises])
        both = zip(self._arrays, (self._motion, self._noise), strict=True)
        return np.stack([_starts(values, first)[places] for values, places in both])[: len(self.names)]


def _starts(values: Array, first: int) -> NDArray[np.int64]:
    """Address of sample 0 in each part of (parts, samples, columns) that begins at `first`."""
    starts = values.ctypes.data + values.strides[0] * np.arange(len(values))
    return np.asarray(starts - first * values.strides[1])
