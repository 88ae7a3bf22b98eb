"""What a batch compiles: code that loops share, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics import control
from tendonrepro.physics.dynamics import Plant, holding_torque, rest_state
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import LaneRows, Written, bundled, columns, part_of, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code, of_one_lane
from tendonrepro.simulation.kernel import LawNumbers, experiment_code, sample_code, slope_code
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.resolution import HIGHEST, plant_modes, steps_needed
from tendonrepro.simulation.sampled import Hardware, longest, measure, start

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
    """Compiled code that loops share, and their numbers.

    ``start`` holds first values of rows by name, (rows, N); ``column`` a loop's column by its place in the
    batch. ``code`` has the addresses of functions by name, and ``prepare`` those to be run once before any
    of them. They work on so many `lanes`: a bundle, or one run by SciPy.
    """

    rows: LaneRows
    start: dict[str, Array]
    column: dict[int, int]
    code: Mapping[str, int]
    prepare: Sequence[int]
    lanes: int = LANES

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
        bundles = bundled(values, self.lanes)
        for address in self.prepare:
            for bundle in bundles:
                callable_code(address)(bundle.ctypes.data, 0.0, 0.0)
        return columns(bundles)[:, : len(places)]


Chunk: TypeAlias = tuple[Plant, Array]
"""Stacked plants and the strokes of their motions."""

Counts: TypeAlias = dict[float, NDArray[np.int64]]
"""Steps per sample of a chunk, (levels, N), by sampling period."""

ForEach: TypeAlias = Callable[[Callable[[Chunk], Counts], Sequence[Chunk]], Iterable[Counts]]
"""What calls a function for each chunk, such as ``map``."""


def plant_needs(
    loops: Mapping[int, Loop], tolerance: float, for_each: ForEach
) -> tuple[dict[int, NDArray[np.int64]], dict[int, Rest]]:
    """Steps per sample and rest, by place, of plants with as many joints and parts of the disturbance.

    Steps are (levels,), one for each level of demand; 0 where none are enough.
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
    counted = list(for_each(partial(_steps, periods=periods, tolerance=tolerance), chunks))
    counts = {L: np.hstack([part[L] for part in counted]) for L in periods}
    column = {name: k for k, name in enumerate(single)}
    places = {place: column[name] for place, name in key.items()}
    at_rest = rest_at(q, plant)
    return (
        {place: counts[loop.L][:, places[place]] for place, loop in loops.items()},
        {place: Rest(*(part[:, k] for part in at_rest)) for place, k in places.items()},
    )


def _steps(chunk: Chunk, *, periods: Collection[float], tolerance: float) -> Counts:
    modes = plant_modes(*chunk)
    return {L: np.stack([steps_needed(cases, L, tolerance) for cases in modes]) for L in periods}


def experiment_part(
    loops: Mapping[int, Loop],
    rest: Mapping[int, Rest],
    steps: Mapping[int, NDArray[np.int64]],
    block: Callable[[float], int],
    *,
    record: bool,
) -> CompiledPart:
    """Compile law and plant of loops alike in all that chooses branches, see `batch`.

    Errors are summed up over ``block(L)`` samples.
    """
    ordered = [(loop, rest[place]) for place, loop in loops.items()]
    numbers = law_numbers(ordered, block)
    command = next(iter(loops.values())).controller.command or control.command
    plants = stacked([loop.plant for loop in loops.values()])
    counts = np.array([steps[place] for place in loops], dtype=np.float64).T
    length = np.array([loop.L for loop in loops.values()]) / np.maximum(counts, 1.0)
    first = {
        "state": np.array([still.state for _, still in ordered]).T,
        "demand": np.full((1, len(loops)), HIGHEST),
        "steps": counts,
        "length": length,
    }
    written = experiment_code((plants, numbers), record, command)
    return _compiled(written, first | _start(ordered, numbers), {place: k for k, place in enumerate(loops)})


def sample_part(loop: Loop, rest: Rest) -> CompiledPart:
    """Compile a sample of one run by SciPy."""
    numbers = law_numbers([(loop, rest)], lambda _: 1)
    written = sample_code(numbers, loop.controller.command or control.command)
    return _compiled(written, _start([(loop, rest)], numbers), {0: 0}, lanes=1)


