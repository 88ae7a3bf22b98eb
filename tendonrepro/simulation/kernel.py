"""Experiments on lanes: their code, written from the physics and compiled, and the numbers they start with.

One sample of a law, and its plant until the next one, work on the same rows. Law and plant meet in rows of
the names `state`, `torque`, `ddq` and `live` alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, Numeric, choose, times
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Servo, unpacked
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen import machine
from tendonrepro.simulation.codegen.lanes import (
    LaneRows,
    LaneTape,
    Written,
    bundled,
    columns,
    remembered,
    stacked,
)
from tendonrepro.simulation.codegen.machine import LANES
from tendonrepro.simulation.codegen.symbols import Symbol
from tendonrepro.simulation.loop import (
    CommandFunction,
    Hardware,
    SampledState,
    Three,
    longest,
    measure,
    recorded,
    sample,
    start,
)
from tendonrepro.simulation.resolution import HIGHEST, PACES, PreparedLoop, demand


class LawNumbers(NamedTuple):
    """All numbers of a loop but its plant's; ``block`` samples have their errors summed up together."""

    law: Law | Servo
    hardware: Hardware
    phases: streaming.Thresholds
    samples: Array
    block: Array


def experiment_rows(n: int) -> LaneRows:
    """Rows of every experiment, which come first: the same for all laws, so plants share their code."""
    rows = LaneRows()
    sizes = {"state": 4 * n, "torque": n, "ddq": n, "live": 1, "desired": 3 * n, "noise": 3 * n}
    for name, size in sizes.items():
        rows.known(name, size)
    return rows


@remembered
def experiment_code(numbers: tuple[Plant, LawNumbers], record: bool, command: CommandFunction) -> Written:
    """Source of ``advance`` and ``sample`` for experiments of a batch, and their rows."""
    plant, law = numbers
    moved, rows = advance_code(plant)
    # The rows of the law follow those of the plant, which other laws share.
    code = LaneTape(replace(rows, named={**rows.named}))
    write_sample(code, law, command, statistics=True, record=record)
    return {**moved, "sample": code.source("sample")}, code.rows


@remembered
def single_code(numbers: tuple[Plant] | tuple[Plant, LawNumbers], command: CommandFunction) -> Written:
    """Source for a run by SciPy, and its rows: ``slope``, and ``sample`` where there is a law.

    ``slope`` gives SciPy the derivative at a time and a state, an array of its own.
    """
    plant, *laws = numbers
    n, rows = plant.preload.shape[0], experiment_rows(plant.preload.shape[0])
    code = LaneTape(rows)
    x, t = code.symbols(plant), _time(code)
    code.leave("slope", state_derivative(t, code.read("state", 4 * n), code.read("torque", n), x))
    outer = machine.on_array_code("slope", "derivative", rows.named["state"], rows.named["slope"], 4 * n)
    sources = {"slope": code.source("derivative") + outer}
    for law in laws:
        sampling = LaneTape(rows)
        write_sample(sampling, law, command, statistics=False, record=True)
        sources["sample"] = sampling.source("sample")
    return sources, rows


def _time(code: LaneTape) -> Any:
    """A symbol where the physics says that a time is a float."""
    return code.write("time")


@remembered
def advance_code(plant: Plant) -> Written:
    """Source of ``advance``, plants from a sample at a time to the next one, torque held; and its rows.

    A beginning is followed by steps while row ``left`` is positive. Rows ``steps`` and ``length`` hold number
    and length, s, of steps at each level of demand. A period begins with the level that the last one met.
    Where a plant meets a higher one, its steps were too long to be stable there (up to 32 times, in the box
    of plants), so it goes back to the period's start. That costs 2 % of the ensemble's time. Row ``ddq``
    receives the acceleration at the start.
    """
    n, rows = plant.preload.shape[0], experiment_rows(plant.preload.shape[0])
    begin, step = LaneTape(rows), LaneTape(rows)

    def of_level(code: LaneTape, name: str, level: Numeric) -> Numeric:
        cells: Sequence[Numeric] = [*code.read(name, len(PACES))]
        return choose(level >= 2.0, cells[2], choose(level >= 1.0, cells[1], cells[0]))

    live, most = begin.number("live"), begin.number("demand")
    begin.leave("begin", begin.read("state", 4 * n))
    begin.leave("left", [choose(live > 0.0, of_level(begin, "steps", most), 0.0)])
    begin.leave("done", [0.0])
    begin.leave("h", [choose(live > 0.0, of_level(begin, "length", most), 0.0)])
    begin.leave("demand", [choose(live > 0.0, 0.0, most)])

    x, torque, state = step.symbols(plant), step.read("torque", n), step.read("state", 4 * n)
    left, done, h, most = (step.number(name) for name in ("left", "done", "h", "demand"))
    after, slope = runge_kutta(
        lambda t, state: state_derivative(t, state, torque, x), _time(step) + done * h, state, h
    )
    met = np.maximum(most, demand(state, after, x))
    # A lane that is done waits for its neighbours.
    busy = left > 0.0
    is_last, wanted = busy * (done + 1.0 >= left), of_level(step, "steps", met)
    again = is_last * (wanted > left)
    ahead = [choose(again, *pair) for pair in zip(step.read("begin", 4 * n), after, strict=True)]
    at_start = busy * (done <= 0.0)
    step.leave("ddq", [choose(at_start, *p) for p in zip(slope[n : 2 * n], step.read("ddq", n), strict=True)])
    step.leave("state", [choose(busy, *pair) for pair in zip(ahead, state, strict=True)])
    step.leave("left", [choose(is_last, choose(again, wanted, 0.0), left)])
    step.leave("done", [choose(is_last, 0.0, done + busy)])
    step.leave("h", [choose(again, of_level(step, "length", met), h)])
    step.leave("demand", [choose(busy, choose(again, 0.0, met), most)])
    first = machine.vector_code("begin", begin.lines, begin.results)
    again_and_again = machine.repeated("advance", "begin", "step", rows.named["left"])
    return {"advance": "\n".join((first, step.source("step"), again_and_again))}, rows


