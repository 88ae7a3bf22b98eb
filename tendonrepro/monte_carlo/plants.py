"""Draws of the parameter ranges straight to closed loops, many at once as arrays.

The long way makes a configuration of a draw (`configured`), changes it by a reading (`under`) and takes it
apart again (`build_loops`), which costs milliseconds a draw. The loops are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from tendonrepro.arrays import Array, Numeric
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.experiment import (
    NoDisturbance,
    NoiseDisturbance,
    SineDisturbance,
    is_multiple,
)
from tendonrepro.configuration.models.readings import ERROR_RATES, FRICTIONS, Reading, start_offset, under
from tendonrepro.configuration.models.reference import MinimumJerk, RaisedCosine, Ramp, Sine, Trapezoidal
from tendonrepro.configuration.quantity import to_si
from tendonrepro.configuration.strict_model import Model
from tendonrepro.configuration.strict_yaml import Section, section
from tendonrepro.experiments import rig
from tendonrepro.experiments.loops import (
    build_law,
    build_reference,
    build_solver,
    check_errors_from,
    newest_weight,
    power_floor,
)
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.monte_carlo.around import ArmDraws, AroundArm
from tendonrepro.monte_carlo.box import (
    Box,
    configured,
    drawn_disturbance,
    drawn_reference,
    noise_seed,
    put_manipulator,
    switched,
)
from tendonrepro.physics.arm import Arm, carried_mass, weight_moment
from tendonrepro.physics.control import Law
from tendonrepro.physics.drive import Drive
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.friction import Friction
from tendonrepro.physics.instruments import Actuator, Encoder
from tendonrepro.physics.statics import tensioner_side, tensioner_torque
from tendonrepro.simulation.loop import DesiredMotion, Loop, Solver, TimeDelayController

BoxColumns: TypeAlias = Mapping[str, Array]
"""Values (N,) of N draws by row of the box, SI."""

Moved: TypeAlias = tuple[Arm, Drive, Friction, Array]
"""Arm, drive, link friction and preload: all of a `Plant` but its disturbance."""

_MOTION = {"motion", "sampling_period"}
"""Axes of readings that the desired motion depends on."""

_KINDS: Mapping[str, type[RaisedCosine | MinimumJerk | Ramp | Trapezoidal | Sine]] = {
    "raised_cosine": RaisedCosine,
    "minimum_jerk": MinimumJerk,
    "ramp": Ramp,
    "trapezoidal": Trapezoidal,
    "sine": Sine,
}
_DISTURBANCES: Mapping[str, type[Model]] = {
    "none": NoDisturbance,
    "sine": SineDisturbance,
    "noise": NoiseDisturbance,
}


@dataclass(frozen=True)
class _Case:
    """A run under a reading: what no draw changes.

    ``drawn`` are the axes whose value the draw has. ``plant`` are arguments of `Draws.plants`. Cases of one
    ``plant`` share their plants, and those of one ``motion`` their motions.
    """

    run: str
    law: Law
    drawn: frozenset[str]
    plant: tuple[float, str, str, bool]
    motion: Reading
    joint_encoder: Encoder
    torque_step: float
    output_delay: int
    error_rate: str
    estimate_filter: str
    starts_apart: bool
    late: bool
    motor_encoder: Encoder
    L: float
    solver: Solver
    divergence_limit: float
    cold: bool


def _case(run: str, reading: Reading, nominal: CompareConfig, draw: Mapping[str, float]) -> _Case:
    settings = dict(reading.settings)
    config = under(reading, nominal, draw)
    readings, manipulator, chosen = config.control.readings, config.manipulator, config.runs[run]
    instruments = {"error_rate", "output_delay", "encoder"} if "hardware" in settings else set()
    friction = FRICTIONS.get(run, "") if "run_friction" in settings else ""
    pulls = settings.get("tensioner") != "absent"
    return _Case(
        run=run,
        law=build_law(config, chosen.law),
        # What a reading says itself replaces what the draw's hardware has.
        drawn=frozenset((instruments | {"torque_step"}) - settings.keys()),
        plant=(chosen.payload.si, friction, manipulator.tensioner.side, pulls),
        motion=Reading("", tuple(pair for pair in reading.settings if pair[0] in _MOTION)),
        joint_encoder=rig.build_encoder(manipulator.encoders.joint),
        torque_step=manipulator.actuator.torque_resolution.si,
        output_delay=int(manipulator.actuator.output_delay.si),
        error_rate=readings.error_rate,
        estimate_filter=readings.estimate_filter,
        starts_apart=chosen.start_offset is not None,
        late=readings.reference_acceleration == "late",
        motor_encoder=rig.build_encoder(manipulator.encoders.motor),
        L=config.sampling_period.si,
        solver=build_solver(config),
        divergence_limit=config.status.divergence_limit.si,
        cold=readings.start == "cold",
    )


class Draws:
    """Draws (N, P) of a box, as closed loops of cases: runs, each under a reading."""

    def __init__(
        self, base: LoadedConfig, box: Box, values: Array, cases: Sequence[tuple[str, Reading]]
    ) -> None:
        self._base, self._box, self._values = base, box, values
        self._nominal = configured(base, box, box.nominal)
        named = box.named(box.nominal)
        self._cases = [_case(run, reading, self._nominal, named) for run, reading in cases]
        self._columns: BoxColumns = dict(zip(box.names, np.ascontiguousarray(values.T), strict=True))
        self._arm: Section = deepcopy(section(base.tree, "manipulator"))
        put_manipulator(self._arm, self._columns)
        self._n = len(self._nominal.joints)
        self._posture = np.broadcast_to(self._columns["posture"], (self._n, len(values)))
        plants = dict.fromkeys(case.plant for case in self._cases)
        self._plants = {plant: _each(self.plants(*plant)) for plant in plants}
        self._limit = np.ascontiguousarray(self._joints("actuator", "torque_limit").T)
        apart = {case.run for case in self._cases if case.starts_apart}
        self._offsets = {
            run: np.ascontiguousarray(start_offset(self._posture, self._columns, run).T) for run in apart
        }

    def plants(self, payload: float, friction: str, side: str, pulls: bool) -> Moved:
        """Stacked plants (n, ..., N), SI, without their disturbance.

        Parameters
        ----------
        payload
            kg.
        friction
            Row of the box that scales friction of links and winches; empty for none.
        side, pulls
            Course of the tensioner, and whether there is one.
        """
        scale = self._columns[friction] if friction else 1.0
        viscous = self._joints("friction", "link", "viscous")
        tensioner = self._nominal.manipulator.tensioner
        force = self._columns["tensioner_force"] * pulls
        sides = tensioner_side(side, self._nominal.manipulator.joints)
        preload = tensioner_torque(force, sides, tensioner.diameter.si)[-self._n :]
        return self._links(payload), self._drive(scale), self._friction("link", viscous, scale), preload

    def _joints(self, *path: str) -> Array:
        """A quantity of the moving joints, (n, N), SI."""
        values = self._quantity(*path)[-self._n :]
        return np.broadcast_to(values if values.ndim > 1 else values[:, np.newaxis], self._posture.shape)

    def _quantity(self, *path: str) -> Array:
        part = self._arm
        for key in path:
            part = part[key]
        return np.asarray(to_si(np.array(part["value"], dtype=np.float64), part["unit"]))

    def _links(self, payload: float) -> Arm:
        """As `make_arm`, of many."""
        length, mass, com, inertia = (
            self._joints("links", name) for name in ("length", "mass", "com", "inertia")
        )
        carried = carried_mass(mass, payload)
        moment = mass * com + carried * length
        own = inertia + mass * com**2 + carried * length**2
        a = np.zeros((self._n, *own.shape))
        for i in range(self._n):
            a[i, i] = own[i]
            for j in range(i + 1, self._n):
                a[i, j] = a[j, i] = length[i] * moment[j]
        gravity = self._nominal.manipulator.gravity.si
        return Arm(a=a, b=weight_moment(length, mass, com, payload, gravity), phi_0=self._posture)

    def _drive(self, scale: Array | float) -> Drive:
        """As `build_drive`, of many."""
        nominal, shape = self._nominal.manipulator, self._posture.shape
        radius = nominal.routing.winch_diameter.si[-self._n :, np.newaxis] / 2.0
        guide_pulleys = np.array(self._nominal.joints, dtype=np.float64)[:, np.newaxis] - 1.0
        efficiency, wobble = (
            self._quantity(*path)
            for path in (("friction", "reducer_efficiency"), ("transmission_error", "peak_to_peak"))
        )
        S, S_inv = (
            np.broadcast_to(matrix[..., np.newaxis], (self._n, *shape))
            for matrix in rig.coupling(self._nominal)
        )
        return Drive(
            S=S,
            S_inv=S_inv,
            inertia=self._joints("winches", "reflected_inertia") + self._joints("winches", "drum_inertia"),
            stiffness=self._joints("tendons", "axial_stiffness") * radius**2,
            damping=self._quantity("tendons", "damping_factor")
            * self._joints("tendons", "axial_damping")
            * radius**2,
            slack=self._joints("tendons", "clearance") / (2.0 * radius),
            one_way=np.full(shape, float(nominal.tendons.unilateral == "on")),
            friction=self._friction("winch", self._joints("winches", "viscous"), scale),
            pulley_loss=self._quantity("friction", "per_pulley") * guide_pulleys,
            reducer_loss=np.broadcast_to(1.0 - efficiency, shape),
            wobble=np.broadcast_to(wobble / 2.0, shape),
            wobble_rate=np.full(shape, nominal.transmission_error.cycles_per_turn.si),
        )

    def _friction(self, side: str, viscous: Array, scale: Array | float) -> Friction:
        coulomb, *rest = (
            self._joints("friction", side, name)
            for name in ("coulomb", "static_ratio", "stribeck_velocity", "smoothing_velocity")
        )
        return Friction(scale * viscous, scale * coulomb, *rest)

    def loops(self, k: int) -> list[Loop]:
        """Loops of draw k, from 0, by case; plants and motions are shared as far as they are the same.

        Raises
        ------
        ConfigError
            If the draw makes no sound configuration, or leaves the workspace.
        """
        draw = self._box.named(self._values[k])
        config = self._sections(k, draw)
        disturbance = rig.build_disturbance(config)
        plants = {
            name: Plant(arm, drive, link_friction, preload, disturbance)
            for name, moved in self._plants.items()
            for arm, drive, link_friction, preload in [moved[k]]
        }
        motions: dict[Reading, DesiredMotion] = {}
        for case in self._cases:
            if case.motion not in motions:
                changed = under(case.motion, config, draw)
                motions[case.motion] = build_reference(changed.reference, changed, self._base.folder)
                check_errors_from(config, motions[case.motion])
        seed = int(config.seed.si)
        return [
            self._loop(case, k, draw, plants[case.plant], motions[case.motion], seed) for case in self._cases
        ]

    def _sections(self, k: int, draw: Mapping[str, float]) -> CompareConfig:
        """The nominal configuration with what is no part of the manipulator drawn."""
        reference = _constructed(_KINDS, drawn_reference(draw, self._box.shortest_run))
        if not is_multiple(reference.duration, self._nominal.sampling_period.si):
            # Its message says what is wrong and where.
            configured(self._base, self._box, self._values[k])
        return self._nominal.model_copy(
            update={
                "posture": _Drawn([draw["posture"], 0.0, 0.0]),
                "reference": reference,
                "disturbance": _constructed(_DISTURBANCES, drawn_disturbance(draw)),
                "seed": _Drawn(noise_seed(draw)),
            }
        )

    def _loop(
        self, case: _Case, k: int, draw: Mapping[str, float], plant: Plant, motion: DesiredMotion, seed: int
    ) -> Loop:
        joint = case.joint_encoder
        return Loop(
            plant=plant,
            joint_encoder=Encoder(draw["encoder_count"], joint.noise) if "encoder" in case.drawn else joint,
            actuator=Actuator(
                limit=self._limit[k],
                resolution=switched(draw, "torque_resolution")
                if "torque_step" in case.drawn
                else case.torque_step,
                noise=switched(draw, "torque_noise"),
                delay=int(draw["output_delay"]) if "output_delay" in case.drawn else case.output_delay,
            ),
            controller=TimeDelayController(_law(case, draw)),
            reference=motion,
            seed=seed,
            start_offset=self._offsets[case.run][k] if case.starts_apart else None,
            reference_lag=draw["reference_lag"] if case.late else 0.0,
            motor_encoder=case.motor_encoder,
            L=case.L,
            solver=case.solver,
            divergence_limit=case.divergence_limit,
            cold=case.cold,
        )


def draws_of(
    loaded: LoadedEnsemble,
    plants: Box | AroundArm,
    values: Array,
    cases: Sequence[tuple[str, Reading]],
    laws: Sequence[UserLaw] = (),
) -> Draws | ArmDraws:
    """Draws (N, P) of the ranges of the paper's arm, or around one of a user's own, where `laws` run too."""
    if isinstance(plants, AroundArm):
        return ArmDraws(plants, values, cases, laws)
    return Draws(loaded.base, plants, values, cases)


def _law(case: _Case, draw: Mapping[str, float]) -> Law:
    """The case's law with the instruments and filters of a draw."""
    law, rate = case.law, case.error_rate
    if "encoder" in case.drawn:
        law = law._replace(power_floor=power_floor(draw["encoder_count"], law.angle_scale))
    if "error_rate" in case.drawn:
        rate = ERROR_RATES[int(draw["error_rate"])]
    filtered = {
        "rate_filter": rate == "low_pass",
        "ddq_filter": case.estimate_filter == "acceleration",
        "estimate_filter": case.estimate_filter == "estimate",
    }
    if not any(filtered.values()) and rate == case.error_rate:
        return law
    newest = newest_weight(draw["filter_cutoff"], law.L)
    weights = {name: newest if acts else 1.0 for name, acts in filtered.items()}
    return law._replace(
        rate_filter=weights["rate_filter"],
        ddq_filter=weights["ddq_filter"],
        estimate_filter=weights["estimate_filter"],
    )


class _Drawn(NamedTuple):
    """Stands for a quantity of a configuration, in SI, where a whole one would take most of the time."""

    value: Numeric | list[Numeric]

    @property
    def si(self) -> Numeric:
        return np.array(self.value) if isinstance(self.value, list) else self.value


Kind = TypeVar("Kind", bound=Model)


def _constructed(kinds: Mapping[str, type[Kind]], tree: Section) -> Kind:
    """Model of a kind from plain values that are known to be sound."""
    parts: Section = {name: _Drawn(part["value"]) for name, part in tree.items() if name != "kind"}
    return kinds[tree["kind"]].model_construct(kind=tree["kind"], **parts)


def _each(record: Any) -> list[Any]:
    """Records of N experiments, from a stacked one whose leaves are (..., N)."""
    if isinstance(record, tuple):
        make = getattr(type(record), "_make", tuple)
        return [make(parts) for parts in zip(*map(_each, record), strict=True)]
    return list(np.ascontiguousarray(np.moveaxis(record, -1, 0)))
