"""Tapes and their machine code do what the functions do that they were made from, and what numba does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.oracles import FEATURES, random_plant

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.control import command
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation.codegen import elementary
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, aligned, signature, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.codegen.symbols import Tape, needed
from tendonrepro.simulation.kernel import advance_code, runge_kutta, single_code
from tendonrepro.simulation.resolution import demand

SAMPLE, T = 7.0, 0.4
"""Number of a sample, and time, s, that code is called with."""


def filled(rows: LaneRows) -> Array:
    """Rows of a bundle with their parameters."""
    w = aligned(np.zeros((rows.count, LANES)))
    for row, values in rows.constants.items():
        w[row] = values
    return w


def run(source: str, w: Array, *names: str) -> Array:
    for address in assembled(source, *names):
        callable_code(address)(w.ctypes.data, SAMPLE, T)
    return w


# ---- Elementary functions from arithmetic, within their stated bounds --------------------------------------

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("largest", [1.0, 20.0, 700.0])
def test_exp(largest: float) -> None:
    x = RNG.uniform(-largest, largest, 200_000)
    assert np.abs(elementary.exp(x) / np.exp(x) - 1.0).max() < 1e-15
    ends = elementary.exp(np.array([-1e9, 1e9]))
    assert 0.0 < ends[0] < 1e-300
    assert 1e300 < ends[1] < np.inf


def test_tanh() -> None:
    x = np.concatenate([RNG.uniform(-30.0, 30.0, 200_000), RNG.normal(size=20_000) * 1e-4, [0.0, 1e9, -1e9]])
    assert np.abs(elementary.tanh(x) - np.tanh(x)).max() < 4e-16


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_sine_and_cosine(name: str) -> None:
    near_zeros = np.pi * np.arange(-300, 301) + RNG.uniform(-1e-9, 1e-9, 601)
    x = np.concatenate([RNG.uniform(-1000.0, 1000.0, 300_000), near_zeros])
    assert np.abs(getattr(elementary, name)(x) - getattr(np, name)(x)).max() < 1e-15


def test_log() -> None:
    x = 10.0 ** RNG.uniform(-300.0, 300.0, 200_000)
    error = np.abs(elementary.log(x) - np.log(x)) / np.maximum(1.0, np.abs(np.log(x)))
    assert error.max() < 4e-16
    assert elementary.log(np.array([1.0]))[0] == 0.0


def test_power() -> None:
    x, b = 10.0 ** RNG.uniform(-12.0, 3.0, 200_000), RNG.uniform(-1.0, 1.0, 200_000)
    error = np.abs(elementary.power(x, b) / x**b - 1.0) / (1.0 + np.abs(b * np.log(x)))
    assert error.max() < 1e-15
    assert 0.0 <= elementary.power(np.array([0.0]), 0.9)[0] < 1e-250


# ---- Symbols -----------------------------------------------------------------------------------------------

# What a feature, switched on alone, needs that nothing else does.
TRACES = {
    "coulomb": "tanh",
    "stribeck": "exp",
    "clearance": "abs",
    "losses": "abs",
    "step": ">=",
    "sine": "time",
}


class WithLibrary(LaneTape):
    """Tape that keeps elementary functions."""

    def function(self, ufunc: Any, x: Any) -> Any:
        return Tape.function(self, ufunc, x)


def operations(plant: Plant) -> set[str]:
    """Kinds of operations in the code of a plant."""
    code, n = WithLibrary(LaneRows()), plant.preload.size
    state, torque, t = code.read("state", 4 * n), code.read("torque", n), code.write("time")
    slope = state_derivative(t, state, torque, code.symbols(stacked([plant])))  # type: ignore[arg-type]
    return {code.lines[name][0] for name in needed(code.lines, slope)}


@pytest.mark.parametrize(("feature", "trace"), TRACES.items(), ids=TRACES)
def test_a_feature_that_is_off_leaves_no_trace(feature: str, trace: str) -> None:
    related = {"coulomb": "stribeck losses", "clearance": "losses", "losses": "clearance", "sine": "step"}
    without = FEATURES - {feature} - set(related.get(feature, "").split())
    on = {"coulomb", feature} if feature == "stribeck" else {feature}
    assert trace in operations(random_plant(2, 1, frozenset(on)).plant)
    assert trace not in operations(random_plant(2, 1, without).plant)


def computed(function: Callable[[Array, Any], Array], x: Array, p: Any) -> Array:
    """What machine code makes of a function of variables and parameters."""
    code = LaneTape(LaneRows())
    results = function(code.read("x", x.size), code.symbols(stacked([p])))
    code.leave("result", results)
    source, places = code.source("f"), code.rows.known("result", len(results))
    w = filled(code.rows)
    w[: x.size] = x[:, np.newaxis]
    run(source, w, "prepare", "f")
    assert (w == w[:, :1]).all()
    return w[places, 0]


EXPRESSIONS = {
    "sum": "x + y, x + p, 2.0 + x, 1.0 + x, x + 1.0, x + 0.0, 0.0 + x",
    "difference": "x - y, p - x, 2.0 - x, 1.0 - x, x - 1.0, x - 0.0, 0.0 - x, x - x",
    "product": "x * y, x * p, 3.0 * x, 1.0 * x, x * 1.0, 0.0 * x, x * 0.0",
    "quotient": "x / y, p / x, 2.0 / x, 1.0 / x, x / 1.0, 0.0 / x",
    "sign": "-x, -p",
    "comparison": "1.0 * (x >= y), 1.0 * (y >= x), 1.0 * (x >= 0.3), 1.0 * (x >= x), 1.0 * (0.3 <= x)",
    "equal numbers": "1.0 * (x > x), 1.0 * (x < x), 1.0 * (x <= x), 1.0 * (x > y), 1.0 * (x < y)",
    "functions": "np.sin(x), np.cos(x), np.tanh(y), np.exp(y), np.sqrt(x), np.abs(-x)",
    "NumPy number on the left": "two * x, two / x, two - x, two + x, 1.0 * (two >= x), np.maximum(two, x)",
    "NumPy number that is less": "np.maximum(0.0 * two, x), np.minimum(0.0 * two, x), 1.0 * (0.0 * two >= x)",
    "choice": "choose(x > y, x, y), choose(x < y, x, 2.0 * y), np.minimum(x, y), np.maximum(x, y)",
    "power": "x ** 0.5, y ** p, y ** 2.0",
    "order": "(x + y) + p, x + (y + p), (x - y) - p, x - (y - p), x / y / p, x / (y / p), x * (y - p)",
}


@pytest.mark.parametrize("expression", EXPRESSIONS.values(), ids=EXPRESSIONS)
def test_symbols_compute_like_numbers(expression: str) -> None:
    def function(x: Array, p: Any) -> Array:
        names = {"np": np, "choose": choose, "two": np.float64(2.0), "x": x[0], "y": x[1], "p": p[0]}
        return np.array(eval(f"[{expression}]", names))

    x, p = np.array([0.3, 1.7]), (np.float64(0.7),)
    assert computed(function, x, p) == pytest.approx(function(x, p), rel=1e-14, abs=1e-15)


def test_a_branch_on_what_is_not_known_is_refused() -> None:
    (x,) = LaneTape(LaneRows()).read("x", 1)
    with pytest.raises(TypeError):
        bool(x > 0.0)
    with pytest.raises(TypeError):
        np.maximum(np.array([x]), np.array([x]))


# ---- Lanes -------------------------------------------------------------------------------------------------


def test_a_lane_that_meets_a_higher_demand_goes_back_and_takes_more_steps() -> None:
    """From fast motion to a change of direction, beside one that moves on and one that stands still."""
    plant = random_plant(1, 1, frozenset({"coulomb"})).plant
    sources, rows = advance_code(stacked([plant] * LANES))
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
    run(sources["advance"], w, "prepare", "advance")

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


def test_code_is_written_once_for_plants_with_the_same_features() -> None:
    first, second = (stacked([random_plant(2, seed).plant] * 2) for seed in (1, 2))
    assert signature(first) == signature(second)
    (one, rows), (other, others) = (single_code((plant,), command) for plant in (first, second))
    assert one is other
    for plant, kept in ((first, rows), (second, others)):
        assert plant.drive.inertia[0].tolist() in [values.tolist() for values in kept.constants.values()]
    assert signature(stacked([random_plant(2, 1, frozenset()).plant] * 2)) != signature(first)
