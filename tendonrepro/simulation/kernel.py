"""The closed loop as code on lanes: a sample, and a step of the plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.control import Law, Servo
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.physics.linalg import times
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen import machine
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, lane_code, remembered
from tendonrepro.simulation.codegen.machine import LANES
from tendonrepro.simulation.codegen.symbols import Symbol, as_operand
from tendonrepro.simulation.resolution import PACES, demand
from tendonrepro.simulation.sampled import CommandFunction, Hardware, Sampled, Three, sample, start
from tendonrepro.simulation.streaming import AT_LIMIT

POINTERS = ("plant", "desired", "noise", "blocks", "trace")
"""Rows of addresses: of a lane's plant, and of its part at sample 0 in arrays that samples go through.

Desired motion (T, 3 n) and unit noise (T, 3 n) are read. Errors summed up over blocks, (B, n), and what is
recorded, (T, columns), are written."""


class LoopNumbers(NamedTuple):
    """All numbers of a loop; ``block`` samples have their errors summed up together."""

    law: Law | Servo
    hardware: Hardware
    phases: streaming.Thresholds
    samples: Array
    block: Array


def plant_rows(n: int) -> LaneRows:
    """Rows of a plant that a sample's code uses."""
    rows = LaneRows()
    for name, size in (("state", 4 * n), ("torque", n), ("ddq", n), ("live", 1)):
        rows.take(name, size)
    return rows


def sample_rows(n: int) -> LaneRows:
    """Rows of a sample that the loop uses."""
    rows = LaneRows()
    for name in ("live", "count", "diverged", *POINTERS):
        rows.take(name, 1)
    rows.take("sums", len(streaming.SUMS) * n)
    return rows


class _Recorder:
    """Tape, its rows, and what is written to them."""

    def __init__(self, rows: LaneRows) -> None:
        self.tape, self.rows = LaneTape(), rows
        self.written: dict[int, Any] = {}

    def read(self, name: str, size: int) -> Array:
        return self.rows.variables(self.tape, name, size)

    def one(self, name: str) -> Any:
        return self.read(name, 1)[0]

    def write(self, name: str, values: Any) -> None:
        self.written.update(zip(self.rows.known(name, len(values)), values, strict=True))


@remembered
def slope_code(plant: Plant) -> tuple[str, LaneRows]:
    """Source of ``slope``: the state's derivative into row ``slope``."""
    tape, n = LaneTape(), plant.preload.shape[0]
    rows = plant_rows(n)
    state, torque = rows.variables(tape, "state", 4 * n), rows.variables(tape, "torque", n)
    t: Any = tape.write("argument", "k")
    slope = state_derivative(t, state, torque, rows.parameters(tape, plant))
    return lane_code("slope", tape, dict(zip(rows.take("slope", 4 * n), slope, strict=True)), rows), rows


@remembered
def advance_code(plant: Plant) -> tuple[str, LaneRows]:
    """Source of ``advance``: plants from sample k to the next one, torque held.

    Rows ``steps`` and ``length`` hold number and length, s, of steps at each level of demand. A lane that
    meets a higher demand goes back. Row ``ddq`` receives the joint acceleration at the start.
    """
    n = plant.preload.shape[0]
    code = _Recorder(plant_rows(n))
    tape, rows, read, one, write = code.tape, code.rows, code.read, code.one, code.write

    def of_level(name: str, level: Any) -> Any:
        cells = read(name, len(PACES))
        return choose(level >= 2.0, cells[2], choose(level >= 1.0, cells[1], cells[0]))

    state, torque, begin = read("state", 4 * n), read("torque", n), read("begin", 4 * n)
    left, done, h, most = one("left"), one("done"), one("h"), one("demand")
    k, period, live = tape.write("argument", "k"), one("period"), one("live")
    x = rows.parameters(tape, plant)

    write("begin", state)
    write("left", [choose(live > 0.0, of_level("steps", most), 0.0)])
    write("done", [0.0])
    write("h", [choose(live > 0.0, of_level("length", most), 0.0)])
    write("demand", [choose(live > 0.0, 0.0, most)])
    first = machine.vector_code("begin", tape.lines, {k: as_operand(x) for k, x in code.written.items()})

    code.written = {}
    busy, t = left > 0.0, k * period + done * h

    def derivative(t: Any, x_t: Array) -> Array:
        return state_derivative(t, x_t, torque, x)

    after, slope = runge_kutta(derivative, t, state, h)
    met = np.maximum(most, demand(state, after, x))
    is_last, wanted = busy * (done + 1.0 >= left), of_level("steps", met)
    again = is_last * (wanted > left)
    ahead = [choose(again, *pair) for pair in zip(begin, after, strict=True)]
    write("state", [choose(busy, *pair) for pair in zip(ahead, state, strict=True)])
    at_start = busy * (done <= 0.0)
    write("ddq", [choose(at_start, *pair) for pair in zip(slope[n : 2 * n], read("ddq", n), strict=True)])
    write("left", [choose(is_last, choose(again, wanted, 0.0), left)])
    write("done", [choose(is_last, 0.0, done + busy)])
    write("h", [choose(again, of_level("length", met), h)])
    write("demand", [choose(busy, choose(again, 0.0, met), most)])
    step = lane_code("step", tape, code.written, rows)
    return "\n".join((first, step, machine.repeated("advance", "begin", "step", rows.named["left"]))), rows


