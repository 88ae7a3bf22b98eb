"""The same tape by machine code of ours, by numba and by Python itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.control import command
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen.lanes import aligned, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.codegen.symbols import as_operand, needed
from tendonrepro.simulation.kernel import Writer, experiment_rows, law_numbers, runge_kutta, write_sample
from tendonrepro.simulation.loop import rest_at

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


@pytest.mark.parametrize("run", ["controller_1", "controller_3"])
def test_a_sample_of_an_experiment_is_that_of_python(run: str) -> None:
    """Law and two steps of the plant, as one tape."""
    found = load_config("plain", "compare", overrides=("manipulator.encoders.joint.noise=1e-5",))
    assert isinstance(found.config, CompareConfig)
    loop = dict(build_loops(found.config, found.folder))[run]
    rest = rest_at(np.zeros(2), loop.plant)
    code = Writer(experiment_rows(2))
    write_sample(code, law_numbers([(loop, rest)]), command, statistics=False, record=True)
    x, torque = code.rows.parameters(code.tape, stacked([loop.plant])), code.read("torque", 2)
    t: Any = code.tape.write("time")
    h: Any = code.number("period") * 0.5
    for k in range(2):
        state = code.read("state", 8)
        code.write(
            "state", runge_kutta(lambda t, y: state_derivative(t, y, torque, x), t + k * h, state, h)[0]
        )
    named, rng = code.rows.named, np.random.default_rng(3)
    w = rows_of(code)
    w[named["period"]], w[named["live"]] = loop.L, 1.0
    w[: named["live"]] = 1e-3 * rng.normal(size=named["live"])
    for name, size in (("memory", 18), ("desired", 6), ("noise", 6)):
        w[named[name] : named[name] + size] = 1e-3 * rng.normal(size=size)
    after = assert_same(code, w, in_python(code))
    assert np.abs(after[:8] - w[:8]).min() > 1e-9, "all of the state has moved"


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
