"""The compiled batch stepper against the SciPy stepper, and against brute force on its own traces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import Readings
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.dynamics import frictionless
from tendonrepro.physics.linear_loop import plant_matrices
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.codegen.lanes import stacked
from tendonrepro.simulation.kernel import runge_kutta
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController
from tendonrepro.simulation.resolution import STEPS, TOLERANCE, plant_modes, steps_needed
from tendonrepro.simulation.stepper import simulate
from tendonrepro.simulation.streaming import STATISTICS

IDEAL = "manipulator.encoders.joint.resolution=0"
STIFF = tuple(
    f"manipulator.friction.{side}.smoothing_velocity=[5e-4,5e-4,5e-4]" for side in ("link", "winch")
)
"""Dry friction turns over a twentieth of the shipped velocity."""
EXACT = 1e-9
"""Allowed difference of q from the SciPy stepper, rad."""
NEAR = 3.8e-5
"""The same while torque pulses of encoder counts hit the steep part of friction: a tenth of a count."""


def loaded(*overrides: str) -> dict[str, Loop]:
    found = load_config("plain", "compare", overrides=overrides)
    return dict(build_loops(found.config, found.folder))


def cut(loop: Loop, duration: float) -> Loop:
    samples, reference = round(duration / loop.L) + 1, loop.reference
    parts = {name: getattr(reference, name)[:samples] for name in ("time", "q_d", "dq_d", "ddq_d")}
    return replace(loop, reference=DesiredMotion(**parts, period=reference.period))


def traced(loops: list[Loop], tolerance: float = TOLERANCE) -> tuple[Batch, list[dict[str, Array]]]:
    batch = simulate_batch(loops, record=True, tolerance=tolerance)
    assert batch.traces is not None
    return batch, [trace for trace in batch.traces if trace is not None]


def assert_same_run(trace: Mapping[str, Array], loop: Loop) -> None:
    truth = simulate(loop)
    assert trace.keys() == truth.keys()
    assert np.abs(trace["q"] - truth["q"]).max() < EXACT
    assert np.abs(trace["theta"] - truth["theta"]).max() < EXACT
    for name in ("tau_m", "H_hat", "s"):
        size = np.abs(truth[name]).max()
        assert np.abs(trace[name] - truth[name]).max() < 1e-3 * size, name


def near_until_a_count_differs(trace: Mapping[str, Array], truth: Mapping[str, Array]) -> int:
    """The sample of the first differing encoder count, up to which the angles must agree."""
    differs = (trace["q_encoder"] != truth["q_encoder"]).any(axis=1)
    first = int(np.argmax(differs)) if differs.any() else differs.size
    assert np.abs(trace["q"] - truth["q"])[:first].max() < NEAR
    return first


def sizes(e: Array) -> dict[str, Array]:
    return {"mae": np.abs(e).mean(axis=0), "rmse": np.sqrt((e**2).mean(axis=0))}


def test_with_ideal_encoders_every_run_is_the_reference_steppers() -> None:
    loops = loaded(IDEAL)
    short = [cut(loop, 3.0) for loop in loops.values()]
    batch, traces = traced(short)
    assert [STATUSES[status] for status in batch.status] == ["ok"] * 4
    for trace, loop in zip(traces, short, strict=True):
        assert_same_run(trace, loop)


def test_with_counts_runs_agree_up_to_the_first_differing_count() -> None:
    loops = loaded()
    batch, traces = traced(list(loops.values()))
    for k, (trace, loop) in enumerate(zip(traces[:3], list(loops.values())[:3], strict=True)):
        truth = simulate(loop)
        assert near_until_a_count_differs(trace, truth) > 400
        for name, size in sizes(truth["e"]).items():
            assert batch.statistics[name][k] == pytest.approx(size, rel=5e-3)


CHOICES = [
    f"control.readings.{name}={value}"
    for name, field in Readings.model_fields.items()
    for value in get_args(field.annotation)[1:]
]
"""Every reading but those as printed, which come first."""
UNSTABLE = {"control.readings.gain_unit=law_in_degrees", "control.readings.torque_coordinates=motor_shaft"}
"""Under which the published gains make rounding grow from sample to sample."""
RAMP = (
    "reference={kind: ramp, amplitude: {value: [11, 8], unit: deg, source: 'assumed: test'}, "
    "rise: {value: 0.2, unit: s, source: 'assumed: test'}, "
    "hold: {value: 0.1, unit: s, source: 'assumed: test'}, "
    "periods: {value: 6, unit: '1', source: 'assumed: test'}}"
)
APART = "runs.controller_1.start_offset={value: [0.7, -1.1], unit: deg, source: 'assumed: test'}"
STORED = "control.readings.stored_torque=applied"
READINGS = (
    *CHOICES,
    "manipulator.actuator.output_delay=1",
    f"{STORED};manipulator.actuator.output_delay=2",
    f"{STORED};manipulator.actuator.torque_resolution=0.016",
    "control.readings.feedback=motor;manipulator.encoders.motor.noise=1e-6",
    "manipulator.actuator.torque_noise=0.05",
    "manipulator.actuator.torque_resolution=0.016",
    "manipulator.encoders.joint.noise=1e-5",
    "manipulator.actuator.torque_limit=[9,9,2]",
    ";".join(
        ("manipulator.friction.link.coulomb=[0,0,0]", "manipulator.friction.winch.coulomb=[1,1,1]", *STIFF)
    ),
    "manipulator.tensioner.force=20",
    "manipulator.friction.per_pulley=0.03",
    "manipulator.transmission_error.peak_to_peak=4.4e-4",
    "disturbance={kind: sine, torque: {value: [0.3, 0.1], unit: N m, source: 'assumed: test'}, "
    "frequency: {value: 2, unit: Hz, source: 'assumed: test'}}",
    f"control.readings.reference_acceleration=late;{RAMP}",
    f"{RAMP};{APART};control.readings.error_rate=difference_of_error",
    f"{APART};control.readings.feedback=motor;manipulator.encoders.motor.noise=1e-6",
    "runs.controller_1.friction_scale={value: 1.4, unit: '1', source: 'assumed: test'}",
)


@pytest.mark.slow
def test_runs_of_all_readings_do_not_mix() -> None:
    """No switch of one law is taken for its neighbour's; code for parts that others have rounds otherwise."""
    found = [loaded(IDEAL, *override.split(";")) for override in READINGS]
    many = [cut(loops["controller_1"], 0.3) for loops in found]
    together = simulate_batch(many)
    for k, loop in enumerate(many):
        alone = simulate_batch([loop])
        for name in ("mae", "rmse", "torque_rms", "H_hat_rms"):
            ours, theirs = together.statistics[name][k], alone.statistics[name][0]
            np.testing.assert_allclose(ours, theirs, rtol=1e-11, err_msg=f"{name} {READINGS[k]}")