def runge_kutta(
    derivative: Callable[[Any, Array], Array], t: Any, state: Array, h: Any
) -> tuple[Array, Array]:
    """Classical Runge-Kutta step: state at ``t + h`` and slope at ``t``."""
    half = 0.5 * h
    k1 = derivative(t, state)
    k2 = derivative(t + half, state + half * k1)
    k3 = derivative(t + half, state + half * k2)
    k4 = derivative(t + h, state + h * k3)
    return state + h * (1.0 / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), k1


@remembered
def sample_code(
    numbers: LoopNumbers, statistics: bool, record: bool, command: CommandFunction
) -> tuple[str, LaneRows]:
    """Source of ``sample``: encoders, law and motors at sample k."""
    n = numbers.hardware.S.shape[0]
    code, plant = _Recorder(sample_rows(n)), plant_rows(n).named
    tape, rows, read, one, write = code.tape, code.rows, code.read, code.one, code.write

    def at(name: str, index: Any, size: int) -> Symbol:
        return tape.write("moved", one(name), index * float(size))

    def of_plant(name: str, size: int) -> range:
        return range(LANES * plant[name], LANES * (plant[name] + size), LANES)

    x, k, live = rows.parameters(tape, numbers), tape.write("argument", "k"), one("live")
    own, desired, noise = one("plant"), at("desired", k, 3 * n), at("noise", k, 3 * n)
    state = tape.load(own, of_plant("state", 4 * n))
    example = start((np.zeros(n), np.zeros(n)), np.zeros(n), np.zeros(n), numbers.law)
    memory = unpacked(read("memory", sum(part.size for part in example)), example)
    delay = x.hardware.actuator.delay
    pending = list(read("pending", delay * n).reshape(-1, n))
    q_d, dq_d, ddq_d = np.split(tape.load(desired, range(3 * n)), 3)
    motion, unit_noise = (q_d, dq_d, ddq_d), tape.load(noise, range(3 * n))
    found = sample(state, memory, pending, motion, unit_noise, x.law, x.hardware, command)

    stores = [(own, *put) for put in zip(of_plant("torque", n), found.torque, strict=True)]
    if statistics:
        before = read("tau_before", n), read("H_before", n), tape.load(own, of_plant("ddq", n))
        stepped = _statistics(found, motion, before, x)
        sums = dict(zip(streaming.SUMS, read("sums", len(streaming.SUMS) * n).reshape(-1, n), strict=True))
        write("sums", np.concatenate([*streaming.add_sample(sums, stepped, live, k, x.phases).values()]))
        write("tau_before", found.tau_m)
        write("H_before", found.signals[0])
        block = at("blocks", np.floor((k + 0.5) * (1.0 / x.block)), n)
        for i, total in enumerate(tape.load(block, range(n))):
            stores.append((block, i, total + choose(live > 0.0, stepped.e[i], 0.0)))
    if record:
        kept = np.concatenate([state, *found.measured, found.tau, found.tau_m, *found.signals])
        place = at("trace", k, kept.size)
        stores += [(place, i, value) for i, value in enumerate(kept)]
    after = live * found.bounded * (k + 1.0 < x.samples)
    write("count", [one("count") + live])
    write("diverged", [one("diverged") + live * (1.0 - found.bounded)])
    write("live", [after])
    write("memory", np.concatenate([np.ravel(part) for part in found.memory]))
    write("pending", np.ravel(found.pending))
    return lane_code("sample", tape, code.written, rows, [*stores, (own, *of_plant("live", 1), after)]), rows


def _statistics(found: Sampled, motion: Three, before: Three, x: Any) -> streaming.Sample:
    """What a sample contributes, from last torque and estimate, and acceleration since."""
    n, actuator = len(found.tau), x.hardware.actuator
    winch = times(x.hardware.S.T, found.tau_m)
    tau, H_hat, ddq = before
    return streaming.Sample(
        e=motion[0] - found.measured[0],
        de=found.rate,
        dq_d=motion[1],
        ddq_d=motion[2],
        s=found.signals[1],
        tau=found.tau_m,
        tau_before=tau,
        H_hat=found.signals[0],
        epsilon=times(x.law.from_joint, tau - H_hat) / x.law.M_bar - ddq,
        saturated=np.array([abs(winch[i]) >= AT_LIMIT * actuator.limit[i] for i in range(n)], dtype=object),
    )


def unpacked(values: Array, example: Any) -> Any:
    """Memory from its numbers in order, shaped as an example."""
    parts = np.split(values, np.cumsum([part.size for part in example])[:-1])
    shaped = [part.reshape(like.shape) for part, like in zip(parts, example, strict=True)]
    return type(example)(*shaped) if hasattr(example, "_fields") else tuple(shaped)
