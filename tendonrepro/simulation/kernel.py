"""The closed loop as code on lanes: one sample of encoders, law and motors, and one step of the plant.

Both come from the functions the SciPy stepper calls, run on symbols for the rows of one flat array.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.arm import mass_matrix
from tendonrepro.physics.control import Law, packed_memory
from tendonrepro.physics.drive import tendon_torque, to_winch_angle, to_winch_torque
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.physics.friction import dry_slope
from tendonrepro.physics.instruments import Actuator, Encoder, applied_torque, quantise
from tendonrepro.physics.linalg import solve_positive_definite, times
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, lane_code, remembered
from tendonrepro.simulation.resolution import demand
from tendonrepro.simulation.sampled import LARGEST_TORQUE, decide_by_estimate, keep_estimate
from tendonrepro.simulation.streaming import AT_LIMIT

RECORDED = ("state", "q_encoder", "tau_cmd", "tau_m", "H_hat", "s")
"""Rows of a sample that a trace is made from, in the order they stand at the start of its array."""


class LoopNumbers(NamedTuple):
    """All numbers of a loop, stacked over experiments: the leaves' last axis (N,).

    ``encoder`` is the one that the law looks at and ``theta_start`` (n, N) where its motors' angles are zero,
    ``S`` and ``S_inv`` are (n, n, N), ``limit`` (N,) the error beyond which a run has diverged, rad,
    ``samples`` (N,) the samples of the reference.
    """

    law: Law
    encoder: Encoder
    theta_start: Array
    actuator: Actuator
    S: Array
    S_inv: Array
    phases: streaming.Thresholds
    limit: Array
    samples: Array


def _step_rows(n: int) -> LaneRows:
    """Rows that the loop shares with the plant's code, for n joints."""
    rows = LaneRows()
    for name, size in (("state", 4 * n), ("tau_applied", n), ("ddq", n), ("t", 1), ("h", 1), ("demand", 1)):
        rows.take(name, size)
    rows.take("live", 1)
    rows.take("ddq_sample", n)
    return rows


def sample_rows(n: int) -> LaneRows:
    """Rows that the loop shares with the sample's code, for n joints."""
    rows = LaneRows()
    for name in RECORDED:
        rows.take(name, 4 * n if name == "state" else n)
    shared = ("q_d", "dq_d", "ddq_d", "noise_q", "noise_tau", "ddq_sample", "tau_applied", "error")
    for name in shared:
        rows.take(name, n)
    for name in ("live", "count", "diverged"):
        rows.take(name, 1)
    rows.take("sums", len(streaming.Sums._fields) * n)
    return rows


@remembered
def step_code(plant: Plant, implicit: bool = False) -> tuple[str, LaneRows]:
    """Source of ``step``: one step of the plants from ``t`` over ``h``, torque held.

    Row ``ddq`` receives the joint acceleration at the start of the step, ``demand`` the highest so
    far. Where ``h`` is zero state and demand stay, to the last bit.
    """
    tape, n = LaneTape(), plant.preload.shape[0]
    rows = _step_rows(n)
    state, tau = rows.variables(tape, "state", 4 * n), rows.variables(tape, "tau_applied", n)
    (t,), (h,), (most,) = (rows.variables(tape, name, 1) for name in ("t", "h", "demand"))
    symbolic = rows.parameters(tape, "plant", plant)

    def derivative(t: Any, x: Array) -> Array:
        return state_derivative(t, x, tau, symbolic)

    if implicit:
        after, slope = rosenbrock(derivative, damped(state, tau, symbolic), t, state, h)
    else:
        after, slope = runge_kutta(derivative, t, state, h)
    most = np.maximum(most, demand(state, after, symbolic, implicit=implicit))
    results: dict[int, Any] = {}
    for name, values in (("state", after), ("ddq", slope[n : 2 * n]), ("demand", [most])):
        before = rows.variables(tape, name, len(values))
        kept = [choose(h > 0.0, *pair) for pair in zip(values, before, strict=True)]
        results |= dict(zip(rows.known(name, len(values)), kept, strict=True))
    return lane_code("step", tape, results, rows), rows


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


GAMMA = 0.435866521508459
NODES = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.87173304301691801, 0.0, 0.0, 0.0],
        [0.84457060015369423, -0.11299064236484185, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ]
)
COUPLING = np.array(
    [
        [GAMMA, 0.0, 0.0, 0.0],
        [-0.87173304301691801, GAMMA, 0.0, 0.0],
        [-0.90338057013044082, 0.054180672388095326, GAMMA, 0.0],
        [0.24212380706095346, -1.2232505839045147, 0.54526025533510214, GAMMA],
    ]
)
"""ROS34PW2 of Rang and Angermann, BIT 45 (2005), 761: of order three whatever part is implicit."""