@pytest.mark.slow
@pytest.mark.parametrize("override", READINGS)
def test_every_reading_and_feature_runs_as_in_the_reference_stepper(override: str) -> None:
    loops = loaded(IDEAL, *override.split(";"))
    # Jumps at zero error and of the torque's steps amplify rounding; short runs stay clear of it.
    short = [cut(loop, 0.02 if override in UNSTABLE else 0.5) for loop in loops.values()]
    _, traces = traced(short, 1e-6)
    for trace, loop in zip(traces, short, strict=True):
        assert_same_run(trace, loop)


def test_a_run_knows_nothing_of_its_neighbours() -> None:
    loops = loaded("manipulator.encoders.joint.noise=1e-5")
    names = "controller_1", "controller_2", "controller_1_payload"
    runs = [replace(cut(loops[name], 0.9), seed=seed) for seed, name in enumerate(names)]
    stiff = cut(loaded(*STIFF)["controller_3"], 0.7)
    # What ends early leaves its lane to others.
    runs += [cut(loops["controller_2"], 0.3), stiff]
    many = [runs[k] for k in (0, 3, 2, 1, 4, 3, 2, 2, 3, 0, 3, 1, 2, 3, 3, 3, 4)]
    together = simulate_batch(many, threads=2)
    for k in (0, 1, 2, 3, 4, 12):
        alone = simulate_batch([many[k]])
        for name in STATISTICS:
            np.testing.assert_array_equal(together.statistics[name][k], alone.statistics[name][0], name)


