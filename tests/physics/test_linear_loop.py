"""The linearised sampled loop against the real one, and the limits that follow from it."""

from functools import cache
from typing import get_args

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import brentq

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import Readings
from tendonrepro.experiments.loops import build_law
from tendonrepro.experiments.rig import build_plant
from tendonrepro.physics.arm import Arm
from tendonrepro.physics.control import (
    Law,
    Surface,
    estimator_weights,
    phi,
    start_memory,
    surface_and_feedback,
)
from tendonrepro.physics.drive import Actuator, Drive, Encoder
from tendonrepro.physics.dynamics import Plant, frictionless, holding_torque, rest_state
from tendonrepro.physics.linear_loop import (
    decay_rate,
    feedback_gains,
    loop_matrix,
    modes,
    slowest,
    spectral_radius,
    stroke,
    without_unread,
)
from tendonrepro.physics.loads import Friction, no_disturbance
from tendonrepro.simulation.loop import DesiredMotion, Loop, Solver, TimeDelayController
from tendonrepro.simulation.stepper import simulate

L = 1e-3
POSTURES = [np.zeros(2), np.deg2rad([16.5, 16.5]), np.deg2rad([33.0, 33.0])]
ONE = np.ones(1)
EVERY_READING = [
    f"{axis}={value}" for axis, field in Readings.model_fields.items() for value in get_args(field.annotation)
]


@cache
def shipped(*overrides):
    return load_config("plain", "compare", overrides=overrides).config


def single_joint(motor_inertia, link_inertia, stiffness, damping):
    """Plant with one joint, a winch that turns as it does, and a link without weight."""
    zero = 0.0 * ONE
    no_friction = Friction(zero, zero, ONE, ONE, ONE)
    drive = Drive(
        S=np.eye(1),
        S_inv=np.eye(1),
        inertia=motor_inertia * ONE,
        stiffness=stiffness * ONE,
        damping=damping * ONE,
        friction=no_friction,
        **dict.fromkeys(("slack", "one_way", "pulley_loss", "reducer_loss", "wobble", "wobble_rate"), zero),
    )
    return Plant(Arm(link_inertia * np.eye(1), zero, zero), drive, no_friction, zero, no_disturbance(1))


def single_law(alpha, newest=1):
    """Controller 3's gains, with an estimator of any alpha."""
    gains = {"M_bar": 0.01, "lam": 8.0, "eta": 1.5, "b": 0.9, "Delta": 0.2, "beta": 2.0, "rate_gain": 1.5}
    return Law(
        surface=int(Surface.TSM),
        L=L,
        **{name: value * ONE for name, value in gains.items()},
        K_d=10.0 * ONE,
        K_p=16.0 * ONE,
        weights=estimator_weights(alpha * ONE),
        newest=newest,
        power_floor=1e-4,
        to_joint=np.eye(1),
        from_joint=np.eye(1),
        stores_applied=True,
    )


def small_step(plant, law, size, samples, delay=0):
    """Real loop from rest at zero to a desired angle close by: deviations from the end, (samples, n)."""
    n = plant.preload.size
    target = np.tile(size, (samples, 1))
    loop = Loop(
        plant=plant,
        joint_encoder=Encoder(0.0, 0.0),
        motor_encoder=Encoder(0.0, 0.0),
        actuator=Actuator(np.full(n, 1e6), 0.0, 0.0, delay),
        controller=TimeDelayController(law),
        reference=DesiredMotion(L * np.arange(samples), target, 0.0 * target, 0.0 * target),
        L=L,
        solver=Solver("dop853", 1e-13, 1e-17, L),
        divergence_limit=np.inf,
        ringing_frequency=3.0,
        ringing_share=0.5,
        cold=False,
        seed=0,
    )
    return simulate(loop)["q"] - target


def linear_step(plant, law, size, samples, delay=0):
    """The same by powers of the loop's matrix."""
    n, end = plant.preload.size, place_reached(plant, law, size)
    before, after = rest_state(np.zeros(n), plant), rest_state(end, plant)
    tau = holding_torque(np.zeros(n), plant) - holding_torque(end, plant)
    start = start_memory(-np.array(size), tau, law.lag, np.zeros(n))
    z = np.concatenate([before - after, *map(np.ravel, start), np.tile(tau, delay)])
    matrix = loop_matrix(end, plant, law, delay)
    path = np.empty((samples, n))
    for k in range(samples):
        path[k] = z[:n] + end - size
        z = matrix @ z
    return path


