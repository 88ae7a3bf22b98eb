"""The types of ``summary.json`` of an ensemble.

Where there are no plants, or too few, a number is NaN, in a file null. Whoever reads one looks at ``plants``
first.
"""

from __future__ import annotations

from typing import Literal, NotRequired, TypeAlias, TypedDict

SUMMARY_VERSION = 2
"""Of ``summary.json``: from 2 on the first population stands under ``populations`` alone."""

RatioName: TypeAlias = Literal["ratio_c1_c2", "ratio_c2_c3"]
"""Key of a ratio of two controllers' errors."""


class ShareOfPlants(TypedDict):
    """A share of so many plants, with its 95 % interval."""

    share: float
    low: float
    high: float
    plants: int


class StatusShare(ShareOfPlants):
    """A share of plants, and how many they are."""

    count: int


class Quantile(TypedDict):
    """A quantile with its 95 % interval."""

    value: float
    low: float
    high: float


class Quantiles(TypedDict):
    """How a number spreads over plants, beside what the paper prints."""

    q05: Quantile
    q25: Quantile
    median: Quantile
    q75: Quantile
    q95: Quantile
    lowest: float
    highest: float
    plants: int
    printed: NotRequired[float]


SharesByJoint: TypeAlias = dict[str, ShareOfPlants]
"""Shares by ``both`` joints, or one."""

QuantilesByJoint: TypeAlias = dict[str, Quantiles]
"""Quantiles by joint."""

RankingShares: TypeAlias = dict[str, dict[str, SharesByJoint]]
"""How often a ranking holds, by set of plants and metric."""

ErrorRatio: TypeAlias = dict[str, dict[str, QuantilesByJoint]]
"""A ratio of errors, by set of plants and metric."""


class Rankings(TypedDict):
    """How often each of `shares.RANKINGS` holds."""

    share_c1_lt_c2_lt_c3: RankingShares
    share_c1_lt_c3_lt_c2: RankingShares
    share_c2_lt_c1_lt_c3: RankingShares
    share_c2_lt_c3_lt_c1: RankingShares
    share_c3_lt_c1_lt_c2: RankingShares
    share_c3_lt_c2_lt_c1: RankingShares
    share_c1_best: RankingShares
    share_c1_worst: RankingShares
    share_c2_lt_c1: RankingShares
    share_c2_ties_c3: RankingShares


class Agreement(TypedDict):
    """Whether the printed ratios lie among a reading's: the verdict, and their names."""

    verdict: str
    inside: list[str]
    outside: list[str]
    beyond: list[str]


class BesidePrint(TypedDict, total=False):
    """Shapes of errors, and how far a plant is from the print; nothing of it is said of another arm."""

    joint_3_over_2: dict[str, dict[str, Quantiles]]
    rmse_over_mae_growth: QuantilesByJoint
    share_rmse_over_mae_rises: SharesByJoint
    distance: Quantiles
    share_c1_smoother: ShareOfPlants
    agreement: Agreement


class ReadingSummary(Rankings, BesidePrint):
    """What one reading makes of the claims; ``theory`` is the ratio C1/C2 of slow errors, by joint."""

    name: str
    status: dict[str, dict[str, StatusShare]]
    without_start: Rankings
    ratio_c1_c2: ErrorRatio
    ratio_c2_c3: ErrorRatio
    theory: NotRequired[dict[str, float]]


class PairRow(TypedDict):
    """Errors of one run over another's on one joint, see `report.pair_rows`."""

    reading: str
    run: str
    over: str
    joint: int
    arms: int
    ratio: float
    ratio_low: float
    ratio_high: float
    share_smaller: float
    share_low: float
    share_high: float


class PopulationSummary(TypedDict):
    """What there is to say about one population; pairs of another arm alone."""

    plants: int
    joints: list[int]
    laws: dict[str, dict[str, int]]
    readings: list[ReadingSummary]
    pairs: NotRequired[list[PairRow]]


class Summary(TypedDict):
    """An ensemble; the first of its populations is the one by which claims are judged."""

    schema_version: int
    experiment: str
    tendonrepro_version: str
    config_sha256: str
    identity: str
    physics_sha256: str
    of_paper: bool
    around: NotRequired[dict[str, object]]
    seed: int
    draws: int
    scramblings: int
    populations: dict[str, PopulationSummary]
    cost: dict[str, float]
    experiments_per_second: float | None
    resumed_from: int
    blocks: int