def test_a_diverged_run_ends_where_the_reference_steppers_does() -> None:
    """Also if it rings."""
    loops = loaded(IDEAL, "status.divergence_limit=0.5", "status.ringing_share=1e-9")
    loop = loops["controller_1"]
    batch, (trace,) = traced([loop])
    truth = simulate(loop)
    assert STATUSES[batch.status[0]] == "diverged"
    assert trace["time"].size == truth["time"].size
    assert batch.status_time[0] == truth["time"][-1]
    assert np.isfinite(batch.statistics["mae"]).all()


def test_stiff_dry_friction_is_followed_within_a_billionth_of_a_radian() -> None:
    """Standstill, break-away, motion and standstill again, in 48 steps a sample."""
    loops = loaded(IDEAL, *STIFF)
    runs = [cut(loops[name], 5.0) for name in ("controller_1", "controller_3")]
    batch = simulate_batch(runs, record=True)
    assert (batch.steps == 48).all()
    assert batch.traces is not None
    for run, trace in zip(runs, batch.traces, strict=True):
        exact = simulate(replace(run, solver=replace(run.solver, method="lsoda", rtol=1e-10, atol=1e-12)))
        assert trace is not None
        assert np.abs(trace["q"] - exact["q"]).max() < EXACT


def test_a_plant_too_fast_to_resolve_gets_a_status_not_a_guess() -> None:
    loops = loaded("manipulator.friction.link.smoothing_velocity=[1e-5,1e-5,1e-5]")
    batch = simulate_batch([loops["controller_1"]])
    assert STATUSES[batch.status[0]] == "unresolved"
    assert batch.steps[0] == 0
    assert np.isnan(batch.statistics["mae"]).all()


def test_modes_without_friction_are_those_of_the_plants_matrices() -> None:
    loops = loaded()
    plant = frictionless(loops["controller_1"].plant)
    modes = plant_modes(stacked([plant]), np.zeros((2, 1)))[-1][0, 0]
    expected = np.linalg.eigvals(plant_matrices(np.zeros(2), plant)[0])
    assert np.sort_complex(modes) == pytest.approx(np.sort_complex(expected), rel=1e-4, abs=1e-3)


def test_steps_follow_the_fastest_mode() -> None:
    modes = np.array([[[-100.0]], [[-3000.0]], [[-100.0 + 800.0j]], [[-1e6]]], dtype=complex)
    needed = steps_needed(modes, 1e-3)
    assert needed.tolist() == [1, 2, 1, 0]
    assert steps_needed(modes, 1e-3, 1e-6).tolist() == [1, 12, 8, 0]
    assert STEPS[-1] == 64


@pytest.mark.parametrize("turn", [0.0, 1.2, 1.5])
def test_what_decays_faster_than_a_sample_never_grows_by_its_steps(turn: float) -> None:
    """The tolerance alone lets a mode grow by up to 1e-2 of its size squared, sample after sample.

    Of 512 plants of the box 13 would then take fewer steps; one at rest is off by 4e-7 rad in place of 1e-13.
    """
    modes = -np.geomspace(1e3, 1.5e5, 300) * np.exp(1j * turn)
    needed = steps_needed(modes[:, np.newaxis, np.newaxis], 1e-3)
    resolved = needed > 0
    assert resolved.sum() > 200
    assert len({*needed}) > 8
    state, h = np.ones(resolved.sum(), dtype=complex), 1e-3 / needed[resolved]
    for _ in range(64):
        after, _ = runge_kutta(lambda _, x: modes[resolved] * x, 0.0, state, h)
        assert (np.abs(after) <= np.abs(state)).all()
        state = after


def test_no_loops_and_a_law_of_somebody_else_are_refused() -> None:
    loops = loaded()
    loop = loops["controller_1"]
    assert isinstance(loop.controller, TimeDelayController)

    def strange(*_: object) -> tuple[Array, Array, Array, Array]:
        raise AssertionError

    other = replace(loop, controller=TimeDelayController(loop.controller.law, strange))
    for refused, message in (([], "no loops"), ([other], "own control laws")):
        with pytest.raises(TendonreproError, match=message):
            simulate_batch(refused)
