"""The compiled baseline of the benchmark: that it simulates the same run. No timing is judged."""

from __future__ import annotations

import ast
from types import ModuleType

import numpy as np
import pytest
from support import ROOT


@pytest.mark.slow
def test_it_is_the_same_run(bench: ModuleType, baseline: ModuleType, compiled: ModuleType) -> None:
    _, parameters, reference = bench.stated_case(0.5)
    expected = baseline.run(parameters, reference, 1e-12, "DOP853")
    found = compiled.run(parameters, reference, 4)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)
    assert np.abs(expected).max() > 1e-2


def test_two_steps_are_enough_for_smooth_friction_only(
    bench: ModuleType, batch: ModuleType, baseline: ModuleType, compiled: ModuleType
) -> None:
    _, parameters, reference = bench.stated_case(0.2, (*batch.IDEAL_ENCODER, *batch.SMOOTH_FRICTION))
    expected = baseline.run(parameters, reference, 1e-12, "DOP853")
    np.testing.assert_allclose(compiled.run(parameters, reference), expected, rtol=0.0, atol=1e-10)
    _, parameters, reference = bench.stated_case(0.2)
    two, four = (compiled.run(parameters, reference, steps) for steps in (2, 4))
    assert not np.abs(two - four).max() < 1e-8


@pytest.mark.parametrize("changed", [{"encoder_step": 1e-4}, {"torque_limit": np.array([0.5, 0.1])}])
def test_encoder_and_torque_limit_are_the_same(
    bench: ModuleType, baseline: ModuleType, compiled: ModuleType, changed: dict[str, object]
) -> None:
    _, parameters, reference = bench.stated_case(0.1)
    ideal = compiled.run(parameters, reference, 4)
    found = compiled.run(parameters | changed, reference, 4)
    expected = baseline.run(parameters | changed, reference, 1e-12, "DOP853")
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)
    assert np.abs(found - ideal).max() > 1e-7


def test_derivative_is_the_same(bench: ModuleType, baseline: ModuleType, compiled: ModuleType) -> None:
    _, parameters, _ = bench.stated_case(0.01)
    parameters["payload"] = 0.3
    plant, arm = compiled.plant_of(parameters), baseline.FlexibleArm(parameters)
    rng = np.random.default_rng(5)
    found = np.empty(8)
    for _ in range(20):
        state, tau_m = rng.uniform(-0.5, 0.5, 8), rng.uniform(-5.0, 5.0, 2)
        compiled.derivative.py_func(state, tau_m, plant, found)
        np.testing.assert_allclose(found, arm.derivative(0.0, state, tau_m), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("e", [-0.5, -0.2, -0.1, 0.0, 0.1, 0.2, 0.5])
def test_phi_is_the_same(bench: ModuleType, baseline: ModuleType, compiled: ModuleType, e: float) -> None:
    _, parameters, _ = bench.stated_case(0.01)
    gains = parameters["gains"]
    law = baseline.Controller1(gains, parameters["L"], np.zeros(2), np.zeros(2))
    expected = np.array(law.phi(np.array([e, 0.3])))[:, 0]
    found = compiled.phi.py_func(e, gains["b"][0], gains["Delta"][0])
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("name", "packages"),
    [("baseline_numba", {"math", "numba", "numpy"}), ("baseline_solve_ivp", {"numpy", "scipy.integrate"})],
)
def test_baselines_share_no_code_with_the_package(name: str, packages: set[str]) -> None:
    tree = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {"__future__", "collections"} | packages
