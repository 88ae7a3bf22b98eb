"""The scripts of the benchmarks: what they print, and that their baselines simulate the same run.

No timing is judged.
"""

from __future__ import annotations

import ast
import json
from typing import Any

import against
import baseline_solve_ivp as baseline
import bench
import bench_batch as batch
import numpy as np
import pytest
import recovery
from support import ROOT

from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.stepper import simulate

KEYS = {"what", "cpu", "experiments_per_second", "ratio_to_baselines", "max_error_rad", "bars"}


def test_compare_case_has_the_contracts_keys() -> None:
    baselines = {"plain": ("RK45", (1e-9, 1e-11)), "loose": ("RK45", (1e-3,))}
    found = json.loads(json.dumps(bench.compare_case(0.02, baselines, 1)))
    assert found.keys() == KEYS | {"seconds", "baselines"}
    assert found["ratio_to_baselines"].keys() == baselines.keys()
    assert found["bars"]["smallest_ratio"].keys() == {"value", "bar", "met"}
    assert found["experiments_per_second"] > 0.0
    assert 0.0 <= found["max_error_rad"] < 1e-9
    assert not found["baselines"]["loose"]["error_matched"]


def test_command_case_measures_time_and_memory() -> None:
    found = bench.command_case(["--version"], 1)
    assert found.keys() == KEYS | {"cpu_seconds"}
    assert found["bars"].keys() == {"seconds", "peak_memory_mb"}
    assert all(entry["value"] > 0.0 for entry in found["bars"].values())


def test_turns_with_another_checkout_have_both_times(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(against, "stepped", lambda _: {"mix, s": 2.0})
    rows = list(against.rows_of(ROOT, ROOT, {"import": ["-c", "import tendonrepro"]}, 1))
    assert [row[0] for row in rows] == ["import, s", "import, processor s", "mix, s"]
    assert all(number > 0.0 for row in rows for number in row[1:])


@pytest.mark.slow
def test_batch_cases_have_the_contracts_keys() -> None:
    found = json.loads(json.dumps(batch.batch_cases(0.02, 5, 1)))
    alone = {"plain_solve_ivp", "plain_numba", "batch_alone"}
    assert set(found) == alone | {"batch_one_core", "batch_two_cores", "batch_default", "batch_held_out"}
    for entry in found.values():
        assert entry.keys() >= KEYS | {"seconds"}
        assert entry["experiments_per_second"] > 0.0
        assert entry["max_error_rad"] < 1e-8
    barred = {name for name, entry in found.items() if "max_error_rad" in entry["bars"]}
    assert barred == found.keys() - {"batch_default", "batch_held_out"}
    assert all(found[name]["bars"]["max_error_rad"]["bar"] == 1e-8 for name in barred)
    assert found["batch_one_core"]["steps"] == [2]
    assert found["batch_one_core"]["targets"].keys() == {"ratio_to_numba_rk4", "ratio_to_solve_ivp"}


@pytest.mark.slow
def test_the_mix_runs_every_case_of_a_draw() -> None:
    found = batch.mix_case(draws=1, turns=1)
    assert found["experiments_per_second"] > 0.0
    assert found["what"].startswith(f"{len(load_study(None, (), None, 'default').cases)} runs")


def test_plants_of_a_batch_differ_and_baselines_have_the_same_ones() -> None:
    loop, parameters, _ = batch.stated_case(0.01)
    loops, plain = batch.different_plants(loop, parameters, 6)
    assert len({arm.plant.arm.a.tobytes() for arm in loops}) == 6
    assert max(np.abs(p["mass"] / parameters["mass"] - 1.0).max() for p in plain) <= batch.SPREAD
    state, tau_m = np.linspace(-0.4, 0.5, 8), np.array([1.0, -2.0])
    for ours, theirs in zip(loops, plain, strict=True):
        expected = baseline.FlexibleArm(theirs).derivative(0.0, state, tau_m)
        found = state_derivative(0.0, state, tau_m, ours.plant)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(
    "overrides",
    [(), ("manipulator.encoders.joint.resolution=0",), ("manipulator.actuator.torque_limit=[1, 0.5, 0.1]",)],
)
def test_baseline_run_is_the_same_run(overrides: Any) -> None:
    """The whole loop against a program of its own, with encoder counts and limits too."""
    loop, parameters, reference = bench.stated_case(0.12, overrides)
    angles = baseline.run(parameters, reference, 1e-11)
    np.testing.assert_allclose(angles, simulate(bench.tightened(loop))["q"], rtol=0.0, atol=1e-11)
    assert np.abs(angles).max() > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("changed", [{}, {"encoder_step": 1e-4}, {"torque_limit": np.array([0.5, 0.1])}])
def test_numba_computes_the_same_run(changed: dict[str, object]) -> None:
    import baseline_numba as compiled

    _, parameters, reference = bench.stated_case(0.1 if changed else 0.5)
    found = compiled.run(parameters | changed, reference, 4)
    expected = baseline.run(parameters | changed, reference, 1e-12, "DOP853")
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8)
    if changed:
        assert np.abs(found - compiled.run(parameters, reference, 4)).max() > 1e-7
    else:
        assert np.abs(expected).max() > 1e-2


@pytest.mark.parametrize(
    ("name", "packages"),
    [("baseline_numba", {"math", "numba", "numpy"}), ("baseline_solve_ivp", {"numpy", "scipy.integrate"})],
)
def test_baselines_share_no_code_with_the_package(name: str, packages: set[str]) -> None:
    tree = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text(encoding="utf-8"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported == {"__future__", "collections"} | packages


@pytest.mark.slow
def test_a_log_of_the_paper_s_controller_is_judged_on_both_joints() -> None:
    name, log = recovery.logs(1)[0]
    assert name == "controller_1 printed"
    answers = recovery.judged(name, log, recovery.RECORDS["all digits"])
    assert len(answers) == 2
    assert recovery.WRONG not in answers
