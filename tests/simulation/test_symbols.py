from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.oracles import FEATURES, random_plant

from tendonrepro.arrays import Array, choose
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation.codegen.lanes import LaneRows, LaneTape, aligned, lane_code, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.codegen.symbols import Tape, needed

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
    tape, rows, n = WithLibrary(), LaneRows(), plant.preload.size
    state, torque = rows.variables(tape, "state", 4 * n), rows.variables(tape, "torque", n)
    t: Any = tape.write("time")
    slope = state_derivative(t, state, torque, rows.parameters(tape, stacked([plant])))
    return {tape.lines[name][0] for name in needed(tape.lines, slope)}


@pytest.mark.parametrize(("feature", "trace"), TRACES.items(), ids=TRACES)
def test_a_feature_that_is_off_leaves_no_trace(feature: str, trace: str) -> None:
    related = {"coulomb": "stribeck losses", "clearance": "losses", "losses": "clearance", "sine": "step"}
    without = FEATURES - {feature} - set(related.get(feature, "").split())
    on = {"coulomb", feature} if feature == "stribeck" else {feature}
    assert trace in operations(random_plant(2, 1, frozenset(on)).plant)
    assert trace not in operations(random_plant(2, 1, without).plant)


def computed(function: Callable[[Array, Any], Array], x: Array, p: Any) -> Array:
    """What machine code makes of a function of variables and parameters."""
    tape, rows = LaneTape(), LaneRows()
    results = function(rows.variables(tape, "x", x.size), rows.parameters(tape, stacked([p])))
    places = rows.take("result", len(results))
    source = lane_code("f", tape, dict(zip(places, results, strict=True)), rows)
    w = aligned(np.zeros((rows.count, LANES)))
    w[: x.size] = x[:, np.newaxis]
    for row, values in rows.constants.items():
        w[row] = values
    for address in assembled(source, "prepare", "f"):
        callable_code(address)(w.ctypes.data, 0.0, 0.5)
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
    (x,) = LaneRows().variables(LaneTape(), "x", 1)
    with pytest.raises(TypeError):
        bool(x > 0.0)
    with pytest.raises(TypeError):
        np.maximum(np.array([x]), np.array([x]))
