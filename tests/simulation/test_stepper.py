"""The closed loop in time: against a second program, and against what it promises."""

from __future__ import annotations

import _thread
import gc
import signal
import sys
import threading
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.overrides import on_plain_arm

from tendonrepro.configuration.load import load_config
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics import control
from tendonrepro.physics.arm import gravity_torque
from tendonrepro.simulation.loop import DesiredMotion, measure, rest_at, sample, start
from tendonrepro.simulation.stepper import MachinePlant, simulate

L = 1e-3
IDEAL = "manipulator.encoders.joint.resolution=0"
NO_DRY_FRICTION = tuple(f"manipulator.friction.{part}.coulomb=[0, 0, 0]" for part in ("link", "winch"))
UNSTABLE = "manipulator.tendons.damping_factor=0.2"
COUNT = np.deg2rad(0.022)
S_INV = np.array([[77.0, 0.0], [-35.0, 37.0]]) / 37.0  # joints 2 and 3 of Table 1
M_BAR = 0.01
ALPHA = np.array([0.1, 0.2])


def raised_cosine(amplitude_deg, period, samples):
    """Reference of both joints, written down once more."""
    t = L * np.arange(samples)[:, np.newaxis] * np.ones(2)
    A, w = np.deg2rad(amplitude_deg) / 2.0, 2.0 * np.pi / period
    return DesiredMotion(t[:, 0], A * (1 - np.cos(w * t)), A * w * np.sin(w * t), A * w**2 * np.cos(w * t))


@cache
def shipped(*overrides):
    return load_config("plain", "compare", overrides=overrides)


def make_loop(*overrides, run="controller_1", reference=None):
    loaded = shipped(*overrides)
    loop = dict(build_loops(loaded.config, loaded.folder))[run]
    return replace(loop, reference=reference or raised_cosine(10.0, 0.8, 301))


OFFSET = "runs.controller_1.start_offset={value: [0.7, -1.1], unit: deg, source: 'assumed: test'}"
LATE = "control.readings.reference_acceleration=late"


@pytest.mark.parametrize("method", ["dop853", "lsoda"])
def test_an_interrupt_ends_a_run(method):
    """Machine code asks for no signals; Python looks between two samples."""
    loop = make_loop(f"solver.method={method}", reference=raised_cosine(10.0, 60.0, 60001))
    simulate(make_loop(f"solver.method={method}"))  # so that the code is there
    # A shell starts jobs in the background deaf to interrupts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.disable()  # Python ignores what is raised in a callback of its, and Hypothesis has one
    timer = threading.Timer(0.05, _thread.interrupt_main)
    try:
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (the run is what is interrupted)
            timer.start()  # on a busy machine it may go off before the run begins
            simulate(loop)
    finally:
        timer.join()
        gc.enable()
        signal.signal(signal.SIGINT, before)


def test_machine_code_counts_references_as_python_does():
    plant = MachinePlant(make_loop())
    first = plant.slope(0.0, plant.state.copy())
    before = sys.getrefcount(first), sys.getrefcount(plant.rows)
    for _ in range(1000):
        assert plant.slope(0.0, plant.state.copy()) is first
    assert (sys.getrefcount(first), sys.getrefcount(plant.rows)) == before


class TestAStartBesideTheReference:
    OFFSET_RAD = np.deg2rad([0.7, -1.1])

    def test_the_arm_rests_there_and_both_encoders_see_it(self):
        at_rest = DesiredMotion(L * np.arange(300), *np.zeros((3, 300, 2)))
        trace = simulate(make_loop(IDEAL, OFFSET, reference=at_rest))
        np.testing.assert_allclose(trace["q"][0], self.OFFSET_RAD, atol=1e-12)
        np.testing.assert_allclose(trace["e"][0], -self.OFFSET_RAD, atol=1e-12)
        np.testing.assert_allclose(trace["dq"][0], 0.0, atol=1e-12)
        # The tendons stretch by what gravity asks for there beyond the start posture.
        seen = np.linalg.inv(S_INV) @ trace["q_motor_encoder"][0]
        np.testing.assert_allclose(seen, self.OFFSET_RAD, atol=np.deg2rad(0.1))
        held = simulate(make_loop(IDEAL, reference=at_rest))
        assert np.abs(trace["theta"][0] - held["theta"][0] - seen).max() < np.deg2rad(0.022)
        # It is drawn to the reference, and nothing is cut off the trace.
        sizes = np.abs(trace["e"][[0, 100, 200, 299]])
        assert (np.diff(sizes, axis=0) < 0.0).all()

    @pytest.mark.parametrize("rate", ["backward_difference", "difference_of_error"])
    def test_it_is_not_lost_in_the_memory_of_the_reference(self, rate):
        """The first rate is that of the reference, and not of a jump onto it."""
        trace = simulate(make_loop(IDEAL, OFFSET, f"control.readings.error_rate={rate}"))
        law = make_loop().controller.law
        s = [law.eta[i] * control.phi(-self.OFFSET_RAD[i], law, i) for i in range(2)]
        np.testing.assert_allclose(trace["s"][0], s, atol=1e-9)


