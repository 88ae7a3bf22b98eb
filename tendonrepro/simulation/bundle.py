"""One bundle of experiments: its numbers in flat arrays, the run, and what is left of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, start_memory
from tendonrepro.physics.dynamics import holding_torque, rest_state
from tendonrepro.physics.instruments import quantise
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen import compiled
from tendonrepro.simulation.codegen.lanes import LANES, LaneRows, stacked
from tendonrepro.simulation.kernel import RECORDED, LoopNumbers, sample_code, step_code
from tendonrepro.simulation.resolution import plant_modes, steps_needed
from tendonrepro.simulation.stepper import JOINT_NOISE, TORQUE_NOISE, Loop, random_stream


@dataclass(frozen=True)
class CompiledPart:
    """Compiled code that some loops share, with the numbers of each.

    ``start`` holds values of rows at the first sample, (rows, N), by name; ``column`` says which column of
    them belongs to a loop, by its place in the batch.
    """

    code: compiled.LaneCode
    rows: LaneRows
    start: dict[str, Array]
    column: dict[int, int]

    def filled(self, places: Sequence[int]) -> Array:
        """Flat array with the parameters and starting values of the experiments at some places."""
        columns = [self.column[place] for place in places]
        flat = np.zeros((self.rows.count, len(places)))
        for row, values in self.rows.constants.items():
            flat[row] = values[columns]
        for name, values in self.start.items():
            if name in self.rows.named:
                first = self.rows.named[name]
                flat[first : first + values.shape[0]] = values[:, columns]
        self.code.prepare(flat.reshape(-1))
        return flat.reshape(-1)


@dataclass(frozen=True)
class Ended:
    """What the M experiments of a bundle left behind: samples done, whether they diverged, sums, each (n, M).

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


def plant_part(
    loops: Mapping[int, Loop], tolerance: float
) -> tuple[CompiledPart, dict[int, int], dict[int, Array]]:
    """Compile the plants of loops with as many joints and components of the disturbance.

    Besides the code, by place in the batch: integration steps per sample, 0 where none are enough, and
    motor torque at rest, N m.
    """
    # Runs under other readings share their plant and motion: these are worked out once.
    key = {place: (id(loop.plant), id(loop.reference)) for place, loop in loops.items()}
    single = {key[place]: loop for place, loop in loops.items()}
    column = {name: k for k, name in enumerate(single)}
    plant = stacked([loop.plant for loop in single.values()])
    stroke = stacked([np.abs(loop.reference.q_d).max(axis=0) for loop in single.values()])
    modes, still = plant_modes(plant, stroke), np.zeros_like(plant.preload)
    torque, (source, rows) = holding_torque(still, plant), step_code(plant)
    code = compiled.compiled_lanes(source, "step", 2)
    places = {place: column[name] for place, name in key.items()}
    part = CompiledPart(code, rows, {"state": rest_state(still, plant)}, places)
    steps = {L: steps_needed(modes, L, tolerance) for L in {loop.L for loop in loops.values()}}
    return (
        part,
        {place: int(steps[loop.L][places[place]]) for place, loop in loops.items()},
        {place: torque[:, k] for place, k in places.items()},
    )


def sample_part(
    loops: Mapping[int, Loop], laws: Mapping[int, Law], torque: Mapping[int, Array]
) -> CompiledPart:
    """Compile encoders, law, motors and statistics of loops alike in every branch; torque at rest in N m."""
    numbers = _numbers([*loops.values()], [laws[place] for place in loops])
    tau = np.stack([np.zeros_like(torque[k]) if loop.cold else torque[k] for k, loop in loops.items()], -1)
    source, rows = sample_code(numbers)
    code = compiled.compiled_lanes(source, "sample", 1)
    start = _start(tau, numbers.actuator.delay, [*loops.values()])
    return CompiledPart(code, rows, start, {place: k for k, place in enumerate(loops)})


def _numbers(loops: Sequence[Loop], laws: Sequence[Law]) -> LoopNumbers:
    phases: dict[int, streaming.Thresholds] = {}
    for loop in loops:
        if id(loop.reference) not in phases:
            reference = loop.reference
            period = round(reference.period / loop.L)
            phases[id(reference)] = streaming.thresholds(reference.dq_d, reference.ddq_d, period)
    numbers: LoopNumbers = stacked(
        [
            LoopNumbers(
                law=law,
                encoder=loop.joint_encoder,
                actuator=loop.actuator,
                S=loop.plant.drive.S,
                S_inv=loop.plant.drive.S_inv,
                phases=phases[id(loop.reference)],
                limit=np.array(loop.divergence_limit),
                samples=np.array(float(loop.reference.time.size)),
            )
            for loop, law in zip(loops, laws, strict=True)
        ]
    )
    return numbers


