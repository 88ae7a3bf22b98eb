"""A log of a known controller gives that controller back, or says that it cannot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.command import answer

import tendonrepro as tr
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import Readings
from tendonrepro.configuration.strict_yaml import dump
from tendonrepro.console import QUIET
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.evidence import fit
from tendonrepro.evidence.hypotheses import LINEAR, NTSM, Hypothesis
from tendonrepro.evidence.log import read_logs, torque_rounding, without_rounding
from tendonrepro.evidence.recover import (
    NONE,
    RECOVERED,
    UNTOLD,
    RecoveredController,
    controller_data,
    controller_tables,
    recover_controllers,
)
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.traces import write_traces

SHORT = {"reference.periods": 1, "reference.rise": 0.4, "reference.hold": 0.1}
PUBLISHED = load_config(None, "compare")
STEP = np.deg2rad(360 / 16384)


@cache
def run(*readings: str, controller: int = 1, more: tuple[tuple[str, Any], ...] = ()) -> TraceFile:
    """One short run under readings ``axis=value``, and with more keys set."""
    pairs = (one.split("=") for one in readings)
    changed = dict(more) | {f"control.readings.{axis}": value for axis, value in pairs}
    file = tr.compare("plain", set=SHORT | changed, controllers=[controller]).traces
    assert file is not None
    return replace(file, runs={f"controller_{controller}": file.runs[f"controller_{controller}"]})


def holding(file: TraceFile, variables: dict[str, Any], time: Any = None) -> TraceFile:
    """The file with other variables of its run, and with other times if some are given."""
    ((name, trace),) = file.runs.items()
    other = replace(trace, time=trace.time if time is None else time, variables=variables)
    return replace(file, runs={name: other})


def rounded(file: TraceFile, torque: float = 0.0, angle_deg: float = 0.0, every: int = 1) -> TraceFile:
    """The file as a recorder of few digits, or a slow one, would keep it, every column rounded.

    It has angles and the applied torque alone.
    """

    def coarse(values: Any, step: float) -> Any:
        return np.round(values / step) * step if step else values

    (trace,) = file.runs.values()
    steps = {"q_encoder": np.deg2rad(angle_deg), "q_d": np.deg2rad(angle_deg), "tau_m": torque}
    variables = {name: coarse(trace[name], step)[::every] for name, step in steps.items()}
    return holding(file, variables, trace.time[::every])


@pytest.fixture
def one_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search the cutoff of one filter, not of three: with logs that none of them made this takes longest."""
    monkeypatch.setattr(fit, "FILTERS", fit.FILTERS[:1])


def of_joint_3(file: TraceFile) -> TraceFile:
    """The file without joint 2, which takes as long again."""
    S = file.plant.values["S"]
    plant = replace(file.plant, values={"S": replace(S, value=S.value[1:, 1:])})
    return replace(file, plant=plant, runs={name: run.of_joints((3,)) for name, run in file.runs.items()})


@cache
def joint_3(file: TraceFile) -> RecoveredController:
    (found,) = recover_controllers(of_joint_3(file), PUBLISHED, QUIET)
    return found


@pytest.mark.parametrize("controller", [1, 2, 3])
def test_the_published_controllers_are_found_to_the_last_digits(controller: int) -> None:
    gains = PUBLISHED.config.control.gains
    for i, one in enumerate(recover_controllers(run(controller=controller), PUBLISHED, QUIET)):
        alpha = gains.alpha.si[i] if controller == 1 else 0.0
        assert one.answer == RECOVERED
        assert one.best.hypothesis.name == "printed"
        assert (one.best.hypothesis.surface == LINEAR) == (controller == 3)
        assert one.best.parameters[:3] == pytest.approx([1 - alpha, alpha, 0.01], abs=1e-9)
        feedback = [10.0, 16.0] if controller == 3 else [8.0, 1.5]
        assert one.best.parameters[3:] == pytest.approx(feedback, rel=1e-6)


QUICK = ("error_rate=difference_of_error", "phi_branch=power", "Delta_unit=deg")
SLOW = (
    "reference_acceleration=late", "differencing=centred", "error_rate=low_pass", "gain_unit=phi_in_degrees",
    "estimate_filter=acceleration", "estimate_filter=estimate", "delay_time=two_periods",
)  # fmt: skip


