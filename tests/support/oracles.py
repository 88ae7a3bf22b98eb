"""Slow, obvious references for the plant, and random plants to test on.

Nothing here uses the package's physics: the arm comes from the Euler-Lagrange equations of its centres of
mass, the tendons from the lengths of rope that winches and pulleys take up.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import sympy
from numpy.typing import NDArray

from tendonrepro.physics.arm import Arm, make_arm
from tendonrepro.physics.drive import Drive, coupling_inverse, coupling_matrix
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.loads import Disturbance, Friction, no_disturbance, step_disturbance
from tendonrepro.physics.statics import TendonPath

Array = NDArray[np.float64]

SMALLEST = 1e-30
"""Complex step: its square vanishes beside one, so a derivative has only the rounding of the function."""

# ---- Routing -----------------------------------------------------------------------------------------------


def path_length(path: TendonPath) -> Array:
    """Length from where a tendon leaves its winch to its end, m, (T,)."""
    step = np.diff(path.centre, axis=1)
    straight = np.sqrt((step**2).sum(axis=-1) - np.diff(path.radius) ** 2)
    return np.asarray(straight.sum(axis=1) + path.wrap @ np.abs(path.radius))


class Routing(NamedTuple):
    """Diameters in m and signs of Eq. (1)."""

    winch: Array
    pulley: Array
    sign: Array


TABLE_1 = Routing(
    winch=np.array([0.037, 0.037, 0.037]),
    pulley=np.array([[0.077, 0.035, 0.035], [0.0, 0.077, 0.035], [0.0, 0.0, 0.037]]),
    sign=np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]),
)
"""The paper's mechanism, with the signs of its section 3.3."""


def rope_used(q: Array, routing: Routing) -> Array:
    """Length each tendon needs more when the joints turn by q, from the right-hand side of Eq. (1), m."""
    used = []
    for n in range(q.shape[0]):
        length = routing.sign[n, n] * routing.pulley[n, n] / 2 * q[n]
        for i in range(n):
            length = length - routing.sign[i, n] * routing.pulley[i, n] / 2 * q[i]
        used.append(length)
    return np.array(used)


def winch_angles(q: Array, routing: Routing) -> Array:
    """Winch angles that take up that length, rad."""
    return np.array([2 * length / D for length, D in zip(rope_used(q, routing), routing.winch, strict=True)])


def elongation(q: Array, q_motor: Array, routing: Routing) -> Array:
    """Stretch of every tendon when its winch stands at q_motor, m."""
    wound = np.array([D / 2 * angle for D, angle in zip(routing.winch, q_motor, strict=True)])
    return np.asarray(wound - rope_used(q, routing))


def coupling_by_columns(routing: Routing) -> Array:
    """`S_inv`, one unit joint angle at a time."""
    return np.column_stack([winch_angles(column, routing) for column in np.eye(routing.winch.size)])


ROPE = 0.0185 * coupling_by_columns(TABLE_1)
"""Rope of tendons 1 to 3 that the joints' turns wind up, m/rad, (3, 3)."""

TENDON_4 = {
    "negative": np.array([-17.5, -17.5, -18.5]) / 1000.0,
    "distal_only": np.array([0.0, 0.0, -18.5]) / 1000.0,
    "alternating": np.array([-17.5, 17.5, -18.5]) / 1000.0,
}
"""Signed lever of tendon 4 at each joint, m, (3,), by its course."""


# ---- The arm -----------------------------------------------------------------------------------------------


class Links(NamedTuple):
    """Links as someone would measure them."""

    length: Array
    mass: Array
    com: Array
    inertia: Array
    phi_0: Array
    payload_mass: float
    gravity: float

    def arm(self) -> Arm:
        return make_arm(*self[:4], phi_0=self.phi_0, payload_mass=self.payload_mass, gravity=self.gravity)


class Lagrangian(NamedTuple):
    """Functions of (q, dq, ddq, links), generated from symbols."""

    kinetic: Callable[..., Array]
    potential: Callable[..., Array]
    torque: Callable[..., Array]
    """Inverse dynamics: `M ddq + C dq + G` in one."""


