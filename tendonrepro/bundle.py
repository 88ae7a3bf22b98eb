"""One bundle of experiments: its numbers in flat arrays, the run, and what is left of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tendonrepro import compiled, streaming
from tendonrepro.arrays import Array
from tendonrepro.control import Law, start_memory
from tendonrepro.dynamics import Plant, holding_torque, rest_state
from tendonrepro.encoder import quantise
from tendonrepro.kernel import RECORDED, Numbers, sample_code, sample_rows, step_code, step_rows
from tendonrepro.lanes import LANES, Rows, stacked
from tendonrepro.resolution import plant_modes, steps_needed
from tendonrepro.simulate import JOINT_NOISE, TORQUE_NOISE, Loop, random_stream


@dataclass(frozen=True)
class Group:
    """Loops that run through one piece of code, N of them.

    Attributes
    ----------
    loops : sequence of Loop
    index : array (N,)
        Their places in the batch.
    steps : array (N,)
        Integration steps per sample; 0 where none are enough.
    sample, step : LaneCode
    sample_rows, step_rows : Rows
    start : dict of str to array (rows, N)
        Values of the rows at the first sample.
    """

    loops: Sequence[Loop]
    index: NDArray[np.int64]
    steps: NDArray[np.int64]
    sample: compiled.LaneCode
    step: compiled.LaneCode
    sample_rows: Rows
    step_rows: Rows
    start: dict[str, Array]


@dataclass(frozen=True)
class Ended:
    """What one experiment left behind.

    Attributes
    ----------
    count : int
        Samples done.
    diverged : bool
    sums : Sums
        Each (n,).
    blocks : array (B, n)
        Errors summed up over blocks of samples.
    recorded : dict of array (T, ...)
        By the names of `RECORDED`; without rows unless asked for.
    """

    count: int
    diverged: bool
    sums: streaming.Sums
    blocks: Array
    recorded: dict[str, Array]


def compiled_group(loops: Sequence[Loop], laws: Sequence[Law], index: Sequence[int]) -> Group:
    """Generate and compile the code of a group.

    Parameters
    ----------
    loops : sequence of Loop
        Alike in every branch of their code.
    laws : sequence of Law
        One of each.
    index : sequence of int
        Their places in the batch.
    """
    plant, n = stacked([loop.plant for loop in loops]), loops[0].plant.preload.size
    numbers = _numbers(loops, laws)
    samples, steps = sample_rows(n), step_rows(n)
    stroke = stacked([np.abs(loop.reference.q_d).max(axis=0) for loop in loops])
    return Group(
        loops=loops,
        index=np.array(index),
        steps=steps_needed(plant_modes(plant, stroke), loops[0].L),
        sample=compiled.compiled_lanes(sample_code(numbers, samples), "sample", 1),
        step=compiled.compiled_lanes(step_code(plant, steps), "step", 2),
        sample_rows=samples,
        step_rows=steps,
        start=_start(plant, numbers, loops),
    )


def _numbers(loops: Sequence[Loop], laws: Sequence[Law]) -> Numbers:
    phases: dict[int, streaming.Thresholds] = {}
    for loop in loops:
        if id(loop.reference) not in phases:
            reference = loop.reference
            period = round(reference.period / loop.L)
            phases[id(reference)] = streaming.thresholds(reference.dq_d, reference.ddq_d, period)
    numbers: Numbers = stacked(
        [
            Numbers(
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


def _start(plant: Plant, numbers: Numbers, loops: Sequence[Loop]) -> dict[str, Array]:
    """Every experiment at rest, the law's memory filled by the start-up rule."""
    n, count = plant.preload.shape
    still = np.zeros((n, count))
    cold = np.array([loop.cold for loop in loops])
    tau = np.where(cold, 0.0, holding_torque(still, plant))
    angles = [
        quantise(loop.joint_encoder.noise * unit_noise(loop, 1)[0, :n], loop.joint_encoder.resolution)
        for loop in loops
    ]
    memory = start_memory(np.stack(angles, axis=-1), tau)
    return {
        "state": rest_state(still, plant),
        "memory": np.concatenate([np.reshape(part, (-1, count)) for part in memory]),
        "pending": np.tile(tau, (numbers.actuator.delay, 1)),
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
    group: Group, members: NDArray[np.int64], block: int, *, refine: int, record: bool
) -> list[Ended]:
    """Run the experiments of one bundle.

    Parameters
    ----------
    group : Group
    members : array (M,)
        Places in the group, at most as many as there are lanes; all with the same steps.
    block : int
        Samples of a block, see `Ended`.
    refine : int
        Multiplies the number of steps.
    record : bool
        Keep traces.

    Returns
    -------
    list of Ended
        One of each member.
    """
    # Empty lanes repeat the last experiment.
    lanes = np.append(members, np.repeat(members[-1], LANES - members.size))
    loops = [group.loops[i] for i in lanes]
    n = loops[0].plant.preload.size
    v, w = _filled(group.sample_rows, group.start, lanes), _filled(group.step_rows, group.start, lanes)
    group.sample.prepare(v)
    group.step.prepare(w)
    desired = _desired(loops)
    samples = desired.shape[0]
    slow = np.zeros((-(-samples // block), n * LANES))
    trace = np.empty((samples if record else 0, 9 * n * LANES))
    compiled.follow(
        v,
        w,
        n,
        LANES,
        desired,
        _noise(loops, samples),
        loops[0].L,
        int(group.steps[members[0]]) * refine,
        block,
        slow,
        trace,
        group.sample.run,
        group.step.run,
    )
    values, sums = v.reshape(-1, LANES), slow.reshape(-1, n, LANES)
    kept = trace.reshape(trace.shape[0], 9 * n, LANES)
    return [
        _ended(values[:, k], group.sample_rows, n, sums[..., k], kept[..., k]) for k in range(members.size)
    ]


def _filled(rows: Rows, start: dict[str, Array], lanes: NDArray[np.int64]) -> Array:
    """Flat array with the parameters and starting values of the experiments."""
    flat = np.zeros((rows.count, LANES))
    for row, values in rows.constants.items():
        flat[row] = values[lanes]
    for name, values in start.items():
        if name in rows.named:
            first = rows.named[name]
            flat[first : first + values.shape[0]] = values[:, lanes]
    return flat.reshape(-1)


def _desired(loops: Sequence[Loop]) -> Array:
    """Reference of every lane, (T, 3 n LANES); at rest after its own end."""
    samples, n = max(loop.reference.time.size for loop in loops), loops[0].plant.preload.size
    desired = np.zeros((samples, 3, n, LANES))
    for lane, loop in enumerate(loops):
        reference, end = loop.reference, loop.reference.time.size
        for k, values in enumerate((reference.q_d, reference.dq_d, reference.ddq_d)):
            desired[:end, k, :, lane] = values
    return desired.reshape(samples, -1)


def _noise(loops: Sequence[Loop], samples: int) -> Array:
    """Unit noise of every lane, (T, 2 n LANES); without rows where no lane has any."""
    n = loops[0].plant.preload.size
    if all(loop.joint_encoder.noise == loop.actuator.noise == 0.0 for loop in loops):
        return np.zeros((0, 2 * n * LANES))
    return np.stack([unit_noise(loop, samples) for loop in loops], axis=-1).reshape(samples, -1)


def _ended(values: Array, rows: Rows, n: int, slow: Array, trace: Array) -> Ended:
    def row(name: str) -> int:
        return int(values[rows.named[name]])

    first, fields = rows.named["sums"], len(streaming.Sums._fields)
    sums = values[first : first + fields * n].reshape(fields, n)
    recorded, at = {}, 0
    for name in RECORDED:
        size = 4 * n if name == "state" else n
        recorded[name] = trace[: row("count"), at : at + size]
        at += size
    return Ended(row("count"), row("diverged") > 0, streaming.Sums(*sums), slow, recorded)
