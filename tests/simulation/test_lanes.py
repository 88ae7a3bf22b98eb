"""Code on lanes does what the functions do that it was made from."""

from __future__ import annotations

import numpy as np
import pytest
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, aligned, lane_code, signature, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.kernel import advance_code, runge_kutta
from tendonrepro.simulation.resolution import demand

K = 400.0
"""Number that code is called with."""


def filled(rows: LaneRows) -> Array:
    w = aligned(np.zeros((rows.count, LANES)))
    for row, values in rows.constants.items():
        w[row] = values
    return w


def run(source: str, w: Array, *names: str) -> None:
    for address in assembled(source, *names):
        callable_code(address)(w.ctypes.data, K)


@pytest.mark.parametrize(
    ("n", "features"), [(2, FEATURES), pytest.param(3, FEATURES, marks=pytest.mark.slow), (2, frozenset())]
)
def test_a_step_on_lanes_is_that_of_the_plants_one_by_one(n: int, features: frozenset[str]) -> None:
    plants = [random_plant(n, seed, features).plant for seed in range(LANES)]
    rng = np.random.default_rng(8)
    state, tau = random_state(n, rng, (LANES,)), rng.normal(size=(n, LANES))
    source, rows = advance_code(stacked(plants))
    after, at = filled(rows), rows.named
    after[: 4 * n], after[4 * n : 5 * n] = state, tau
    live = np.arange(LANES) != 3
    # One step at every level.
    after[at["live"]], after[at["period"]], after[at["demand"]] = live, 1e-3, 2.0
    after[at["steps"] : at["steps"] + 3], after[at["length"] : at["length"] + 3] = 1.0, 1e-3
    run(source, after, "prepare_step", "advance")
    for lane, plant in enumerate(plants):

        def derivative(t: float, x: Array, lane: int = lane, plant: object = plant) -> Array:
            return state_derivative(t, x, tau[:, lane], plant)  # type: ignore[arg-type]

        if not live[lane]:
            assert after[: 4 * n, lane].tolist() == state[:, lane].tolist()
            continue
        expected, slope = runge_kutta(derivative, 0.4, state[:, lane], 1e-3)
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
    source, rows = advance_code(stacked([plant] * LANES))
    v, S, at = plant.link_friction.smoothing_velocity[0], plant.drive.S[0, 0], rows.named
    winch = 50.0 * S * plant.drive.friction.smoothing_velocity[0]
    state = np.zeros((4, LANES))
    state[1], state[3], state[1, 1], state[:, 2] = 4.5 * v, winch, 60.0 * v, 0.0
    torque, h = np.full((1, LANES), 0.0), 1e-3
    w = filled(rows)
    w[:4], w[4], w[at["live"]], w[at["period"]] = state, torque, 1.0, h
    w[at["demand"]] = [0.0, 0.0, 2.0, *[0.0] * (LANES - 3)]
    for level, steps in enumerate((1.0, 2.0, 5.0)):
        w[at["steps"] + level], w[at["length"] + level] = steps, h / steps
    run(source, w, "prepare_step", "advance")

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


def test_pointers_lead_each_lane_to_its_own_numbers() -> None:
    tape, rows = LaneTape(), LaneRows()
    (pointer,) = rows.variables(tape, "pointer", 1)
    moved = tape.write("moved", pointer, 2.0 * tape.write("argument", "k"))
    first, second = tape.load(moved, range(2))
    source = lane_code("sums", tape, {}, rows, [(moved, 1, first + second)])
    numbers, w = np.arange(1000.0 * LANES).reshape(LANES, 1000), filled(rows)
    wanted = numbers.copy()
    wanted[:, 801] += numbers[:, 800]
    w.view(np.int64)[0] = [row.ctypes.data for row in numbers]
    run(source, w, "prepare_sums", "sums")
    np.testing.assert_array_equal(numbers, wanted)


def test_code_is_written_once_for_plants_with_the_same_features() -> None:
    first, second = (stacked([random_plant(2, seed).plant] * 2) for seed in (1, 2))
    assert signature(first) == signature(second)
    (one, rows), (other, others) = advance_code(first), advance_code(second)
    assert one is other
    for plant, kept in ((first, rows), (second, others)):
        assert plant.drive.inertia[0].tolist() in [values.tolist() for values in kept.constants.values()]
    assert signature(stacked([random_plant(2, 1, frozenset()).plant] * 2)) != signature(first)
