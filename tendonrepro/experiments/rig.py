"""From a configuration to the plant and its instruments, in SI units.

Vectors of a manipulator have one entry per joint. Joints held rigidly come first and drop out here, from the
coupling too: a held joint winds no tendon.
"""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import Config
from tendonrepro.configuration.models.manipulator import DryFriction, EncoderConfig
from tendonrepro.configuration.quantity import Vector
from tendonrepro.physics import disturbance
from tendonrepro.physics.arm import Arm, make_arm
from tendonrepro.physics.drive import Drive
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.friction import Friction
from tendonrepro.physics.instruments import Actuator, Encoder
from tendonrepro.physics.kinematics import coupling_inverse, coupling_matrix
from tendonrepro.physics.statics import tensioner_side, tensioner_torque

DISTURBANCE_STREAM = 3
"""Random stream of the disturbance; the streams before it belong to the instruments."""


def coupling(config: Config) -> tuple[Array, Array]:
    """``S`` and ``S_inv`` of the moving joints, (n, n), Eq. (2)."""
    routing, n = config.manipulator.routing, len(config.joints)
    S_inv = coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    S_inv = np.ascontiguousarray(S_inv[-n:, -n:])
    return coupling_matrix(S_inv), S_inv


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


def build_drive(config: Config) -> Drive:
    """Winches and tendons of the moving joints."""
    manipulator, n = config.manipulator, len(config.joints)
    winches, tendons, friction = manipulator.winches, manipulator.tendons, manipulator.friction
    S, S_inv = coupling(config)
    radius = manipulator.routing.winch_diameter.si[-n:] / 2.0
    guide_pulleys = np.array(config.joints, dtype=np.float64) - 1.0
    wobble = manipulator.transmission_error
    return Drive(
        S=S,
        S_inv=S_inv,
        inertia=(winches.reflected_inertia.si + winches.drum_inertia.si)[-n:],
        stiffness=tendons.axial_stiffness.si[-n:] * radius**2,
        damping=tendons.damping_factor.si * tendons.axial_damping.si[-n:] * radius**2,
        slack=tendons.clearance.si[-n:] / (2.0 * radius),
        one_way=np.full(n, float(tendons.unilateral == "on")),
        friction=_friction(friction.winch, winches.viscous, n),
        pulley_loss=friction.per_pulley.si * guide_pulleys,
        reducer_loss=np.full(n, 1.0 - friction.reducer_efficiency.si),
        wobble=np.full(n, wobble.peak_to_peak.si / 2.0),
        wobble_rate=np.full(n, wobble.cycles_per_turn.si),
    )


def _friction(dry: DryFriction, viscous: Vector, n: int) -> Friction:
    values = {name: getattr(dry, name).si[-n:] for name in DryFriction.model_fields}
    return Friction(viscous=viscous.si[-n:], **values)


def build_preload(config: Config) -> Array:
    """Joint torque of tendon 4, N m, positive clockwise, (n,)."""
    tensioner, n = config.manipulator.tensioner, len(config.joints)
    side = tensioner_side(tensioner.side, config.manipulator.joints)
    return tensioner_torque(tensioner.force.si, side, tensioner.diameter.si)[-n:]


def build_disturbance(config: Config) -> disturbance.Disturbance:
    """Disturbance torque of Eq. (4), the same for every run."""
    choice = config.disturbance
    match choice.kind:
        case "none":
            return disturbance.no_disturbance(len(config.joints))
        case "step":
            return disturbance.step_disturbance(choice.torque.si, choice.start.si)
        case "sine":
            return disturbance.sine_disturbance(choice.torque.si, choice.frequency.si)
        case "noise":
            rng = np.random.default_rng([int(config.seed.si), DISTURBANCE_STREAM])
            components = int(choice.components.si)
            return disturbance.noise_disturbance(choice.torque.si, choice.band.si, components, rng)


def build_plant(config: Config, payload_mass: float) -> Plant:
    """Everything that moves, with a payload in kg."""
    link, n = config.manipulator.friction.link, len(config.joints)
    return Plant(
        arm=build_arm(config, payload_mass),
        drive=build_drive(config),
        link_friction=_friction(link, link.viscous, n),
        preload=build_preload(config),
        disturbance=build_disturbance(config),
    )


def build_encoder(encoder: EncoderConfig) -> Encoder:
    """Encoder of motors or joints."""
    return Encoder(resolution=encoder.resolution.si, noise=encoder.noise.si)


def build_actuator(config: Config) -> Actuator:
    """Motors' limits."""
    actuator = config.manipulator.actuator
    return Actuator(
        limit=actuator.torque_limit.si[-len(config.joints) :],
        resolution=actuator.torque_resolution.si,
        noise=actuator.torque_noise.si,
        delay=int(actuator.output_delay.si),
    )