def _start(tau: Array, delay: int, loops: Sequence[Loop]) -> dict[str, Array]:
    """Memory of every law by the start-up rule; ``tau`` (n, N) acted before."""
    n, count = tau.shape
    angles = [
        quantise(loop.joint_encoder.noise * unit_noise(loop, 1)[0, :n], loop.joint_encoder.resolution)
        for loop in loops
    ]
    memory = start_memory(np.stack(angles, axis=-1), tau)
    return {
        "memory": np.concatenate([np.reshape(part, (-1, count)) for part in memory]),
        "pending": np.tile(tau, (delay, 1)),
        "tau_m": tau,
        "H_hat": tau,
        "live": np.ones((1, count)),
    }


def unit_noise(loop: Loop, samples: int) -> Array:
    """Noise of encoders and torque before it is scaled, (samples, 2 n); zero where the loop has none."""
    n = loop.plant.preload.size
    if loop.joint_encoder.noise == loop.actuator.noise == 0.0:
        return np.zeros((samples, 2 * n))
    streams = (random_stream(loop, stream) for stream in (JOINT_NOISE, TORQUE_NOISE))
    return np.hstack([stream.standard_normal((samples, n)) for stream in streams])


def run_bundle(
    loops: Mapping[int, Loop],
    sample: CompiledPart,
    plant: CompiledPart,
    steps: int,
    block: int,
    *,
    record: bool,
) -> Ended:
    """Run the experiments of one bundle, by place in the batch; all have the same sampling period.

    ``block`` is the number of samples of a block, see `Ended`; with ``record`` traces are kept.
    """
    # Empty lanes repeat the last experiment.
    places = list(loops)
    places += places[-1:] * (LANES - len(places))
    chosen = [loops[place] for place in places]
    n, L = chosen[0].plant.preload.size, chosen[0].L
    v, w, desired = sample.filled(places), plant.filled(places), _desired(chosen)
    samples = desired.shape[0]
    slow = np.zeros((-(-samples // block), n * LANES))
    trace = np.empty((samples if record else 0, 9 * n * LANES))
    noise = _noise(chosen, samples)
    run = (sample.code.run, plant.code.run)
    compiled.compiled_lane_loop()(v, w, n, LANES, desired, noise, L, steps, block, slow, trace, *run)
    return _ended(v.reshape(-1, LANES)[:, : len(loops)], sample.rows, slow, trace)


def _desired(loops: Sequence[Loop]) -> Array:
    """Reference of every lane, (T, 3 n LANES); at rest after its own end."""
    samples, n = max(loop.reference.time.size for loop in loops), loops[0].plant.preload.size
    desired = np.zeros((samples, 3, n, LANES))
    for first, loop in enumerate(loops):
        reference = loop.reference
        lanes = [lane for lane, other in enumerate(loops) if other.reference is reference]
        if lanes[0] == first:
            for k, values in enumerate((reference.q_d, reference.dq_d, reference.ddq_d)):
                desired[: reference.time.size, k, :, lanes] = values[np.newaxis]
    return desired.reshape(samples, -1)


def _noise(loops: Sequence[Loop], samples: int) -> Array:
    """Unit noise of every lane, (T, 2 n LANES); without rows where no lane has any."""
    n = loops[0].plant.preload.size
    if all(loop.joint_encoder.noise == loop.actuator.noise == 0.0 for loop in loops):
        return np.zeros((0, 2 * n * LANES))
    return np.stack([unit_noise(loop, samples) for loop in loops], axis=-1).reshape(samples, -1)


def _ended(values: Array, rows: LaneRows, slow: Array, trace: Array) -> Ended:
    """Read what is left in the rows (R, M) after a run."""
    members, fields = values.shape[1], len(streaming.Sums._fields)
    n = slow.shape[1] // LANES
    sums = values[rows.named["sums"] :][: fields * n].reshape(fields, n, members)
    return Ended(
        count=values[rows.named["count"]].astype(np.int64),
        diverged=values[rows.named["diverged"]] > 0.0,
        sums=streaming.Sums(*sums),
        blocks=slow.reshape(-1, n, LANES)[..., :members],
        trace=trace.reshape(trace.shape[0], 9 * n, LANES)[..., :members],
    )