@cache
def lagrangian(n: int) -> Lagrangian:
    """Energies and Euler-Lagrange torque of n links and a tip mass, from their positions."""
    q, dq, ddq = (sympy.symbols(f"{name}:{n}") for name in ("q", "dq", "ddq"))
    length, mass, com, inertia, phi_0 = (sympy.symbols(f"{name}:{n}") for name in "lmcJp")
    payload, g = sympy.symbols("payload g")
    joint = sympy.Matrix([0, 0])
    phi: sympy.Expr = sympy.Integer(0)
    T = V = sympy.Integer(0)
    for i in range(n):
        phi = phi_0[i] + sum(q[: i + 1])
        # The arm works on the left of its base: clockwise from hanging is to the left and up.
        along = sympy.Matrix([-sympy.sin(phi), -sympy.cos(phi)])
        T += inertia[i] * sum(dq[: i + 1]) ** 2 / 2
        bodies = [(mass[i], joint + com[i] * along)]
        joint = joint + length[i] * along
        if i == n - 1:
            bodies.append((payload, joint))
        for m, position in bodies:
            velocity = position.jacobian(q) * sympy.Matrix(dq)
            T += m * velocity.dot(velocity) / 2
            V += m * g * position[1]
    state, rate = [*q, *dq], [*dq, *ddq]
    torque = []
    for i in range(n):
        momentum = sympy.diff(T, dq[i])
        momentum_rate = sum(sympy.diff(momentum, x) * dx for x, dx in zip(state, rate, strict=True))
        torque.append(momentum_rate - sympy.diff(T - V, q[i]))
    arguments = (q, dq, ddq, (length, mass, com, inertia, phi_0, payload, g))
    kinetic, potential, inverse = (
        sympy.lambdify(arguments, expression, "numpy", cse=True) for expression in (T, V, torque)
    )
    return Lagrangian(kinetic, potential, lambda *values: np.array(inverse(*values)))


def mass_matrix_by_lagrange(q: Array, links: Links) -> Array:
    """Mass matrix, one unit acceleration at a time, kg m²."""
    n, still = q.size, np.zeros(q.size)
    torque = lagrangian(n).torque
    weight = torque(q, still, still, links)
    return np.column_stack([torque(q, still, column, links) - weight for column in np.eye(n)])


# ---- Plants to test on -------------------------------------------------------------------------------------

FEATURES = frozenset(
    {"damping", "viscous", "coulomb", "stribeck", "clearance", "losses", "wobble", "preload", "step", "sine"}
)
"""What a random plant can have."""

PAPER = FEATURES - {"clearance", "losses", "wobble"}
"""What Eqs. (3) to (5) can hold: F and tau_d are free there, and a preload is a constant part of tau_d."""


class Subject(NamedTuple):
    """A plant, and what it was made of."""

    links: Links
    routing: Routing
    plant: Plant


def random_links(n: int, rng: np.random.Generator) -> Links:
    length = rng.uniform(0.1, 0.4, n)
    mass = rng.uniform(0.1, 1.5, n)
    return Links(
        length=length,
        mass=mass,
        com=length * rng.uniform(0.3, 0.7, n),
        inertia=mass * length**2 * rng.uniform(0.05, 0.12, n),
        phi_0=rng.uniform(0.3, 1.2, n),
        payload_mass=float(rng.uniform(0.0, 0.5)),
        gravity=9.81,
    )


def random_routing(n: int, rng: np.random.Generator) -> Routing:
    """Below its diagonal, which Eq. (2) does not use, the routing holds nonsense."""
    return Routing(
        winch=rng.uniform(0.02, 0.08, n),
        pulley=rng.uniform(0.02, 0.08, (n, n)),
        sign=rng.choice([-1.0, 1.0], (n, n)),
    )


def random_friction(n: int, rng: np.random.Generator, size: float, features: frozenset[str]) -> Friction:
    rough = 1.0 * ("coulomb" in features)
    return Friction(
        viscous=size * rng.uniform(0.5, 2.0, n) * ("viscous" in features),
        coulomb=size * rng.uniform(0.5, 2.0, n) * rough,
        static_ratio=1.0 + rng.uniform(0.1, 0.6, n) * ("stribeck" in features) * rough,
        stribeck_velocity=rng.uniform(0.1, 0.5, n),
        smoothing_velocity=rng.uniform(0.02, 0.2, n),
    )


def random_plant(n: int, seed: int, features: frozenset[str] = FEATURES) -> Subject:
    """Plant of plausible size whose numbers are all different."""
    rng = np.random.default_rng([n, seed])
    links, routing = random_links(n, rng), random_routing(n, rng)
    S_inv = coupling_inverse(*routing)
    has = {feature: 1.0 * (feature in features) for feature in FEATURES}
    drive = Drive(
        S=coupling_matrix(S_inv),
        S_inv=S_inv,
        inertia=rng.uniform(0.05, 0.2, n),
        stiffness=rng.uniform(30.0, 90.0, n),
        damping=rng.uniform(0.1, 0.6, n) * has["damping"],
        slack=rng.uniform(0.01, 0.05, n) * has["clearance"],
        one_way=np.zeros(n),
        friction=random_friction(n, rng, 0.5, features),
        pulley_loss=rng.uniform(0.01, 0.1, n) * has["losses"],
        reducer_loss=rng.uniform(0.1, 0.4, n) * has["losses"],
        wobble=rng.uniform(1e-3, 2e-3, n) * has["wobble"],
        wobble_rate=rng.uniform(100.0, 200.0, n),
    )
    return Subject(
        links,
        routing,
        Plant(
            arm=links.arm(),
            drive=drive,
            link_friction=random_friction(n, rng, 0.05, features),
            preload=rng.uniform(-0.5, 0.5, n) * has["preload"],
            disturbance=_random_disturbance(n, rng, features),
        ),
    )