@pytest.mark.parametrize(
    "reading", [*QUICK, *(pytest.param(reading, marks=pytest.mark.slow) for reading in SLOW)]
)
def test_a_reading_is_found(reading: str) -> None:
    file = run(reading)
    if file.runs["controller_1"].status == "diverged":
        pytest.skip("this plant does not hold that loop")
    one = joint_3(file)
    assert one.answer == RECOVERED
    assert reading in one.best.hypothesis.name
    assert one.weights == "interpolating"


@pytest.mark.parametrize("kind", ["minimum_jerk", "ramp"])
def test_an_acceleration_that_is_absent_is_found_where_the_reference_has_one(kind: str) -> None:
    """Of a ramp, which has none, the simplest answer is named."""
    small = {"reference.kind": kind, "reference.amplitude": 4}
    absent = {"control.readings.reference_acceleration": "absent"}
    file = tr.compare("plain", set=SHORT | small | absent, controllers=[1]).traces
    assert file is not None
    one = joint_3(replace(file, runs={"controller_1": file.runs["controller_1"]}))
    assert (one.answer, one.weights) == (RECOVERED, "interpolating")
    found = one.best.hypothesis.name
    assert found == ("printed" if kind == "ramp" else "reference_acceleration=absent")


@pytest.mark.usefixtures("one_filter")
@pytest.mark.parametrize("weights", [pytest.param("interpolating", marks=pytest.mark.slow), "extrapolating"])
def test_weights_survive_the_rounding_of_a_record(weights: str) -> None:
    """One torque alone, in steps of 10 mN m, and angles to 0.001 deg, less than an encoder step."""
    one = joint_3(rounded(run(f"weights={weights}"), torque=0.01, angle_deg=0.001))
    older = {"interpolating": 0.2, "extrapolating": -0.2}[weights]
    assert (one.answer, one.weights) == (RECOVERED, weights)
    assert one.best.parameters[1] == pytest.approx(older, abs=max(3 * one.best.half[1], 0.002))


READINGS = [
    f"{axis}={value}"
    for axis, field in Readings.model_fields.items()
    for value in get_args(field.annotation)
    if value != getattr(PUBLISHED.config.control.readings, axis)
]


@pytest.mark.slow
@pytest.mark.parametrize("reading", READINGS)
def test_no_reading_of_the_package_is_taken_for_another_controller(reading: str) -> None:
    file = run(reading, more=(("reference.amplitude", 4),))
    if file.runs["controller_1"].status == "diverged":
        pytest.skip("this plant does not hold that loop")
    assert joint_3(file).answer != NONE


@pytest.mark.usefixtures("one_filter")
@pytest.mark.parametrize("derivatives", [True, False])
def test_a_log_with_lost_samples_and_a_jittering_clock(derivatives: bool) -> None:
    """Where a rounded desired angle alone was recorded, its spline bridges them."""
    file = run() if derivatives else rounded(run(), torque=1e-3, angle_deg=0.001)
    (trace,) = file.runs.values()
    rng = np.random.default_rng(2)
    kept = np.sort(rng.choice(len(trace.time), size=int(0.97 * len(trace.time)), replace=False))
    time = trace.time[kept] + rng.normal(scale=2e-5, size=len(kept))
    names = [key for key in ("q_encoder", "q_d", "dq_d", "ddq_d", "tau_m") if key in trace]
    one = joint_3(holding(file, {key: trace[key][kept] for key in names}, time))
    assert (one.answer, one.weights) == (RECOVERED, "interpolating")
    assert one.best.samples > 0.5 * len(trace.time)


@pytest.mark.usefixtures("one_filter")
@pytest.mark.parametrize(
    "record", [{"torque": 2.0}, pytest.param({"angle_deg": 0.05}, marks=pytest.mark.slow), {"every": 10}]
)
def test_a_coarse_record_cannot_tell(record: dict[str, float]) -> None:
    one = joint_3(rounded(run(), **record))
    assert one.answer == UNTOLD
    assert one.advice
    assert ("10 ms" in one.advice) == ("every" in record)
    # Numbers that need not be true are not given.
    answers, parameters, _ = controller_tables([one])
    assert answers.rows[0]["surface"] is None
    assert not parameters.rows
    assert controller_data(one)["parameters"] == {}


