"""The closed loop as code on lanes: one sample of encoders, law and motors, and one step of the plant.

Both come from the functions the SciPy stepper calls, run on symbols for the rows of one flat array.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose
from tendonrepro.physics import control
from tendonrepro.physics.control import Law, Memory
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.physics.instruments import Actuator, Encoder, applied_torque, quantise
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, lane_code, remembered
from tendonrepro.simulation.controllers import Measurement, TimeDelayController
from tendonrepro.simulation.stepper import LARGEST_TORQUE

AT_LIMIT = 1.0 - 1e-12
"""Share of the torque limit that counts as saturated."""


RECORDED = ("state", "q_encoder", "tau_cmd", "tau_m", "H_hat", "s")
"""Rows of a sample that a trace is made from, in the order they stand at the start of its array."""


class LoopNumbers(NamedTuple):
    """All numbers of a loop, stacked over experiments: the leaves' last axis (N,).

    ``S`` and ``S_inv`` are (n, n, N), ``limit`` (N,) the error beyond which a run has diverged, rad,
    ``samples`` (N,) the samples of the reference.
    """

    law: Law
    encoder: Encoder
    actuator: Actuator
    S: Array
    S_inv: Array
    phases: streaming.Thresholds
    limit: Array
    samples: Array


def _step_rows(n: int) -> LaneRows:
    """Rows that the loop shares with the plant's code, for n joints."""
    rows = LaneRows()
    for name, size in (("state", 4 * n), ("tau_applied", n), ("ddq", n)):
        rows.take(name, size)
    return rows


def _sample_rows(n: int) -> LaneRows:
    """Rows that the loop shares with the sample's code, for n joints."""
    rows = LaneRows()
    for name in RECORDED:
        rows.take(name, 4 * n if name == "state" else n)
    shared = ("q_d", "dq_d", "ddq_d", "noise_q", "noise_tau", "ddq_sample", "tau_applied", "block")
    for name in shared:
        rows.take(name, n)
    for name in ("live", "count", "diverged"):
        rows.take(name, 1)
    return rows


@remembered
def step_code(plant: Plant) -> tuple[str, LaneRows]:
    """Source of ``step(w, t, h)``: one Runge-Kutta step of the plants, torque held.

    Row ``ddq`` receives the joint acceleration at the start of the step.
    """
    tape, n = LaneTape(), plant.preload.shape[0]
    rows = _step_rows(n)
    state, tau = rows.variables(tape, "state", 4 * n), rows.variables(tape, "tau_applied", n)
    symbolic = rows.parameters(tape, "plant", plant)

    def derivative(t: Any, x: Array) -> Array:
        return state_derivative(t, x, tau, symbolic)

    after, slope = runge_kutta(derivative, tape.write("t", ()), state, tape.write("h", ()))
    results = dict(zip(rows.known("state", 4 * n), after, strict=True))
    results |= dict(zip(rows.known("ddq", n), slope[n : 2 * n], strict=True))
    return lane_code("step", "t, h", tape, results, rows), rows


def runge_kutta(
    derivative: Callable[[Any, Array], Array], t: Any, state: Array, h: Any
) -> tuple[Array, Array]:
    """Classical Runge-Kutta step of order four: state at ``t + h``, and slope at ``t``, each (m, ...)."""
    half = 0.5 * h
    k1 = derivative(t, state)
    k2 = derivative(t + half, state + half * k1)
    k3 = derivative(t + half, state + half * k2)
    k4 = derivative(t + h, state + h * k3)
    return state + h * (1.0 / 6.0) * (k1 + 2.0 * (k2 + k3) + k4), k1


@remembered
def sample_code(numbers: LoopNumbers) -> tuple[str, LaneRows]:
    """Source of ``sample(w, k)``: encoders, law, motors, memory and statistics at sample k."""
    tape, n = LaneTape(), numbers.S.shape[0]
    rows = _sample_rows(n)
    results: dict[int, Any] = {}

    def read(name: str, size: int) -> Array:
        return rows.variables(tape, name, size)

    def write(name: str, values: Any) -> None:
        results.update(zip(rows.known(name, len(values)), values, strict=True))

    x = rows.parameters(tape, "loop", numbers)
    k, q_d, dq_d, ddq_d = tape.write("k", ()), read("q_d", n), read("dq_d", n), read("ddq_d", n)
    controller = TimeDelayController(x.law, control.command)
    memory = Memory(*(read("memory", 7 * n)[part].reshape(shape) for part, shape in _memory_parts(n)))
    pending = list(read("pending", x.actuator.delay * n).reshape(-1, n))
    q = read("state", 4 * n)[:n] + x.encoder.noise * read("noise_q", n)
    measured = Measurement(np.array([quantise(angle, x.encoder.resolution) for angle in q], dtype=object), q)
    decision = controller.decide(memory, measured, q_d, dq_d, ddq_d)
    tau_m = applied_torque((queue := [*pending, decision.tau])[0], x.actuator, x.S, x.S_inv)
    after = controller.remember(memory, measured, decision, tau_m)

    H_hat, s = decision.signals
    tau_before, live = read("tau_m", n), read("live", 1)[0]
    epsilon = (x.law.from_joint @ (tau_before - read("H_hat", n))) / x.law.M_bar - read("ddq_sample", n)
    winch = x.S.T @ tau_m
    sample = streaming.Sample(
        e=q_d - measured.q,
        de=decision.carry,
        dq_d=dq_d,
        ddq_d=ddq_d,
        s=s,
        tau=tau_m,
        tau_before=tau_before,
        H_hat=H_hat,
        epsilon=epsilon,
        saturated=np.array([abs(winch[i]) >= AT_LIMIT * x.actuator.limit[i] for i in range(n)], dtype=object),
    )
    sums = streaming.Sums(*read("sums", len(streaming.Sums._fields) * n).reshape(-1, n))
    write("sums", np.concatenate(streaming.add_sample(sums, sample, live, k, x.phases)))
    block = read("block", n)
    write("block", [block[i] + choose(live > 0.0, sample.e[i], 0.0) for i in range(n)])

    bounded: Any = 1.0
    for i in range(n):
        bounded = bounded * (abs(sample.e[i]) <= x.limit) * (abs(tau_m[i]) <= LARGEST_TORQUE)
    write("count", [read("count", 1)[0] + live])
    write("diverged", [read("diverged", 1)[0] + live * (1.0 - bounded)])
    write("live", [live * bounded * (k + 1.0 < x.samples)])
    write("memory", np.concatenate([np.ravel(part) for part in after]))
    write("pending", np.concatenate(queue[1:]) if pending else [])
    write("q_encoder", measured.q)
    write("tau_cmd", decision.tau)
    write("tau_m", tau_m)
    write("H_hat", H_hat)
    write("s", s)
    write("tau_applied", tau_m + x.S_inv.T @ (x.actuator.noise * read("noise_tau", n)))
    return lane_code("sample", "k", tape, results, rows), rows


def _memory_parts(n: int) -> tuple[tuple[slice, tuple[int, ...]], ...]:
    """Where each part of the law's memory stands, and its shape."""
    return (slice(0, 4 * n), (4, n)), (slice(4 * n, 6 * n), (2, n)), (slice(6 * n, 7 * n), (n,))
