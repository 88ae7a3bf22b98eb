"""Plants around an arm of one's own: its values times factors, by the shipped ranges or by a spread."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import Around, LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.box import BoxRange

PER_JOINT = {
    "length": "link_length",
    "mass": "link_mass",
    "com": "link_com",
    "inertia": "link_inertia",
    "axial_stiffness": "tendon_stiffness",
    "axial_damping": "tendon_damping",
}
"""Rows of the box that each joint has of its own, by the arm's key; the box has them for joints 2 and 3."""

SHARED = {
    ("winches", "reflected_inertia"): "rotor_inertia",
    ("winches", "drum_inertia"): "drum_inertia",
    ("winches", "viscous"): "winch_viscous",
    ("friction", "link", "coulomb"): "link_coulomb",
    ("friction", "link", "viscous"): "link_viscous",
    ("friction", "link", "stribeck_velocity"): "link_stribeck_velocity",
    ("friction", "winch", "coulomb"): "winch_coulomb",
    ("friction", "per_pulley"): "pulley_loss",
    ("tensioner", "force"): "tensioner_force",
    ("transmission_error", "peak_to_peak"): "transmission_error",
    ("actuator", "torque_limit"): "torque_limit",
}
"""Rows that all joints share, by the arm's keys; what an arm has off stays off."""


class Factor(NamedTuple):
    """Ends of a factor on the value of a key, of one joint or of all (None)."""

    key: str
    joint: int | None
    low: float
    high: float
    log: bool

    def value(self, unit: float) -> float:
        """At a place between the ends, from 0 to 1."""
        if self.log:
            return float(self.low * (self.high / self.low) ** unit)
        return float(self.low + (self.high - self.low) * unit)


@dataclass(frozen=True)
class AroundArm:
    """Draws around the arm of a comparison, each a configuration of its own."""

    loaded: LoadedEnsemble
    around: Around

    @property
    def factors(self) -> list[Factor]:
        """Of all that varies."""
        return [*self._factors()]

    def _factors(self) -> Iterator[Factor]:
        box, joints = dict(self.loaded.config.box), self.loaded.compare.joints
        for key, row in PER_JOINT.items():
            for joint in joints:
                held = box[f"{row}_{3 if joint == joints[-1] else 2}"]
                yield self._factor(key, joint, held)
        for path, row in SHARED.items():
            yield self._factor(".".join(path), None, box[row])

    def _factor(self, key: str, joint: int | None, row: Any) -> Factor:
        assert isinstance(row, BoxRange)
        if self.around.spread is not None:
            return Factor(key, joint, 1.0 / (1.0 + self.around.spread), 1.0 + self.around.spread, log=True)
        return Factor(key, joint, row.low / row.nominal, row.high / row.nominal, row.scale == "log")

    def draw(self, number: int) -> CompareConfig:
        """Configuration of a number, from 0; each depends on its number and the ensemble's seed alone."""
        from scipy.stats import qmc

        factors = self.factors
        generator = np.random.default_rng(int(self.loaded.config.seed.si))
        engine = qmc.Sobol(len(factors), scramble=True, seed=generator)
        if number > 0:
            engine.fast_forward(number)
        return self.configured(engine.random(1)[0])

    def configured(self, unit: Array) -> CompareConfig:
        """Configuration at a point (P,) of the unit cube of all factors."""
        tree: dict[str, Any] = deepcopy(dict(self.loaded.base.tree))
        arm, n = tree["manipulator"], self.loaded.compare.manipulator.joints
        by_key: dict[str, Array] = {}
        for factor, place in zip(self.factors, unit.tolist(), strict=True):
            joints = slice(None) if factor.joint is None else slice(factor.joint - 1, factor.joint)
            by_key.setdefault(factor.key, np.ones(n))[joints] = factor.value(place)
        # Centres of mass and inertias follow, and have factors of their own on their share.
        by_key["com"] *= by_key["length"]
        by_key["inertia"] *= by_key["mass"] * by_key["length"] ** 2
        sections = dict.fromkeys(("length", "mass", "com", "inertia"), "links")
        for key, factors in by_key.items():
            path = key.split(".") if "." in key else [sections.get(key, "tendons"), key]
            held = arm
            for part in path:
                held = held[part]
            scaled = np.array(held["value"]) * (factors if isinstance(held["value"], list) else factors[0])
            held |= {"value": scaled.tolist(), "source": f"assumed: draw {self.around.told}"}
        return CompareConfig.model_validate(tree)
