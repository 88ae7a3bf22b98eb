"""Rules of docs/verdicts.md: from shares and ranges to verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.files import Json
from tendonrepro.monte_carlo.shares import FEW, MOST, Ends, Share, Spread

HEADINGS: Mapping[str, Mapping[str, str]] = {
    "holds": {
        "exact": "follows, to the published digits",
        "reproduced": "follows from the equations",
        "compatible": "agrees",
        "direction_only": "agrees in direction, not in size",
    },
    "does not hold": {
        "not_met": "holds on almost no plant",
        "outside_model": "outside the range of the plants",
        "not_reproduced": "does not follow from the equations",
    },
    "the opposite holds": {"contradicted": "the equations say the opposite"},
    "cannot be tested here": {
        "depends_on_plant": "depends on the plant",
        "no_power": "agrees, but so would most values",
        "not_testable": "not testable",
    },
}
"""Verdicts and what each means, by heading."""
VERDICTS = {name: words for under in HEADINGS.values() for name, words in under.items()}
INSIDE = frozenset({"compatible", "no_power"})
"""Verdicts on a number inside the central 90 % of the plants."""
FAILURES = frozenset({"not_reproduced", "contradicted", "not_met", "outside_model"})
"""Verdicts for which ``claims --check`` ends with exit code 3."""

EDITION = 5
"""Of the rules."""

SIMILAR = 0.05
"""Largest relative difference of what is called similar."""
MOST_UNRESOLVED = 0.05
NO_POWER = 0.5
"""Power from which on a range that holds a number says nothing."""

Mask: TypeAlias = NDArray[np.bool_]
Evidence: TypeAlias = Json
"""What a verdict rests on; its keys differ from rule to rule."""
Bounds: TypeAlias = tuple[Fraction | float, Fraction | float]


@dataclass(frozen=True)
class Ruling:
    """What a rule says of a claim or number, from one source, under one reading.

    `borderline`: a threshold lies inside an interval. `ours` is the share of plants on which a claim holds,
    or our number in the printed unit.
    """

    verdict: str
    borderline: bool = False
    ours: float | None = None
    evidence: Evidence = field(default_factory=dict)


Rulings: TypeAlias = Mapping[str, Ruling]
"""Rulings on one claim or number by the name of the reading; the one under ``printed`` decides."""


def not_testable(what: str, command: str | None = None, **evidence: object) -> Ruling:
    """Rule that something is missing; `command` supplies it."""
    return Ruling("not_testable", evidence={"missing": what, "run": command} | evidence)


def meets(first: Bounds, second: Bounds) -> bool:
    """Whether intervals share a number, ends included."""
    return first[0] <= second[1] and second[0] <= first[1]


def of_number(
    printed: Ends, spread: Spread, direction: Share | None, power: float, *, all_reversed: bool = True
) -> Ruling:
    """Judge a printed interval by the spread over plants, else by direction.

    `all_reversed` tells whether the other numbers between the same runs are contradicted, too.
    """
    near = any(edge and meets(printed, edge) for edge in (spread.low_interval, spread.high_interval))
    if meets(printed, (spread.low, spread.high)):
        return Ruling("no_power" if power >= NO_POWER else "compatible", near)
    if direction is None:
        return Ruling("outside_model", near)
    by_direction = of_share(direction)
    verdict = "direction_only" if by_direction.verdict == "compatible" else by_direction.verdict
    if verdict == "contradicted" and not all_reversed:
        verdict = "depends_on_plant"
    return Ruling(verdict, near or by_direction.borderline)


def power_of(printed: Ends, spread: Spread, least: float = 0.0) -> float:
    """Share of the decade around a printed number that would also be inside, 0 to 1.

    The decade is of what exceeds `least`, the smallest possible number. That of a negative number is
    negative, and 0 has none.
    """
    low, high = printed
    value, half = 0.5 * (low + high) - least, 0.5 * (high - low)
    ends = np.array([spread.low - half, spread.high + half]) - least
    if value <= 0.0:
        value, ends = -value, -ends[::-1]
    if value == 0.0:
        return 0.0
    decades = np.log10(np.clip(ends, value / 10**0.5, value * 10**0.5) / value)
    return float(decades[1] - decades[0])


def of_share(share: Share) -> Ruling:
    """Judge one statement."""
    near = _near(share, MOST) or _near(share, FEW)
    if share.share >= MOST:
        return Ruling("compatible", near)
    return Ruling("contradicted" if share.share <= FEW else "depends_on_plant", near)


def of_claim(whole: Share, opposite: Share) -> Ruling:
    """Judge a claim of several statements."""
    near = _near(whole, MOST) or _near(opposite, MOST) or _near(whole, FEW)
    if whole.share >= MOST:
        return Ruling("compatible", near)
    if opposite.share >= MOST:
        return Ruling("contradicted", near)
    return Ruling("not_met" if whole.share <= FEW else "depends_on_plant", near)


def _near(share: Share, limit: float) -> bool:
    return share.interval is not None and meets(share.interval, (limit, limit))


def of_values(claim: Ruling, values: Sequence[Ruling]) -> Ruling:
    """Judge a claim by the weakest of its values if all are inside, else by its direction."""
    near = any(value.borderline for value in values)
    inside = {value.verdict for value in values}
    if inside <= INSIDE:
        return Ruling("no_power" if "no_power" in inside else "compatible", near)
    verdict = "direction_only" if claim.verdict == "compatible" else claim.verdict
    return Ruling(verdict, near or claim.borderline)


def of_arithmetic(consistent: bool, ours: float | None = None, evidence: Evidence | None = None) -> Ruling:
    """Judge what follows from other printed numbers."""
    return Ruling("exact" if consistent else "not_reproduced", ours=ours, evidence=evidence or {})


def of_courses(ways: Sequence[Ruling]) -> Ruling:
    """Judge by every way that an unpublished part can be, where they agree."""
    near = any(way.borderline for way in ways)
    verdicts = {way.verdict for way in ways}
    return Ruling(verdicts.pop() if len(verdicts) == 1 else "depends_on_plant", near)


def of_model(holds: bool, ours: float | None = None, evidence: Evidence | None = None) -> Ruling:
    """Judge what follows without any unknown."""
    return Ruling("reproduced" if holds else "not_reproduced", ours=ours, evidence=evidence or {})
