"""What a batch compiles: code that loops share, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics import control
from tendonrepro.physics.dynamics import Plant, holding_torque, rest_state
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import LaneRows, bundled, columns, part_of, stacked
from tendonrepro.simulation.codegen.machine import LaneCode, assembled, callable_code
from tendonrepro.simulation.kernel import LoopNumbers, advance_code, sample_code, slope_code
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import HIGHEST, plant_modes, steps_needed
from tendonrepro.simulation.sampled import Hardware, measure, start

CHUNK = 128
"""Plants whose steps are worked out together, by one thread."""


class Rest(NamedTuple):
    """State (4 n,) in which an arm waits, motor torque (n,) that holds it, and motor angles read as zero."""

    state: Array
    tau: Array
    zero: Array


def rest_at(q: Array, plant: Plant) -> Rest:
    """Rest at joint angles (n,); encoders are zeroed where the reference begins, at the start posture."""
    n = len(q)
    posture = rest_state(np.zeros_like(q), plant)
    return Rest(rest_state(q, plant), holding_torque(q, plant), posture[2 * n : 3 * n])


@dataclass(frozen=True)
class CompiledPart:
    """Compiled code that loops share.

    ``start`` holds first values by name, (rows, N); ``column`` a loop's column by its place in the batch.
    """

    code: LaneCode
    rows: LaneRows
    start: dict[str, Array]
    column: dict[int, int]

    def filled(self, places: Sequence[int]) -> Array:
        """Rows at the start, (rows, M)."""
        own = [self.column[place] for place in places]
        values = np.zeros((self.rows.count, len(places)))
        for row, numbers in self.rows.constants.items():
            values[row] = numbers[own]
        for name, numbers in self.start.items():
            if name in self.rows.named:
                first = self.rows.named[name]
                values[first : first + numbers.shape[0]] = numbers[:, own]
        bundles = bundled(values)
        prepare = callable_code(self.code.prepare)
        for bundle in bundles:
            prepare(bundle.ctypes.data, 0.0)
        return columns(bundles)[:, : len(places)]


def plant_parts(
    loops: Mapping[int, Loop], tolerance: float, for_each: Callable[..., Iterator[Any]]
) -> tuple[dict[int, CompiledPart], dict[int, NDArray[np.int64]], dict[int, Rest]]:
    """Compile plants with as many joints and components of the disturbance.

    By place: code, steps per sample at each level of demand, 0 where none are enough, and rest.
    """
    # Runs under other readings share their plant and motion: these are worked out once.
    key = {
        place: (id(loop.plant), id(loop.reference.q_d), loop.start_angles.tobytes())
        for place, loop in loops.items()
    }
    single = {key[place]: loop for place, loop in loops.items()}
    angles = {id(loop.reference.q_d): loop.reference.q_d for loop in single.values()}
    far = {name: streaming.peak(q_d) for name, q_d in angles.items()}
    plant, stroke, q = stacked(
        [(loop.plant, far[id(loop.reference.q_d)], loop.start_angles) for loop in single.values()]
    )
    chunks = [part_of((plant, stroke), slice(k, k + CHUNK)) for k in range(0, len(single), CHUNK)]
    periods = {loop.L for loop in loops.values()}
    found = list(for_each(partial(_steps, periods=periods, tolerance=tolerance), chunks))
    counts = {L: np.hstack([part[L] for part in found]) for L in periods}
    column = {name: k for k, name in enumerate(single)}
    places = {place: column[name] for place, name in key.items()}
    once, at_rest = np.ones((1, len(single))), rest_at(q, plant)

    @cache
    def part(L: float) -> CompiledPart:
        source, rows = advance_code(plant)
        steps = counts[L].astype(float)
        start = {
            "state": at_rest.state,
            "live": once,
            "demand": HIGHEST * once,
            "steps": steps,
            "length": L / np.maximum(steps, 1.0),
            "period": L * once,
        }
        return CompiledPart(LaneCode(*assembled(source, "prepare_step", "advance")), rows, start, places)

    return (
        {place: part(loop.L) for place, loop in loops.items()},
        {place: counts[loop.L][:, places[place]] for place, loop in loops.items()},
        {place: Rest(*(part[:, k] for part in at_rest)) for place, k in places.items()},
    )


def slope_part(plant: Plant) -> CompiledPart:
    """Compile the state's derivative of one plant."""
    source, rows = slope_code(stacked([plant]))
    return CompiledPart(LaneCode(*assembled(source, "prepare_slope", "slope")), rows, {}, {0: 0})


