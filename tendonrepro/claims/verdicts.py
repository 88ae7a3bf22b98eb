"""Rules of docs/verdicts.md: shares of the box, ranges, and the verdicts that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tendonrepro.ensemble.shares import FEW, MOST, Ends, Range, Share

Name: TypeAlias = Literal[
    "exact",
    "reproduced",
    "compatible",
    "direction_only",
    "depends_on_plant",
    "contradicted",
    "outside_model",
    "not_reproduced",
    "not_testable",
]
NAMES: tuple[Name, ...] = get_args(Name)
FAILURES = frozenset({"not_reproduced", "contradicted", "outside_model"})
"""Verdicts for which ``claims --check`` ends with exit code 3."""

SIMILAR = 0.05
"""Largest relative difference of what is called similar."""
LEAST_PLANTS = 100
MOST_UNRESOLVED = 0.05

Mask: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True)
class Decision:
    """A verdict, and whether a threshold behind it lies inside an interval."""

    verdict: Name
    borderline: bool = False


def inside(printed: Ends, found: Range) -> bool:
    """Whether a printed number's rounding interval meets the central 90 %, ends included."""
    return printed[0] <= found.high and printed[1] >= found.low


def of_number(printed: Ends, found: Range, direction: Share | None) -> Decision:
    """Judge a printed number.

    Parameters
    ----------
    printed : tuple of float
        Its rounding interval.
    found : Range
        The same number over the plants.
    direction : Share or None
        Where its direction holds; None when it claims none.
    """
    edges = [found.low_interval, found.high_interval]
    near = any(edge is not None and meets(printed, edge) for edge in edges)
    if inside(printed, found):
        return Decision("compatible", near)
    if direction is None:
        return Decision("outside_model", near)
    by_direction = of_share(direction)
    verdict: Name = "direction_only" if by_direction.verdict == "compatible" else by_direction.verdict
    return Decision(verdict, near or by_direction.borderline)


def of_share(share: Share) -> Decision:
    """Judge a claim, or one statement of it, without a value by its share."""
    near = any(_within(limit, share.interval) for limit in (MOST, FEW))
    if share.value >= MOST:
        return Decision("compatible", near)
    return Decision("contradicted" if share.value <= FEW else "depends_on_plant", near)


def with_values(claim: Decision, values: Sequence[Decision]) -> Decision:
    """Judge a claim that also prints values, from its statements and from the verdicts on the values."""
    if claim.verdict != "compatible" or all(value.verdict == "compatible" for value in values):
        return Decision(claim.verdict, claim.borderline or _any_near(claim, values))
    return Decision("direction_only", claim.borderline or _any_near(claim, values))


def of_values(values: Sequence[Decision], claim: Decision) -> Decision:
    """Judge a claim that is its values: compatible when all are, else by its direction."""
    near = any(value.borderline for value in values)
    if all(value.verdict == "compatible" for value in values):
        return Decision("compatible", near)
    verdict: Name = "direction_only" if claim.verdict == "compatible" else claim.verdict
    return Decision(verdict, near or claim.borderline)


def of_arithmetic(consistent: bool) -> Decision:
    """Judge what follows from other printed numbers."""
    return Decision("exact" if consistent else "not_reproduced")


def of_model(holds: bool) -> Decision:
    """Judge what follows from the printed equations without any unknown."""
    return Decision("reproduced" if holds else "not_reproduced")


def meets(first: Ends, second: Ends) -> bool:
    """Whether two intervals share a number."""
    return first[0] <= second[1] and second[0] <= first[1]


def _within(limit: float, interval: Ends | None) -> bool:
    return interval is not None and interval[0] <= limit <= interval[1]


def _any_near(claim: Decision, values: Sequence[Decision]) -> bool:
    return claim.verdict == "compatible" and any(value.borderline for value in values)
