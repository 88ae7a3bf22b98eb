"""The types of an ensemble's answer as the package stores it, and pages tell it."""

from __future__ import annotations

from typing import TypedDict

from tendonrepro.monte_carlo.summary import ShareOfPlants


class Quantiles(TypedDict):
    """Median and central 90 % of the plants; None where there are too few."""

    q05: float
    median: float
    q95: float


class Orders(TypedDict, total=False):
    """Shares of the plants on which the controllers rank so, in MAE and RMSE on both joints.

    ``in_order`` is the published order, ``in_reverse`` its reverse; ``first`` is Controller 1.
    """

    in_order: ShareOfPlants
    in_reverse: ShareOfPlants
    first_best: ShareOfPlants
    first_worst: ShareOfPlants
    last_two_tie: ShareOfPlants


class ReadingAnswer(Orders, total=False):
    """What an ensemble says of one reading.

    ``without_start`` are shares of errors without the first two seconds; ``behind_by_mae``, of whole runs and
    without their start, is how often Controller 1 errs more than Controller 2, by joint.
    ``c1_c2`` and ``c2_c3`` are ratios of errors by joint; ``joint_3_over_2`` is by controller; ``ok`` are the
    shares of stable plants by run.
    """

    name: str
    diverged_last: Orders
    without_start: Orders
    behind_by_mae: dict[str, dict[str, ShareOfPlants]]
    ok: dict[str, float]
    smoother: ShareOfPlants
    rmse_over_mae_rises: ShareOfPlants
    growth: dict[str, Quantiles]
    joint_3_over_2: dict[str, Quantiles]
    c1_c2: dict[str, Quantiles]
    c2_c3: dict[str, Quantiles]


class PopulationAnswer(TypedDict):
    """Plants of a population, and what each reading gives on them."""

    plants: int
    readings: list[ReadingAnswer]


class EnsembleAnswer(TypedDict):
    """An ensemble's ``summary.json`` without what no page shows; ``docs/results/ensemble.json``."""

    tendonrepro_version: str
    config_sha256: str
    draws: int
    scramblings: int
    spot_check: dict[str, float | str | None]
    cost: dict[str, float]
    populations: dict[str, PopulationAnswer]
