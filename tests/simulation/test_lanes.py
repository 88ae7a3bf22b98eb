"""Code on lanes does what the functions do that it was made from."""

from __future__ import annotations

import numpy as np
import pytest
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen import compiled
from tendonrepro.simulation.codegen.lanes import LANES, LaneRows, LaneTape, lane_code, signature, stacked
from tendonrepro.simulation.kernel import runge_kutta, step_code


def filled(rows: LaneRows) -> Array:
    w = np.zeros((rows.count, LANES))
    for row, values in rows.constants.items():
        w[row] = values
    return w


@pytest.mark.parametrize(
    ("n", "features"), [(2, FEATURES), pytest.param(3, FEATURES, marks=pytest.mark.slow), (2, frozenset())]
)
def test_a_step_on_lanes_is_that_of_the_plants_one_by_one(n: int, features: frozenset[str]) -> None:
    plants = [random_plant(n, seed, features).plant for seed in range(LANES)]
    rng = np.random.default_rng(8)
    state, tau = random_state(n, rng, (LANES,)), rng.normal(size=(n, LANES))
    source, rows = step_code(stacked(plants))
    code = compiled.compiled_lanes(source, "step", 2)
    w = filled(rows)
    w[: 4 * n], w[4 * n : 5 * n] = state, tau
    flat = w.reshape(-1)
    code.prepare(flat)
    code.run(flat, 0.4, 1e-3)
    after = flat.reshape(w.shape)
    for lane, plant in enumerate(plants):

        def derivative(t: float, x: Array, lane: int = lane, plant: object = plant) -> Array:
            return state_derivative(t, x, tau[:, lane], plant)  # type: ignore[arg-type]

        expected, slope = runge_kutta(derivative, 0.4, state[:, lane], 1e-3)
        assert after[: 4 * n, lane] == pytest.approx(expected, rel=1e-11, abs=1e-12)
        assert after[5 * n : 6 * n, lane] == pytest.approx(slope[n : 2 * n], rel=1e-10, abs=1e-10)


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


def test_numbers_that_are_zero_or_one_everywhere_stay_numbers() -> None:
    tape, rows = LaneTape(), LaneRows()
    record = (np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.0]]), 3, True)
    symbols, whole, flag = rows.parameters(tape, "p", record)
    assert (symbols[0], symbols[1], whole, flag) == (0.0, 1.0, 3, True)
    assert next(iter(rows.constants.values())).tolist() == [0.0, 2.0]


def test_what_parameters_determine_is_prepared_once() -> None:
    tape, rows = LaneTape(), LaneRows()
    (p,) = rows.parameters(tape, "p", (np.array([2.0, 3.0]),))
    x = rows.variables(tape, "x", 1)[0]
    source = lane_code("f", "t", tape, {rows.known("y", 1)[0]: x * (p * p + 1.0) / p}, rows)
    loop, prepared = source.split("def prepare_f")
    assert "/" in prepared
    assert "/" not in loop
    assert loop.count("*") - loop.count(" l]") <= 2 + loop.count("w[")


def test_choices_and_comparisons_on_lanes() -> None:
    tape, rows = LaneTape(), LaneRows()
    x, y = rows.variables(tape, "x", 2)
    results = [choose(x > y, x, 2.0 * y), np.minimum(x, y), np.maximum(x, y), 1.0 * (x <= y), abs(x) ** 0.5]
    source = lane_code("choices", "t", tape, dict(zip(rows.known("out", 5), results, strict=True)), rows)
    code = compiled.compiled_lanes(source, "choices", 1)
    w = filled(rows)
    w[0], w[1] = np.linspace(-1.0, 1.0, LANES), 0.1
    a, b = w[0].copy(), w[1].copy()
    flat = w.reshape(-1)
    code.prepare(flat)
    code.run(flat, 0.0)
    found = flat.reshape(w.shape)[2:7]
    assert found[0].tolist() == np.where(a > b, a, 2.0 * b).tolist()
    assert found[1].tolist() == np.minimum(a, b).tolist()
    assert found[2].tolist() == np.maximum(a, b).tolist()
    assert found[3].tolist() == (a <= b).astype(float).tolist()
    assert found[4] == pytest.approx(np.sqrt(np.abs(a)), rel=1e-14)


def test_stacking_keeps_what_must_agree() -> None:
    record = stacked([(np.array([1.0, 2.0]), 2, False), (np.array([3.0, 4.0]), 2, False)])
    assert record[0].tolist() == [[1.0, 3.0], [2.0, 4.0]]
    assert record[1:] == (2, False)


def test_code_is_written_once_for_plants_with_the_same_features() -> None:
    first, second = (stacked([random_plant(2, seed).plant] * 2) for seed in (1, 2))
    assert signature(first) == signature(second)
    (one, rows), (other, others) = step_code(first), step_code(second)
    assert one is other
    row = rows.named["plant.drive.inertia[0]"]
    assert rows.constants[row].tolist() == first.drive.inertia[0].tolist()
    assert others.constants[row].tolist() == second.drive.inertia[0].tolist()
    assert signature(stacked([random_plant(2, 1, frozenset()).plant] * 2)) != signature(first)
