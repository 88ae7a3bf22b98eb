"""The manipulator: what the paper's Eqs. (1) to (5) need, most of it unpublished."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from tendonrepro.configuration.quantity import Joints, Matrix, Physical, Scalar, nonneg, positive, wrong_sizes
from tendonrepro.configuration.strict_model import Mistakes, Model, SchemaVersion

MOST_JOINTS = 6
"""Joints of an arm that is completed; its postures and loads are tried up to here."""


class Routing(Model):
    """Winches, pulleys and the sides tendons pass them on: all that Eqs. (1) and (2) need."""

    winch_diameter: Annotated[Joints, positive("m", "winch diameter D_n", usual=(1e-3, 1.0))]
    pulley_diameter: Annotated[
        Matrix, nonneg("m", "pulley diameter D_pq, joint p (row), tendon q (column)", usual=(1e-3, 1.0))
    ]
    sign: Annotated[
        Matrix,
        Physical("1", "side c_pq, joint p (row), tendon q (column)", at_least=-1.0, at_most=1.0, whole=True),
    ]

    def _mistakes(self) -> Mistakes:
        below = "must be 0, as the tendon of this column does not pass the joint of this row"
        own = "must not be 0, else the coupling matrix is singular"
        for name, matrix in (("pulley_diameter", self.pulley_diameter), ("sign", self.sign)):
            for i, row in enumerate(matrix.value):
                for j, entry in enumerate(row):
                    # Above the diagonal 0 is a tendon that passes a joint without a pulley.
                    if entry != 0.0 if i > j else i == j and entry == 0.0:
                        yield (name, "value", i, j), below if i > j else own


class Links(Model):
    """Rigid links from one joint axis to the next; the last one ends at the tool."""

    length: Annotated[Joints, positive("m", "link length", usual=(0.01, 10.0))]
    mass: Annotated[Joints, positive("kg", "link mass", usual=(1e-3, 1e3))]
    com: Annotated[Joints, nonneg("m", "centre of mass from the proximal axis", usual=(1e-3, 10.0))]
    inertia: Annotated[Joints, positive("kg m2", "inertia about the centre of mass", usual=(1e-8, 1e4))]


class Winches(Model):
    """Motor side of Eq. (3), per winch, after the reducer."""

    reduction: Annotated[Scalar, positive("1", "turns of a motor per turn of its winch", usual=(0.1, 1e4))]
    reflected_inertia: Annotated[
        Joints, positive("kg m2", "rotor and reducer inertia at the winch", usual=(1e-8, 1e3))
    ]
    drum_inertia: Annotated[Joints, nonneg("kg m2", "inertia of the drum", usual=(1e-9, 1e3))]
    viscous: Annotated[Joints, nonneg("N m s rad-1", "viscous damping D_m at the winch", usual=(1e-7, 1e4))]


class Tendons(Model):
    """Elasticity of Eq. (5), per tendon, and assembly clearance."""

    axial_stiffness: Annotated[Joints, positive("N m-1", "axial stiffness of a tendon", usual=(1e2, 1e9))]
    axial_damping: Annotated[Joints, nonneg("N s m-1", "axial damping of a tendon", usual=(1e-2, 1e7))]
    damping_factor: Annotated[Scalar, positive("1", "common factor on the axial damping")]
    clearance: Annotated[
        Joints, nonneg("m", "slack a tendon takes up before it pulls; 0 is none", usual=(1e-6, 0.05))
    ]
    unilateral: Literal["off", "on"] | None = None
    """on: a tendon that would push goes slack; without the key it pushes, Eq. (5)"""


class DryFriction(Model):
    """Coulomb and static friction, per joint or winch."""

    coulomb: Annotated[Joints, nonneg("N m", "Coulomb friction", usual=(1e-6, 1e3))]
    static_ratio: Annotated[Joints, Physical("1", "static over Coulomb friction", at_least=1.0)]
    stribeck_velocity: Annotated[Joints, positive("rad s-1", "Stribeck velocity")]
    smoothing_velocity: Annotated[Joints, positive("rad s-1", "velocity over which the sign is smoothed")]


class LinkFriction(DryFriction):
    """Friction F(q, dq) of Eq. (4), per joint."""

    viscous: Annotated[Joints, nonneg("N m s rad-1", "viscous friction of a joint", usual=(1e-7, 1e4))]


class FrictionConfig(Model):
    """All friction of the mechanism."""

    link: LinkFriction
    winch: Annotated[DryFriction, Field(description="motor and reducer; the viscous part is winches.viscous")]
    per_pulley: Annotated[
        Scalar, nonneg("1", "share of the tension lost at each guide pulley; 0 is off", below=1.0)
    ]
    reducer_efficiency: Annotated[Scalar, positive("1", "efficiency of the reducer; 1 is off", at_most=1.0)]


class Tensioner(Model):
    """The extra tendon that keeps the others taut; no published equation holds it."""

    force: Annotated[Scalar, nonneg("N", "constant force on the tendon; 0 is off", usual=(1e-2, 1e5))]
    diameter: Annotated[Joints, positive("m", "diameter it passes at each joint", usual=(1e-3, 1.0))]
    side: Literal["negative", "distal_only", "alternating"]
    """on which side of the joints the tensioning tendon passes"""


class TransmissionError(Model):
    """Periodic position error of the reducer."""

    peak_to_peak: Annotated[
        Scalar, nonneg("rad", "peak-to-peak error at the winch; 0 is off", usual=(1e-8, 0.2))
    ]
    cycles_per_turn: Annotated[Scalar, positive("1", "cycles per turn of the winch")]


class EncoderConfig(Model):
    """An incremental encoder that reads zero at the start posture."""

    resolution: Annotated[Scalar, nonneg("rad", "angle of one count; 0 is ideal", usual=(1e-9, 0.1))]
    noise: Annotated[Scalar, nonneg("rad", "RMS noise of a reading; 0 is off")]


class Encoders(Model):
    """The two kinds of encoder."""

    joint: Annotated[EncoderConfig, Field(description="encoders on the joints")]
    motor: Annotated[EncoderConfig, Field(description="encoders of the motors, as angles of the winch")]


class ActuatorConfig(Model):
    """From commanded to applied torque, at the winch."""

    torque_limit: Annotated[Joints, positive("N m", "saturation at the winch", usual=(1e-3, 1e5))]
    torque_resolution: Annotated[Scalar, nonneg("N m", "step of the torque command at the winch; 0 is off")]
    torque_noise: Annotated[Scalar, nonneg("N m", "RMS torque noise at the winch; 0 is off")]
    output_delay: Annotated[Scalar, nonneg("1", "delay of the command in samples", at_most=100.0, whole=True)]


class Manipulator(Model):
    """A planar serial chain driven by one tendon per joint."""

    schema_version: SchemaVersion
    name: Annotated[str, Field(min_length=1, description="name for titles and tables")]
    gravity: Annotated[Scalar, nonneg("m s-2", "gravitational acceleration", usual=(0.1, 30.0))]
    routing: Routing
    links: Links
    winches: Winches
    tendons: Tendons
    friction: FrictionConfig
    tensioner: Tensioner
    transmission_error: TransmissionError
    encoders: Encoders
    actuator: ActuatorConfig

    def _mistakes(self) -> Mistakes:
        return wrong_sizes(self, {"joints": self.joints})

    @property
    def joints(self) -> int:
        """Number of joints, and of motors."""
        return len(self.routing.winch_diameter.value)
