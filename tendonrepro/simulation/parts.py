"""Code that loops share, compiled, and their numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics import control
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import LaneRows, Written, bundled, columns, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code, of_one_lane
from tendonrepro.simulation.kernel import LawNumbers, experiment_code, single_code
from tendonrepro.simulation.loop import (
    Loop,
    Rest,
    hardware_of,
    longest,
    measure,
    noise_source,
    start,
    torque_before,
    unit_noise,
)
from tendonrepro.simulation.resolution import HIGHEST, PreparedLoop


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


def experiment_part(
    alike: Mapping[int, PreparedLoop], block: Callable[[float], int], *, record: bool
) -> CompiledPart:
    """Compile law and plant of loops alike in all that chooses branches, by place in the batch.

    Errors are summed up over ``block(L)`` samples.
    """
    loops, rests, steps = zip(*alike.values(), strict=True)
    ordered = [*zip(loops, rests, strict=True)]
    numbers = law_numbers(ordered, block)
    plants = stacked([loop.plant for loop in loops])
    counts = np.array(steps, dtype=np.float64).T
    first = {
        "state": np.array([rest.state for rest in rests]).T,
        "demand": np.full((1, len(loops)), HIGHEST),
        "steps": counts,
        "length": np.array([loop.L for loop in loops]) / np.maximum(counts, 1.0),
    }
    written = experiment_code((plants, numbers), record, loops[0].controller.command or control.command)
    return _compiled(written, first | _start(ordered, numbers), {place: k for k, place in enumerate(alike)})


def single_part(loop: Loop, rest: Rest, *, sampled: bool) -> CompiledPart:
    """Compile the plant of one run by SciPy, and its sample unless Python does that."""
    plant = stacked([loop.plant])
    if not sampled:
        return _compiled(single_code((plant,), control.command), {}, {0: 0}, lanes=1)
    numbers = law_numbers([(loop, rest)], lambda _: 1)
    written = single_code((plant, numbers), loop.controller.command or control.command)
    return _compiled(written, _start([(loop, rest)], numbers), {0: 0}, lanes=1)


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
