"""Tensions at rest over the postures of the working half-plane, for every course of tendon 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.models.box import BoxRange
from tendonrepro.configuration.published import published
from tendonrepro.errors import ConfigError
from tendonrepro.experiments.rig import Experiment, build_arm, coupling
from tendonrepro.physics.arm import Arm, gravity_torque, joint_angles
from tendonrepro.physics.statics import (
    SLACK,
    TENSIONER_SIDES,
    Spring,
    force_window,
    sign_of_side,
    spring_force,
    tendon_tension,
    tension_with_losses,
    tensioner_side,
    tensioner_stretch,
    tensioner_torque,
)
from tendonrepro.results.paper import is_arm_of_paper

COURSES = tuple(TENSIONER_SIDES)
"""Ways in which tendon 4 may pass the joints: values of the reading `tensioner`."""

RESERVE = 5.0
"""Tension that should be left, N; at a 37 mm winch a disturbance of 0.09 N m takes it away."""

STRETCH = 0.1
"""How far the spring is stretched in the start posture, m; it then pulls as hard as the motor."""

CASES = ("motor", "payload", "spring")
"""Tendon 4 by a motor without and with the payload of section 5.4; by a spring, without payload."""

_MAP = np.linspace(0.0, np.pi, 91)
_MOST_POSTURES = 5e4
_FINEST = 36


class Mechanism(NamedTuple):
    """Routing of the n moving joints.

    ``S`` (n, n), ``winch`` diameters (n,), m; ``side`` and ``diameter`` (n, n + 1) of every tendon at every
    joint, tendon 4 last, m; ``phi_0`` (n,) the links' start angles, rad.
    """

    S: Array
    winch: Array
    side: Array
    diameter: Array
    phi_0: Array


@dataclass(frozen=True)
class Course:
    """What one course of tendon 4 gives; A angles along each side of a map.

    Attributes
    ----------
    per_newton : array (n,)
        Tension that a newton of tendon 4 adds to each tendon.
    travel : float
        Range of tendon 4's length over the half-plane, m.
    least : mapping of str to array (A, A)
        Smallest tension of any tendon by case, N, on the map.
    band : array (2, A, A)
        Lowest and highest such tension of the case ``motor`` with friction of the guide pulleys.
    needed : array (A, A)
        Least force of tendon 4 that leaves the reserve to every tendon it can reach, N, on the map.
    room : array (A, A)
        N, below zero where no force leaves the reserve to all: by how much too little some tendon has that
        tendon 4 does not reach, or by how much the least force is above the largest.
    over_all : mapping of str to dict
        By case, over the whole half-plane: see :func:`_over_all`.
    """

    per_newton: Array
    travel: float
    least: Mapping[str, Array]
    band: Array
    needed: Array
    room: Array
    over_all: Mapping[str, dict[str, Any]]


@dataclass(frozen=True)
class Survey:
    """Tensions of an arm; angles in rad, of links, from hanging.

    ``fixed`` are the angles of the moving links that the maps hold, ``angles`` (A,) those of the last two
    links; ``force`` N, ``payload`` kg and ``loss`` come with the source of each.
    """

    joints: tuple[int, ...]
    held: tuple[int, ...]
    posture: Array
    fixed: Array
    angles: Array
    force: float
    loss: float
    payload: float
    sources: Mapping[str, str]
    gravity_alone: Array
    postures: int
    nearest_edge: float
    courses: Mapping[str, Course]
    origin: str
    of_paper: bool


def survey(loaded: LoadedConfig) -> Survey:
    """Work out tensions over the half-plane.

    Raises
    ------
    ConfigError
        If fewer than two joints move.
    """
    config = loaded.config
    n = len(config.joints)
    if n < 2:
        message = f"maps are over the angles of two links, but {n} joint moves"
        raise ConfigError(message, where="joints")
    force, force_source = _value_or_box(config.manipulator.tensioner.force.si, "tensioner_force")
    loss, loss_source = _value_or_box(config.manipulator.friction.per_pulley.si, "pulley_loss")
    payload = published().number("hardware.payload")
    arms = {"motor": build_arm(config, 0.0), "payload": build_arm(config, payload)}
    arms["spring"] = arms["motor"]
    postures = map_postures(config), half_plane(n)
    routing = {course: mechanism(config, course) for course in COURSES}
    weight = _weight_tension(postures[1], arms["motor"], routing[COURSES[0]])
    found = {course: _course(config, arms, route, force, loss, postures) for course, route in routing.items()}
    absolute = np.cumsum(config.posture.si)
    return Survey(
        joints=tuple(config.joints),
        held=tuple(k for k in range(1, config.manipulator.joints + 1) if k not in config.joints),
        posture=absolute,
        fixed=absolute[-n:-2],
        angles=_MAP,
        force=force,
        loss=loss,
        payload=payload,
        sources={"force": force_source, "loss": loss_source, "payload": "printed: section 5.4"},
        gravity_alone=weight.min(axis=1),
        postures=postures[1].shape[1],
        nearest_edge=float(postures[1].min()),
        courses=found,
        origin=f"{loaded.origin} (sha256 {loaded.sha256[:12]})",
        of_paper=is_arm_of_paper(config.manipulator),
    )


def _value_or_box(configured: float, row: str) -> tuple[float, str]:
    """A value of the configuration or, where that switches the effect off, the nominal of the box."""
    if configured > 0.0:
        return configured, "as configured"
    held = dict(load_ensemble(None).config.box)[row]
    assert isinstance(held, BoxRange)
    return held.nominal, f"off in the configuration; nominal of the box, {held.low:g} to {held.high:g}"


def mechanism(config: Experiment, course: str) -> Mechanism:
    """Routing of the moving joints with tendon 4 on a course; sides follow from the signs of Eq. (1)."""
    manipulator, n = config.manipulator, len(config.joints)
    routing, joints = manipulator.routing, manipulator.joints
    own = sign_of_side(routing.sign.si)
    side = np.column_stack([own, tensioner_side(course, joints)])
    diameter = np.column_stack([routing.pulley_diameter.si, manipulator.tensioner.diameter.si])
    S, _ = coupling(config)
    phi_0 = np.cumsum(config.posture.si)[-n:]
    return Mechanism(S, routing.winch_diameter.si[-n:], side[-n:, -n - 1 :], diameter[-n:, -n - 1 :], phi_0)


def map_postures(config: Experiment) -> Array:
    """Link angles of a map, (n, A, A), rad: the last link upwards, the one before across, the others held."""
    n = len(config.joints)
    held = np.cumsum(config.posture.si)[-n:]
    last, before = np.meshgrid(_MAP, _MAP, indexing="ij")
    return np.stack([*(np.full_like(last, angle) for angle in held[:-2]), before, last])


def half_plane(n: int) -> Array:
    """Link angles of n links spread evenly over the half-plane, (n, P), rad: centres of cells, no edges."""
    cells = min(_FINEST, int(_MOST_POSTURES ** (1.0 / n)))
    centres = (np.arange(cells) + 0.5) * np.pi / cells
    return np.stack(np.meshgrid(*[centres] * n, indexing="ij")).reshape(n, -1)


def tensions(phi: Array, arm: Arm, route: Mechanism, spring: Spring) -> Array:
    """Tensions of the motors' tendons at rest, N, (n, ...), at link angles ``phi`` (n, ...), rad."""
    return tendon_tension(_load(phi, arm, route, spring), route.S, route.winch)


