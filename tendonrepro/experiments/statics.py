"""Tensions at rest over the working half-plane, for every course of the tensioning tendon, the paper's 4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import Config, LoadedConfig
from tendonrepro.configuration.models.box import BoxRange
from tendonrepro.configuration.published import published
from tendonrepro.configuration.quantity import Scalar
from tendonrepro.experiments.rig import build_arm, coupling, start_angles
from tendonrepro.physics import statics
from tendonrepro.physics.arm import Arm, gravity_torque, joint_angles
from tendonrepro.results.tables import TableRows

COURSES = tuple(statics.TENSIONER_SIDES)
"""Ways in which tendon 4 may pass the joints: values of the reading `tensioner`."""

RESERVE = 5.0
"""Tension that should be left, N; at a 37 mm winch a disturbance of 0.09 N m takes it away."""

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


class Maps(NamedTuple):
    """What a course of tendon 4 gives over the angles of the last two links, N, (A, A).

    `least` is the smallest tension by case, `band` (2, A, A) its range for ``motor`` with friction of the
    guide pulleys. `needed` is the least force of tendon 4 that leaves the reserve to every tendon it can
    reach; where `room` is below zero, no force does for all.
    """

    least: Mapping[str, Array]
    band: Array
    needed: Array
    room: Array


@dataclass(frozen=True)
class Survey:
    """Tensions at rest over the working half-plane.

    `force`, N, pulls the tensioning tendon, a share `loss` is lost at each pulley, and these have the
    `diameter` (joints,), m; each of these, and `payload`, kg, has its source beside it. `half_plane` (n, P),
    rad, are link angles of the postures. `weight_alone` (n,), N, is the least tension that the weight leaves
    to each tendon. `courses` has a row for each course of the tensioning tendon, `tensions` one for each
    course and case, over all postures; there are `maps` by course where two joints or more move.
    """

    loaded: LoadedConfig
    force: tuple[float, str]
    loss: tuple[float, str]
    payload: tuple[float, str]
    diameter: tuple[Array, str]
    half_plane: Array
    weight_alone: Array
    courses: TableRows
    tensions: TableRows
    maps: Mapping[str, Maps]

    @property
    def joints(self) -> list[int]:
        """The moving joints."""
        return list(self.loaded.config.joints)

    @property
    def tensioning_tendon(self) -> int:
        """Number of the tendon that is led past all joints."""
        return self.loaded.config.manipulator.joints + 1

    @property
    def origin(self) -> str:
        """Configuration, for captions."""
        return f"{self.loaded.origin} (sha256 {self.loaded.sha256[:12]})"


def survey(loaded: LoadedConfig) -> Survey:
    """Work out tensions over the half-plane, and maps where two joints or more move."""
    config = loaded.config
    tensioner = config.manipulator.tensioner
    force = _value_or_box(tensioner.force, "tensioner_force")
    loss = _value_or_box(config.manipulator.friction.per_pulley, "pulley_loss")
    payload = _payload(config)
    arm, motor = build_arm(config, 0.0), statics.Spring(force[0], 0.0)
    cases: dict[str, Case] = {
        "motor": (arm, motor),
        "payload": (build_arm(config, payload[0]), motor),
        "spring": (arm, statics.Spring(force[0], force[0] / STRETCH)),
    }
    everywhere = half_plane(len(config.joints))
    routes = {course: mechanism(config, course) for course in COURSES}
    maps: dict[str, Maps] = {}
    if len(config.joints) > 1:
        grid = map_postures(config)
        maps = {name: _maps(grid, cases, route, loss[0]) for name, route in routes.items()}
    return Survey(
        loaded,
        force,
        loss,
        payload,
        (tensioner.diameter.si, tensioner.diameter.source),
        everywhere,
        # Without its pull the course of tendon 4 does not matter.
        weight_alone=routes[COURSES[0]].tension(everywhere, arm, WEIGHT_ALONE).min(axis=1),
        courses=[_course_row(name, route, maps.get(name)) for name, route in routes.items()],
        tensions=[
            {"course": name, "case": case} | _over_all(everywhere, *cases[case], route, config.joints)
            for name, route in routes.items()
            for case in cases
        ],
        maps=maps,
    )


def _course_row(name: str, route: Mechanism, maps: Maps | None) -> dict[str, object]:
    """What a newton on a course adds to each tendon, how its length changes, and what its maps show."""
    row: dict[str, object] = {
        "course": name,
        "tension_per_newton": route.per_newton().tolist(),
        "change_of_length_mm": 1e3 * route.travel(),
    }
    if maps is None:
        return row
    return row | {
        "map_least_tension_N": {case: float(least.min()) for case, least in maps.least.items()},
        "map_least_tension_with_friction_N": float(maps.band[0].min()),
        "map_force_for_reserve_N": float(maps.needed.max()),
        "map_share_where_a_force_leaves_reserve": float((maps.room >= 0.0).mean()),
    }


def _value_or_box(configured: Scalar, row: str) -> tuple[float, str]:
    """A value and its source; where the configuration has it off, one of the paper's arm's ranges."""
    if configured.si > 0.0:
        return configured.si, configured.source
    values = dict(load_ensemble(None).config.box)[row]
    assert isinstance(values, BoxRange)
    return (
        values.nominal,
        f"assumed, for the configuration has none; {values.low:g} to {values.high:g} of the paper's arm",
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


def _maps(grid: Array, cases: Mapping[str, Case], route: Mechanism, loss: float) -> Maps:
    weight, per_newton = route.tension(grid, cases["motor"][0], WEIGHT_ALONE), route.per_newton()
    reached = per_newton != 0.0
    needed, largest = statics.force_window(weight[reached], per_newton[reached], RESERVE)
    beyond = np.min(weight[~reached] - RESERVE, axis=0, initial=np.inf)
    return Maps(
        least={name: route.tension(grid, *case).min(axis=0) for name, case in cases.items()},
        band=_friction_band(grid, cases["motor"], route, loss),
        needed=needed,
        room=np.minimum(largest - needed, beyond),
    )


def _friction_band(phi: Array, motor: Case, route: Mechanism, loss: float) -> Array:
    """Lowest and highest of the smallest tension, N, (2, ...), over all ways in which pulleys may hold rope.

    Tension is monotonic in what each pulley passes on, so extremes are where every tendon is about to move.
    """
    arm, spring = motor
    weight = gravity_torque(joint_angles(phi, route.phi_0), arm)
    pull = np.full(weight.shape[1:], spring.force)
    smallest = []
    for senses in product((-1.0, 1.0), repeat=route.side.shape[1]):
        passed_on = 1.0 + loss * np.array(senses)
        tension = statics.tension_with_losses(weight, pull, route.side, route.diameter, passed_on)
        smallest.append(tension.min(axis=0))
    return np.stack([np.min(smallest, axis=0), np.max(smallest, axis=0)])


def _over_all(
    phi: Array, arm: Arm, spring: statics.Spring, route: Mechanism, joints: Sequence[int]
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
