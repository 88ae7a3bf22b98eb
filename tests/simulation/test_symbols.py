from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support.oracles import FEATURES, PAPER, random_plant, random_state

from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation.codegen.symbols import unrolled

Array = NDArray[np.float64]

each_size = pytest.mark.parametrize("n", [1, 2, 3])
# All on, all off, and each one alone.
FEATURE_SETS = [FEATURES, PAPER, frozenset(), *(frozenset({feature}) for feature in sorted(FEATURES))]
each_feature_set = pytest.mark.parametrize(
    "features", FEATURE_SETS, ids=["all", "paper", "none", *sorted(FEATURES)]
)


def executed(source: str) -> Callable[..., Array]:
    """Run the source with NumPy's functions: those of `math` may differ from them in the last bit."""
    assert source.startswith("from math import ")
    scope: dict[str, Any] = {name: getattr(np, name) for name in ("cos", "exp", "sin", "sqrt", "tanh")}
    exec(source.split("\n", 1)[1], scope)

    def result(*arguments: Any) -> Array:
        filled = np.empty(source.count("result["))
        scope["compiled"](*arguments, filled)
        return filled

    return result


def code(plant: Plant) -> str:
    """Source without its import line."""
    return unrolled(state_derivative, plant, plant.preload.size)[0].split("\n", 1)[1]


@each_size
@each_feature_set
def test_source_computes_the_derivative_bit_for_bit(n: int, features: frozenset[str]) -> None:
    rng = np.random.default_rng([n, 3])
    for seed in range(3):
        plant = random_plant(n, seed, features).plant
        source, p = unrolled(state_derivative, plant, n)
        derivative = executed(source)
        for t in (0.0, 0.5, 0.8):
            state, tau_m = random_state(n, rng), rng.uniform(-5.0, 5.0, n)
            expected = state_derivative(t, state, tau_m, plant)
            assert (derivative(t, state, tau_m, p) == expected).all()


@each_size
def test_straight_line(n: int) -> None:
    text = code(random_plant(n, 1).plant)
    assert not re.search(r"\b(for|while|def|lambda|import)\b(?! compiled)", text)
    # Each name is given once, and used after it was given.
    given: set[str] = set()
    for line in text.splitlines():
        if match := re.match(r"    (x\d+) = (.*)", line):
            assert set(re.findall(r"x\d+", match[2])) <= given
            assert match[1] not in given
            given.add(match[1])
    assert set(re.findall(r"x\d+", text)) == given


# What a feature, switched on alone, writes that nothing else does.
TRACES = {
    "coulomb": r"tanh\(",
    "stribeck": r"exp\(",
    "clearance": r"abs\(",
    "losses": r"abs\(",
    "step": r">=",
    "sine": r"\bt\b(?!,)",
}


@each_size
@pytest.mark.parametrize(("feature", "trace"), TRACES.items(), ids=TRACES)
def test_a_feature_that_is_off_leaves_no_trace(n: int, feature: str, trace: str) -> None:
    related = {"coulomb": "stribeck losses", "clearance": "losses", "losses": "clearance", "sine": "step"}
    without = FEATURES - {feature} - set(related.get(feature, "").split())
    needed = {"coulomb", feature} if feature == "stribeck" else {feature}
    assert re.search(trace, code(random_plant(n, 1, frozenset(needed)).plant))
    assert not re.search(trace, code(random_plant(n, 1, without).plant))


@each_size
@each_feature_set
def test_plants_with_the_same_features_share_their_code(n: int, features: frozenset[str]) -> None:
    first, second = (unrolled(state_derivative, random_plant(n, seed, features).plant, n) for seed in (1, 2))
    assert first[0] == second[0]
    assert first[1].shape == second[1].shape
    assert (first[1] != second[1]).any()


class Numbers(NamedTuple):
    a: float
    b: Array


class Nested(NamedTuple):
    inner: Numbers
    c: Array


EXPRESSIONS = {
    "sum": "x + y, x + p, 2.0 + x, 1.0 + x, x + 1.0, x + 0.0, 0.0 + x",
    "difference": "x - y, p - x, 2.0 - x, 1.0 - x, x - 1.0, x - 0.0, 0.0 - x, x - x",
    "product": "x * y, x * p, 3.0 * x, 1.0 * x, x * 1.0, 0.0 * x, x * 0.0",
    "quotient": "x / y, p / x, 2.0 / x, 1.0 / x, x / 1.0, 0.0 / x",
    "sign": "-x, -p",
    "comparison": "1.0 * (x >= y), 1.0 * (y >= x), 1.0 * (x >= 0.3), 1.0 * (x >= x), 1.0 * (0.3 <= x)",
    "functions": "np.sin(x), np.cos(x), np.tanh(y), np.exp(y), np.sqrt(x), np.abs(-x)",
    "NumPy number on the left": "two * x, two / x, two - x, two + x",
    "order": "(x + y) + p, x + (y + p), (x - y) - p, x - (y - p), x / y / p, x / (y / p), x * (y - p)",
}


class TestExpressions:
    @pytest.mark.parametrize("expression", EXPRESSIONS.values(), ids=EXPRESSIONS)
    def test_symbols_compute_like_numbers(self, expression: str) -> None:
        def function(t: Any, state: Any, tau_m: Any, record: Numbers) -> Any:
            del t, tau_m
            names = {"np": np, "two": np.float64(2.0), "x": state[0], "y": state[1], "p": record.a}
            return np.array(eval(f"[{expression}]", names))

        record = Numbers(0.7, np.zeros(0))
        source, p = unrolled(function, record, 1)
        state = np.array([0.3, 1.7, 0.0, 0.0])
        expected = function(0.0, state, np.zeros(1), record)
        assert executed(source)(0.0, state, np.zeros(1), p).tolist() == expected.tolist()

    def test_arrays_of_symbols_compute_elementwise(self) -> None:
        def function(t: Any, state: Any, tau_m: Any, record: Numbers) -> Any:
            return np.array([*(record.b * tau_m), *(record.b - t), *(state[:2] / record.a)])

        record = Numbers(0.7, np.array([2.0, 3.0]))
        source, p = unrolled(function, record, 2)
        arguments = 0.5, np.arange(1.0, 9.0), np.array([5.0, 7.0])
        assert executed(source)(*arguments, p).tolist() == function(*arguments, record).tolist()

    def test_zeros_and_ones_are_written_out_and_other_numbers_are_read(self) -> None:
        def function(t: Any, state: Any, tau_m: Any, record: Nested) -> Any:
            del t, tau_m
            return state[:1] * record.inner.a + record.inner.b.sum() + record.c[0] * state[1]

        record = Nested(Numbers(1.0, np.array([0.0, 4.0, 5.0])), np.array([6.0, 1.0]))
        source, p = unrolled(function, record, 1)
        assert p.tolist() == [4.0, 5.0, 6.0]
        assert executed(source)(0.0, np.array([2.0, 3.0]), np.zeros(1), p).tolist() == [29.0]

    def test_an_operation_asked_for_twice_is_written_once_and_one_not_needed_never(self) -> None:
        def function(t: Any, state: Any, tau_m: Any, record: Numbers) -> Any:
            del t, tau_m
            np.cos(state[0] * record.a)
            return np.array([np.sin(state[0] * record.a), np.sin(state[0] * record.a), 0.25])

        source, p = unrolled(function, Numbers(0.7, np.zeros(0)), 1)
        assert executed(source)(0.0, np.zeros(4), np.zeros(1), p).tolist() == [0.0, 0.0, 0.25]
        assert source.count("sin(x") == 1
        assert "cos(x" not in source
