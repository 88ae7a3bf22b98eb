"""The types of ``summary.json`` of an ensemble.

Where there are no plants a number is None. Whoever reads one looks at ``plants`` first.
"""

from __future__ import annotations

from typing import Literal, NotRequired, TypeAlias, TypedDict

RatioName: TypeAlias = Literal["ratio_c1_c2", "ratio_c2_c3"]
"""Key of a ratio of two controllers' errors."""


QuantileName: TypeAlias = Literal["q05", "q25", "median", "q75", "q95"]
"""Key of a quantile."""


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


Shares: TypeAlias = dict[str, ShareOfPlants]
"""Shares by ``both`` joints, or one."""

Spreads: TypeAlias = dict[str, Quantiles]
"""Quantiles by joint."""

Ranking: TypeAlias = dict[str, dict[str, Shares]]
"""How often a ranking holds, by set of plants and metric."""

Ratio: TypeAlias = dict[str, dict[str, Spreads]]
"""A ratio of errors, by set of plants and metric."""


RankingName: TypeAlias = Literal[
    "share_c1_lt_c2_lt_c3", "share_c3_lt_c2_lt_c1", "share_c1_best", "share_c1_worst", "share_c2_ties_c3"
]
"""Key of a ranking that pages show."""


class Rankings(TypedDict):
    """How often each of `shares.RANKINGS` holds."""

    share_c1_lt_c2_lt_c3: Ranking
    share_c1_lt_c3_lt_c2: Ranking
    share_c2_lt_c1_lt_c3: Ranking
    share_c2_lt_c3_lt_c1: Ranking
    share_c3_lt_c1_lt_c2: Ranking
    share_c3_lt_c2_lt_c1: Ranking
    share_c1_best: Ranking
    share_c1_worst: Ranking
    share_c2_lt_c1: Ranking
    share_c2_ties_c3: Ranking


class Agreement(TypedDict):
    """Whether the printed ratios lie among a reading's: the verdict, and their names."""

    verdict: str
    inside: list[str]
    outside: list[str]
    beyond: list[str]


class Shapes(TypedDict):
    """RMSE over MAE, and how far a plant is from the print."""

    share_reverse_near_print: ShareOfPlants
    rmse_over_mae: dict[str, Spreads]
    rmse_over_mae_growth: Spreads
    share_rmse_over_mae_rises: Shares
    distance: Quantiles
    share_c1_smoother: ShareOfPlants
    share_order_and_smoother: ShareOfPlants
    share_order_and_rise: ShareOfPlants
    share_order_rise_and_smoother: ShareOfPlants


class OfAnyArm(Rankings):
    """What one reading makes of the claims that any arm can be asked about."""

    name: str
    status: dict[str, dict[str, StatusShare]]
    without_start: Rankings
    ratio_c1_c2: Ratio
    ratio_c2_c3: Ratio


class OfPaper(OfAnyArm, Shapes):
    """What one reading makes of the claims."""

    joint_3_over_2: dict[str, dict[str, Quantiles]]
    agreement: Agreement


class ReadingSummary(OfPaper):
    """A reading as it is stored, with the ratio of slow errors. Of another arm `OfAnyArm` is all there is."""

    theory: dict[str, float]


class PairRow(TypedDict):
    """Errors of one run over another's on one joint, see `arm_report.pair_rows`."""

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


class StoredAround(TypedDict):
    """Which arm plants lie around."""

    arm: str
    spread: float | None
    told: str


class Summary(PopulationSummary):
    """An ensemble, its first population twice."""

    tendonrepro_version: str
    config_sha256: str
    of_paper: bool
    around: NotRequired[StoredAround]
    draws: int
    scramblings: int
    spot_check: dict[str, float | str | None]
    cost: dict[str, float]
    populations: dict[str, PopulationSummary]
