"""What a trace file says about the plant, enough to rebuild it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tendonrepro.configuration.load import Config
from tendonrepro.configuration.quantity import UNITS, Matrix, Physical, Scalar, Vector
from tendonrepro.configuration.strict_model import Model
from tendonrepro.experiments.rig import build_drive
from tendonrepro.physics.kinematics import to_joint_matrix
from tendonrepro.results.records import PlantRecord, PlantValue

ANGLES = (
    "q is the displacement from the start posture, where q and the encoders are zero. The absolute angle of "
    "moving link i is the sum of all posture entries up to its joint plus the sum of q up to it; it is "
    "measured from hanging, positive clockwise as the paper draws it, that is upwards into the working "
    "half-plane between 0 and 180 deg. Gravity turns links back, so holding torques are positive. theta is "
    "the motor angle in joint coordinates, theta = S q_motor, positive where the tendon winds onto its winch."
)

FRICTION = (
    "torque = viscous v + coulomb (1 + (static_ratio - 1) exp(-(v / stribeck_velocity)^2)) "
    "tanh(v / smoothing_velocity); joints in joint velocity, winches in winch velocity S_inv dtheta with the "
    "viscous part winches_viscous, whose joint matrix is D_m. Winches also lose "
    "per_pulley (joint number - 1) |tendon torque| + (1 - reducer_efficiency) |motor torque|, times the "
    "same tanh."
)

EQUATIONS = (
    "tau_m - tau_s = I ddtheta + D_m dtheta + winch friction (3); "
    "tau_s = M ddq + C dq + G + F + tau_d - tendon 4 (4); "
    "tau_s = K_s (theta - q) + D_s (dtheta - dq) (5), "
    "with a dead zone of the whole width tendons_clearance in each tendon, and without pushing where "
    "tendons_unilateral is on: each entry of S^T tau_s is then zero instead of negative; links are a planar "
    "serial chain, the payload a point mass at the tip; tau_m is held from one sample to the next."
)


def plant_record(config: Config) -> PlantRecord:
    """Values with units and sources: matrices of the moving joints, the rest for all."""
    values = _derived_matrices(config) | dict(_stated(config.manipulator, ""))
    posture = "start posture; joints before the moving ones are held there"
    values["posture"] = _plant_value(config.posture, posture)
    held = [joint for joint in range(1, config.manipulator.joints + 1) if joint not in config.joints]
    attributes = {
        "arm": config.manipulator.name,
        "angle_convention": ANGLES,
        "friction_law": FRICTION,
        "equations": EQUATIONS,
        "held_joints": ", ".join(map(str, held)) or "none",
        "moving_joints": ", ".join(map(str, config.joints)),
        "tensioner_side": config.manipulator.tensioner.side,
        "tendons_unilateral": config.manipulator.tendons.unilateral or "off",
        "disturbance": config.disturbance.model_dump_json(),
    }
    return PlantRecord(values, attributes)


def _derived_matrices(config: Config) -> dict[str, PlantValue]:
    drive = build_drive(config)
    source, routing = "derived: winch and tendon values through S_inv", "derived: routing, Eq. (2)"
    values = {
        name: PlantValue(to_joint_matrix(winch, drive.S_inv), units, source, f"{meaning} S_inv")
        for name, winch, units, meaning in (
            ("I", drive.inertia, "kg m2", "motor inertia, S_invT diag(winch inertia)"),
            ("D_m", drive.friction.viscous, "N m s rad-1", "motor damping, S_invT diag(winch viscous)"),
            ("K_s", drive.stiffness, "N m rad-1", "joint stiffness, S_invT diag(axial stiffness r^2)"),
            ("D_s", drive.damping, "N m s rad-1", "joint damping, S_invT diag(factor axial damping r^2)"),
        )
    }
    values["S"] = PlantValue(drive.S, "1", routing, "coupling matrix, q = S q_motor")
    values["S_inv"] = PlantValue(drive.S_inv, "1", routing, "inverse coupling matrix, q_motor = S_inv q")
    return values


def _stated(section: Model, prefix: str) -> Iterator[tuple[str, PlantValue]]:
    """Quantities of the manipulator by their paths in the configuration."""
    for key, item in section:
        name = f"{prefix}{key}"
        if isinstance(item, Scalar | Vector | Matrix):
            rules = type(section).model_fields[key].metadata
            (meaning,) = (rule.about for rule in rules if isinstance(rule, Physical))
            yield name.removeprefix("links_").removeprefix("routing_"), _plant_value(item, meaning)
        elif isinstance(item, Model):
            yield from _stated(item, f"{name}_")


def _plant_value(quantity: Scalar | Vector | Matrix, long_name: str) -> PlantValue:
    return PlantValue(np.asarray(quantity.si), UNITS[quantity.unit].si, quantity.source, long_name)