def slope_part(plant: Plant) -> CompiledPart:
    """Compile the state's derivative of one plant."""
    return _compiled(slope_code(stacked([plant])), {}, {0: 0}, lanes=1)


def _compiled(
    written: Written, start: dict[str, Array], column: dict[int, int], lanes: int = LANES
) -> CompiledPart:
    sources, rows = written
    if lanes == 1:
        sources = {name: of_one_lane(source) for name, source in sources.items()}
    code = {name: assembled(source, "prepare", name) for name, source in sources.items()}
    prepare, run = zip(*code.values(), strict=True)
    return CompiledPart(rows, start, column, dict(zip(code, run, strict=True)), prepare, lanes)


def law_numbers(loops: Sequence[tuple[Loop, Rest]], block: Callable[[float], int]) -> LawNumbers:
    """Stack all numbers of loops but their plants'; errors are summed up over ``block(L)`` samples."""
    phases: dict[int, streaming.Thresholds] = {}
    for name, loop in {id(loop.reference): loop for loop, _ in loops}.items():
        reference, period = loop.reference, round(loop.reference.period / loop.L)
        phases[name] = streaming.thresholds(reference.dq_d, reference.ddq_d, loop.L, period)
    return stacked(
        [
            LawNumbers(
                law=loop.controller.law,
                hardware=hardware_of(loop, rest),
                phases=phases[id(loop.reference)],
                samples=np.array(float(loop.reference.time.size)),
                block=np.array(float(block(loop.L))),
            )
            for loop, rest in loops
        ]
    )


def hardware_of(loop: Loop, rest: Rest) -> Hardware:
    """Encoders, drives and coupling."""
    drive, encoders = loop.plant.drive, (loop.joint_encoder, loop.motor_encoder)
    limit = np.float64(loop.divergence_limit)
    return Hardware(*encoders, rest.zero, loop.actuator, drive.S, drive.S_inv, limit)


def torque_before(loop: Loop, rest: Rest) -> Array:
    """Torque (n,) that the law has seen before its start."""
    return np.zeros_like(rest.tau) if loop.cold else rest.tau


def _start(loops: Sequence[tuple[Loop, Rest]], numbers: LawNumbers) -> dict[str, Array]:
    """First values of rows, (rows, N), by the start-up rule."""
    sources = {noise_source(loop): loop for loop, _ in loops}
    noise = {source: unit_noise(loop)(1)[0] for source, loop in sources.items()}
    at_start = [
        (rest.state, noise[noise_source(loop)], torque_before(loop, rest), loop.reference.q_d[0])
        for loop, rest in loops
    ]
    state, first, tau, q_d = stacked(at_start)
    # Where an encoder is ideal there is no step to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        memory = start(measure(state, first, numbers.law, numbers.hardware), q_d, tau, numbers.law)
    return {
        "memory": np.concatenate([part.reshape(-1, len(loops)) for part in memory]),
        "pending": np.tile(tau, (longest(numbers.hardware.actuator.delay), 1)),
        "tau_before": tau,
        "H_before": tau,
        "live": np.ones((1, len(loops))),
    }


def is_noisy(loop: Loop) -> bool:
    """Whether any instrument has noise."""
    return any(noise_source(loop)[1:])


def noise_source(loop: Loop) -> tuple[int, bool, bool, bool]:
    """What a loop's noise depends on: its seed, and which instruments have any."""
    instruments = loop.joint_encoder, loop.motor_encoder, loop.actuator
    joint, motor, torque = (part.noise > 0.0 for part in instruments)
    return loop.seed, joint, motor, torque


def unit_noise(loop: Loop) -> Callable[[int], Array]:
    """Unscaled noise, (samples, 3 n), of the next samples at each call; zeros of instruments without any."""
    n, (seed, *noisy) = loop.plant.preload.size, noise_source(loop)
    streams = [np.random.default_rng([seed, k]) if acts else None for k, acts in enumerate(noisy)]
    return lambda samples: np.hstack(
        [
            np.zeros((samples, n)) if stream is None else stream.standard_normal((samples, n))
            for stream in streams
        ]
    )