def test_an_acceleration_that_is_absent_or_late_is_missed_by_the_law_alone():
    """The trace keeps the reference's own; the torque lacks the law's share of it at the first sample."""
    reference = raised_cosine(10.0, 0.8, 40)
    fed, absent, late = (
        simulate(make_loop(IDEAL, *changed, reference=reference))
        for changed in ((), ("control.readings.reference_acceleration=absent",), (LATE,))
    )
    for trace in (absent, late):
        np.testing.assert_array_equal(trace["ddq_d"], fed["ddq_d"])
    share = M_BAR * reference.ddq_d[0]
    np.testing.assert_allclose(fed["tau_cmd"][0] - absent["tau_cmd"][0], share, rtol=1e-9)
    missed = np.exp(-L / 10e-3) * share
    np.testing.assert_allclose(fed["tau_cmd"][0] - late["tau_cmd"][0], missed, rtol=1e-9)


class TestTraceObeysTheEquations:
    """Variables of a trace, recomputed from one another."""

    @pytest.mark.parametrize("run", ["controller_1", "controller_3"])
    @pytest.mark.parametrize(
        ("reading", "stored"),
        [
            ("control.readings.weights=interpolating", "commanded"),
            ("control.readings.differencing=centred", "applied"),
        ],
    )
    def test_estimate_is_equation_15_of_the_stored_torque(self, run, reading, stored):
        """Also where motors saturate and answer late: what was applied, or the command within the limits."""
        limits = "manipulator.actuator.torque_limit=[1, 1, 1]", "manipulator.actuator.output_delay=1"
        loop = make_loop(IDEAL, reading, f"control.readings.stored_torque={stored}", *limits, run=run)
        trace, drive = simulate(loop), loop.plant.drive
        alpha = ALPHA if run == "controller_1" else np.zeros(2)
        centred = reading.endswith("centred")
        within = np.clip(trace["tau_cmd"] @ drive.S, -1.0, 1.0) @ drive.S_inv
        q, tau = trace["q_encoder"], trace["tau_m"] if stored == "applied" else within
        assert np.abs(tau - trace["tau_cmd"]).max() > 0.01
        assert np.abs(within - trace["tau_m"]).max() > 0.01
        second_difference = (q[2:] - 2 * q[1:-1] + q[:-2]) / L**2  # entry k has its newest sample at k + 2
        for k in range(4, len(q)):
            newest = [k, k - 1] if centred else [k - 1, k - 2]
            H_1, H_2 = (tau[k - i] - M_BAR * second_difference[newest[i - 1] - 2] for i in (1, 2))
            np.testing.assert_allclose(trace["H_hat"][k], (1 - alpha) * H_1 + alpha * H_2, atol=1e-12)

    @pytest.mark.parametrize("run", ["controller_1", "controller_2", "controller_3"])
    def test_torque_lumped_dynamics_and_estimation_error(self, run):
        loop = make_loop(run=run)
        trace, law = simulate(loop), loop.controller.law
        q = trace["q_encoder"]
        e, de = trace["q_d"] - q, trace["dq_d"] - np.diff(q, axis=0, prepend=np.zeros((1, 2))) / L
        feedback = [control.surface_and_feedback(e[:, i], de[:, i], law, i)[1] for i in range(2)]
        u = trace["ddq_d"] + np.stack(feedback, axis=1)
        # Torques of some 10 N m keep 1e-14; q/L in the velocity, 1e-13 times lam M_bar.
        np.testing.assert_allclose(trace["tau_cmd"] - trace["H_hat"], M_BAR * u, atol=1e-13)
        np.testing.assert_allclose(trace["H"], trace["tau_m"] - M_BAR * trace["ddq"], atol=1e-12)
        # Eqs. (6), (17) and (19): epsilon = u - ddq while the commanded torque is applied.
        np.testing.assert_allclose(trace["epsilon"], u - trace["ddq"], atol=1e-9)