def _steps(
    plants: tuple[Plant, Array], *, periods: Collection[float], tolerance: float
) -> dict[float, NDArray[np.int64]]:
    """Steps per sample of stacked plants, (levels, N), by sampling period."""
    modes = plant_modes(*plants)
    return {L: np.stack([steps_needed(cases, L, tolerance) for cases in modes]) for L in periods}


def sample_part(
    loops: Mapping[int, Loop],
    rest: Mapping[int, Rest],
    block: Callable[[float], int],
    *,
    statistics: bool,
    record: bool,
) -> CompiledPart:
    """Compile a sample of loops alike in command and branches; errors are summed up over ``block(L)``."""
    ordered = [(loop, rest[place]) for place, loop in loops.items()]
    numbers = _numbers(ordered, block)
    command = next(iter(loops.values())).controller.command or control.command
    source, rows = sample_code(numbers, statistics, record, command)
    code = LaneCode(*assembled(source, "prepare_sample", "sample"))
    return CompiledPart(code, rows, _start(ordered, numbers), {place: k for k, place in enumerate(loops)})


def _numbers(loops: Sequence[tuple[Loop, Rest]], block: Callable[[float], int]) -> LoopNumbers:
    phases: dict[int, streaming.Thresholds] = {}
    for name, loop in {id(loop.reference): loop for loop, _ in loops}.items():
        reference, period = loop.reference, round(loop.reference.period / loop.L)
        phases[name] = streaming.thresholds(reference.dq_d, reference.ddq_d, loop.L, period)
    numbers: LoopNumbers = stacked(
        [
            LoopNumbers(
                law=loop.controller.law,
                hardware=hardware_of(loop, rest),
                phases=phases[id(loop.reference)],
                samples=np.array(float(loop.reference.time.size)),
                block=np.array(float(block(loop.L))),
            )
            for loop, rest in loops
        ]
    )
    return numbers


def hardware_of(loop: Loop, rest: Rest) -> Hardware:
    """Encoders, drives and coupling."""
    drive, encoders = loop.plant.drive, (loop.joint_encoder, loop.motor_encoder)
    limit = np.float64(loop.divergence_limit)
    return Hardware(*encoders, rest.zero, loop.actuator, drive.S, drive.S_inv, limit)


def torque_before(loop: Loop, rest: Rest) -> Array:
    """Torque (n,) that the law has seen before its start."""
    return np.zeros_like(rest.tau) if loop.cold else rest.tau


def _start(loops: Sequence[tuple[Loop, Rest]], numbers: LoopNumbers) -> dict[str, Array]:
    """First values of rows, (rows, N), by the start-up rule."""
    noise = {seed: unit_noise(loop)(1)[0] for seed, loop in {loop.seed: loop for loop, _ in loops}.items()}
    found = [
        (rest.state, noise[loop.seed], torque_before(loop, rest), loop.reference.q_d[0])
        for loop, rest in loops
    ]
    state, first, tau, q_d = stacked(found)
    # Where an encoder is ideal there is no step to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        memory = start(measure(state, first, numbers.law, numbers.hardware), q_d, tau, numbers.law)
    return {
        "memory": np.concatenate([part.reshape(-1, len(loops)) for part in memory]),
        "pending": np.tile(tau, (numbers.hardware.actuator.delay, 1)),
        "tau_before": tau,
        "H_before": tau,
        "live": np.ones((1, len(loops))),
    }


def is_noisy(loop: Loop) -> bool:
    """Whether any instrument has noise."""
    return any(part.noise > 0.0 for part in (loop.joint_encoder, loop.motor_encoder, loop.actuator))


def unit_noise(loop: Loop) -> Callable[[int], Array]:
    """Unscaled noise, (samples, 3 n), of the next samples at each call."""
    n = loop.plant.preload.size
    streams = [np.random.default_rng([loop.seed, stream]) for stream in range(3)]
    return lambda samples: np.hstack([stream.standard_normal((samples, n)) for stream in streams])