@pytest.mark.slow
@pytest.mark.usefixtures("one_filter")
def test_another_controller_is_none_of_these() -> None:
    """A feedback without any estimate."""
    trace = run().runs["controller_1"]
    torque = 300.0 * trace["e"] + 5.0 * np.gradient(trace["e"], trace.time, axis=0)
    held = {"q_encoder": trace["q_encoder"], "q_d": trace["q_d"], "tau_m": torque}
    assert joint_3(holding(run(), held)).answer == NONE


@pytest.mark.parametrize(
    ("K_d", "K_p", "answer"),
    [
        pytest.param(3, 16, NONE, marks=pytest.mark.slow),
        (10, 16, RECOVERED),
        pytest.param(10, 0, NONE, marks=pytest.mark.slow),
    ],
)
def test_a_pid_is_time_delay_control_with_gains_of_its_own(K_d: float, K_p: float, answer: str) -> None:
    """Centred differences and M_bar = K_d L, the published one for 10; without an integral K_p is 0."""
    trace = run().runs["controller_1"]
    L, q = 1e-3, trace["q_encoder"]
    e, de = trace["q_d"] - q, trace["dq_d"][1:] - np.diff(q, axis=0) / L
    acceleration = trace["ddq_d"][2:] - np.diff(q, n=2, axis=0) / L**2
    held = {name: trace[name][2:] for name in ("q_encoder", "q_d", "dq_d", "ddq_d")}
    held["tau_m"] = np.cumsum(K_d * L * (acceleration + 10.0 * de[1:] + K_p * e[2:]), axis=0)
    one = joint_3(holding(run(), held, trace.time[2:]))
    assert one.answer == answer
    assert one.best.parameters[2] == pytest.approx(K_d * L, rel=1e-6)
    assert ("M_bar" in one.advice) == (answer == NONE)
    # Where a PID explains as much, it is named as well.
    assert one.pid == pytest.approx({"K_p": 10.0 * K_d, "K_i": K_p * K_d, "K_d": K_d}, rel=1e-5, abs=1e-5)
    assert "PID" in one.sentence