def _random_disturbance(n: int, rng: np.random.Generator, features: frozenset[str]) -> Disturbance:
    step = rng.uniform(-0.5, 0.5, n)
    made = step_disturbance(step, 0.5) if "step" in features else no_disturbance(n)
    if "sine" in features:
        waves = {"amplitude": rng.uniform(0.1, 0.5, (n, 2)), "phase": rng.uniform(0.1, 6.0, (n, 2))}
        made = made._replace(omega=rng.uniform(2.0, 20.0, 2), **waves)
    return made


def random_state(n: int, rng: np.random.Generator, lanes: tuple[int, ...] = ()) -> Array:
    """Stacked q, dq, theta, dtheta with tendons stretched by tenths of a radian."""
    q, dq, dtheta = rng.uniform(-1.0, 1.0, (3, n, *lanes))
    theta = q + rng.uniform(-0.2, 0.2, (n, *lanes))
    return np.concatenate([q, dq, theta, dtheta])


# ---- The flexible arm with the paper's matrices ------------------------------------------------------------


def friction_by_formula(velocity: Array, friction: Friction) -> Array:
    torque = [
        viscous * v + coulomb * (1 + (ratio - 1) * np.exp(-((v / fading) ** 2))) * np.tanh(v / smooth)
        for v, viscous, coulomb, ratio, fading, smooth in zip(velocity, *friction, strict=True)
    ]
    return np.array(torque)


def disturbance_by_formula(t: float, disturbance: Disturbance) -> Array:
    step = disturbance.step if t >= disturbance.start else 0.0 * disturbance.step
    sines = disturbance.amplitude * np.sin(disturbance.omega * t + disturbance.phase)
    return np.asarray(step + sines.sum(axis=1))


class JointMatrices(NamedTuple):
    """`I`, `D_m`, `K_s`, `D_s` of Eqs. (3) and (5)."""

    I: Array
    D_m: Array
    K_s: Array
    D_s: Array


def joint_matrices(subject: Subject) -> JointMatrices:
    drive, S_inv = subject.plant.drive, coupling_by_columns(subject.routing)
    winch_values = (drive.inertia, drive.friction.viscous, drive.stiffness, drive.damping)
    return JointMatrices(*(S_inv.T @ np.diag(values) @ S_inv for values in winch_values))


def accelerations_by_matrices(t: float, state: Array, tau_m: Array, subject: Subject) -> tuple[Array, Array]:
    """Solve Eqs. (3) to (5) for `ddq` and `ddtheta`, all in joint coordinates; only for features of PAPER."""
    q, dq, theta, dtheta = np.split(state, 4)
    plant, S_inv = subject.plant, coupling_by_columns(subject.routing)
    matrix = joint_matrices(subject)
    tau_s = matrix.K_s @ (theta - q) + matrix.D_s @ (dtheta - dq)
    bias = lagrangian(q.size).torque(q, dq, np.zeros(q.size), subject.links)
    F = friction_by_formula(dq, plant.link_friction)
    tau_d = disturbance_by_formula(t, plant.disturbance) - plant.preload
    dry = plant.drive.friction._replace(viscous=0.0 * dtheta)
    winch_dry = S_inv.T @ friction_by_formula(S_inv @ dtheta, dry)
    ddq = np.linalg.solve(mass_matrix_by_lagrange(q, subject.links), tau_s - bias - F - tau_d)
    ddtheta = np.linalg.solve(matrix.I, tau_m - tau_s - matrix.D_m @ dtheta - winch_dry)
    return ddq, ddtheta


def turned(motor: Array, drive: Drive) -> Array:
    """Winch angles behind reducers with a transmission error, rad."""
    return np.asarray(motor + drive.wobble * np.sin(drive.wobble_rate * motor))


def stretch_energy(q: Array, theta: Array, subject: Subject) -> Array:
    """Energy in the tendons from their elongation and axial stiffness, J; a clearance stores none."""
    drive, radius = subject.plant.drive, subject.routing.winch / 2
    stretch = elongation(q, turned(winch_angles(theta, subject.routing), drive), subject.routing)
    free = drive.slack * radius
    pulled = np.where(np.abs(stretch.real) > free, stretch - np.sign(stretch.real) * free, 0.0)
    return np.asarray((drive.stiffness / radius**2 * pulled**2 / 2).sum())


def total_energy(state: Array, subject: Subject) -> Array:
    """Energy of arm, winches, tendons and constant preload, J."""
    q, dq, theta, dtheta = np.split(state, 4)
    arm = lagrangian(q.size)
    energy = arm.kinetic(q, dq, 0.0 * q, subject.links) + arm.potential(q, dq, 0.0 * q, subject.links)
    energy = energy + (subject.plant.drive.inertia * winch_angles(dtheta, subject.routing) ** 2).sum() / 2
    return np.asarray(energy + stretch_energy(q, theta, subject) - (subject.plant.preload * q).sum())


def slope(function: Callable[[Array], Array], at: Array, along: Array) -> Array:
    """Derivative of a function at a point along a direction, to rounding."""
    return np.asarray(function(at + 1j * SMALLEST * along)).imag / SMALLEST
