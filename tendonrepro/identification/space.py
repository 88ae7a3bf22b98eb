"""Where a search looks: the ranges of the paper's arm, or those around an arm of one's own.

Both are a box of rows, a unit cube of points in it, and what makes a plant of its values.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.configuration.models.readings import Reading, under
from tendonrepro.configuration.strict_yaml import Section, section
from tendonrepro.monte_carlo.population import Population, holding_base, population_of

_FOLLOWS = {"links.com": ("links.length",), "links.inertia": ("links.mass", "links.length")}
"""Values of an arm that move with others, too."""
_DRAWN = "assumed: draw from the box, "
_HELD = "not searched but of the arm at the start, "
_OF_JOINT = re.compile("(_joint)?_[23]$")
"""End of a row's name that a source leaves out."""


@dataclass(frozen=True)
class _Searched:
    """A population in which is searched: rows that are not searched keep what its base has."""

    box: Population

    @property
    def base(self) -> LoadedConfig:
        """The comparison whose plants are searched, or around whose arm."""
        return self.box.loaded.base

    def config(self, values: Array, reading: Reading) -> CompareConfig:
        """Configuration of values (P,) under a reading."""
        return under(reading, self.box.configured(values), self.box.asked_by_readings(values))


class PaperSpace(_Searched):
    """The ensemble's ranges."""

    within: ClassVar[str] = "the box"

    def acting(self) -> Array:
        """Points at which every effect acts, for each disturbance, with and without torque steps."""
        box = self.box
        disturbance, steps = (box.names.index(name) for name in ("disturbance", "torque_resolution_acts"))
        kinds = len(box.rows[disturbance].choices)
        # Off the middle, where a value might be exactly one.
        units = np.full((2 * kinds, len(box.names)), 0.4142)
        # The last of the sides of friction are the most.
        units[:, [name.endswith("_acts") or name == "friction_sides" for name in box.names]] = 0.999
        units[:, disturbance] = np.tile((np.arange(kinds) + 0.5) / kinds, 2)
        units[kinds:, steps] = 0.001
        return units

    def shown(self, config: CompareConfig) -> Mapping[str, tuple[float, str]]:
        """Nothing: rows are values already."""
        del config
        return {}

    def sourced(self, config: CompareConfig, source: str, rows: Sequence[str]) -> Section:
        """A configuration as plain values; each number says whether its row was searched."""
        searched = "|".join(f"{row}|{_OF_JOINT.sub('', row)}" for row in rows)

        def told(drawn: re.Match[str]) -> str:
            """Where a number comes from: a row that was searched, or one that kept what the arm has."""
            is_searched = re.search(rf"\b({searched})\b", drawn[1])
            return f"{source}, " + ("" if is_searched else _HELD) + drawn[1]

        return _plain(re.sub(f'{_DRAWN}([^"]*)', told, config.model_dump_json(exclude_none=True)))


class ArmSpace(_Searched):
    """Ranges around an arm of one's own: rows are factors on its values, and 1 is the arm itself."""

    within: ClassVar[str] = "these ranges"

    def acting(self) -> Array:
        """No points: what an arm has off stays off, so all plants share their code."""
        return np.empty((0, len(self.box.names)))

    def shown(self, config: CompareConfig) -> Mapping[str, tuple[float, str]]:
        """The value that each row gives an arm, with its unit, by its name."""
        found, arm = {}, _plain(config.manipulator.model_dump_json())
        for row in self.box.rows:
            quantity: Section = section(arm, *row.key.split("."))
            held = np.atleast_1d(quantity["value"])[row.joint - 1 if row.joint else -1]
            found[row.name] = float(held), quantity["unit"]
        return found

    def sourced(self, config: CompareConfig, source: str, rows: Sequence[str]) -> Section:
        """A configuration as plain values; what was not searched keeps the source that it has."""
        tree = _plain(config.model_dump_json(exclude_none=True))
        factors, joints = self.box.rows, config.manipulator.joints
        for key in dict.fromkeys(factor.key for factor in factors):
            moving = (key, *_FOLLOWS.get(key, ()))
            searched = [factor for factor in factors if factor.key in moving and factor.name in rows]
            value = section(tree, "manipulator", *key.split("."))
            value["source"] = own = section(self.base.tree, "manipulator", *key.split("."))["source"]
            if searched:
                moved = {factor.joint for factor in searched}
                all_joints = None in moved or len(moved) == joints
                others = "" if all_joints else f"; the others {own}"
                value["source"] = f"{source}, {', '.join(factor.name for factor in searched)}{others}"
        if tree["reference"]["kind"] == "sampled":
            # The file that names it now lies elsewhere.
            tree["reference"]["file"] = str((self.base.folder / tree["reference"]["file"]).resolve())
        return tree


Space: TypeAlias = PaperSpace | ArmSpace


def space_of(loaded: LoadedEnsemble) -> Space:
    """The space of an ensemble, or around the arm of a comparison."""
    population = holding_base(population_of(loaded))
    return ArmSpace(population) if loaded.around else PaperSpace(population)


def _plain(text: str) -> Section:
    """JSON as plain values, an integer where a number is whole: the schema wants counts to be."""
    found: Section = json.loads(text, parse_float=_whole)
    return found


def _whole(text: str) -> float:
    return int(float(text)) if float(text).is_integer() else float(text)
