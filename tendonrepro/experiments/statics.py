"""Tensions at rest over the working half-plane, for every course of the tensioning tendon, the paper's 4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import Config, LoadedConfig
from tendonrepro.configuration.published import published
from tendonrepro.experiments.rig import build_arm, coupling, start_angles
from tendonrepro.physics import statics
from tendonrepro.physics.arm import Arm, gravity_torque, joint_angles
from tendonrepro.results.tables import TableRows

COURSES = tuple(statics.TENSIONER_SIDES)
"""Ways in which tendon 4 may pass the joints: values of the reading `tensioner`."""

STRETCH = 0.1
"""How far the spring is stretched in the start posture, m; it then pulls as hard as the motor."""

MAP_ANGLES = np.linspace(0.0, np.pi, 91)
"""Angles along each side of a map, rad from hanging, (A,)."""


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

    @property
    def tendon_4(self) -> tuple[Array, Array]:
        """Its side and diameter at every joint, (n,) each, m."""
        return self.side[:, -1], self.diameter[:, -1]

    def stretch(self, phi: Array) -> Array:
        """Rope drawn from tendon 4's end since the start, m, (...), at link angles (n, ...), rad."""
        return statics.tensioner_stretch(joint_angles(phi, self.phi_0), *self.tendon_4)

    def tension(self, phi: Array, arm: Arm, spring: statics.Spring) -> Array:
        """Tensions of the motors' tendons at rest, N, (n, ...), at link angles (n, ...), rad."""
        weight = gravity_torque(joint_angles(phi, self.phi_0), arm)
        added = statics.tensioner_torque(statics.spring_force(self.stretch(phi), spring), *self.tendon_4)
        return statics.tendon_tension(weight - added, self.S, self.winch)

    def friction_band(self, phi: Array, arm: Arm, force: float, loss: float) -> list[float]:
        """Lowest and highest that the smallest tension may be, N, as guide pulleys hold the rope.

        Tension is monotonic in what each pulley passes on, so extremes are where every tendon is about to
        move.
        """
        weight = gravity_torque(joint_angles(phi, self.phi_0), arm)
        pull = np.full(weight.shape[1:], force)
        smallest = []
        for senses in product((-1.0, 1.0), repeat=self.side.shape[1]):
            passed_on = 1.0 + loss * np.array(senses)
            tension = statics.tension_with_losses(weight, pull, self.side, self.diameter, passed_on)
            smallest.append(tension.min(axis=0))
        return [float(np.min(smallest)), float(np.max(smallest, axis=0).min())]

    def per_newton(self) -> Array:
        """Tension that a newton of tendon 4 adds to each tendon, (n,)."""
        added = statics.tendon_tension(-statics.tensioner_torque(1.0, *self.tendon_4), self.S, self.winch)
        # Diameters that cancel leave rounding behind.
        return np.where(np.abs(added) < statics.SLACK, 0.0, added)

    def travel(self) -> float:
        """Range of tendon 4's length over the half-plane, m; its ends are at corners."""
        corners = np.array(list(product((0.0, np.pi), repeat=len(self.side)))).T
        return float(np.ptp(self.stretch(corners)))


Case: TypeAlias = tuple[Arm, statics.Spring]
"""What an arm carries, and what pulls tendon 4."""

WEIGHT_ALONE = statics.Spring(0.0, 0.0)
"""Tendon 4 does not pull."""


@dataclass(frozen=True)
class Survey:
    """Tensions at rest over the working half-plane.

    `inputs` has a row for each value that the configuration need not have, with its source. `half_plane`
    (n, P), rad, are link angles of the postures. `weight_alone` (n,), N, is the least tension that the weight
    leaves to each tendon. `courses` has a row for each course of the tensioning tendon, `tensions` one for
    each course and case, over all postures. `maps` (A, A), N, are smallest tensions of any tendon over the
    last two links' angles, by course and case, where two joints or more move.
    """

    loaded: LoadedConfig
    inputs: TableRows
    half_plane: Array
    weight_alone: Array
    courses: TableRows
    tensions: TableRows
    maps: Mapping[tuple[str, str], Array]