def _load(phi: Array, arm: Arm, route: Mechanism, spring: Spring) -> Array:
    """Joint torque of the weight less that of tendon 4, N m."""
    q = joint_angles(phi, route.phi_0)
    side, diameter = route.side[:, -1], route.diameter[:, -1]
    pull = spring_force(tensioner_stretch(q, side, diameter), spring)
    return gravity_torque(q, arm) - tensioner_torque(pull, side, diameter)


def _weight_tension(phi: Array, arm: Arm, route: Mechanism) -> Array:
    weight = gravity_torque(joint_angles(phi, route.phi_0), arm)
    return tendon_tension(weight, route.S, route.winch)


def _course(
    config: Experiment,
    arms: Mapping[str, Arm],
    route: Mechanism,
    force: float,
    loss: float,
    postures: tuple[Array, Array],
) -> Course:
    grid, all_over = postures
    springs = dict.fromkeys(CASES, Spring(force, 0.0)) | {"spring": Spring(force, force / STRETCH)}
    side, diameter = route.side[:, -1], route.diameter[:, -1]
    per_newton = tendon_tension(-tensioner_torque(1.0, side, diameter), route.S, route.winch)
    # Diameters that cancel leave rounding behind.
    per_newton = np.where(np.abs(per_newton) < SLACK, 0.0, per_newton)
    stretch = tensioner_stretch(joint_angles(all_over, route.phi_0), side, diameter)
    corners = np.stack(np.meshgrid(*[[0.0, np.pi]] * len(side), indexing="ij")).reshape(len(side), -1)
    ends = tensioner_stretch(joint_angles(corners, route.phi_0), side, diameter)
    needed, room = _force_map(_weight_tension(grid, arms["motor"], route), per_newton)
    return Course(
        per_newton=per_newton,
        travel=float(np.ptp(ends)),
        least={case: tensions(grid, arms[case], route, springs[case]).min(axis=0) for case in CASES},
        band=friction_band(grid, arms["motor"], route, force, loss),
        needed=needed,
        room=room,
        over_all={
            case: _over_all(
                all_over,
                _weight_tension(all_over, arms[case], route),
                tensions(all_over, arms[case], route, springs[case]),
                spring_force(stretch, springs[case]),
                per_newton,
                tuple(config.joints),
            )
            for case in CASES
        },
    )


