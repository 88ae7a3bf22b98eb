"""Plants around an arm of one's own: its values times factors, by the shipped ranges or by a spread."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.around import PER_JOINT, SHARED, Around, drawn_config
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.box import BoxRange
from tendonrepro.configuration.models.readings import Reading, named_readings, parse_reading, under
from tendonrepro.configuration.strict_yaml import section
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import slow_error_ratio
from tendonrepro.results.summary import CONTROLLERS

_DRAWING = {("hardware", "drawn"), ("motion", "ramp"), ("starts", "apart"), ("run_friction", "drawn")}
"""Settings of readings whose numbers are rows of the box."""


class Factor(NamedTuple):
    """Ends of a factor on the value of a key, of one joint or of all (None)."""

    key: str
    joint: int | None
    low: float
    high: float
    log: bool

    @property
    def name(self) -> str:
        """Of the key and, where joints differ, its joint."""
        return self.key if self.joint is None else f"{self.key}_{self.joint}"

    def value(self, unit: Array) -> Array:
        """At places between the ends, from 0 to 1."""
        if self.log:
            return np.asarray(self.low * (self.high / self.low) ** unit)
        return np.asarray(self.low + (self.high - self.low) * unit)


@dataclass(frozen=True)
class AroundArm:
    """Draws around the arm of a comparison, each a configuration of its own.

    The motion, and where runs start, are the comparison's.
    """

    loaded: LoadedEnsemble
    around: Around

    @cached_property
    def factors(self) -> list[Factor]:
        """Of all that varies."""
        return [*self._factors()]

    def _factors(self) -> Iterator[Factor]:
        box, joints = dict(self.loaded.config.box), self.loaded.compare.joints
        for key, row in PER_JOINT.items():
            for joint in joints:
                yield self._factor(key, joint, box[f"{row}_{3 if joint == joints[-1] else 2}"])
        for key, row in SHARED.items():
            yield self._factor(key, None, box[row])

    def _factor(self, key: str, joint: int | None, row: object) -> Factor:
        assert isinstance(row, BoxRange)
        if key in self.around.ranges:
            return Factor(key, joint, *self.around.ranges[key], log=True)
        if self.around.spread is not None:
            return Factor(key, joint, 1.0 / (1.0 + self.around.spread), 1.0 + self.around.spread, log=True)
        return Factor(key, joint, row.low / row.nominal, row.high / row.nominal, row.scale == "log")

    @property
    def names(self) -> tuple[str, ...]:
        """Of the factors, as ``links.mass_2`` of joint 2, or ``winches.viscous`` of all."""
        return tuple(factor.name for factor in self.factors)

    def named(self, values: Array) -> dict[str, float]:
        """Factors (P,) of one arm by name."""
        return dict(zip(self.names, values.tolist(), strict=True))

    def sample(self, seed: int, replicate: int, first: int, count: int) -> Array:
        """Factors (count, P) from number `first` on, from 0; see `sobol`."""
        factors = self.factors
        unit = sobol(len(factors), [seed, replicate], first, count)
        return np.stack([factor.value(unit[:, i]) for i, factor in enumerate(factors)], axis=1)

    def draw(self, number: int) -> CompareConfig:
        """Configuration of a number, from 0; each depends on its number and the seed of draws alone."""
        return self.configured(self.sample(int(self.loaded.config.seed.si), 0, number, 1)[0])

    def configured(self, values: Array) -> CompareConfig:
        """Configuration of one arm, from its factors (P,).

        Raises
        ------
        ConfigError
            Where a value leaves what is possible, such as a loss above all of the tension.
        """
        tree = deepcopy(dict(self.loaded.base.tree))
        arm, n = section(tree, "manipulator"), self.loaded.compare.manipulator.joints
        by_key: dict[str, Array] = {}
        for factor, value in zip(self.factors, values.tolist(), strict=True):
            joints = slice(None) if factor.joint is None else slice(factor.joint - 1, factor.joint)
            by_key.setdefault(factor.key, np.ones(n))[joints] = value
        # Centres of mass and inertias follow, and have factors of their own on their share.
        by_key["links.com"] *= by_key["links.length"]
        by_key["links.inertia"] *= by_key["links.mass"] * by_key["links.length"] ** 2
        for key, factors in by_key.items():
            quantity = section(arm, *key.split("."))
            value = quantity["value"]
            scaled = np.array(value) * (factors if isinstance(value, list) else factors[0])
            quantity |= {"value": scaled.tolist(), "source": f"assumed: draw {self.around.told}"}
        return drawn_config(tree, self.around)

    def slow_ratio(self, reading: str) -> Array:
        """Ratio C1/C2 of slowly changing errors under a reading, (n,); it is the same on all arms."""
        config = under(parse_reading(reading), self.loaded.compare, {})
        return slow_error_ratio(config, CONTROLLERS[:2])


def draws_rows(reading: Reading) -> list[str]:
    """Settings of a reading whose numbers are drawn from the ranges of the paper's arm."""
    return [f"{name}={value}" for name, value in reading.settings if (name, value) in _DRAWING]


def readings_on(loaded: LoadedEnsemble, names: str) -> tuple[Reading, ...]:
    """Readings by their names; around an arm the printed one leaves its comparison as it is.

    Raises
    ------
    UsageError
        For an unknown one. Around an arm also for one that draws from the ranges of the paper's arm, or that
        the comparison lacks something for.
    """
    readings = named_readings(names)
    for reading in readings if loaded.around else ():
        if drawing := draws_rows(reading):
            message = f"{drawing[0]} draws from the ranges of the paper's arm"
            hint = "say it in the comparison: control.readings, reference, start_offset, friction_scale"
            raise UsageError(message, where="--readings", hint=hint)
        try:
            changed = under(reading, loaded.compare, {})
            CompareConfig.model_validate(changed.model_dump(mode="json", exclude_none=True))
        except ValueError as error:
            message = f"the comparison cannot be run under {reading.name}: {error}"
            raise UsageError(message, where="--readings") from error
    return readings


def sobol(dimensions: int, key: Sequence[int], first: int, count: int) -> Array:
    """Points (count, P) of a scrambled Sobol sequence in the unit cube, from number `first` on, from 0."""
    from scipy.stats import qmc

    engine = qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(key))
    if first > 0:
        engine.fast_forward(first)
    with warnings.catch_warnings():
        # A block is a part of a power of two, not one itself.
        warnings.filterwarnings("ignore", message="The balance properties", category=UserWarning)
        return np.asarray(engine.random(count))
