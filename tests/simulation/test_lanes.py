"""Code on lanes does what the functions do that it was made from."""

from __future__ import annotations

import numpy as np
import pytest
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array
from tendonrepro.physics.control import command
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, aligned, lane_code, signature, stacked
from tendonrepro.simulation.codegen.machine import (
    LANES,
    Signal,
    TraceBuffer,
    assembled,
    callable_code,
    callable_sweep,
    sweep_code,
)
from tendonrepro.simulation.kernel import advance_source, experiment_rows, runge_kutta, single_code
from tendonrepro.simulation.resolution import demand

T = 0.4
"""Time that code is called with, s."""


def filled(rows: LaneRows) -> Array:
    w = aligned(np.zeros((rows.count, LANES)))
    for row, values in rows.constants.items():
        w[row] = values
    return w


def run(source: str, w: Array, *names: str) -> None:
    for address in assembled(source, *names):
        callable_code(address)(w.ctypes.data, 0.0, T)


@pytest.mark.parametrize(
    ("n", "features"), [(2, FEATURES), pytest.param(3, FEATURES, marks=pytest.mark.slow), (2, frozenset())]
)
def test_a_step_on_lanes_is_that_of_the_plants_one_by_one(n: int, features: frozenset[str]) -> None:
    plants = [random_plant(n, seed, features).plant for seed in range(LANES)]
    rng = np.random.default_rng(8)
    state, tau = random_state(n, rng, (LANES,)), rng.normal(size=(n, LANES))
    rows = experiment_rows(n)
    source = advance_source(stacked(plants), rows)
    after, at = filled(rows), rows.named
    after[: 4 * n], after[4 * n : 5 * n] = state, tau
    live = np.arange(LANES) != 3
    # One step at every level.
    after[at["live"]], after[at["demand"]] = live, 2.0
    after[at["steps"] : at["steps"] + 3], after[at["length"] : at["length"] + 3] = 1.0, 1e-3
    run(source, after, "prepare", "advance")
    for lane, plant in enumerate(plants):

        def derivative(t: float, x: Array, lane: int = lane, plant: object = plant) -> Array:
            return state_derivative(t, x, tau[:, lane], plant)  # type: ignore[arg-type]

        if not live[lane]:
            assert after[: 4 * n, lane].tolist() == state[:, lane].tolist()
            continue
        expected, slope = runge_kutta(derivative, T, state[:, lane], 1e-3)
        assert after[at["demand"], lane] == demand(state[:, lane], expected, plant)
        assert after[: 4 * n, lane] == pytest.approx(expected, rel=1e-11, abs=1e-12)
        assert after[at["ddq"] : at["ddq"] + n, lane] == pytest.approx(slope[n : 2 * n], rel=1e-10, abs=1e-10)


def test_runge_kutta_is_of_order_four() -> None:
    def derivative(t: float, x: Array) -> Array:
        return np.cos(t) * x

    def error(steps: int) -> float:
        x, h = np.ones(1), 1.0 / steps
        for k in range(steps):
            x, _ = runge_kutta(derivative, k * h, x, h)
        return abs(x[0] - np.exp(np.sin(1.0)))

    order = np.log2(error(20) / error(40))
    assert order == pytest.approx(4.0, abs=0.1)


def test_a_lane_that_meets_a_higher_demand_goes_back_and_takes_more_steps() -> None:
    """From fast motion to a change of direction, beside one that moves on and one that stands still."""
    plant = random_plant(1, 1, frozenset({"coulomb"})).plant
    rows = experiment_rows(1)
    source = advance_source(stacked([plant] * LANES), rows)
    v, S, at = plant.link_friction.smoothing_velocity[0], plant.drive.S[0, 0], rows.named
    winch = 50.0 * S * plant.drive.friction.smoothing_velocity[0]
    state = np.zeros((4, LANES))
    state[1], state[3], state[1, 1], state[:, 2] = 4.5 * v, winch, 60.0 * v, 0.0
    torque, h = np.full((1, LANES), 0.0), 1e-3
    w = filled(rows)
    w[:4], w[4], w[at["live"]] = state, torque, 1.0
    w[at["demand"]] = [0.0, 0.0, 2.0, *[0.0] * (LANES - 3)]
    for level, steps in enumerate((1.0, 2.0, 5.0)):
        w[at["steps"] + level], w[at["length"] + level] = steps, h / steps
    run(source, w, "prepare", "advance")

    def after(lane: int, steps: int) -> tuple[Array, int]:
        x, met = state[:, lane], 0
        for k in range(steps):
            ahead, _ = runge_kutta(
                lambda t, y: state_derivative(t, y, torque[:, lane], plant), k * h / steps, x, h / steps
            )
            met, x = max(met, int(demand(x, ahead, plant))), ahead
        return x, met

    for lane, first in enumerate((1, 1, 5)):
        expected, met = after(lane, first)
        steps = max(first, (1, 2, 5)[met])
        if steps > first:
            expected, met = after(lane, steps)
        assert w[:4, lane] == pytest.approx(expected, rel=1e-11, abs=1e-13)
        assert w[at["demand"], lane] == met


def test_signals_and_records_are_each_lanes_own() -> None:
    """A run of three rows: it ends with a lane's own sample, and sums what it is given from there on."""
    tape, rows = LaneTape(), LaneRows()
    live, given, total = rows.variables(tape, "numbers", 3)
    k = tape.write("sample")
    sample = lane_code("sample", tape, {0: live * (k < 7.0), 2: total + given}, rows)
    advance = lane_code("advance", tape, {2: total + 1000.0}, rows)
    signals, records = [Signal(1, 1)], [TraceBuffer(2, 1, 2)]
    codes = [assembled(source, name)[0] for source, name in ((sample, "sample"), (advance, "advance"))]
    (address,) = assembled(sweep_code(0, signals, records), "sweep")
    numbers, kept = np.arange(20.0 * LANES).reshape(LANES, 20), np.zeros((8, 1, LANES))
    starts, into = np.array([row.ctypes.data for row in numbers]), np.array([kept.ctypes.data])
    w = aligned(np.zeros((rows.count, LANES)))
    w[0] = 1.0
    callable_sweep(address)(*codes, w.ctypes.data, 3, 20, 1e-3, starts.ctypes.data, into.ctypes.data)
    sums = np.cumsum(numbers[:, 3:8], axis=1) + 1000.0 * np.arange(5)
    # Two samples to an entry; the last one stands.
    assert kept[:3, 0].T.tolist() == sums[:, [1, 3, 4]].tolist()
    assert not kept[3:].any()


def test_code_is_written_once_for_plants_with_the_same_features() -> None:
    first, second = (stacked([random_plant(2, seed).plant] * 2) for seed in (1, 2))
    assert signature(first) == signature(second)
    (one, rows), (other, others) = (single_code((plant,), command) for plant in (first, second))
    assert one is other
    for plant, kept in ((first, rows), (second, others)):
        assert plant.drive.inertia[0].tolist() in [values.tolist() for values in kept.constants.values()]
    assert signature(stacked([random_plant(2, 1, frozenset()).plant] * 2)) != signature(first)
