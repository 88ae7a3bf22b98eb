"""From the shipped configurations to plants; most laws of the plant itself are tested on random ones."""

import numpy as np
import pytest
from support.overrides import on_plain_arm, quantity

from tendonrepro.experiments import rig
from tendonrepro.physics.arm import bias_torque, mass_matrix
from tendonrepro.physics.drive import to_joint_matrix
from tendonrepro.physics.loads import disturbance_torque


def config_of(experiment, *overrides):
    """On the plain arm, whose numbers are worked by hand here."""
    return on_plain_arm(experiment, *overrides).config


def arm_with(*keys):
    """Configuration of the comparison with other values of the arm."""
    return config_of("compare", *(f"manipulator.{key}" for key in keys))


COMPARE, DECOUPLE = config_of("compare"), config_of("decouple")


def test_coupling_with_joint_1_held_is_the_trailing_block():
    S, S_inv = rig.coupling(COMPARE)
    assert 37.0 * S_inv == pytest.approx(np.array([[77.0, 0.0], [-35.0, 37.0]]), rel=1e-14)
    assert np.abs(S).round(4).tolist() == [[0.4805, 0], [0.4545, 1]]
    assert S_inv.flags.c_contiguous


class TestArm:
    def test_posture_gives_absolute_angles_from_hanging(self):
        for experiment, angles in (("decouple", [40.0, 60.0, 50.0]), ("compare", [60.0, 50.0])):
            bent = config_of(experiment, "posture=[40, 20, -10]")
            assert np.rad2deg(rig.start_angles(bent)) == pytest.approx(angles)

    def test_joint_1_held_leaves_the_trailing_block(self):
        whole, held = rig.build_arm(DECOUPLE, 0.2), rig.build_arm(COMPARE, 0.2)
        q, dq = np.array([0.0, 0.3, -0.2]), np.array([0.0, 1.0, 2.0])
        assert mass_matrix(q[1:], held) == pytest.approx(mass_matrix(q, whole)[1:, 1:], rel=1e-14)
        assert bias_torque(q[1:], dq[1:], held) == pytest.approx(bias_torque(q, dq, whole)[1:], rel=1e-14)


class TestDrive:
    def test_joint_matrices_of_two_joints(self):
        """By hand: own tendon on the diagonal, tendon 3 over the guide pulley of joint 2 beside it."""
        drive = rig.build_drive(COMPARE)
        guide = 35.0 / 37.0
        K_s = [[280.0 + guide**2 * 100.0, -guide * 100.0], [-guide * 100.0, 100.0]]
        assert to_joint_matrix(drive.stiffness, drive.S_inv) == pytest.approx(np.array(K_s), rel=1e-5)
        I = np.array([[77.0**2 + 35.0**2, -35.0 * 37.0], [-35.0 * 37.0, 37.0**2]]) / 37.0**2 * 0.108032
        assert to_joint_matrix(drive.inertia, drive.S_inv) == pytest.approx(I, rel=1e-12)

    @pytest.mark.parametrize(
        ("experiment", "override", "field", "value"),
        [
            # Half of it over the winch radius.
            ("compare", "tendons.clearance=[0.1, 0.37, 0.74]", "slack", [0.01, 0.02]),
            # A tendon passes one guide pulley per joint before its own.
            ("decouple", "friction.per_pulley=0.03", "pulley_loss", [0.0, 0.03, 0.06]),
            # What the reducer does not pass on is lost.
            ("compare", "friction.reducer_efficiency=0.7", "reducer_loss", [0.3, 0.3]),
            ("compare", "transmission_error.peak_to_peak=4.4e-4", "wobble", [2.2e-4, 2.2e-4]),
            # Times the common factor of the plain arm, 5.
            ("compare", "tendons.axial_damping=[1, 2, 3]", "damping", [10.0 * 0.0185**2, 15.0 * 0.0185**2]),
        ],
    )
    def test_losses_and_play(self, experiment, override, field, value):
        drive = rig.build_drive(config_of(experiment, f"manipulator.{override}"))
        assert getattr(drive, field) == pytest.approx(value, rel=1e-12)


