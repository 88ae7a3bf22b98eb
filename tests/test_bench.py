"""The benchmark script: what it prints, and that its baseline simulates the same run. No timing is judged."""

from __future__ import annotations

import ast
import json
import platform
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tendonrepro.dynamics import state_derivative
from tendonrepro.simulate import simulate

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
KEYS = {"what", "cpu", "experiments_per_second", "ratio_to_baselines", "max_error_rad", "bars"}


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import bench

    return bench


@pytest.fixture
def baseline(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import baseline_solve_ivp

    return baseline_solve_ivp


def test_compare_case_has_the_contracts_keys(bench: ModuleType) -> None:
    baselines = {"plain": ("RK45", (1e-9, 1e-11)), "loose": ("RK45", (1e-3,))}
    found = json.loads(json.dumps(bench.compare_case(0.02, baselines, 1)))
    assert found.keys() == KEYS | {"seconds", "baselines"}
    assert found["ratio_to_baselines"].keys() == baselines.keys()
    assert found["bars"]["smallest_ratio"].keys() == {"value", "bar", "met"}
    assert found["experiments_per_second"] > 0.0
    assert 0.0 <= found["max_error_rad"] < 1e-9
    assert not found["baselines"]["loose"]["error_matched"]


def test_command_case_measures_time_and_memory(bench: ModuleType) -> None:
    found = bench.command_case(["--version"], 1)
    assert found.keys() == KEYS | {"cpu_seconds"}
    assert found["bars"].keys() == {"seconds", "peak_memory_mb"}
    assert all(entry["value"] > 0.0 for entry in found["bars"].values())


def test_import_case_finds_heavy_packages(bench: ModuleType) -> None:
    found = bench.import_case(["config", "list"])
    assert found.keys() == KEYS | {"packages"}
    assert {"pydantic", "yaml"} <= set(found["packages"])
    assert found["bars"]["packages"] == {"value": len(found["packages"]), "bar": 0, "met": False}


def test_the_printed_object(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = {"help_case": "help", "import_case": "import_heavy", "command_case": "whole_command"}
    for function, name in {**names, "compare_case": "compare_run"}.items():
        monkeypatch.setattr(bench, function, lambda *_, name=name: {"what": name})
    bench.main()
    found = json.loads(capsys.readouterr().out)
    assert found["schema_version"] == 1
    assert found["cpu"]
    assert found["python"] == platform.python_version()
    assert {key: entry["what"] for key, entry in found["cases"].items()} == {
        key: key for key in (*names.values(), "compare_run")
    }


def test_loosest_tolerance_that_is_good_enough(bench: ModuleType) -> None:
    errors = {1e-5: 1e-6, 1e-6: 1.05e-9, 1e-7: 1e-12}
    assert bench.matching_tolerance(errors, 1e-9, errors.get) == (1e-6, 1.05e-9)
    assert bench.matching_tolerance(errors, 1e-15, errors.get) == (1e-7, 1e-12)


def test_bars_say_whether_they_are_met(bench: ModuleType) -> None:
    assert bench.bar(2.0, 3.0)["met"]
    assert not bench.bar(2.0, 3.0, at_least=True)["met"]


def test_baseline_plant_is_the_same_differential_equation(bench: ModuleType, baseline: ModuleType) -> None:
    loop, parameters, _ = bench.stated_case(0.01)
    arm = baseline.FlexibleArm(parameters)
    rng = np.random.default_rng(4)
    for _ in range(20):
        state, tau_m = rng.uniform(-0.5, 0.5, 8), rng.uniform(-5.0, 5.0, 2)
        expected = state_derivative(0.0, state, tau_m, loop.plant)
        np.testing.assert_allclose(arm.derivative(0.0, state, tau_m), expected, rtol=1e-11, atol=1e-11)


def test_baseline_run_is_the_same_run(bench: ModuleType, baseline: ModuleType) -> None:
    loop, parameters, reference = bench.stated_case(0.06)
    angles = baseline.run(parameters, reference, 1e-11)
    np.testing.assert_allclose(angles, simulate(bench.tightened(loop))["q"], rtol=0.0, atol=1e-13)
    assert np.abs(angles).max() > 1e-6


def test_baseline_shares_no_code_with_the_package() -> None:
    tree = ast.parse((BENCHMARKS / "baseline_solve_ivp.py").read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {"__future__", "collections", "numpy", "scipy.integrate"}