def rosenbrock(
    derivative: Callable[[Any, Array], Array],
    damped: Callable[[Array, Any], Array],
    t: Any,
    state: Array,
    h: Any,
) -> tuple[Array, Array]:
    """Linearly implicit step of order three: state at ``t + h``, and slope at ``t``, each (m, ...).

    ``damped(x, c)`` solves ``(1 - c A) y = x`` for whatever part ``A`` of the derivative's slope is stiff.
    """
    inverse = np.linalg.inv(COUPLING)
    shares, past = NODES @ inverse, np.eye(4) / GAMMA - inverse
    moves: list[Array] = []
    slopes: list[Array] = []
    for i in range(4):
        reached = sum((shares[i, j] * moves[j] for j in range(i)), state)
        slopes.append(derivative(t + float(NODES[i].sum()) * h, reached))
        drawn = sum((past[i, j] * moves[j] for j in range(i)), h * slopes[i])
        moves.append(damped(GAMMA * drawn, GAMMA * h))
    weights = (NODES[3] + COUPLING[3]) @ inverse
    return sum((weights[i] * moves[i] for i in range(4)), state), slopes[0]


def damped(state: Array, tau: Array, plant: Plant) -> Callable[[Array, Any], Array]:
    """Solver for :func:`rosenbrock` with dry friction of links and winches implicit, at a state."""
    n, drive = plant.preload.shape[0], plant.drive
    q, dq, theta, dtheta = (state[k * n : (k + 1) * n] for k in range(4))
    M, none = mass_matrix(q, plant.arm), np.zeros_like(q)
    links = dry_slope(dq, none, plant.link_friction)
    tendon, motor = tendon_torque(q, dq, theta, dtheta, drive), to_winch_torque(tau, drive)
    lost = np.array(
        [drive.pulley_loss[i] * abs(tendon[i]) + drive.reducer_loss[i] * abs(motor[i]) for i in range(n)]
    )
    winches = dry_slope(to_winch_angle(dtheta, drive), lost, drive.friction)

    def solve(x: Array, c: Any) -> Array:
        W = M.copy()
        for i in range(n):
            W[i, i] = M[i, i] + c * links[i]
        winch = to_winch_angle(x[3 * n :], drive)
        for i in range(n):
            winch[i] = winch[i] / (1.0 + c * winches[i] / drive.inertia[i])
        links_after = solve_positive_definite(W, times(M, x[n : 2 * n]))
        return np.concatenate([x[:n], links_after, x[2 * n : 3 * n], times(drive.S, winch)])

    return solve


@remembered
def sample_code(numbers: LoopNumbers) -> tuple[str, LaneRows]:
    """Source of ``sample``: encoders, law, motors, memory and statistics at sample k."""
    tape, n = LaneTape(), numbers.S.shape[0]
    rows = sample_rows(n)
    results: dict[int, Any] = {}

    def read(name: str, size: int) -> Array:
        return rows.variables(tape, name, size)

    def write(name: str, values: Any) -> None:
        results.update(zip(rows.known(name, len(values)), values, strict=True))

    x = rows.parameters(tape, "loop", numbers)
    k, q_d, dq_d, ddq_d = tape.write("argument", "k"), read("q_d", n), read("dq_d", n), read("ddq_d", n)
    memory = packed_memory(read("memory", (6 * x.law.lag + 3) * n), n, x.law.lag)
    pending = list(read("pending", x.actuator.delay * n).reshape(-1, n))
    state, noise = read("state", 4 * n), x.encoder.noise * read("noise_q", n)
    q = x.S_inv @ (state[2 * n : 3 * n] - x.theta_start) if x.law.motor_side else state[:n]
    q = np.array([quantise(angle, x.encoder.resolution) for angle in q + noise], dtype=object)
    measured = (x.S @ q if x.law.motor_side else q), q
    tau, (H_hat, s), carry = decide_by_estimate(memory, measured, (q_d, dq_d, ddq_d), x.law)
    tau_m = applied_torque((queue := [*pending, tau])[0], x.actuator, x.S, x.S_inv)
    commanded = applied_torque(tau, x.actuator._replace(resolution=0.0), x.S, x.S_inv)
    after = keep_estimate(measured, (tau_m, commanded), carry, x.law)

    tau_before, live = read("tau_m", n), read("live", 1)[0]
    epsilon = (x.law.from_joint @ (tau_before - read("H_hat", n))) / x.law.M_bar - read("ddq_sample", n)
    winch = x.S.T @ tau_m
    sample = streaming.Sample(
        e=q_d - measured[0],
        de=carry[2],
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
    write("error", [choose(live > 0.0, sample.e[i], 0.0) for i in range(n)])

    bounded: Any = 1.0
    for i in range(n):
        bounded = bounded * (abs(sample.e[i]) <= x.limit) * (abs(tau_m[i]) <= LARGEST_TORQUE)
    write("count", [read("count", 1)[0] + live])
    write("diverged", [read("diverged", 1)[0] + live * (1.0 - bounded)])
    write("live", [live * bounded * (k + 1.0 < x.samples)])
    write("memory", np.concatenate([np.ravel(part) for part in after]))
    write("pending", np.concatenate(queue[1:]) if pending else [])
    write("q_encoder", measured[0])
    write("tau_cmd", tau)
    write("tau_m", tau_m)
    write("H_hat", H_hat)
    write("s", s)
    write("tau_applied", tau_m + x.S_inv.T @ (x.actuator.noise * read("noise_tau", n)))
    return lane_code("sample", tape, results, rows), rows