class TestEquivalence:
    @pytest.mark.parametrize(
        "overrides",
        [
            (),
            ("manipulator.actuator.output_delay=2", "control.readings.stored_torque=applied"),
            ("manipulator.actuator.torque_limit=[1, 0.5, 0.5]", "control.readings.delay_time=two_periods"),
            ("control.readings.feedback=motor", "manipulator.encoders.motor.noise=0.01"),
            ("control.readings.start=cold", "status.divergence_limit=0.5"),
            ("control.readings.phi_branch=power", "control.readings.gain_unit=law_in_degrees"),
            ("control.readings.torque_coordinates=winch", "control.readings.error_rate=difference_of_error"),
            ("control.readings.estimate_filter=estimate",),
        ],
    )
    def test_machine_code_does_what_a_law_in_python_does(self, overrides):
        """Also to its end, where it diverges."""
        loop = make_loop(IDEAL, *overrides, reference=raised_cosine(10.0, 0.8, 101))
        called = replace(loop.controller, command=control.command)
        ours, theirs = simulate(loop), simulate(replace(loop, controller=called))
        assert ours.keys() == theirs.keys()
        for name, values in ours.items():
            size = np.abs(values).max()
            np.testing.assert_allclose(values, theirs[name], rtol=0, atol=1e-7 * size, err_msg=name)

    @pytest.mark.parametrize("method", ["dopri5", "lsoda"])
    def test_integrators_agree(self, method):
        finer = IDEAL, "solver.rtol=1e-7", "solver.atol=1e-9"
        ours, theirs = (simulate(make_loop(*finer, f"solver.method={m}")) for m in ("dop853", method))
        # 300 periods, each started afresh, of a plant whose tendons damp at 2600 1/s.
        np.testing.assert_allclose(ours["q"], theirs["q"], atol=2e-7)
        assert np.any(ours["q"] != theirs["q"])


class TestRepeatability:
    noise = "manipulator.encoders.joint.noise=0.01", "manipulator.actuator.torque_noise=0.02"

    def test_seed(self):
        first, other, again = (simulate(make_loop(*self.noise, f"seed={seed}")) for seed in (1, 2, 1))
        for name, values in first.items():
            np.testing.assert_array_equal(values, again[name], err_msg=name)
        assert np.any(first["q_encoder"] != other["q_encoder"])

    def test_all_runs_meet_the_same_noise(self):
        noises = []
        for run in ("controller_1", "controller_3", "controller_1_payload"):
            trace = simulate(make_loop(IDEAL, *self.noise, run=run))
            noises.append(trace["q_encoder"] - trace["q"])
        assert np.rad2deg(noises[0].std()) == pytest.approx(0.01, rel=0.1)  # 600 values: 3 % rms
        for k in (1, 2):
            np.testing.assert_allclose(noises[k], noises[0], atol=1e-15)

    def test_motors_have_a_noise_of_their_own(self):
        changes = [f"manipulator.encoders.{side}.noise=0.01" for side in ("joint", "motor")]
        trace = simulate(make_loop(IDEAL, "manipulator.encoders.motor.resolution=0", *changes))
        joints = trace["q_encoder"] - trace["q"]
        motors = trace["q_motor_encoder"] - (trace["theta"] - trace["theta"][0]) @ S_INV.T
        assert np.rad2deg(motors.std()) == pytest.approx(0.01, rel=0.1)
        for i in range(2):
            assert abs(np.corrcoef(joints[:, i], motors[:, i])[0, 1]) < 0.2

    def test_torque_noise_acts_at_each_winch_and_no_controller_knows_it(self):
        """Stored with the torque it would come back in every estimate."""
        loop = make_loop(IDEAL, "manipulator.actuator.torque_noise=0.2")
        rest, law, motion = rest_at(loop.start_angles, loop.plant), loop.controller.law, loop.reference
        hardware, noise = loop.hardware(rest), np.array([0.0, 0.0, 0.0, 0.0, 1.0, -3.0])
        desired = motion.q_d[0], motion.dq_d[0], motion.ddq_d[0]
        memory = start(measure(rest.state, noise, law, hardware), desired[0], rest.tau, law)
        sampled = sample(rest.state, memory, [], desired, noise, law, hardware)
        at_winches = hardware.S.T @ (sampled.torque - sampled.tau_m)
        np.testing.assert_allclose(at_winches, 0.2 * noise[4:], rtol=1e-12)
        for known in (sampled.tau_m, sampled.memory.tau[0]):
            np.testing.assert_allclose(known, sampled.tau, rtol=1e-14)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_output_delay_shifts_whole_samples(delay):
    trace = simulate(make_loop(IDEAL, f"manipulator.actuator.output_delay={delay}"))
    applied, commanded = trace["tau_m"], trace["tau_cmd"]
    np.testing.assert_array_equal(applied[delay:], commanded[: len(commanded) - delay])
    # Until the first command arrives the holding torque stays on.
    hold = gravity_torque(np.zeros(2), make_loop().plant.arm)
    np.testing.assert_allclose(applied[:delay], np.tile(hold, (delay, 1)), rtol=1e-13)


