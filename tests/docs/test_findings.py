"""The numbers of README and docs/findings.md, computed again from the shipped configurations."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from support import ROOT

from tendonrepro.config.load import CompareConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.experiments.loops import build_law, build_loops
from tendonrepro.experiments.rig import build_plant
from tendonrepro.experiments.run import simulate_all, trace_file
from tendonrepro.physics.linear_loop import decay_rate
from tendonrepro.physics.metrics import mae, rmse, window_mean
from tendonrepro.physics.slow_error import error_ratio
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import table_data_compare, table_data_decouple
from tendonrepro.results.traces import write_traces
from tendonrepro.simulation.batch import simulate_batch

DOCS = ROOT
MANIFEST = {"created": "2026-01-01T00:00:00+00:00"}
CONTROLLERS = ("controller_1", "controller_2", "controller_3")
MEAN = 50
DRY_FRICTION = "manipulator.friction.winch.coulomb=[0.48,0.48,0.48]"
LOW_DAMPING = "manipulator.winches.viscous=[0.2,0.2,0.2]"
EXTRAPOLATING = "control.readings.weights=extrapolating"
POWER = "control.readings.phi_branch=power"
EVEN = "control.readings.phi_negative=even"
DROPPED = "control.readings.eta_in_controller_2=dropped"
APPLIED = "control.readings.stored_torque=applied"
DELAY = "manipulator.actuator.output_delay=1"


def simulated(experiment: Any, *overrides: str) -> TraceFile:
    loaded = load_config(experiment, None, overrides=overrides)
    return trace_file(loaded, simulate_all([(loaded, None)], Talk(quiet=True))[0], MANIFEST)


def found(experiment: Any, *overrides: str) -> dict[str, Any]:
    file = simulated(experiment, *overrides)
    return table_data_decouple(file) if experiment == "decouple" else table_data_compare(file)


@pytest.fixture(scope="module")
def comparison() -> TraceFile:
    return simulated("compare")


@pytest.fixture(scope="module")
def compared(comparison: TraceFile) -> dict[str, Any]:
    return table_data_compare(comparison)


@pytest.fixture(scope="module")
def decoupling() -> TraceFile:
    return simulated("decouple")


def stated(pattern: str, page: str = "docs/findings.md") -> list[float]:
    """Numbers in the groups of a pattern; a space in it stands for any white space of the text."""
    text = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    match = re.search(pattern, text)
    assert match, pattern
    return [number(group) for group in match.groups()]


def number(text: str) -> float:
    return float(text.replace("−", "-"))


def pair(cell: str) -> list[float]:
    return [number(part) for part in cell.split("/")]


def rows(page: str, first: str) -> list[list[str]]:
    """Cells of the table rows of a page that begin with a text."""
    lines = (DOCS / page).read_text(encoding="utf-8").splitlines()
    return [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in lines
        if line.strip().startswith(f"| {first}")
    ]


def test_findings_table_of_errors(compared: dict[str, Any]) -> None:
    for k in (1, 2, 3):
        (cells,) = rows("docs/findings.md", f"Controller {k}, here")
        errors = compared["table2"][f"controller_{k}"]
        ours = [errors[metric][joint] for joint in (0, 1) for metric in ("mae_deg", "rmse_deg")]
        assert cells[1:] == [f"{value:.4f}" for value in ours]


def test_readme_table_of_errors(compared: dict[str, Any]) -> None:
    for k, law in enumerate(("α-TDE + NTSM (proposed)", "TDE + NTSM", "TDE + TSM"), start=1):
        (cells,) = rows("README.md", f"Controller {k}, {law}")
        mae = compared["table2"][f"controller_{k}"]["mae_deg"]
        assert cells[1::3] == [f"{value:.4f}" for value in mae]


@pytest.mark.slow
def test_readme_table_of_the_second_motion() -> None:
    data = found("compare_cosine")
    assert set(data["status"].values()) == {"ok"}
    assert orders(data) == ["321"] * 4
    sizes = []
    for k in (1, 2, 3):
        (cells,) = rows("README.md", f"Controller {k}, ")
        mae = data["table2"][f"controller_{k}"]["mae_deg"]
        assert cells[2::3] == [f"{value:.4f}" for value in mae]
        sizes.append(mae[0])
    pattern = r"`compare_cosine` gives ([\d.]+)°, ([\d.]+)° and ([\d.]+)° on joint 2"
    assert stated(pattern) == pytest.approx(sizes, abs=6e-4)


def test_all_runs_are_stable_and_the_order_is_reversed(compared: dict[str, Any]) -> None:
    assert set(compared["status"].values()) == {"ok"}
    for joint in compared["ranking"].values():
        for metric in joint.values():
            assert metric["order"] == ["controller_3", "controller_2", "controller_1"]


def test_ratios_are_those_of_the_theory(compared: dict[str, Any]) -> None:
    mae = {k: compared["table2"][f"controller_{k}"]["mae_deg"] for k in (1, 2, 3)}
    # Friction reversals and counts blur them by a few hundredths.
    assert mae[1][0] / mae[2][0] == pytest.approx(1.1, abs=0.02)
    assert mae[1][1] / mae[2][1] == pytest.approx(1.2, abs=0.03)
    assert mae[2][0] / mae[3][0] == pytest.approx(1.032, abs=0.015)


def test_payload_changes(compared: dict[str, Any]) -> None:
    loads = compared["table3"]
    ours = [
        100.0 * (with_load / without - 1.0)
        for with_load, without in zip(loads["with_load"]["mae_deg"], loads["no_load"]["mae_deg"], strict=True)
    ]
    assert stated(r"MAE by (−?[\d.]+) % and (−?[\d.]+) %") == pytest.approx(ours, abs=0.05)


def test_decoupling_errors(decoupling: TraceFile) -> None:
    errors = table_data_decouple(decoupling)["errors"]
    for label, key in (("MAE", "mae_deg"), ("largest", "max_deg")):
        (cells,) = rows("docs/findings.md", f"{label} |")
        assert cells[1:] == [f"{errors[f'joint_{joint}'][key]:.3f}" for joint in (1, 2, 3)]
    (within,) = stated(r"Figs. 10 to 12\), up to ([\d.]+)°")
    assert within - 0.01 < max(errors[f"joint_{joint}"]["max_deg"] for joint in (1, 2, 3)) <= within


def test_pulling_tendon_1_moves_joint_2(decoupling: TraceFile) -> None:
    trace = decoupling.runs["pull_tendon_1"]
    S = decoupling.plant.matrix("S", trace.joint)
    end = trace["q"][np.abs(trace["q"][:, 0]).argmax()]
    ours = [S[1, 0] / S[0, 0], end[1] / end[0]]
    assert stated(r"by \+([\d.]+) of joint 1 in theory, ([\d.]+) in the") == pytest.approx(ours, abs=5e-4)


def test_stretch_of_the_tendons_and_what_reaches_each_joint(decoupling: TraceFile) -> None:
    trace = decoupling.runs["decouple"]
    S, S_inv = (decoupling.plant.matrix(name, trace.joint) for name in ("S", "S_inv"))
    stretch = np.rad2deg(trace["theta"] - trace["q"])
    winch = (stretch - stretch[0]) @ S_inv.T
    three = r"([\d.]+)°, ([\d.]+)°"
    assert stated(rf"stretches change by {three} and ([\d.]+)°") == pytest.approx(mae(winch), abs=6e-4)
    (first,) = stated(r"Joint 1 gets ([\d.]+)° from tendon 1")
    assert first == pytest.approx(mae(winch * S[0])[0], abs=6e-4)
    ours = list(mae(winch * S[1])[[1, 0]])
    assert stated(r"Joint 2 gets ([\d.]+)° from its own tendon and, through S₂₁, ([\d.]+)°") == pytest.approx(
        ours, abs=6e-4
    )
    assert np.mean(winch[:, 0] * winch[:, 1] > 0.0) > 0.5
    parts = mae(winch * S[2])
    assert stated(rf"tendons 1, 2 and 3 \({three}, ([\d.]+)°\)") == pytest.approx(parts, abs=6e-4)
    assert mae(winch @ S[2]) < 0.5 * parts.sum()


@pytest.mark.slow
def test_without_gravity_tendons_push_and_joint_3_is_the_worst() -> None:
    data = found("decouple", "manipulator.gravity=0")
    pushing = data["tension"]["decouple"]["slack_s"]
    assert min(pushing) > 0.5 * 30.4
    errors = data["errors"]
    ours = [errors[f"joint_{joint}"]["mae_deg"] for joint in (1, 2, 3)]
    assert ours == sorted(ours)
    pattern = r"would have to push half of the time, the MAE is ([\d.]+)°, ([\d.]+)° and ([\d.]+)°"
    assert stated(pattern) == pytest.approx(ours, abs=6e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "overrides"),
    [
        ("dry friction of the winches on", [DRY_FRICTION]),
        ("viscous friction of the winches", [LOW_DAMPING]),
        ("both changes", [DRY_FRICTION, LOW_DAMPING]),
    ],
)
def test_what_makes_the_error(row: str, overrides: list[str]) -> None:
    data = found("compare", *overrides)
    (cells,) = rows("docs/findings.md", row)
    assert cells[1:] == [f"{value:.3f}" for value in data["table2"]["controller_1"]["mae_deg"]]
    assert {data["status"][name] for name in CONTROLLERS} == {"ok"}
    assert orders(data) == ["321"] * 4


def test_shipped_row_of_what_makes_the_error(compared: dict[str, Any]) -> None:
    (cells,) = rows("docs/findings.md", "as shipped")
    assert cells[1:] == [f"{value:.3f}" for value in compared["table2"]["controller_1"]["mae_deg"]]


def orders(data: dict[str, Any]) -> list[str]:
    """Order of the controllers, best first: joint 2 MAE, RMSE, joint 3 MAE, RMSE."""
    return [
        "".join(name[-1] for name in metric["order"])
        for joint in data["ranking"].values()
        for metric in joint.values()
    ]


def test_torque_table(comparison: TraceFile) -> None:
    ripple, power, means, upward = [], [], [], []
    for k, name in enumerate(CONTROLLERS, start=1):
        trace = comparison.runs[name]
        tau, speed = trace["tau_m"], trace["dq_d"] / np.abs(trace["dq_d"]).max(axis=0)
        mean = window_mean(tau, MEAN)
        ripple.append(rmse(tau - mean))
        power.append(rmse(tau))
        moving = [[mean[where[:, j], j].mean() for j in (0, 1)] for where in (speed > 0.05, speed < -0.05)]
        means.append(moving)
        up = [tau[speed[:, j] > 0.05, j] for j in (0, 1)]
        upward.append([size(signal) for size in (rmse, lambda x: np.abs(x).max()) for signal in up])
        (cells,) = rows("docs/findings.md", f"Controller {k} | ")
        ours = [ripple[-1], power[-1], *map(np.array, moving)]
        for cell, values in zip(cells[1:], ours, strict=True):
            assert pair(cell) == pytest.approx(list(values), abs=6e-3)
    assert stated(r"ripple is ([\d.]+) and ([\d.]+) times Controller 2's") == pytest.approx(
        list(ripple[0] / ripple[1]), abs=6e-3
    )
    assert stated(r"RMS torque is (\d+) % lower on joint 2 and (\d+) % lower on joint 3") == pytest.approx(
        list(100.0 * (1.0 - power[0] / power[1])), abs=0.6
    )
    assert ripple[1][1] > 0.5 * power[1][1] > 0.5 * ripple[1][1]
    pattern = r"By RMS it is (\d+) % and (\d+) % lower .* moving up, by peak (\d+) % and (\d+) %"
    lower = 100.0 * (1.0 - np.array(upward[0]) / upward[1])
    assert stated(pattern) == pytest.approx(list(lower), abs=0.6)
    (spread,) = stated(r"means up and down differ by at most ([\d.]+) N m")
    assert np.ptp(means, axis=0).max() == pytest.approx(spread, abs=6e-4)


def test_estimate_and_torque_differ_little(comparison: TraceFile) -> None:
    (most,) = stated(r"differ by M̄ u, ([\d.]+) N m RMS at most")
    ours = max(
        rmse(comparison.runs[name]["tau_m"] - comparison.runs[name]["H_hat"]).max() for name in CONTROLLERS
    )
    assert ours == pytest.approx(most, abs=6e-4)


def test_white_noise_factors_quoted() -> None:
    alpha = np.array([0.1, 0.2])
    factors = np.sqrt((1.0 - alpha) ** 2 + alpha**2)
    for page, pattern in (
        ("docs/findings.md", r"\[theory\]\(theory.md\) has ([\d.]+) and ([\d.]+)\."),
        ("docs/theory.md", r"= ([\d.]+) and ([\d.]+), for noise that is white in the angle"),
    ):
        assert stated(pattern, page) == pytest.approx(list(factors), abs=6e-4)
    # Second differences of what is white have the correlation -2/3 from one to the next.
    steps = np.array([1.0, -2.0, 1.0])
    lag = (steps[1:] @ steps[:-1]) / (steps @ steps)
    angle = np.sqrt((1.0 - alpha) ** 2 + alpha**2 + 2.0 * lag * alpha * (1.0 - alpha))
    said = stated(r"\(1 − α\)\) = ([\d.]+) and ([\d.]+); counts", "docs/theory.md")
    assert said == pytest.approx(list(angle), abs=6e-3)


@pytest.mark.parametrize(
    ("row", "settings", "delay"),
    [
        ("extrapolating weights", ["weights=extrapolating"], 0),
        ("weights swapped", ["weights=swapped"], 0),
        ("delay time of two", ["delay_time=four_periods"], 0),
        ("applied torque stored", ["stored_torque=applied"], 1),
        ("estimate through a low-pass", ["estimate_filter=estimate"], 0),
    ],
)
def test_ratios_of_other_readings_in_the_theory(row: str, settings: list[str], delay: int) -> None:
    (cells,) = rows("docs/theory.md", f"Controller 1 / Controller 2, {row}")
    config = load_config(None, "compare", overrides=[f"control.readings.{one}" for one in settings]).config
    assert isinstance(config, CompareConfig)
    first, second = (build_law(config, name) for name in CONTROLLERS[:2])
    assert cells[2:] == [f"{ratio:.2f}" for ratio in error_ratio(first, second, 1e-3, delay)]


def test_sliding_surfaces(comparison: TraceFile) -> None:
    s = [window_mean(comparison.runs[name]["s"], MEAN) for name in CONTROLLERS]
    sizes = np.array([rmse(values) for values in s])
    three = r"([\d.]+), ([\d.]+) and ([\d.]+) rad/s"
    quoted = stated(rf"have the RMS {three} on joint 2, {three} on joint 3")
    assert quoted == pytest.approx(list(sizes.T.ravel()), abs=1e-4)
    apart = [rmse(s[i] - s[j]) for i, j in ((0, 1), (1, 2), (0, 2))]
    assert stated(r"two differ by ([\d.]+) to ([\d.]+) rad/s RMS") == pytest.approx(
        [np.min(apart), np.max(apart)], abs=1e-4
    )
    shares = np.array(apart) / sizes[[1, 2, 2]]
    assert 0.23 < shares[:, 0].min() < shares[:, 0].max() < 0.26
    assert shares[:, 1].min() > 1.0


def test_rapid_phases(comparison: TraceFile) -> None:
    first, second = (comparison.runs[name] for name in CONTROLLERS[:2])
    worse = np.rad2deg(np.abs(first["e"]) - np.abs(second["e"]))
    size = np.abs(first["ddq_d"])
    rapid = size > 0.5 * size.max(axis=0)
    ours = [worse[where[:, j], j].mean() for where in (rapid, ~rapid) for j in (0, 1)]
    two = r"([\d.]+)° and ([\d.]+)°"
    pattern = rf"less Controller 2's is {two} \(joints 2 and 3\) where .* half its peak, and {two} elsewhere"
    assert stated(pattern) == pytest.approx(ours, abs=6e-4)


def test_variables_each_experiment_stores(
    comparison: TraceFile, decoupling: TraceFile, tmp_path: Path
) -> None:
    assert {"s", "H", "H_hat", "epsilon", "q_motor_encoder"} <= comparison.runs[
        "controller_1"
    ].variables.keys()
    assert not {"q_motor", "q_calculated"} & comparison.runs["controller_1"].variables.keys()
    write_traces(tmp_path / "traces.h5", decoupling)
    with h5py.File(tmp_path / "traces.h5") as file:
        for name in ("s", "H", "H_hat", "epsilon"):
            assert np.isnan(file[f"decouple/{name}"][()]).all()
            assert "missing" in file[f"decouple/{name}"].attrs["comment"]
        assert not np.isnan(file["decouple/q_motor_encoder"][()]).any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "overrides", "order"),
    [
        ("neither slip mended", [EVEN, DROPPED], ["321"] * 4),
        ("weights (1 + α, −α)", [EXTRAPOLATING], ["132"] * 4),
        ("power branch", [POWER], ["213", "213", "231", "231"]),
        ("both of these", [EXTRAPOLATING, POWER], ["123"] * 4),
    ],
)
def test_changes_that_turn_the_order(row: str, overrides: list[str], order: list[str]) -> None:
    data = found("compare", *overrides)
    assert orders(data) == order
    (cells,) = rows("docs/findings.md", row)
    assert len(cells) == 4
    for k, cell in enumerate(cells[1:], start=1):
        mae = data["table2"][f"controller_{k}"]["mae_deg"]
        assert cell == f"{mae[0]:.3f} / {mae[1]:.3f}"


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_delay_changes_little_where_the_command_is_stored(delay: int) -> None:
    for name in CONTROLLERS:
        assert slowest(name, delay=delay) == pytest.approx(2.0, abs=0.1)


def test_one_sample_of_output_delay_leaves_only_controller_1_well_damped_with_applied_torque() -> None:
    (stated_rate,) = stated(r"decay at ([\d.]+) s⁻¹, counts shake them until they diverge")
    rates = [slowest(name, APPLIED, delay=1) for name in CONTROLLERS]
    assert rates[0] > 1.5
    assert rates[1:] == pytest.approx([stated_rate] * 2, abs=0.006)
    assert slowest("controller_1", APPLIED, EXTRAPOLATING, delay=1) < 0.0


def slowest(name: str, *overrides: str, delay: int) -> float:
    """Slowest decay of a law at the start posture, s⁻¹."""
    config = load_config(None, "compare", overrides=overrides).config
    assert isinstance(config, CompareConfig)
    return decay_rate([np.zeros(2)], build_plant(config, 0.0), build_law(config, name), delay=delay)


@pytest.mark.slow
def test_closest_plant_without_its_disturbance() -> None:
    pattern = r"joint 3 is ([\d.]+)°, ([\d.]+)° and ([\d.]+)° instead of ([\d.]+)°, ([\d.]+)° and ([\d.]+)°"
    ours = []
    for overrides in (["disturbance={kind: none}"], []):
        table = found("closest", *overrides)["table2"]
        ours += [table[name]["mae_deg"][1] for name in CONTROLLERS]
    assert stated(pattern) == pytest.approx(ours, abs=6e-3)


@pytest.mark.slow
def test_delays_of_the_table() -> None:
    (cells,) = rows("docs/findings.md", "one sample between")
    data = found("compare", DELAY)
    for cell, name in zip(cells[1:], CONTROLLERS, strict=True):
        assert pair(cell) == pytest.approx(data["table2"][name]["mae_deg"], abs=0.0015)
    (cells,) = rows("docs/findings.md", "that, the applied torque stored")
    data = found("compare", DELAY, APPLIED)
    first = data["table2"]["controller_1"]
    assert pair(cells[1]) == pytest.approx(first["mae_deg"], abs=0.0015)
    for name in ("controller_2", "controller_3"):
        worse = [a > b for a, b in zip(data["table2"][name]["rmse_deg"], first["rmse_deg"], strict=True)]
        assert data["status"][name] == "diverged" or worse == [True, True]


def test_joint_1_held_by_its_motor_changes_little() -> None:
    """The command of docs/slips.md, by the batch stepper."""
    text = (DOCS / "docs" / "slips.md").read_text(encoding="utf-8")
    (line,) = (line for line in text.splitlines() if "--out reports/joint_1" in line)
    held, rigid = (
        [batch_errors(metric, *overrides) for metric in ("mae", "rmse")] for overrides in (set_in(line), [])
    )
    (given,) = stated(r"it gives by ([\d.]+)° on average", "docs/slips.md")
    pattern = r"joints 2 and 3 changes by some ([\d.]+) % at most, the RMSE by some ([\d.]+) %, and the order"
    most = stated(pattern, "docs/slips.md")
    assert held[0][0, 0] == pytest.approx(given, abs=6e-3)
    changes = [100.0 * np.abs(one[:, 1:] / other - 1.0).max() for one, other in zip(held, rigid, strict=True)]
    assert changes == pytest.approx(most, abs=0.2)
    assert all((np.diff(one[:, 1:], axis=0) < 0.0).all() for one in held)


def set_in(line: str) -> list[str]:
    return re.findall(r"--set \"?([^\s\"]+)", line)


def batch_errors(metric: str, *overrides: str) -> np.ndarray:
    """MAE or RMSE of Controllers 1 to 3 in degrees, (3, joints)."""
    loaded = load_config(None, "compare", overrides=overrides)
    loops = dict(build_loops(loaded.config, loaded.folder))
    batch = simulate_batch([loops[name] for name in CONTROLLERS], loaded.config.status)
    assert not batch.status.any()
    return np.rad2deg(batch.statistics[metric])
