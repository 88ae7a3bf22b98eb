"""Tendons that only pull: between the steppers, where none goes slack, and at rest."""

import numpy as np
import pytest

from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.loops import build_loops
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


@pytest.fixture(scope="module")
def thrown():
    loop = run_of("on")
    return loop, simulate(loop)


def test_batch_and_reference_stepper_agree_while_tendons_are_slack(thrown):
    loop, truth = thrown
    tension = tension_of(truth, loop)
    assert tension.min() > -1e-9
    assert (slack_time(truth["time"], tension) > 0.05).all(), "both tendons go slack"
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
