"""Rules of docs/verdicts.md: shares of the box, ranges, and the verdicts that follow from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.monte_carlo.shares import FEW, MOST, Ends, Share, Spread

VerdictName: TypeAlias = str

HEADINGS: Mapping[str, Mapping[VerdictName, str]] = {
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
"""Verdicts and what each means, as terminal and report group them."""
VERDICTS = {name: words for under in HEADINGS.values() for name, words in under.items()}
INSIDE = frozenset({"compatible", "no_power"})
"""Verdicts on a number that lies inside the central 90 % of the plants."""
FAILURES = frozenset({"not_reproduced", "contradicted", "not_met", "outside_model"})
"""Verdicts for which ``claims --check`` ends with exit code 3."""

EDITION = 3
"""Of the rules; stored verdicts of another one are shown as such."""

SIMILAR = 0.05
"""Largest relative difference of what is called similar."""
MOST_UNRESOLVED = 0.05
NO_POWER = 0.5
"""Share of the decade around a printed number from which on a range that holds it says nothing."""

Mask: TypeAlias = NDArray[np.bool_]
Evidence: TypeAlias = dict[str, Any]
Bounds: TypeAlias = tuple[Fraction | float, Fraction | float]


@dataclass(frozen=True)
class Decision:
    """A verdict, and whether a threshold behind it lies inside an interval."""

    verdict: VerdictName
    borderline: bool = False


@dataclass(frozen=True)
class Judged:
    """Outcome of a rule."""

    decision: Decision
    ours: float | None = None
    evidence: Evidence = field(default_factory=dict)
    other_readings: dict[str, VerdictName] = field(default_factory=dict)


def missing(what: str, command: str | None = None, **evidence: Any) -> Judged:
    """Not testable, with what is missing and the command that supplies it."""
    return Judged(Decision("not_testable"), None, {"missing": what, "run": command} | evidence)


def meets(first: Bounds, second: Bounds) -> bool:
    """Whether two intervals share a number, ends included."""
    return first[0] <= second[1] and second[0] <= first[1]


def of_number(printed: Ends, found: Spread, direction: Share | None, power: float) -> Decision:
    """Judge a printed number's rounding interval by its spread over the plants, else by its direction.

    `power` is that of `power_of`; where it is large, lying inside says nothing.
    """
    edges = [found.low_interval, found.high_interval]
    near = any(edge is not None and meets(printed, edge) for edge in edges)
    if meets(printed, (found.low, found.high)):
        return Decision("no_power" if power >= NO_POWER else "compatible", near)
    if direction is None:
        return Decision("outside_model", near)
    by_direction = of_share(direction)
    verdict: VerdictName = "direction_only" if by_direction.verdict == "compatible" else by_direction.verdict
    return Decision(verdict, near or by_direction.borderline)


def power_of(printed: Ends, found: Spread, least: float = 0.0) -> float:
    """Share of the decade around a printed number that would also be inside, 0 to 1; 1 says nothing.

    Of a number that cannot be below `least` it is the decade around what it has beyond that.
    """
    low, high = printed
    value, half = 0.5 * (low + high) - least, 0.5 * (high - low)
    ends = np.array([found.low - half, found.high + half]) - least
    decades = np.log10(np.clip(ends, value / 10**0.5, value * 10**0.5) / value)
    return float(decades[1] - decades[0])


def of_share(share: Share) -> Decision:
    """Judge one statement without a value by its share; its opposite is that it fails."""
    near = _near(share, MOST) or _near(share, FEW)
    if share.share >= MOST:
        return Decision("compatible", near)
    return Decision("contradicted" if share.share <= FEW else "depends_on_plant", near)


def of_claim(whole: Share, opposite: Share) -> Decision:
    """Judge a claim without a value by the shares on which it holds and on which its opposite does."""
    near = _near(whole, MOST) or _near(opposite, MOST) or _near(whole, FEW)
    if whole.share >= MOST:
        return Decision("compatible", near)
    if opposite.share >= MOST:
        return Decision("contradicted", near)
    return Decision("not_met" if whole.share <= FEW else "depends_on_plant", near)


def _near(share: Share, limit: float) -> bool:
    return share.interval is not None and meets(share.interval, (limit, limit))


def with_values(claim: Decision, values: Sequence[Decision]) -> Decision:
    """Judge a claim that also prints values, from its statements and from the verdicts on the values."""
    if claim.verdict != "compatible":
        return claim
    return of_values(claim, values)


def of_values(claim: Decision, values: Sequence[Decision]) -> Decision:
    """Judge a claim that is its values: by the weakest of them when all are inside, else by its direction."""
    near = any(value.borderline for value in values)
    inside = {value.verdict for value in values}
    if inside <= INSIDE:
        return Decision("no_power" if "no_power" in inside else "compatible", near)
    verdict: VerdictName = "direction_only" if claim.verdict == "compatible" else claim.verdict
    return Decision(verdict, near or claim.borderline)


def of_arithmetic(consistent: bool) -> Decision:
    """Judge what follows from other printed numbers."""
    return Decision("exact" if consistent else "not_reproduced")


def of_courses(ways: Sequence[Decision]) -> Decision:
    """Judge what has a verdict for each way in which an unprinted part can be: theirs where all agree."""
    near = any(way.borderline for way in ways)
    verdicts = {way.verdict for way in ways}
    return Decision(verdicts.pop() if len(verdicts) == 1 else "depends_on_plant", near)


def of_model(holds: bool) -> Decision:
    """Judge what follows from the printed equations without any unknown."""
    return Decision("reproduced" if holds else "not_reproduced")