class TestStart:
    still = raised_cosine(0.0, 1.0, 1001)

    def test_filled_history_keeps_an_arm_at_rest(self):
        trace = simulate(make_loop(IDEAL, reference=self.still))
        # Equilibrium to rounding: holding torque and tendon stretch agree to 1e-15 N m.
        assert np.abs(trace["q"]).max() < 1e-12
        assert np.abs(trace["tau_m"] - trace["tau_m"][0]).max() < 1e-9
        np.testing.assert_allclose(trace["H_hat"], np.tile(trace["tau_m"][0], (1001, 1)), atol=1e-9)

    def test_cold_history_drops_the_arm_which_recovers(self):
        loop = make_loop(
            IDEAL, *NO_DRY_FRICTION, "control.readings.start=cold", reference=raised_cosine(0.0, 1.0, 4001)
        )
        trace = simulate(loop)
        np.testing.assert_array_equal(trace["tau_cmd"][0], np.zeros(2))
        np.testing.assert_array_equal(trace["dq"][0], np.zeros(2))  # a brake has held it until now
        q = np.rad2deg(trace["q"])
        assert q[:, 0].min() < -0.3
        assert np.abs(q[-1]).max() < 1e-3


class TestDivergence:
    def test_run_ends_with_the_first_sample_beyond_the_limit(self):
        loop = make_loop(UNSTABLE, reference=raised_cosine(10.0, 4.0, 4001))
        trace = simulate(loop)
        done = len(trace["time"])
        assert 10 < done < 4001
        largest = np.abs(trace["e"]).max(axis=1)
        assert largest[-1] > loop.divergence_limit == pytest.approx(np.deg2rad(10.0))
        assert np.all(largest[:-1] <= loop.divergence_limit)
        for name, values in trace.items():
            assert len(values) == done, name
            assert np.isfinite(values).all(), name
        short = simulate(replace(loop, divergence_limit=loop.divergence_limit / 4.0))["q"]
        assert len(short) < done
        np.testing.assert_array_equal(trace["q"][: len(short)], short)

    def test_plant_beyond_the_integrator_is_an_error(self):
        """One message for the user, and no warning (which would fail this test by itself)."""
        loop = make_loop("solver.method=dop853", "manipulator.tendons.axial_stiffness=[1e5, 1e18, 1e18]")
        message = r"dop853 cannot follow the plant beyond t = 0\.000 s"
        with pytest.raises(TendonreproError, match=message) as caught:
            simulate(loop)
        assert "solver.method=lsoda" in caught.value.hint


@pytest.fixture(scope="module")
def decoupling():
    """First 0.4 s of the decoupling experiment."""
    loaded = on_plain_arm("decouple")
    loop = dict(build_loops(loaded.config, loaded.folder))["decouple"]
    full = loop.reference
    cut = DesiredMotion(full.time[:400], full.q_d[:400], full.dq_d[:400], full.ddq_d[:400])
    return loop, simulate(replace(loop, reference=cut))


class TestPositionLoop:
    """The decoupling experiment's loop: motors follow, joints are calculated."""

    def test_torque_is_the_servo_on_top_of_the_holding_torque(self, decoupling):
        loop, values = decoupling
        S_inv, servo = loop.plant.drive.S_inv, loop.controller.law
        q_motor = values["q_motor_encoder"]
        rate = np.diff(q_motor, axis=0, prepend=np.zeros((1, 3))) / L
        winch = servo.stiffness * (values["q_d"] @ S_inv.T - q_motor)
        winch += servo.damping * (values["dq_d"] @ S_inv.T - rate)
        # At the first sample nothing has moved and the arm is held.
        wanted = values["tau_cmd"][0] + winch @ S_inv
        np.testing.assert_allclose(values["tau_cmd"], wanted, atol=1e-10)

    def test_motor_and_calculated_angles(self, decoupling):
        loop, values = decoupling
        drive = loop.plant.drive
        moved = values["theta"] - values["theta"][0]
        np.testing.assert_allclose(values["q_motor"] @ drive.S.T, moved, atol=1e-13)
        step = loop.motor_encoder.resolution
        assert np.abs(values["q_motor_encoder"] - values["q_motor"]).max() <= 0.5 * step * (1.0 + 1e-9)
        np.testing.assert_allclose(values["q_calculated"], values["q_motor_encoder"] @ drive.S.T, atol=1e-13)
        assert not {"s", "H_hat", "epsilon"} & values.keys()
