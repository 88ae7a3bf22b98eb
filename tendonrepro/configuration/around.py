"""How far plants lie around an arm of one's own: a spread for all that varies, ranges of single keys."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from pydantic import ValidationError

from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.rows import PER_JOINT, SHARED, held_values
from tendonrepro.configuration.strict_model import explain
from tendonrepro.configuration.strict_yaml import Node
from tendonrepro.errors import ConfigError, UsageError, did_you_mean

ROWS: Mapping[str, str] = {row.key: name for name, row in PER_JOINT.items()} | {
    SHARED[name].key: name
    for name in (
        "rotor_inertia",
        "drum_inertia",
        "winch_viscous",
        "link_coulomb",
        "link_viscous",
        "link_stribeck_velocity",
        "winch_coulomb",
        "pulley_loss",
        "tensioner_force",
        "transmission_error",
        "torque_limit",
    )
}
"""Rows of the box that vary around an arm, by the arm's keys; what an arm has off stays off."""

_OF = {"friction.link.stribeck_velocity": "friction.link.coulomb"}
"""Keys that are of an effect whose size is another one."""

MOST = 10.0
"""Largest factor on a value of an arm, and its inverse the smallest."""

Ends: TypeAlias = tuple[float, float]
"""Smallest and largest factor on the value of a key."""

Ranges: TypeAlias = Sequence[str] | Mapping[str, Sequence[float]] | None
"""``KEY=LOW,HIGH``, or ends by key, as a user gives them."""


@dataclass(frozen=True)
class Around:
    """Draws around an arm of one's own.

    Its values are multiplied by factors. Those of a key in `ranges` lie between its ends, the others between
    1 + `spread` and its inverse; where that is None the shipped ranges over their nominal values hold.
    """

    arm: str
    spread: float | None = None
    ranges: Mapping[str, Ends] = field(default_factory=dict)

    @property
    def told(self) -> str:
        """In words, for tables and pictures: these are the user's ranges, not those of the paper's arm."""
        if self.spread is None:
            others = f"around {self.arm}, the shipped ranges relative to its values"
        else:
            others = f"around {self.arm}, each value within a factor of {1.0 + self.spread:g}"
        own = [
            f"{key} times {low:g} to {high:g}" if low < high else f"{key} times {low:g}"
            for key, (low, high) in self.ranges.items()
        ]
        return "; ".join([others, *own])

    def as_data(self) -> dict[str, object]:
        """Plain values for JSON."""
        ranges = {"ranges": {key: [*ends] for key, ends in self.ranges.items()}} if self.ranges else {}
        return {"arm": self.arm, "spread": self.spread, **ranges}


def spread_of(spread: float | None) -> float | None:
    """A spread that is sound, or a UsageError."""
    if spread is not None and not 0.0 < spread <= MOST - 1.0:
        raise UsageError(f"must be above 0 and at most {MOST - 1.0:g}, found {spread:g}", where="--spread")
    return spread


def ranges_of(ranges: Ranges) -> dict[str, Ends]:
    """Ends of the factors on the values of keys.

    Raises
    ------
    UsageError
        For another form, a key that does not vary or is given twice, or ends that are none.
    """
    if isinstance(ranges, Mapping):
        given = [(key, [float(end) for end in ends]) for key, ends in ranges.items()]
    else:
        given = [_read(text) for text in ranges or ()]
    checked = {}
    for key, ends in given:
        if key not in ROWS:
            message = f"no key {key!r} varies around an arm{did_you_mean(key, ROWS)}"
            raise UsageError(message, where="--range", hint=f"There are: {', '.join(ROWS)}")
        if key in checked:
            message, hint = f"{key} is given twice", "name each key once"
            raise UsageError(message, where="--range", hint=hint)
        if len(ends) != 2 or not 1.0 / MOST <= ends[0] <= ends[1] <= MOST:
            shown = ",".join(f"{end:g}" for end in ends)
            message = (
                f"{key}: needs two factors from {1.0 / MOST:g} to {MOST:g}, the smaller first, found {shown}"
            )
            raise UsageError(message, where="--range", hint=f"{key}=0.5,2 is half to twice the arm's value")
        checked[key] = (ends[0], ends[1])
    return checked


def refuse_off(config: CompareConfig, keys: Iterable[str]) -> None:
    """Raise a UsageError for a key on which nothing depends, because the arm has its effect off."""
    moving = slice(-len(config.joints), None)
    for key in keys:
        owner = _OF.get(key, key)
        if not np.any(held_values(config.manipulator, owner)[moving]):
            message = f"{owner} is 0 on {config.manipulator.name}, so nothing depends on {key}"
            hint = f"give the arm a {owner} above 0, or leave this range out"
            raise UsageError(message, where="--range", hint=hint)


def _read(text: str) -> tuple[str, list[float]]:
    """Key and numbers of ``KEY=LOW,HIGH``; one number stands for both."""
    key, _, ends = text.partition("=")
    try:
        numbers = [float(end) for end in re.split(r"[,\s]+", ends.strip(" []"))]
    except ValueError:
        message = f"must be KEY=LOW,HIGH, found {text!r}"
        raise UsageError(message, where="--range", hint="For example --range links.mass=0.5,2") from None
    return key.strip(), numbers * 2 if len(numbers) == 1 else numbers


def drawn_config(tree: Mapping[str, Node], around: Around) -> CompareConfig:
    """Comparison with a drawn arm; a ConfigError where a value left what is possible."""
    try:
        return CompareConfig.model_validate(tree)
    except ValidationError as error:
        first = explain(error, tree, around.arm).message.splitlines()[1]
        message = f"an arm drawn {around.told}, is impossible: {first.partition(': ')[2]}"
        hint = "give a smaller --spread, or --range KEY=LOW,HIGH for that key"
        raise ConfigError(message, hint=hint) from error
