"""Tendons that only pull: against a program of its own, between the steppers, and where none goes slack."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics import drive, dynamics
from tendonrepro.physics.dynamics import holding_torque, rest_state
from tendonrepro.physics.statics import slack_time, tendon_tension
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.stepper import simulate

WINCH = np.full(2, 0.037)
# Thrown up from nearly hanging, faster than gravity brings the last link back.
THROWN = (
    "posture=[10, 0, 0]",
    "reference.rise=0.34",
    "reference.hold=0.4",
    "reference.periods=1",
    "manipulator.encoders.joint.resolution=0",
    "manipulator.friction.link.coulomb=[0, 0, 0]",
    "manipulator.friction.link.viscous=[0, 0, 0]",
)


def run_of(unilateral, *overrides):
    finer = "solver.rtol=1e-7", "solver.atol=1e-9"
    changes = (*THROWN, *finer, f"manipulator.tendons.unilateral={unilateral}", *overrides)
    loaded = load_config("plain", "compare", overrides=changes, controllers=[1])
    return dict(build_loops(loaded.config, loaded.folder))["controller_1"]


def tension_of(trace, loop):
    return tendon_tension(trace["tau_s"].T, loop.plant.drive.S, WINCH)


def by_hand(trace):
    """The plain arm's joints 2 and 3 under a trace's torque, written in link angles and rope lengths."""
    arm_angle = np.deg2rad(10.0)
    l2, (m2, m3), (c2, c3), (i2, i3) = 0.28, (0.47, 0.22), (0.1344, 0.096), (3.611104e-3, 8.624e-4)
    rope, damper = np.array([188902.0, 292184.1]), 5.0 * np.array([479.0015, 1139.518])
    motor, drag, g = 0.108 + 3.2e-5, 1.0, 9.81

    def slope(_, x, torque):
        phi, dphi, winch, dwinch = x[:2], x[2:4], x[4:6], x[6:]
        q, dq = np.array([phi[0] - arm_angle, phi[1] - phi[0]]), np.array([dphi[0], dphi[1] - dphi[0]])
        # Tendon 2 turns joint 2 at 38.5 mm; tendon 3 passes joint 2 at 17.5 mm on the other side.
        drawn = np.array([0.0385 * q[0], -0.0175 * q[0] + 0.0185 * q[1]])
        drawn_rate = np.array([0.0385 * dq[0], -0.0175 * dq[0] + 0.0185 * dq[1]])
        tension = rope * (0.0185 * winch - drawn) + damper * (0.0185 * dwinch - drawn_rate)
        tension = np.maximum(tension, 0.0)
        on_2, on_3 = 0.0385 * tension[0] - 0.0175 * tension[1], 0.0185 * tension[1]
        cross, lean = m3 * l2 * c3, phi[0] - phi[1]
        mass = np.array(
            [[i2 + m2 * c2**2 + m3 * l2**2, cross * np.cos(lean)], [cross * np.cos(lean), i3 + m3 * c3**2]]
        )
        force = np.array(
            [
                on_2 - on_3 - cross * np.sin(lean) * dphi[1] ** 2 - g * (m2 * c2 + m3 * l2) * np.sin(phi[0]),
                on_3 + cross * np.sin(lean) * dphi[0] ** 2 - g * m3 * c3 * np.sin(phi[1]),
            ]
        )
        # Virtual work: joint torque is 77/37 of winch 2's less 35/37 of winch 3's, and winch 3's.
        third = torque[1]
        second = (torque[0] + 35.0 / 37.0 * third) * 37.0 / 77.0
        pulling = np.array([second, third]) - drag * dwinch - 0.0185 * tension
        return np.concatenate([dphi, np.linalg.solve(mass, force), dwinch, pulling / motor])

    q, theta = trace["q"][0], trace["theta"][0]
    winch = np.array([77.0 * theta[0], -35.0 * theta[0] + 37.0 * theta[1]]) / 37.0
    state = np.concatenate([arm_angle + np.cumsum(q), np.zeros(2), winch, np.zeros(2)])
    found = [state]
    for k in range(len(trace["time"]) - 1):
        span = (trace["time"][k], trace["time"][k + 1])
        solved = solve_ivp(
            slope, span, found[-1], args=(trace["tau_m"][k],), rtol=1e-7, atol=1e-9, max_step=5e-4
        )
        found.append(solved.y[:, -1])
    phi = np.array(found)[:, :2]
    return np.stack([phi[:, 0] - arm_angle, phi[:, 1] - phi[:, 0]], axis=1)


@pytest.fixture(scope="module")
def thrown():
    loop = run_of("on")
    return loop, simulate(loop)


def test_a_slack_run_is_that_of_a_program_of_its_own(thrown):
    loop, trace = thrown
    tension = tension_of(trace, loop)
    assert tension.min() > -1e-9
    assert (slack_time(trace["time"], tension) > 0.05).all(), "both tendons go slack"
    some = {name: values[:400] for name, values in trace.items()}
    assert (tension_of(some, loop) < 1e-6).any(axis=1).all()
    assert by_hand(some) == pytest.approx(some["q"], abs=1e-7)


def test_batch_and_reference_stepper_agree_while_tendons_are_slack(thrown):
    loop, truth = thrown
    both = [loop, run_of("off")]
    trace, pushing = simulate_batch(both, record=True, tolerance=1e-8).traces
    assert tension_of(pushing, loop).min() < -1.0, "its neighbour may push"
    assert len(trace["q"]) == len(truth["q"])
    # Steps meet the corner of the slack somewhere inside, and later the arm is thrown about.
    assert np.abs(trace["q"] - truth["q"])[:400].max() < 1e-6
    slack = [slack_time(one["time"], tension_of(one, loop)) for one in (trace, truth)]
    assert slack[0] == pytest.approx(slack[1], abs=2e-3)


def test_a_preload_that_keeps_all_tense_leaves_every_bit():
    preload = ("manipulator.tensioner.force=60", "reference.rise=0.6", "reference.hold=0.01")
    loops = {unilateral: run_of(unilateral, *preload) for unilateral in ("off", "on")}
    runs = {unilateral: simulate(loop) for unilateral, loop in loops.items()}
    assert tension_of(runs["on"], loops["on"]).min() > 5.0
    for name, values in runs["off"].items():
        assert (values == runs["on"][name]).all(), name
    batch = {unilateral: simulate_batch([loop], record=True).traces[0] for unilateral, loop in loops.items()}
    assert batch["on"]["q"] == pytest.approx(batch["off"]["q"], abs=1e-12)


def test_a_tendon_that_would_push_at_rest_has_no_torque():
    loop = run_of("on", "manipulator.tensioner.force=0")
    light = loop.plant._replace(arm=loop.plant.arm._replace(b=-np.ones(2)))
    state, torque = rest_state(np.zeros(2), light), holding_torque(np.zeros(2), light)
    winch = drive.to_winch_torque(torque, light.drive)
    carried = drive.tendon_torque(*np.split(state, 4), light.drive)
    assert winch == pytest.approx(carried, abs=1e-9)
    assert (winch >= -1e-12).all()
    pushed = drive.to_winch_torque(dynamics.load_at_rest(np.zeros(2), light), light.drive)
    assert (pushed < 0.0).any()
