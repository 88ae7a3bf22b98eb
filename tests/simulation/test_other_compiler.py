"""The same tape by machine code of ours and by numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen.lanes import aligned, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.codegen.symbols import as_operand, needed
from tendonrepro.simulation.kernel import Writer, experiment_rows

WRITTEN = {
    # No branch: numba takes minutes for hundreds of them.
    "choose": "({2}, {1})[int({0} != 0.0)]",
    "negative": "-{0}",
    "exp2": "2.0 ** {0}",
    "alternating": "1.0 - 2.0 * ({0} % 2.0)",
    "mantissa": "math.frexp({0})[0]",
    "exponent": "float(math.frexp({0})[1])",
    **{name: f"math.{name}({{0}})" for name in ("sqrt", "floor")},
    "abs": "abs({0})",
    **{operator: f"{{0}} {operator} {{1}}" for operator in "+-*/"},
    **{operator: f"1.0 * ({{0}} {operator} {{1}})" for operator in (">=", ">", "<=", "<")},
    "sample": "k",
    "time": "t",
}
"""An operation in Python."""


def in_python(code: Writer) -> Callable[[Array, float, float], None]:
    """The tape as a function of Python that changes rows (rows,), given sample and time."""
    values = {row: as_operand(value) for row, value in code.written.items()}
    body = []
    for name in needed(code.tape.lines, values.values()):
        operation, operands = code.tape.lines[name]
        text = f"w[{int(operands[0])}]" if operation == "row" else WRITTEN[operation].format(*operands)
        body.append(f"    {name} = {text}")
    body += [f"    w[{row}] = {value}" for row, value in values.items()]
    scope: dict[str, Any] = {}
    exec("\n".join(("import math", "def tape(w, k, t):", *body)), scope)
    function: Callable[[Array, float, float], None] = scope["tape"]
    return function


def by_lanes(code: Writer, w: Array, k: float, t: float) -> Array:
    """The same by our own machine code, in each lane."""
    source = code.source("sample")
    rows = aligned(np.zeros((code.rows.count, LANES)))
    rows[: len(w)] = w[:, np.newaxis]
    for address in assembled(source, "prepare", "sample"):
        callable_code(address)(rows.ctypes.data, k, t)
    assert (rows == rows[:, :1]).all()
    return rows[: len(w), 0]


def assert_same(code: Writer, w: Array, other: Callable[[Array, float, float], None]) -> Array:
    """Rows of both programs, which must be equal up to rounding."""
    k, t = 7.0, 7e-3
    expected, ours, changed = w.copy(), by_lanes(code, w, k, t), [*code.written]
    other(expected, k, t)
    np.testing.assert_allclose(ours[changed], expected[changed], rtol=1e-11, atol=1e-12)
    return expected


@pytest.mark.slow
def test_the_slope_of_a_plant_is_that_of_numba() -> None:
    plant = random_plant(2, 5, FEATURES).plant
    code = Writer(experiment_rows(2))
    t: Any = code.tape.write("time")
    x = code.rows.parameters(code.tape, stacked([plant]))
    code.write("slope", state_derivative(t, code.read("state", 8), code.read("torque", 2), x))
    w = rows_of(code)
    w[:8], w[8:10] = random_state(2, np.random.default_rng(4)), (1.0, -2.0)
    assert_same(code, w, numba.njit(in_python(code)))


def rows_of(code: Writer) -> Array:
    """Rows (rows,) with their parameters."""
    w = np.zeros(code.rows.count)
    for row, values in code.rows.constants.items():
        w[row] = values[0]
    return w