@pytest.mark.usefixtures("one_filter")
@pytest.mark.parametrize("controller", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_rounded_motion_with_corners_makes_no_hypothesis_win_by_its_samples(controller: int) -> None:
    """Near corners a spline tells no derivatives: a law that needs none has more samples."""
    one = joint_3(rounded(run(controller=controller), torque=1e-3, angle_deg=0.001))
    assert one.answer == RECOVERED
    assert len({fit.samples for fit in one.fits}) == 1
    assert one.best.samples < len(one.log.q) - 100
    assert f"Controller {controller}" in one.controllers
    truth = Hypothesis(LINEAR if controller == 3 else NTSM)
    assert truth in [fit.hypothesis for fit in one.equal]
    assert "absent" not in one.best.hypothesis.name


def test_intervals_beside_a_filter_count_that_its_cutoff_is_fitted() -> None:
    file = run("estimate_filter=estimate", more=(("reference.amplitude", 4),))
    one = joint_3(rounded(file, torque=0.01, angle_deg=0.001))
    assert "estimate_filter=estimate" in one.best.hypothesis.name
    assert abs(one.best.parameters[1] - 0.2) <= one.best.half[1]
    assert abs(one.best.parameters[2] - 0.01) <= one.best.half[2]


def test_gains_of_ones_own(joints_1_2: TraceFile, tmp_path: Path) -> None:
    """A measured record of joints without published gains is compared with those of a configuration."""
    own = tmp_path / "own.yaml"
    own.write_text(joints_1_2.config_yaml)
    write_traces(tmp_path / "log.h5", replace(joints_1_2, source="measured"))
    found = answer("data", "recover", "log.h5", "--config", "own.yaml", cwd=tmp_path)
    assert found["gains_from"] == "configuration"
    assert [(row["joint"], row["answer"]) for row in found["runs"]] == [(1, RECOVERED), (2, RECOVERED)]
    other = answer(
        "data", "recover", "log.h5", "--config", "own.yaml", "--set", "control.gains.M_bar=[0.1, 0.1]",
        "--out", "other", cwd=tmp_path,
    )  # fmt: skip
    assert {row["answer"] for row in other["runs"]} == {NONE}


@pytest.mark.parametrize("step", [1e-3, 1e-2])
@pytest.mark.parametrize("controller", [2, 3])
def test_rounding_of_remembered_torques_is_in_the_intervals(controller: int, step: float) -> None:
    """Plain estimation: rounding makes the last weight too light, alike in every part of the log.

    In steps of 10 mN m the torque moves by 383.5 steps with each step of an encoder: errors take turns.
    """
    (log,), _ = read_logs(rounded(run(controller=controller), torque=step, angle_deg=0.001), PUBLISHED.config)
    log = replace(log, torque_rounding=np.full(2, step), angle_rounding=np.zeros(2))
    truth = Hypothesis(LINEAR if controller == 3 else NTSM)
    for joint in (0, 1):
        rows = fit.rows_of_all(log, joint, [Hypothesis(LINEAR)])
        found = fit.fitted(log, joint, truth, rows)
        exact = fit.fitted(replace(log, torque_rounding=np.zeros(2)), joint, truth, rows)
        assert (abs(found.parameters[:2] - [1.0, 0.0]) <= found.half[:2]).all()
        assert (found.half[:2] > exact.half[:2]).all()
        assert exact.bias == 0.0 < found.bias


def test_intervals_hold_the_true_weights_where_errors_take_turns() -> None:
    """Errors of which each is half the opposite of the one before, as steps of an encoder make them."""
    inside = 0
    for controller, seed in product((2, 3), (1, 2)):
        (log,), _ = read_logs(run(controller=controller), PUBLISHED.config)
        white = np.random.default_rng(seed).normal(scale=0.01 / np.sqrt(24.0), size=(len(log.q) + 1, 2))
        torque = log.command + np.diff(white, axis=0)
        coarse = replace(log, command=torque, applied=None, torque_rounding=np.full(2, 0.01))
        for joint in (0, 1):
            rows = fit.rows_of_all(coarse, joint, [Hypothesis(LINEAR)])
            truth = Hypothesis(LINEAR if controller == 3 else NTSM)
            found = fit.fitted(coarse, joint, truth, rows)
            inside += bool((abs(found.parameters[:2] - [1.0, 0.0]) <= found.half[:2]).all())
    assert inside >= 6


def test_equal_equations_do_not_crowd_the_true_one_out() -> None:
    """Of hypotheses that differ in what their coefficients are, and in nothing before, all are tried."""
    one = joint_3(rounded(run("Delta_unit=deg"), torque=1e-3, angle_deg=0.001))
    assert Hypothesis(NTSM, (("Delta_unit", "deg"),)) in [fit.hypothesis for fit in one.equal]
    data, rows = controller_data(one), controller_tables([one])[2].rows
    assert data["as_good"] == len(one.equal) - 1 > 0
    assert [row["hypothesis"] for row in rows if row["as_good"]] == data["equally_good"]
    assert all(name in one.sentence for name in one.controllers)


def test_rounding_of_angles_on_a_grid_is_undone() -> None:
    true = STEP * np.cumsum(np.random.default_rng(3).integers(-3, 4, size=4000))
    found, left = without_rounding(np.round(true, 5), STEP)
    assert left == 0.0
    assert found - found[0] == pytest.approx(true - true[0], abs=1e-6)
    smooth = np.sin(np.linspace(0.0, 9.0, 4000))
    assert without_rounding(smooth, STEP)[0] is smooth


def test_the_grid_of_a_drive_is_found_below_the_digits_of_a_record() -> None:
    """A winch whose step does not change gets the digits of both joints' columns, less than a step."""
    (log,), _ = read_logs(run(), PUBLISHED.config)
    at_winches = 0.016 * np.cumsum(np.random.default_rng(3).integers(-3, 4, size=log.command.shape), axis=0)
    digits = np.round(at_winches @ np.linalg.inv(log.S) / 1e-3) * 1e-3
    mapped = np.linalg.norm(np.linalg.inv(log.S.T), axis=1)
    assert torque_rounding(digits, log.S) == pytest.approx(0.016 * mapped, rel=1e-3)


def test_numbers_are_those_of_another_least_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eqs. (15), (16) and (18) of Controller 3 under white noise, fitted by SciPy from the trace."""
    monkeypatch.setattr(fit, "FILTERS", ())
    (trace,) = of_joint_3(run(controller=3)).runs.values()
    tau = trace["tau_m"] + np.random.default_rng(5).normal(scale=3e-4, size=trace["tau_m"].shape)
    signals = {name: trace[name] for name in ("q_encoder", "q_d", "dq_d", "ddq_d")} | {"tau_m": tau}
    noisy = replace(run(controller=3), runs={trace.name: replace(trace, variables=signals)})
    data = controller_data(joint_3(noisy))
    q, q_d, dq_d, ddq_d, tau = (values[:, 0] for values in signals.values())
    L, k = 1e-3, np.arange(4, len(q))
    ddq = np.zeros_like(q)
    ddq[3:] = (q[2:] - 2.0 * q[1:-1] + q[:-2])[:-1] / L**2  # of one sample before
    de, e = dq_d[k] - (q[k] - q[k - 1]) / L, q_d[k] - q[k]

    def left(x: Any, part: Any) -> Any:
        w_1, w_2, M_bar, K_d, K_p = x
        H = w_1 * (tau[k - 1] - M_bar * ddq[k]) + w_2 * (tau[k - 2] - M_bar * ddq[k - 1])
        return (tau[k] - H - M_bar * (ddq_d[k] + K_d * de + K_p * e))[part]

    def fit_to(part: Any) -> Any:
        return least_squares(left, [0.9, 0.1, 0.02, 8.0, 10.0], args=(part,), x_scale="jac", xtol=1e-14).x

    everything, odd = np.ones(len(k), bool), k // 200 % 2 == 1
    others = [np.setdiff1d(np.arange(len(k)), part) for part in np.array_split(np.arange(len(k)), 16)]
    values, left_out = fit_to(everything), np.stack([fit_to(part) for part in others])
    half = 1.753 * np.sqrt(15.0 * left_out.var(axis=0))
    told = data["parameters"]
    assert data["samples"] == len(k)
    assert (abs(values - [told[name]["value"] for name in told]) < 0.01 * half).all()
    assert [told[name]["half_90"] for name in told] == pytest.approx(half, rel=0.02)
    unexplained = np.std(left(fit_to(~odd), odd)) / np.sqrt(np.mean(np.diff(tau) ** 2))
    assert data["unexplained"] == pytest.approx(unexplained, rel=1e-3)
    assert data["position_gain"] == pytest.approx(values[4] / 16.0, rel=1e-4)


def of_last_two(node: Any) -> Any:
    """Values by joint, of an arm that lacks the first joint."""
    if isinstance(node, dict):
        return {key: of_last_two(value) for key, value in node.items()}
    if isinstance(node, list):
        return [of_last_two(item) for item in (node[1:] if len(node) == 3 else node)]
    return node


@pytest.fixture(scope="module")
def joints_1_2(tmp_path_factory: pytest.TempPathFactory) -> TraceFile:
    """A run of an arm with two joints, both moving, with another M_bar than the paper's."""
    tree = load_config("plain", "compare").tree
    arm = {key: of_last_two(tree[key]) for key in ("manipulator", "posture")}
    arm["posture"]["value"] = [45, 0]
    path = tmp_path_factory.mktemp("arm") / "two.yaml"
    path.write_text(dump(tree | arm | {"joints": [1, 2]}))
    file = tr.compare(path, set=SHORT | {"control.gains.M_bar": [0.03, 0.03]}, controllers=[1]).traces
    assert file is not None
    return replace(file, runs={"controller_1": file.runs["controller_1"]})


def test_measured_joints_without_published_gains_are_left_out(joints_1_2: TraceFile) -> None:
    measured = replace(joints_1_2, source="measured")
    (found,) = recover_controllers(measured, PUBLISHED, QUIET)
    assert (found.joint, found.answer) == (2, NONE)
    alone = {name: run.of_joints((1,)) for name, run in measured.runs.items()}
    S = measured.plant.values["S"]
    plant = replace(measured.plant, values={"S": replace(S, value=S.value[:1, :1])})
    with pytest.raises(UsageError):
        recover_controllers(replace(measured, runs=alone, plant=plant), PUBLISHED, QUIET)


@pytest.mark.parametrize(
    ("M_bar", "half", "gain", "gain_half", "answer"),
    [
        (0.01, 0.0, 1.0, 0.4, RECOVERED),
        (0.01, 0.0, 1.0, 0.6, UNTOLD),
        (0.01, 0.0, 2.2, 2.9, UNTOLD),
        (0.01, 0.0, 3.0, 0.9, NONE),
        (0.01, 0.006, 1.0, 0.0, UNTOLD),
        (0.4, 0.0, 1.0, 0.0, RECOVERED),
        (0.01 * np.rad2deg(1.0), 0.0, 1.0, 0.0, RECOVERED),
    ],
)
def test_loose_gains_cannot_tell(
    M_bar: float, half: float, gain: float, gain_half: float, answer: str
) -> None:
    """A 90 % interval has to lie inside a factor of two of the published gain, or outside."""
    one = joint_3(run())
    parameters, halves = np.array([0.9, 0.1, M_bar, 8.0, 1.5]), np.array([0.0, 0.0, half, 0.0, 0.0])
    published = 8.0 * 1.5
    gains = {"error_gain": published * gain, "error_gain_half": published * gain_half}
    best = replace(one.best, parameters=parameters, half=halves, **gains)
    assert replace(one, fits=[best]).answer == answer


def test_a_log_without_any_acceleration_or_torque_of_its_own_warns_of_nothing() -> None:
    """Free coefficients are zero there, and say nothing of parameters."""
    (log,), _ = read_logs(run(controller=2), PUBLISHED.config)
    still = replace(log, q=0.0 * log.q, q_d=0.0 * log.q, dq_d=0.0 * log.q, ddq_d=0.0 * log.q, applied=None)
    pushed = replace(still, command=np.random.default_rng(1).normal(size=log.q.shape))
    for hypothesis in (Hypothesis(NTSM), Hypothesis(LINEAR)):
        rows = fit.rows_of_all(pushed, 0, [hypothesis])
        assert np.isfinite(fit.fitted(pushed, 0, hypothesis, rows).residual)


@pytest.mark.slow
@pytest.mark.usefixtures("one_filter")
def test_a_lone_commanded_torque_whose_estimator_stores_the_applied_one() -> None:
    """One sample late, and nothing but the command in the log."""
    late = ("manipulator.actuator.output_delay", 1), ("reference.amplitude", 4)
    file = run("stored_torque=applied", more=late)
    (trace,) = file.runs.values()
    held = {key: trace[key] for key in ("q_encoder", "q_d", "dq_d", "ddq_d")} | {"tau_m": trace["tau_cmd"]}
    one = joint_3(holding(file, held))
    assert (one.answer, one.weights) == (RECOVERED, "interpolating")
    assert "logged_torque=commanded" in one.best.hypothesis.name


def cut(file: TraceFile, samples: int, pause: float = 0.0) -> Trace:
    """The first samples of a run, the last of them after a pause, s."""
    (trace,) = file.runs.values()
    time = trace.time[:samples] + pause * (np.arange(samples) == samples - 1)
    variables = {name: values[:samples] for name, values in trace.variables.items()}
    return replace(trace, time=time, variables=variables)


@pytest.mark.parametrize(("samples", "pause"), [(1, 0.0), (5, 0.0), (100, 86400.0)])
def test_a_run_that_cannot_be_put_on_samples_is_named_and_others_are_read(samples: int, pause: float) -> None:
    file = run()
    bad, good = cut(file, samples, pause), cut(file, 300)
    with pytest.raises(DataMissingError, match=bad.name):
        recover_controllers(replace(file, runs={"a": bad}), PUBLISHED, QUIET)
    both = {"a": bad, "b": replace(good, name="b")}
    found = recover_controllers(replace(file, runs=both), PUBLISHED, QUIET)
    assert {one.log.run for one in found} == {"b"}


def test_a_log_of_which_nothing_can_be_told_is_an_answer_of_the_command(tmp_path: Path) -> None:
    file = run()
    write_traces(tmp_path / "short.h5", replace(file, runs={"controller_1": cut(file, 300)}))
    data = answer("data", "recover", "short.h5", cwd=tmp_path)
    assert data["gains_from"] == "paper"
    assert [one["answer"] for one in data["runs"]] == [UNTOLD, UNTOLD]
    assert (tmp_path / "reports" / "recover" / "tables" / "controllers.md").exists()
