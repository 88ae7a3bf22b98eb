"""From a configuration to the plant and its instruments, in SI units, and to what a trace file says of them.

Vectors of a manipulator have one entry per joint. Joints held rigidly come first and drop out here, from the
coupling too: a held joint winds no tendon.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import Config
from tendonrepro.configuration.models.manipulator import DryFriction, EncoderConfig
from tendonrepro.configuration.quantity import UNITS, Matrix, Physical, Scalar, Vector
from tendonrepro.configuration.strict_model import Model
from tendonrepro.physics import drive, loads, statics
from tendonrepro.physics.arm import Arm, make_arm
from tendonrepro.physics.dynamics import Plant
from tendonrepro.results.records import PlantRecord, PlantValue

DISTURBANCE_STREAM = 3
"""Random stream of the disturbance; the streams before it belong to the instruments."""


def coupling(config: Config) -> tuple[Array, Array]:
    """``S`` and ``S_inv`` of the moving joints, (n, n), Eq. (2)."""
    routing, n = config.manipulator.routing, len(config.joints)
    S_inv = drive.coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    S_inv = np.ascontiguousarray(S_inv[-n:, -n:])
    return drive.coupling_matrix(S_inv), S_inv


def start_angles(config: Config) -> Array:
    """Absolute start angles of the moving links, rad from hanging, (n,)."""
    return np.cumsum(config.posture.si)[-len(config.joints) :]


def build_arm(config: Config, payload_mass: float) -> Arm:
    """Chain of the moving links, with a payload in kg at the tip."""
    links, n = config.manipulator.links, len(config.joints)
    return make_arm(
        *(values.si[-n:] for values in (links.length, links.mass, links.com, links.inertia)),
        phi_0=start_angles(config),
        payload_mass=payload_mass,
        gravity=config.manipulator.gravity.si,
    )


def build_drive(config: Config, friction_scale: float = 1.0) -> drive.Drive:
    """Winches and tendons of the moving joints."""
    manipulator, n = config.manipulator, len(config.joints)
    winches, tendons, friction = manipulator.winches, manipulator.tendons, manipulator.friction
    S, S_inv = coupling(config)
    radius = manipulator.routing.winch_diameter.si[-n:] / 2.0
    guide_pulleys = np.array(config.joints, dtype=np.float64) - 1.0
    wobble = manipulator.transmission_error
    return drive.Drive(
        S=S,
        S_inv=S_inv,
        inertia=(winches.reflected_inertia.si + winches.drum_inertia.si)[-n:],
        stiffness=tendons.axial_stiffness.si[-n:] * radius**2,
        damping=tendons.damping_factor.si * tendons.axial_damping.si[-n:] * radius**2,
        slack=tendons.clearance.si[-n:] / (2.0 * radius),
        one_way=np.full(n, float(tendons.unilateral == "on")),
        friction=_friction(friction.winch, winches.viscous, n, friction_scale),
        pulley_loss=friction.per_pulley.si * guide_pulleys,
        reducer_loss=np.full(n, 1.0 - friction.reducer_efficiency.si),
        wobble=np.full(n, wobble.peak_to_peak.si / 2.0),
        wobble_rate=np.full(n, wobble.cycles_per_turn.si),
    )


def _friction(dry: DryFriction, viscous: Vector, n: int, scale: float) -> loads.Friction:
    values = {name: getattr(dry, name).si[-n:] for name in DryFriction.model_fields}
    values["coulomb"] = scale * values["coulomb"]
    return loads.Friction(viscous=scale * viscous.si[-n:], **values)


def build_preload(config: Config) -> Array:
    """Joint torque of tendon 4, N m, positive clockwise, (n,)."""
    tensioner, n = config.manipulator.tensioner, len(config.joints)
    side = statics.tensioner_side(tensioner.side, config.manipulator.joints)
    return statics.tensioner_torque(tensioner.force.si, side, tensioner.diameter.si)[-n:]


def build_disturbance(config: Config) -> loads.Disturbance:
    """Disturbance torque of Eq. (4), the same for every run."""
    choice = config.disturbance
    match choice.kind:
        case "none":
            return loads.no_disturbance(len(config.joints))
        case "step":
            return loads.step_disturbance(choice.torque.si, choice.start.si)
        case "sine":
            return loads.sine_disturbance(choice.torque.si, choice.frequency.si)
        case "noise":
            rng = np.random.default_rng([int(config.seed.si), DISTURBANCE_STREAM])
            components = int(choice.components.si)
            return loads.noise_disturbance(choice.torque.si, choice.band.si, components, rng)


def build_plant(config: Config, payload_mass: float, friction_scale: float = 1.0) -> Plant:
    """Everything that moves, with a payload in kg, and a factor on friction of links and winches."""
    link, n = config.manipulator.friction.link, len(config.joints)
    return Plant(
        arm=build_arm(config, payload_mass),
        drive=build_drive(config, friction_scale),
        link_friction=_friction(link, link.viscous, n, friction_scale),
        preload=build_preload(config),
        disturbance=build_disturbance(config),
    )


def build_encoder(encoder: EncoderConfig) -> drive.Encoder:
    """Encoder of motors or joints."""
    return drive.Encoder(resolution=encoder.resolution.si, noise=encoder.noise.si)


def build_actuator(config: Config) -> drive.Actuator:
    """Motors' limits."""
    actuator = config.manipulator.actuator
    return drive.Actuator(
        limit=actuator.torque_limit.si[-len(config.joints) :],
        resolution=actuator.torque_resolution.si,
        noise=actuator.torque_noise.si,
        delay=int(actuator.output_delay.si),
    )


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
    resting = [joint for joint in range(1, config.manipulator.joints + 1) if joint not in config.joints]
    attributes = {
        "arm": config.manipulator.name,
        "angle_convention": ANGLES,
        "friction_law": FRICTION,
        "equations": EQUATIONS,
        "held_joints": ", ".join(map(str, resting)) or "none",
        "moving_joints": ", ".join(map(str, config.joints)),
        "tensioner_side": config.manipulator.tensioner.side,
        "tendons_unilateral": config.manipulator.tendons.unilateral or "off",
        "disturbance": config.disturbance.model_dump_json(),
    }
    return PlantRecord(values, attributes)


def _derived_matrices(config: Config) -> dict[str, PlantValue]:
    made = build_drive(config)
    source, routing = "derived: winch and tendon values through S_inv", "derived: routing, Eq. (2)"
    values = {
        name: PlantValue(drive.to_joint_matrix(winch, made.S_inv), units, source, f"{meaning} S_inv")
        for name, winch, units, meaning in (
            ("I", made.inertia, "kg m2", "motor inertia, S_invT diag(winch inertia)"),
            ("D_m", made.friction.viscous, "N m s rad-1", "motor damping, S_invT diag(winch viscous)"),
            ("K_s", made.stiffness, "N m rad-1", "joint stiffness, S_invT diag(axial stiffness r^2)"),
            ("D_s", made.damping, "N m s rad-1", "joint damping, S_invT diag(factor axial damping r^2)"),
        )
    }
    values["S"] = PlantValue(made.S, "1", routing, "coupling matrix, q = S q_motor")
    values["S_inv"] = PlantValue(made.S_inv, "1", routing, "inverse coupling matrix, q_motor = S_inv q")
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