def survey(loaded: LoadedConfig) -> Survey:
    """Work out tensions over the half-plane, and maps where two joints or more move."""
    config, joints = loaded.config, loaded.config.joints
    tensioner, loss = config.manipulator.tensioner, config.manipulator.friction.per_pulley
    force, diameter = tensioner.force, tensioner.diameter
    payload, payload_source = _payload(config)
    arm, motor = build_arm(config, 0.0), statics.Spring(force.si, 0.0)
    cases: dict[str, Case] = {
        "motor": (arm, motor),
        "payload": (build_arm(config, payload), motor),
        "spring": (arm, statics.Spring(force.si, force.si / STRETCH)),
    }
    everywhere = half_plane(len(joints))
    routes = {course: mechanism(config, course) for course in COURSES}
    every = list(product(routes, cases))
    mapped = every if len(joints) > 1 else []
    return Survey(
        loaded,
        inputs=[
            {"input": "force_N", "value": force.si, "source": force.source},
            {"input": "diameter_mm", "value": (1e3 * diameter.si).tolist(), "source": diameter.source},
            {"input": "pulley_loss", "value": loss.si, "source": loss.source},
            {"input": "payload_kg", "value": payload, "source": payload_source},
        ],
        half_plane=everywhere,
        # Without its pull the course of tendon 4 does not matter.
        weight_alone=routes[COURSES[0]].tension(everywhere, arm, WEIGHT_ALONE).min(axis=1),
        courses=[
            {
                "course": course,
                "tension_per_newton": route.per_newton().tolist(),
                "change_of_length_mm": 1e3 * route.travel(),
                "least_tension_with_friction_N": route.friction_band(everywhere, arm, force.si, loss.si),
            }
            for course, route in routes.items()
        ],
        tensions=[
            {"course": course, "case": case} | _over_all(everywhere, *cases[case], routes[course], joints)
            for course, case in every
        ],
        maps={
            (course, case): routes[course].tension(map_postures(config), *cases[case]).min(axis=0)
            for course, case in mapped
        },
    )


def _payload(config: Config) -> tuple[float, str]:
    """The heaviest of the runs, kg, or the paper's where none has any; and its source."""
    heaviest = max((run.payload for run in config.runs.values()), key=lambda payload: payload.si)
    if heaviest.si > 0.0:
        return heaviest.si, heaviest.source
    return published().number("hardware.payload"), "assumed, for no run has one: that of the paper"


def mechanism(config: Config, course: str) -> Mechanism:
    """Routing of the moving joints with tendon 4 on a course, Eq. (1)."""
    manipulator, n = config.manipulator, len(config.joints)
    routing, tendon_4 = manipulator.routing, statics.tensioner_side(course, manipulator.joints)
    side = np.column_stack([statics.sign_of_side(routing.sign.si), tendon_4])
    diameter = np.column_stack([routing.pulley_diameter.si, manipulator.tensioner.diameter.si])
    return Mechanism(
        S=coupling(config)[0],
        winch=routing.winch_diameter.si[-n:],
        side=side[-n:, -n - 1 :],
        diameter=diameter[-n:, -n - 1 :],
        phi_0=start_angles(config),
    )


def map_postures(config: Config) -> Array:
    """Link angles of a map, (n, A, A), rad: the last two links, the others held."""
    last, before = np.meshgrid(MAP_ANGLES, MAP_ANGLES, indexing="ij")
    others = start_angles(config)[:-2]
    return np.stack([*(np.full_like(last, angle) for angle in others), before, last])


def half_plane(n: int) -> Array:
    """Link angles spread evenly over the half-plane, (n, P), rad: centres of cells."""
    cells = min(36, int(5e4 ** (1.0 / n)))
    centres = (np.arange(cells) + 0.5) * np.pi / cells
    return np.stack(np.meshgrid(*[centres] * n, indexing="ij")).reshape(n, -1)


def _over_all(
    phi: Array, arm: Arm, spring: statics.Spring, route: Mechanism, joints: tuple[int, ...]
) -> dict[str, object]:
    """Smallest tension of any tendon over postures (n, P), where it is, and forces that keep all tense."""
    tension, pull = route.tension(phi, arm, spring), statics.spring_force(route.stretch(phi), spring)
    lowest, highest = statics.force_window(route.tension(phi, arm, WEIGHT_ALONE), route.per_newton())
    least = tension.min(axis=0)
    place = int(least.argmin())
    return {
        "least_tension_N": float(least[place]),
        "tendon": joints[int(tension[:, place].argmin())],
        "link_angles_deg": np.rad2deg(phi[:, place]).round(6).tolist(),
        "share_tense": float((least > 0.0).mean()),
        "pull_N": [float(pull.min()), float(pull.max())],
        "force_window_N": [float(lowest.max()), float(highest.min())],
    }