def runge_kutta(
    derivative: Callable[[float, Array], Array], t: float, state: Array, h: Numeric
) -> tuple[Array, Array]:
    """Classical Runge-Kutta step: state at ``t + h`` and slope at ``t``."""
    # The physics says that a time is a float, here too, where it is a symbol.
    step: Any = h
    half = 0.5 * step
    k1 = derivative(t, state)
    k2 = derivative(t + half, state + half * k1)
    k3 = derivative(t + half, state + half * k2)
    k4 = derivative(t + step, state + step * k3)
    return state + step * (1.0 / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), k1


def write_sample(
    code: LaneTape, numbers: LawNumbers, command: CommandFunction, *, statistics: bool, record: bool
) -> None:
    """Write encoders, law and motors at a sample."""
    n, read, number, leave = numbers.hardware.S.shape[0], code.read, code.number, code.leave
    x, k, live = code.symbols(numbers), code.write("sample"), number("live")
    example = start((np.zeros(n), np.zeros(n)), np.zeros(n), np.zeros(n), numbers.law)
    memory = unpacked(read("memory", sum(part.size for part in example)), example)
    pending = list(read("pending", longest(numbers.hardware.actuator.delay) * n).reshape(-1, n))
    q_d, dq_d, ddq_d = np.split(read("desired", 3 * n), 3)
    state, motion = read("state", 4 * n), (q_d, dq_d, ddq_d)
    sampled = sample(state, memory, pending, motion, read("noise", 3 * n), x.law, x.hardware, command)
    if statistics:
        before = read("tau_before", n), read("H_before", n), read("ddq", n)
        stepped = _statistics(sampled, motion, before, x)
        sums = dict(zip(streaming.SUMS, read("sums", len(streaming.SUMS) * n).reshape(-1, n), strict=True))
        leave("sums", np.concatenate([*streaming.add_sample(sums, stepped, live, k, x.phases).values()]))
        leave("tau_before", sampled.tau_m)
        leave("H_before", sampled.signals[0])
        leave("block", _in_blocks(read("block", n), stepped["e"], live, k, x.block))
    if record:
        leave("trace", recorded(state, sampled))
    leave("torque", sampled.torque)
    leave("count", [number("count") + live])
    leave("diverged", [number("diverged") + live * (1.0 - sampled.bounded)])
    leave("live", [live * sampled.bounded * (k + 1.0 < x.samples)])
    leave("memory", np.concatenate([np.ravel(part) for part in sampled.memory]))
    leave("pending", np.ravel(sampled.pending))


def _in_blocks(sums: Array, e: Array, live: Numeric, k: Symbol, block: Numeric) -> list[Numeric]:
    """Sums of the errors since the block's first sample; a run that has ended adds nothing."""
    first = np.floor((k + 0.5) * (1.0 / block)) * block
    return [
        choose(k < first + 0.5, 0.0, total) + choose(live > 0.0, error, 0.0)
        for total, error in zip(sums, e, strict=True)
    ]


def _statistics(sampled: SampledState, motion: Three, before: Three, x: LawNumbers) -> streaming.Signals:
    """What a sample contributes, from last torque and estimate, and acceleration since."""
    n, law, actuator = len(sampled.tau), x.law, x.hardware.actuator
    assert isinstance(law, Law)
    assert sampled.rate is not None
    winch = times(x.hardware.S.T, sampled.tau_m)
    tau, H_hat, ddq = before
    most = streaming.AT_LIMIT * actuator.limit
    return {
        "e": motion[0] - sampled.measured[0],
        "de": sampled.rate,
        "dq_d": motion[1],
        "ddq_d": motion[2],
        "s": sampled.signals[1],
        "tau": sampled.tau_m,
        "tau_before": tau,
        "H": sampled.signals[0],
        "epsilon": times(law.from_joint, tau - H_hat) / law.M_bar - ddq,
        "saturated": np.array([abs(winch[i]) >= most[i] for i in range(n)], dtype=object),
    }


