"""The tape printed as JavaScript computes what Python and machine code compute."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import numpy as np
import pytest
from simulation.test_codegen import EXPRESSIONS, computed
from support.oracles import FEATURES, random_plant, random_state

from tendonrepro.arrays import Array, choose
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import command, start_memory
from tendonrepro.physics.dynamics import Plant, state_derivative
from tendonrepro.simulation.codegen.printed import PlacesTape, function_source, split_by_input
from tendonrepro.simulation.kernel import runge_kutta

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no node on the path")
LAW = load_config("plain", "compare").config


def printed(function: Any, size: int) -> tuple[str, int]:
    """Source of a function of numbers (size,), and how many results it has."""
    tape = PlacesTape()
    results = function(np.array(tape.places("given", size), dtype=object))
    places = {("found", k): value for k, value in enumerate(results)}
    return function_source("f", tape.lines, places, ("given", "found")), len(results)


def by_javascript(source: str, given: Array, count: int) -> Array:
    script = (
        f"{source}\nconst found=new Float64Array({count});f({json.dumps(given.tolist())},found);"
        "console.log(JSON.stringify([...found]))"
    )
    done = subprocess.run([str(NODE), "-"], input=script, capture_output=True, text=True, check=True)
    return np.array(json.loads(done.stdout))


def a_step(numbers: Array, plant: Plant) -> Array:
    """State one step later, from time, state and torque."""
    n = plant.preload.size
    t, state, tau = numbers[0], numbers[1 : 1 + 4 * n], numbers[1 + 4 * n :]
    return runge_kutta(lambda t, x: state_derivative(t, x, tau, plant), t, state, 1e-3)[0]


def a_sample(numbers: Array) -> Array:
    """What Controller 1 makes of memory, encoder values and desired motion."""
    assert isinstance(LAW, CompareConfig)
    still = np.zeros(2)
    like = start_memory(still, still)
    edges = np.cumsum([part.size for part in like])
    parts = np.split(numbers[: edges[-1]], edges[:-1])
    memory = type(like)(*(part.reshape(kept.shape) for part, kept in zip(parts, like, strict=True)))
    tau, H_hat, s, de = command(memory, *numbers[edges[-1] :].reshape(4, 2), build_law(LAW, "controller_1"))
    return np.concatenate([tau, H_hat, s, de])


def random_numbers() -> tuple[Array, Array]:
    rng = np.random.default_rng(45)
    step = np.concatenate([[0.4], random_state(2, rng), rng.normal(size=2)])
    return step, rng.normal(scale=0.3, size=26)


PLANT = random_plant(2, 7, FEATURES).plant
CASES = {"plant": (lambda x: a_step(x, PLANT), random_numbers()[0]), "law": (a_sample, random_numbers()[1])}


@pytest.mark.parametrize(("function", "given"), CASES.values(), ids=CASES)
@needs_node
def test_javascript_python_and_machine_code_agree(function: Any, given: Array) -> None:
    source, count = printed(function, given.size)
    expected = function(given)
    near = pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert by_javascript(source, given, count) == near
    assert computed(lambda x, _: function(x), given, ()) == near


def all_expressions(numbers: Array) -> Array:
    x, y, p = numbers
    names = {"np": np, "choose": choose, "two": np.float64(2.0), "x": x, "y": y, "p": p}
    texts = *EXPRESSIONS.values(), "np.exp2(np.floor(3.0 * y)), choose(x, y, p), choose(p - p, x, y)"
    more = "1e300 * x, 1e-9 * x, np.minimum(np.inf, x)"
    return np.array([value for text in (*texts, more) for value in eval(f"[{text}]", names)])


@needs_node
def test_every_operation() -> None:
    given = np.array([0.3, 1.7, 0.7])
    expected = pytest.approx(all_expressions(given), rel=1e-14, abs=1e-15)
    source, count = printed(all_expressions, 3)
    assert by_javascript(source, given, count) == expected


@needs_node
def test_what_depends_on_one_array_alone_is_computed_once() -> None:
    tape = PlacesTape()
    (a, b), (x,) = tape.places("fixed", 2), tape.places("given", 1)
    shared: Any = np.sin(a) * b
    results = [shared + x, x * a, shared - b]
    once, lines = split_by_input(tape.lines, results, ("fixed",), "kept")
    prepare = function_source("g", tape.lines, once, ("fixed", "kept"))
    places = {("found", k): value for k, value in enumerate(results)}
    inner = function_source("inner", lines, places, ("kept", "given", "found"))
    assert "sin" in prepare
    assert "sin" not in inner
    assert len(once) == 3
    called = "const kept=[];g([2,3],kept);const f=(given,found)=>inner(kept,given,found);"
    found = by_javascript("\n".join((prepare, inner, called)), np.array([5.0]), 3)
    product = np.sin(2.0) * 3.0
    assert found == pytest.approx([product + 5.0, 10.0, product - 3.0], rel=1e-15)
