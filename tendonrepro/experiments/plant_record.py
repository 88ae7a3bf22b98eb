"""What a trace file says about the plant: enough for someone else to rebuild it from that file alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.fields.quantity import UNITS, Matrix, Scalar, Vector
from tendonrepro.experiments.rig import Experiment, build_drive
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

_MATRICES = {
    "I": ("kg m2", "motor inertia, S_invT diag(winch inertia) S_inv"),
    "D_m": ("N m s rad-1", "motor damping, S_invT diag(winch viscous) S_inv"),
    "K_s": ("N m rad-1", "joint stiffness, S_invT diag(axial stiffness r^2) S_inv"),
    "D_s": ("N m s rad-1", "joint damping, S_invT diag(factor axial damping r^2) S_inv"),
}

_RENAMED = {
    "links_length": "length",
    "links_mass": "mass",
    "links_com": "com",
    "links_inertia": "inertia",
    "routing_winch_diameter": "winch_diameter",
    "routing_pulley_diameter": "pulley_diameter",
    "routing_sign": "sign",
}


def plant_record(config: Experiment) -> PlantRecord:
    """Every value of the plant with its unit and source: matrices of the moving joints, the rest for all."""
    posture = "start posture; joints before the moving ones are held there"
    values = _derived_matrices(config) | {"posture": _plant_value(config.posture, posture)}
    values |= dict(_stated(config.manipulator, ""))
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


def _derived_matrices(config: Experiment) -> dict[str, PlantValue]:
    drive = build_drive(config)
    winch = {
        "I": drive.inertia,
        "D_m": drive.friction.viscous,
        "K_s": drive.stiffness,
        "D_s": drive.damping,
    }
    source = "derived: winch and tendon values through S_inv"
    values = {
        name: PlantValue(to_joint_matrix(winch[name], drive.S_inv), units, source, long_name)
        for name, (units, long_name) in _MATRICES.items()
    }
    routing = "derived: routing diameters and signs, Eq. (2)"
    values["S"] = PlantValue(drive.S, "1", routing, "coupling matrix, q = S q_motor")
    values["S_inv"] = PlantValue(drive.S_inv, "1", routing, "inverse coupling matrix, q_motor = S_inv q")
    return values


def _stated(section: Any, prefix: str) -> list[tuple[str, PlantValue]]:
    """Every quantity of the manipulator, named by its path in the configuration."""
    found: list[tuple[str, PlantValue]] = []
    for key in type(section).model_fields:
        item = getattr(section, key)
        name = f"{prefix}{key}"
        if isinstance(item, Scalar | Vector | Matrix):
            found.append((_RENAMED.get(name, name), _plant_value(item, _meaning(section, key))))
        elif hasattr(type(item), "model_fields"):
            found.extend(_stated(item, f"{name}_"))
    return found


def _meaning(section: Any, key: str) -> str:
    """What the configuration's schema says of a quantity, less its limits and units."""
    description = str(section.model_json_schema()["properties"][key]["description"])
    return description.partition("; one per")[0].partition("; unit")[0]


def _plant_value(quantity: Scalar | Vector | Matrix, long_name: str) -> PlantValue:
    value: Array = np.asarray(quantity.si, dtype=np.float64)
    return PlantValue(value, UNITS[quantity.unit].si, quantity.source, long_name)
