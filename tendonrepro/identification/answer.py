"""What searches give, by the keys of ``identify.json``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NotRequired, TypedDict

from tendonrepro.files import Json


class ParameterRow(TypedDict):
    """A row of the ranges on the best plant, and on the seeds' plants that come near."""

    name: str
    unit: str
    low: float
    high: float
    searched: bool
    choice: bool
    best: float | str
    at_bound: str | None
    plants: list[float | str]


class KnownRow(TypedDict):
    """What the numbers tell of a row that was searched; `value` is that of an arm of one's own."""

    name: str
    unit: str
    best: float | str
    lowest: float | str
    highest: float | str
    of_range: float
    determined: bool
    known: str
    value: NotRequired[float]
    value_unit: NotRequired[str]


class SearchAnswer(TypedDict):
    """The search of one reading; rows of `best_shape` and `numbers` have keys that name whose they are."""

    name: str
    search: str
    misfit_log: float
    misfit_rounding: float | None
    fits: bool
    near_limit: float
    near_count: int
    misfit_by_seed: list[float]
    seeds_agree: bool
    rows_searched: list[str]
    best_shape: list[Json]
    numbers: list[Json]
    parameters: list[ParameterRow]
    known: list[KnownRow]


def nearest_search(searches: Sequence[SearchAnswer]) -> SearchAnswer:
    """The reading that fits best."""
    return min(searches, key=lambda search: search["misfit_log"])