@dataclass(frozen=True)
class CompiledPart:
    """Compiled code that loops share, and their numbers.

    ``start`` holds first values of rows by name, (rows, N), a column for each loop. ``code`` has the
    addresses of functions by name, and ``prepare`` those to be run once before any of them. They work on so
    many `lanes`: a bundle, or one run by SciPy.
    """

    rows: LaneRows
    start: dict[str, Array]
    code: Mapping[str, int]
    prepare: Sequence[int]
    lanes: int

    def filled(self, loops: Sequence[int]) -> Array:
        """Rows at the start, (rows, M), of some loops."""
        values = np.zeros((self.rows.count, len(loops)))
        for row, numbers in self.rows.constants.items():
            values[row] = numbers[loops]
        for name, numbers in self.start.items():
            if name in self.rows.named:
                first = self.rows.named[name]
                values[first : first + numbers.shape[0]] = numbers[:, loops]
        bundles = bundled(values, self.lanes)
        for address in self.prepare:
            for bundle in bundles:
                machine.callable_code(address)(bundle.ctypes.data, 0.0, 0.0)
        return columns(bundles)[:, : len(loops)]


def experiment_part(alike: Sequence[PreparedLoop], *, record: bool) -> CompiledPart:
    """Compile law and plant of loops alike in all that chooses branches."""
    numbers = law_numbers(alike)
    records = stacked([ready.loop.plant for ready in alike]), numbers
    command = alike[0].loop.controller.command or control.command
    return _compiled(experiment_code(records, record, command), _first_rows(alike, numbers), LANES)


def single_part(ready: PreparedLoop, *, sampled: bool) -> CompiledPart:
    """Compile the plant of one run by SciPy, and its sample unless Python does that."""
    plant, numbers = stacked([ready.loop.plant]), law_numbers([ready])
    command = ready.loop.controller.command if sampled else None
    written = single_code((plant, numbers) if sampled else (plant,), command or control.command)
    return _compiled(written, _first_rows([ready], numbers), 1)


def _compiled(written: Written, start: dict[str, Array], lanes: int) -> CompiledPart:
    sources, rows = written
    if lanes == 1:
        sources = {name: machine.of_one_lane(source) for name, source in sources.items()}
    code = {name: machine.assembled(source, "prepare", name) for name, source in sources.items()}
    prepare, run = zip(*code.values(), strict=True)
    return CompiledPart(rows, start, dict(zip(code, run, strict=True)), prepare, lanes)


def law_numbers(alike: Sequence[PreparedLoop]) -> LawNumbers:
    """Stack all numbers of loops but their plants'."""
    phases: dict[int, streaming.Thresholds] = {}
    for name, loop in {id(ready.loop.reference): ready.loop for ready in alike}.items():
        reference, period = loop.reference, round(loop.reference.period / loop.L)
        phases[name] = streaming.thresholds(reference.dq_d, reference.ddq_d, loop.L, period)
    return stacked(
        [
            LawNumbers(
                law=loop.controller.law,
                hardware=loop.hardware(rest),
                phases=phases[id(loop.reference)],
                samples=np.array(float(loop.reference.time.size)),
                block=np.array(float(loop.block)),
            )
            for loop, rest, _ in alike
        ]
    )


def _first_rows(alike: Sequence[PreparedLoop], numbers: LawNumbers) -> dict[str, Array]:
    """First values of rows, (rows, N), by the start-up rule."""
    sources = {ready.loop.noise_source: ready.loop for ready in alike}
    noise = {source: loop.unit_noise()(1)[0] for source, loop in sources.items()}
    at_start = [
        (rest.state, noise[loop.noise_source], loop.torque_before(rest), loop.reference.q_d[0],
         np.float64(steps), np.array(loop.L))
        for loop, rest, steps in alike
    ]  # fmt: skip
    state, first, tau, q_d, steps, L = stacked(at_start)
    # Where an encoder is ideal there is no step to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        memory = start(measure(state, first, numbers.law, numbers.hardware), q_d, tau, numbers.law)
    return {
        "state": state,
        "demand": np.full((1, len(alike)), HIGHEST),
        "steps": steps,
        "length": L / np.maximum(steps, 1.0),
        "memory": np.concatenate([part.reshape(-1, len(alike)) for part in memory]),
        "pending": np.tile(tau, (longest(numbers.hardware.actuator.delay), 1)),
        "tau_before": tau,
        "H_before": tau,
        "live": np.ones((1, len(alike))),
    }
