"""What a batch compiles: the code that its loops share, and the numbers of each loop for it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, start_memory
from tendonrepro.physics.dynamics import Plant, holding_torque, rest_state
from tendonrepro.physics.instruments import quantise
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen import compiled, lane_loop
from tendonrepro.simulation.codegen.lanes import LaneRows, bundled, columns, part_of, stacked
from tendonrepro.simulation.codegen.machine import LaneCode
from tendonrepro.simulation.kernel import LoopNumbers, sample_code, step_code
from tendonrepro.simulation.resolution import HIGHEST, PACES, plant_modes, steps_by_demand
from tendonrepro.simulation.stepper import JOINT_NOISE, MOTOR_NOISE, TORQUE_NOISE, Loop, random_stream

CHUNK = 128
"""Plants whose steps are worked out together, by one thread."""


@dataclass(frozen=True)
class CompiledPart:
    """Compiled code that some loops share, with the numbers of each.

    ``start`` holds values of rows at the first sample, (rows, N), by name; ``column`` says which column of
    them belongs to a loop, by its place in the batch.
    """

    code: LaneCode
    rows: LaneRows
    start: dict[str, Array]
    column: dict[int, int]

    def filled(self, places: Sequence[int]) -> Array:
        """Rows with the parameters and starting values of the experiments at some places, (rows, M)."""
        own = [self.column[place] for place in places]
        values = np.zeros((self.rows.count, len(places)))
        for row, numbers in self.rows.constants.items():
            values[row] = numbers[own]
        for name, numbers in self.start.items():
            if name in self.rows.named:
                first = self.rows.named[name]
                values[first : first + numbers.shape[0]] = numbers[:, own]
        bundles = bundled(values)
        for bundle in bundles:
            lane_loop.call(self.code.prepare, bundle, 0.0)
        return columns(bundles)[:, : len(places)]


def plant_parts(
    loops: Mapping[int, Loop], tolerance: float, for_each: Callable[..., Iterator[Any]]
) -> tuple[dict[int, CompiledPart], dict[int, NDArray[np.int64]], dict[int, Array]]:
    """Compile the plants of loops with as many joints and components of the disturbance.

    By place in the batch: the code, integration steps per sample at each level of demand, (levels,), 0 where
    none are enough, and motor torque at rest, N m. `for_each` is `map`, or one on several threads.
    """
    # Runs under other readings share their plant and motion: these are worked out once.
    key = {place: (id(loop.plant), id(loop.reference)) for place, loop in loops.items()}
    single = {key[place]: loop for place, loop in loops.items()}
    motions = {id(loop.reference): loop.reference for loop in single.values()}
    far = {name: np.abs(motion.q_d).max(axis=0) for name, motion in motions.items()}
    plant, stroke = stacked([(loop.plant, far[id(loop.reference)]) for loop in single.values()])
    slices = [slice(first, first + CHUNK) for first in range(0, len(single), CHUNK)]
    chunks = [part_of((plant, stroke), chosen) for chosen in slices]
    periods = {loop.L for loop in loops.values()}
    found = list(for_each(partial(_steps, periods=periods, tolerance=tolerance), chunks))
    counts = {
        L: [np.hstack(parts) for parts in zip(*(part[L] for part in found), strict=True)] for L in periods
    }
    column = {name: k for k, name in enumerate(single)}
    places = {place: column[name] for place, name in key.items()}
    still, once = np.zeros_like(plant.preload), np.ones((1, len(single)))
    torque = holding_torque(still, plant)
    start = {"state": rest_state(still, plant), "live": once, "demand": HIGHEST * once}

    @cache
    def part(implicit: bool) -> CompiledPart:
        source, rows = step_code(plant, implicit)
        return CompiledPart(compiled.compiled_lanes(source, "step"), rows, start, places)

    return (
        {place: part(bool(counts[loop.L][1][places[place]])) for place, loop in loops.items()},
        {place: counts[loop.L][0][:, places[place]] for place, loop in loops.items()},
        {place: torque[:, k] for place, k in places.items()},
    )


def _steps(
    plants: tuple[Plant, Array], *, periods: Collection[float], tolerance: float
) -> dict[float, tuple[NDArray[np.int64], NDArray[np.bool_]]]:
    """Integration steps of stacked plants along their strokes by sampling period, see `steps_by_demand`."""
    modes = [plant_modes(*plants, pace) for pace in PACES]
    return {L: steps_by_demand(modes, L, tolerance) for L in periods}


def sample_part(
    loops: Mapping[int, Loop], laws: Mapping[int, Law], torque: Mapping[int, Array]
) -> CompiledPart:
    """Compile encoders, law, motors and statistics of loops alike in every branch; torque at rest in N m."""
    numbers = _numbers([*loops.values()], [laws[place] for place in loops])
    tau = np.stack([np.zeros_like(torque[k]) if loop.cold else torque[k] for k, loop in loops.items()], -1)
    source, rows = sample_code(numbers)
    code = compiled.compiled_lanes(source, "sample")
    start = _start(tau, numbers, [*loops.values()])
    return CompiledPart(code, rows, start, {place: k for k, place in enumerate(loops)})


def _numbers(loops: Sequence[Loop], laws: Sequence[Law]) -> LoopNumbers:
    phases: dict[int, streaming.Thresholds] = {}
    for loop in loops:
        if id(loop.reference) not in phases:
            reference = loop.reference
            period = round(reference.period / loop.L)
            phases[id(reference)] = streaming.thresholds(reference.dq_d, reference.ddq_d, loop.L, period)
    numbers: LoopNumbers = stacked(
        [
            LoopNumbers(
                law=law,
                encoder=loop.encoder,
                theta_start=_theta_start(loop),
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


def _theta_start(loop: Loop) -> Array:
    """Where motor angles are zero, in joint coordinates, (n,); nobody asks where joints are measured."""
    still = np.zeros_like(loop.plant.preload)
    return np.split(rest_state(still, loop.plant), 4)[2] if loop.controller.motor_side else still


def _start(tau: Array, numbers: LoopNumbers, loops: Sequence[Loop]) -> dict[str, Array]:
    """Memory of every law by the start-up rule; ``tau`` (n, N) acted before."""
    n, count = tau.shape
    angles = [
        quantise(loop.encoder.noise * next(unit_noise(loop, [1]))[0, :n], loop.encoder.resolution)
        if loop.encoder.noise
        else np.zeros(n)
        for loop in loops
    ]
    if numbers.law.motor_side:
        angles = [loop.plant.drive.S @ angle for loop, angle in zip(loops, angles, strict=True)]
    memory = start_memory(np.stack(angles, axis=-1), tau, numbers.law.lag)
    return {
        "memory": np.concatenate([np.reshape(part, (-1, count)) for part in memory]),
        "pending": np.tile(tau, (numbers.actuator.delay, 1)),
        "tau_m": tau,
        "H_hat": tau,
        "live": np.ones((1, count)),
    }


def unit_noise(loop: Loop, lengths: Sequence[int]) -> Iterator[Array]:
    """Noise of encoders and torque before it is scaled, (samples, 2 n), in slices."""
    n, angle = loop.plant.preload.size, MOTOR_NOISE if loop.controller.motor_side else JOINT_NOISE
    streams = [random_stream(loop, kind) for kind in (angle, TORQUE_NOISE)]
    for samples in lengths:
        yield np.hstack([stream.standard_normal((samples, n)) for stream in streams])