def place_reached(plant, law, size):
    """Joint angles at rest where the encoders that the law looks at read `size`."""
    q = np.array(size)
    for _ in range(20 * law.motor_side):
        # What the tendons stretch is a small part of any angle, so this contracts.
        stretched = np.split(rest_state(q, plant) - rest_state(0.0 * q, plant), 4)[2]
        q = q + size - stretched
    return q


class TestFeedbackGains:
    @pytest.mark.parametrize("name", ["controller_1", "controller_2", "controller_3", "tdc"])
    @pytest.mark.parametrize("reading", EVERY_READING)
    def test_are_slopes_of_the_law(self, name, reading):
        """Under every reading, also one that is new."""
        law, h = build_law(shipped(f"control.readings.{reading}"), name), 1e-9
        on_error, on_rate = feedback_gains(law)
        for i in range(2):
            rate = surface_and_feedback(0.0, h, law, i)[1] / h
            assert on_rate[i] == pytest.approx(rate, rel=1e-9)
            # Where phi has a power branch its slope is held at the floor: chord up to there, times b.
            power = law.surface == Surface.NTSM and law.power_inside
            e = law.power_floor if power else h
            chord = law.b[i] * law.lam[i] * law.eta[i] * phi(e, law, i) / e
            error = chord if power else surface_and_feedback(e, 0.0, law, i)[1] / e
            assert on_error[i] == pytest.approx(error, rel=1e-6)


class TestLoop:
    @pytest.mark.parametrize(
        ("name", "reading", "delay"),
        [
            ("controller_1", None, 0),
            ("controller_3", None, 2),
            ("controller_1", "weights=extrapolating", 0),
            ("controller_2", "differencing=centred", 0),
            ("controller_1", "torque_coordinates=winch+estimate_filter=estimate", 0),
            ("controller_1", "torque_unit=percent_of_rated", 0),
            ("controller_1", "stored_torque=applied", 1),
            ("controller_1", "delay_time=two_periods", 1),
            ("controller_1", "estimate_filter=estimate", 0),
            ("controller_1", "error_rate=difference_of_error", 0),
            ("controller_1", "feedback=motor", 0),
            ("tdc", None, 0),
        ],
    )
    def test_powers_of_the_matrix_follow_the_real_loop(self, name, reading, delay):
        """Actual command function, actual integrator, 0.2 s of a step of 1e-5 rad."""
        readings = [f"control.readings.{one}" for one in reading.split("+")] if reading else []
        config = shipped("posture=[45, 15, 15]", *readings)
        plant, law = frictionless(build_plant(config, 0.2)), build_law(config, name)
        size = np.array([1e-5, -2e-5])
        real = small_step(plant, law, size, 200, delay)
        linear = linear_step(plant, law, size, 200, delay)
        assert linear.shape == real.shape
        assert np.abs(real[-1] - real[0]).max() > 1e-6
        # What is not linear: |gamma_2/gamma_1| 2e-5 in phi, 2e-5 in G. Growing loops pass this on.
        np.testing.assert_allclose(real, linear, atol=3e-5 * np.abs(linear).max())


class TestShippedPlant:
    @pytest.mark.parametrize(
        ("name", "multiples"), [("controller_1", (2.444, 3.736)), ("controller_3", (2.490, 3.790))]
    )
    def test_smallest_stable_multiple(self, name, multiples):
        """The table of docs/theory.md: without and with 0.2 kg."""
        config = shipped("manipulator.tendons.damping_factor=1")
        law = build_law(config, name)
        for payload, known in zip((0.0, 0.2), multiples, strict=True):
            plant = build_plant(config, payload)

            def rate(factor, plant=plant):
                drive = plant.drive._replace(damping=factor * plant.drive.damping)
                return decay_rate(POSTURES, plant._replace(drive=drive), law)

            assert brentq(rate, 1.0, 6.0, xtol=1e-5) == pytest.approx(known, abs=6e-4)