def test_tensioner_torque_at_each_joint():
    assert (rig.build_preload(COMPARE) == 0.0).all()
    assert rig.build_preload(arm_with("tensioner.force=20")) == pytest.approx(
        [-20.0 * 0.0175, -20.0 * 0.0185], rel=1e-14
    )


class TestDisturbance:
    def test_torques(self):
        step = self.of_kind("step", torque=("N m", [0.1, 0.2]), start=("s", 1.5))
        sine = self.of_kind("sine", torque=("N m", [0.1, 0.2]), frequency=("Hz", 5))
        on, off = [0.1, 0.2], [0.0, 0.0]
        none = rig.build_disturbance(COMPARE)
        for made, time, torque in ((none, 1.0, off), (step, 1.4999, off), (step, 1.5, on), (sine, 0.05, on)):
            assert [disturbance_torque(time, i, made) for i in range(2)] == pytest.approx(torque)

    def test_noise_follows_the_seed(self):
        fields = {"torque": ("N m", [0.1, 0.2]), "band": ("Hz", [1, 5]), "components": ("1", 40)}
        first, again, other = (self.of_kind("noise", f"seed={seed}", **fields) for seed in (1, 1, 2))
        assert (first.phase == again.phase).all()
        assert (first.phase != other.phase).all()
        assert first.omega.size == 40
        assert ((2.0 * np.pi <= first.omega) & (first.omega <= 10.0 * np.pi)).all()
        assert np.sqrt((first.amplitude**2).sum(axis=1) / 2.0) == pytest.approx([0.1, 0.2])

    @staticmethod
    def of_kind(kind, *overrides, **fields):
        body = ", ".join(f"{name}: {quantity(value, unit)}" for name, (unit, value) in fields.items())
        return rig.build_disturbance(
            config_of("compare", f"disturbance={{kind: {kind}, {body}}}", *overrides)
        )


def test_actuator_takes_the_limits_of_the_moving_joints():
    keys = ("torque_limit=[30, 31, 32]", "torque_resolution=0.016", "output_delay=1")
    actuator = rig.build_actuator(arm_with(*(f"actuator.{key}" for key in keys)))
    assert actuator.limit.tolist() == [31.0, 32.0]
    assert actuator[1:] == (0.016, 0.0, 1)


def test_values_of_held_joints_drop_out():
    """Every per-joint value of joint 1 changed, and the plant of joints 2 and 3 stays the same."""
    first = {
        "links.mass": "[9, 0.47, 0.22]",
        "links.com": "[0.2, 0.1344, 0.096]",
        "links.length": "[0.4, 0.28, 0.20]",
        "winches.reflected_inertia": "[9, 0.108, 0.108]",
        "winches.viscous": "[9, 1, 1]",
        "tendons.axial_stiffness": "[9e5, 188902.0, 292184.1]",
        "tendons.clearance": "[1, 0, 0]",
        "friction.link.coulomb": "[9, 0.045, 0.045]",
        "friction.winch.coulomb": "[9, 0, 0]",
    }
    changed = arm_with(*(f"{key}={values}" for key, values in first.items()))
    np.testing.assert_equal(rig.build_plant(changed, 0.0), rig.build_plant(COMPARE, 0.0))


def test_friction_of_joints_and_winches_is_not_mixed_up_and_its_factor_leaves_shapes_alone():
    fields = ("coulomb", "static_ratio", "stribeck_velocity", "smoothing_velocity")
    keys = ["friction.link.viscous=[1, 7, 8]", "winches.viscous=[1, 9, 10]"]
    for part, first in (("link", 2), ("winch", 20)):
        keys += [f"friction.{part}.{field}=[1, {k}, {k + 1}]" for k, field in enumerate(fields, first)]
    plant = rig.build_plant(arm_with(*keys), 0.0, friction_scale=2.0)
    links, winches = ([field.tolist() for field in f] for f in (plant.link_friction, plant.drive.friction))
    assert links == [[14, 16], [4, 6], [3, 4], [4, 5], [5, 6]]
    assert winches == [[18, 20], [40, 42], [21, 22], [22, 23], [23, 24]]
