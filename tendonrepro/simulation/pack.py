"""A pack of experiments taken through time in slices, and what is left of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen import compiled
from tendonrepro.simulation.codegen.lanes import aligned, bundled, columns
from tendonrepro.simulation.codegen.machine import LANES
from tendonrepro.simulation.kernel import RECORDED, sample_rows
from tendonrepro.simulation.parts import CompiledPart, unit_noise
from tendonrepro.simulation.stepper import DesiredMotion, Loop

SLICE = 500
"""Samples after which experiments that ended leave their lane to others."""


@dataclass(frozen=True)
class Ended:
    """What M experiments left behind: samples done, whether they diverged, sums, each (n, M).

    ``blocks`` (B, n, M) are errors summed up over blocks of samples, ``trace`` (T, 9 n, M) the rows of
    `RECORDED`, without entries unless asked for.
    """

    count: NDArray[np.int64]
    diverged: NDArray[np.bool_]
    sums: streaming.Sums
    blocks: Array
    trace: Array

    def recorded(self, member: int) -> dict[str, Array]:
        """Recorded signals of one experiment by the names of `RECORDED`, each (T, ...)."""
        n, at, signals = self.blocks.shape[1], 0, {}
        for name in RECORDED:
            size = 4 * n if name == "state" else n
            signals[name] = self.trace[: self.count[member], at : at + size, member]
            at += size
        return signals


def run_pack(
    loops: Mapping[int, Loop],
    controllers: Mapping[int, CompiledPart],
    plants: Mapping[int, CompiledPart],
    steps: Mapping[int, NDArray[np.int64]],
    block: int,
    *,
    record: bool,
) -> Ended:
    """Run experiments of one sampling period, by place in the batch.

    Plants and controllers are each bundled by their code, in the order given; a lane of the one knows its
    lane of the other. ``steps`` (levels,) are the integration steps per sample of each, ``block`` is the
    number of samples of a block, see `Ended`; with ``record`` traces are kept.
    """
    n, L = (first := next(iter(loops.values()))).plant.preload.size, first.L
    samples, signals = max(loop.reference.time.size for loop in loops.values()), _Signals([*loops.values()])
    blocks = np.zeros((-(-samples // block), n, len(loops)))
    trace = np.empty((samples if record else 0, 9 * n, len(loops)))
    about = np.array([range(len(loops)), *signals.of])
    counts = np.stack([steps[place] for place in loops], axis=-1)
    pack = _bundle_up(
        [(code, rows, about[:, of]) for code, rows, of in _by_code(loops, controllers)],
        [(code, rows, counts[:, of], of) for code, rows, of in _by_code(loops, plants)],
    )
    live, left = sample_rows(n).named["live"], np.empty((pack.v.shape[1], len(loops)))
    for start, (desired, noise) in zip(range(0, samples, SLICE), signals.slices(samples), strict=True):
        span = desired, noise, start, L, block, blocks, trace
        compiled.compiled_lane_loop()(pack.v, pack.code, pack.lanes, pack.w, pack.step, pack.counts, *span)
        members, values = pack.lanes[:, 0].reshape(-1), columns(pack.v)
        left[:, members[members >= 0]] = values[:, members >= 0]
        going = np.zeros(len(loops), dtype=np.bool_)
        going[members[members >= 0]] = values[live, members >= 0] > 0.0
        if not going.any():
            break
        pack = pack.without_ended(going)
    return _ended(left, n, blocks, trace)


@dataclass(frozen=True)
class _Pack:
    """Bundles as `lane_loop.sweep` takes them; ``members`` (C, lanes) are the experiments of `w`, or -1."""

    v: Array
    code: NDArray[np.int64]
    lanes: NDArray[np.int64]
    w: Array
    step: NDArray[np.int64]
    counts: NDArray[np.int64]
    members: NDArray[np.int64]

    def without_ended(self, going: NDArray[np.bool_]) -> _Pack:
        """Only experiments that still go on, if they need fewer bundles."""
        controllers = _staying(self.code, self.lanes[:, 0], going)
        plants = _staying(self.step, self.members, going)
        needed = sum(-(-stay.size // LANES) for _, _, stay in (*controllers, *plants))
        if needed == len(self.v) + len(self.w):
            return self
        return _bundle_up(
            [
                (code, columns(self.v[of])[:, stay], columns(self.lanes[of])[:3, stay])
                for code, of, stay in controllers
            ],
            [
                (
                    code,
                    columns(self.w[of])[:, stay],
                    columns(self.counts[of])[:, stay],
                    self.members[of].reshape(-1)[stay],
                )
                for code, of, stay in plants
            ],
        )


def _by_code(
    loops: Mapping[int, Loop], parts: Mapping[int, CompiledPart]
) -> list[tuple[int, Array, NDArray[np.int64]]]:
    """Address of each code, rows of the experiments at their start, (R, M), and which those are."""
    found = []
    for part in {id(parts[place]): parts[place] for place in loops}.values():
        members = {k: place for k, place in enumerate(loops) if parts[place] is part}
        found.append((part.code.run, part.filled([*members.values()]), np.array([*members])))
    most = max(len(rows) for _, rows, _ in found)
    return [(code, np.pad(rows, ((0, most - len(rows)), (0, 0))), members) for code, rows, members in found]


def _staying(
    codes: NDArray[np.int64], members: NDArray[np.int64], going: NDArray[np.bool_]
) -> list[tuple[int, NDArray[np.bool_], NDArray[np.int64]]]:
    """Every code with its bundles, and which of their lanes go on."""
    kept = (members >= 0) & going[members]
    return [
        (code, codes == code, np.flatnonzero(kept[codes == code])) for code in dict.fromkeys(codes.tolist())
    ]


def _bundle_up(
    controllers: Sequence[tuple[int, Array, NDArray[np.int64]]],
    plants: Sequence[tuple[int, Array, NDArray[np.int64], NDArray[np.int64]]],
) -> _Pack:
    """Bundles of columns: controllers by code, with their experiment, motion and noise, and plants by code.

    Of plants also the steps, (levels, M), and which experiments they are.
    """
    controllers = [part for part in controllers if part[1].shape[1]]
    plants = [part for part in plants if part[1].shape[1]]
    members = np.concatenate([bundled(of[np.newaxis], np.array([[-1]]))[:, 0] for *_, of in plants])
    seat = np.zeros(members.max() + 1, dtype=np.int64)
    seat[members[members >= 0]] = np.flatnonzero(members >= 0)
    empty = np.array([[-1], [0], [-1], [0], [0]])
    return _Pack(
        v=aligned(np.concatenate([bundled(rows) for _, rows, _ in controllers])),
        code=np.repeat(*np.transpose([(code, -(-rows.shape[1] // LANES)) for code, rows, _ in controllers])),
        lanes=np.concatenate(
            [
                bundled(np.vstack([about, *divmod(seat[about[0]], LANES)]), empty)
                for _, _, about in controllers
            ]
        ),
        w=aligned(np.concatenate([bundled(rows, np.zeros((len(rows), 1))) for _, rows, _, _ in plants])),
        step=np.repeat(*np.transpose([(code, -(-of.size // LANES)) for code, _, _, of in plants])),
        counts=np.concatenate([bundled(counts) for _, _, counts, _ in plants]),
        members=members,
    )


class _Signals:
    """Desired motions and noises of experiments, each distinct one once.

    ``of`` says of every experiment which motion is its own, and which noise, -1 for none.
    """

    def __init__(self, loops: Sequence[Loop]) -> None:
        self._n = loops[0].plant.preload.size
        self._motions = {id(loop.reference): loop.reference for loop in loops}
        self._noises = {_noise_of(loop): loop for loop in loops if _is_noisy(loop)}
        motions, noises = list(self._motions), list(self._noises)
        self.of = (
            [motions.index(id(loop.reference)) for loop in loops],
            [noises.index(_noise_of(loop)) if _is_noisy(loop) else -1 for loop in loops],
        )

    def slices(self, samples: int) -> Iterator[tuple[Array, Array]]:
        """Motions (R, T, 3 n) and unit noises (Q, T, 2 n) of every slice; at rest after a motion's end."""
        lengths = [min(SLICE, samples - start) for start in range(0, samples, SLICE)]
        noises = [unit_noise(loop, lengths) for loop in self._noises.values()]
        for start, length, *noise in zip(range(0, samples, SLICE), lengths, *noises, strict=True):
            motions = [_motion(motion, start, length) for motion in self._motions.values()]
            yield np.stack(motions), np.stack(noise) if noise else np.zeros((0, length, 2 * self._n))


def _motion(motion: DesiredMotion, start: int, length: int) -> Array:
    found = np.hstack([part[start : start + length] for part in (motion.q_d, motion.dq_d, motion.ddq_d)])
    return np.pad(found, ((0, length - len(found)), (0, 0)))


def _is_noisy(loop: Loop) -> bool:
    return not loop.encoder.noise == loop.actuator.noise == 0.0


def _noise_of(loop: Loop) -> tuple[int, bool]:
    """What tells noises apart: their seed, and which encoders they belong to."""
    return loop.seed, loop.controller.motor_side


def _ended(values: Array, n: int, blocks: Array, trace: Array) -> Ended:
    """Read what is left in the rows (R, M) after a run."""
    rows, fields = sample_rows(n).named, len(streaming.Sums._fields)
    sums = values[rows["sums"] :][: fields * n].reshape(fields, n, -1)
    return Ended(
        count=values[rows["count"]].astype(np.int64),
        diverged=values[rows["diverged"]] > 0.0,
        sums=streaming.Sums(*sums),
        blocks=blocks,
        trace=trace,
    )
