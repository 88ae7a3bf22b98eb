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


@pytest.mark.slow
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


@pytest.mark.parametrize(
    ("name", "packages"),
    [("baseline_numba", {"math", "numba", "numpy"}), ("baseline_solve_ivp", {"numpy", "scipy.integrate"})],
)
def test_baselines_share_no_code_with_the_package(name: str, packages: set[str]) -> None:
    tree = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {"__future__", "collections"} | packages