def _force_map(weight: Array, per_newton: Array) -> tuple[Array, Array]:
    """Fill ``needed`` and ``room`` of a course from the tensions of the weight, N, (n, A, A)."""
    reached = per_newton != 0.0
    least, largest = force_window(weight[reached], per_newton[reached], RESERVE)
    beyond = np.min(weight[~reached] - RESERVE, axis=0, initial=np.inf)
    return least, np.minimum(largest - least, beyond)


def friction_band(phi: Array, arm: Arm, route: Mechanism, force: float, loss: float) -> Array:
    """Lowest and highest of the smallest tension, N, (2, ...), over all ways in which pulleys may hold rope.

    Between its ends the tension of a tendon is monotonic in what each pulley passes on, so the extremes are
    where every tendon is on the point of moving one way or the other.
    """
    weight = gravity_torque(joint_angles(phi, route.phi_0), arm)
    pull = np.full(weight.shape[1:], force)
    found = [
        tension_with_losses(weight, pull, route.side, route.diameter, 1.0 + loss * np.array(senses)).min(
            axis=0
        )
        for senses in product((-1.0, 1.0), repeat=route.side.shape[1])
    ]
    return np.stack([np.min(found, axis=0), np.max(found, axis=0)])


def _over_all(
    phi: Array, weight: Array, tension: Array, pull: Array, per_newton: Array, joints: tuple[int, ...]
) -> dict[str, Any]:
    """Smallest tension of any tendon over postures (n, P): value, tendon, posture; share that are tense."""
    least = tension.min(axis=0)
    place = int(least.argmin())
    lowest, highest = force_window(weight, per_newton)
    return {
        "least_tension_N": float(least[place]),
        "tendon": joints[int(tension[:, place].argmin())],
        "link_angles_deg": np.rad2deg(phi[:, place]).round(6).tolist(),
        "share_tense": float((least > 0.0).mean()),
        "pull_N": [float(pull.min()), float(pull.max())],
        "force_window_N": [float(lowest.max()), float(highest.min())],
    }