def test_decay_rate_is_that_of_the_slowest_posture_under_its_delay():
    config = shipped()
    plant, law = build_plant(config, 0.0), build_law(config, "controller_1")
    rates = []
    for delay in (0, 2):
        radii = [np.abs(np.linalg.eigvals(loop_matrix(q, plant, law, delay))).max() for q in POSTURES]
        rates.append(decay_rate(POSTURES, plant, law, delay))
        assert rates[-1] == pytest.approx(-np.log(max(radii)) / L, abs=1e-7)
    assert abs(rates[0] - rates[1]) > 1e-4


@pytest.mark.parametrize(
    ("newest", "known"), [(1, [0.01226, 0.01118, 0.01034]), (0, [0.00505, 0.00461, 0.00430])]
)
def test_smallest_inertia_that_a_rigid_arm_needs(newest, known):
    """For M_bar = 0.01 kg m² and α of 0, 0.1, 0.2: roots of a polynomial worked out by hand."""

    def rate(inertia, alpha):
        # A critically damped tendon of 1e8 N m/rad: its motion dies within a hundredth of a sample.
        half, stiffness = 0.5 * inertia, 1e8
        plant = single_joint(half, half, stiffness, 2.0 * np.sqrt(0.5 * half * stiffness))
        return decay_rate([np.zeros(1)], plant, single_law(alpha, newest))

    limits = [brentq(rate, 0.003, 0.05, args=(alpha,), xtol=1e-9) for alpha in (0.0, 0.1, 0.2)]
    # 1e8 N m/rad is not quite rigid.
    np.testing.assert_allclose(limits, known, rtol=2e-3)


class TestModes:
    L = 2e-3

    def test_rates_and_frequencies_of_known_roots(self):
        """Two oscillations, a root that decays, one that grows, one dead, one nobody reads."""
        roots = np.exp(self.L * np.array([-3.0 + 40.0j, -1.0 + 90.0j, -7.0, 0.5]))
        blocks = [np.array([[z.real, z.imag], [-z.imag, z.real]]) for z in roots[:2]]
        matrix = block_diag(*blocks, roots[2].real, roots[3].real, 1e-13, 0.0)
        matrix[-1, 0] = 5.0
        found = modes(matrix, self.L)
        np.testing.assert_allclose(found, [0.5, -1.0 + 90.0j, -3.0 + 40.0j, -7.0], atol=1e-9)
        growth, hertz = slowest([found[:2], found[2:]], 0.0)
        assert (growth, hertz) == (pytest.approx(0.5), 0.0)
        assert slowest([found], 40.0 / 2.0 / np.pi + 1e-9) == pytest.approx((-1.0, 90.0 / 2.0 / np.pi))
        assert slowest([found], found[2].imag / (2.0 * np.pi)) == pytest.approx((-1.0, 90.0 / 2.0 / np.pi))
        assert slowest([found[2:]], found[2].imag / (2.0 * np.pi)) == pytest.approx(
            (-3.0, 40.0 / 2.0 / np.pi)
        )
        assert np.isnan(slowest([found], 100.0)).all()

    def test_states_that_nothing_reads_are_left_out_and_what_only_they_read(self):
        A = np.array([[0.5, 0.1, 0.0, 0.0], [0.0, 0.4, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1.0, 0.0, 2.0, 0.0]])
        np.testing.assert_array_equal(without_unread(A), A[:2, :2])
        both = np.stack([A, 0.0 * A])
        both[1, 0, 2] = 3.0  # read in one of them
        np.testing.assert_array_equal(without_unread(both), both[:, :3, :3])
        np.testing.assert_allclose(spectral_radius(both), [0.5, 0.0])

    def test_a_stroke_is_start_middle_and_farthest_sample(self):
        q_d = np.array([[2.0, 0.0], [-2.0, 1.0], [4.0, 2.0], [2.0, 0.0]])
        np.testing.assert_array_equal(stroke(q_d), [[2.0, 0.0], [0.0, 0.5], [-2.0, 1.0]])
