"""Which unknowns decide an outcome, by their sensitivity indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, Published, published
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.first_order import first_order_index, half_width
from tendonrepro.verdicts.from_ensemble import outcome
from tendonrepro.verdicts.from_print import ErrorOf
from tendonrepro.verdicts.plants import Plants

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing

RESAMPLES = 50
SHUFFLES = 40
SEED = 20260515
FLOOR_QUANTILE = 0.95
LEAST_OTHERS = 20
"""Outcomes that differ from the commonest; a bootstrap of rarer ones may well hold none."""

DECIDED = ("C1", "C2", "C3", "C5", "C6", "E1")
"""Claims whose deciding unknowns are ranked with the ledger."""
SHOWN = 12
"""Unknowns in the picture."""


class Influence(TypedDict):
    """First-order index of an unknown, and half its 95 % interval."""

    name: str
    index: float
    half_width: float


class Influences(TypedDict):
    """Unknowns by their share of an outcome's variance, the largest first.

    ``noise_floor`` is the 95 % quantile over shuffles of the largest index; ``unexplained`` is what rows
    above it leave; ``draws`` is their number.
    """

    rows: list[Influence]
    noise_floor: float
    unexplained: float
    draws: int


def ranked(
    names: Sequence[str], draws: Array, outcome: Array, noise_floor: float | None = None
) -> Influences | None:
    """Rank unknowns by their share of an outcome's variance (N,), from draws (N, P).

    A `noise_floor` may be taken from another outcome on as many draws.

    Returns
    -------
    Influences or None
        None with too few outcomes, or too few that differ.
    """
    finite = np.isfinite(outcome)
    draws, outcome = draws[finite], outcome[finite].astype(np.float64)
    commonest = np.unique(outcome, return_counts=True)[1].max(initial=0)
    if len(outcome) < LEAST_PLANTS or len(outcome) - commonest < LEAST_OTHERS:
        return None
    rng = np.random.default_rng(SEED)
    # Equal values of an unknown must not keep the order of the sequence they were drawn in.
    order = rng.permutation(len(outcome))
    draws, outcome = draws[order], outcome[order]
    rows: list[Influence] = [
        {
            "name": name,
            "index": first_order_index(unknown, outcome),
            "half_width": half_width(unknown, outcome, RESAMPLES, rng),
        }
        for name, unknown in zip(names, draws.T, strict=True)
    ]
    rows.sort(key=lambda row: -row["index"])
    if noise_floor is None:
        largest = [_largest_index(draws, rng.permutation(outcome)) for _ in range(SHUFFLES)]
        noise_floor = float(np.quantile(largest, FLOOR_QUANTILE))
    left = max(1.0 - sum(row["index"] for row in rows if row["index"] > noise_floor), 0.0)
    return {"rows": rows, "noise_floor": noise_floor, "unexplained": left, "draws": len(outcome)}


def rankings(data: EnsembleData) -> dict[str, Influences]:
    """Rank what decides some claims, the ratio of Controllers 1 and 2, and printed errors."""
    plants = Plants(data, PRINTED)

    def rank(values: Array, *runs: str, floor: float | None = None) -> Influences | None:
        kept = plants.ok(*runs)
        return ranked(data.names, data.draws[kept], values[kept], floor)

    rankings_of = {claim: deciding(data, published(), claim) for claim in DECIDED}
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = {key: np.log(plants[key]) for key in product((*CONTROLLERS, LOADED), METRICS)}
        mae = logs[FIRST, "mae"]
        ratio, joint_3_over_2 = mae - logs[SECOND, "mae"], mae[:, -1] - mae[:, 0]
    for i, joint in enumerate(data.joints):
        rankings_of[f"ratio_joint_{joint}"] = rank(ratio[:, i], FIRST, SECOND)
    # About as many plants, so the same floor.
    first = rankings_of[f"ratio_joint_{data.joints[0]}"]
    floor = None if first is None else first["noise_floor"]
    for (run, metric), errors in logs.items():
        for i, joint in enumerate(data.joints):
            rankings_of[ErrorOf(run, metric, joint).id] = rank(errors[:, i], run, floor=floor)
    rankings_of["joint_3_over_2"] = rank(joint_3_over_2, FIRST, floor=floor)
    return {name: ranking for name, ranking in rankings_of.items() if ranking is not None}


def deciding(data: EnsembleData, paper: Published, identifier: str) -> Influences | None:
    """Rank what decides a verdict; None where nothing does."""
    try:
        values, judged = outcome(Plants(data, PRINTED), paper, identifier)
    except DataMissingError:
        return None
    return ranked(data.names, data.draws[judged], values[judged])


def _largest_index(draws: Array, outcome: Array) -> float:
    return max(first_order_index(unknown, outcome) for unknown in draws.T)


def draw_influences(rankings: Mapping[str, Influences]) -> Drawing:
    """Draw the strongest unknowns' shares of each outcome's variance."""
    from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure

    shares = {name: {row["name"]: row["index"] for row in parts["rows"]} for name, parts in rankings.items()}
    unknowns = sorted(
        next(iter(shares.values())), key=lambda name: -sum(parts[name] for parts in shares.values())
    )[:SHOWN]
    cells = np.array([[100.0 * parts[name] for parts in shares.values()] for name in unknowns])
    with journal_style():
        figure = open_figure(PAGE_MM, 48.0 + 5.0 * len(unknowns))
        axes = figure.subplots()
        axes.imshow(cells, cmap="Blues", vmin=0.0, vmax=60.0, aspect="auto")
        for (row, column), value in np.ndenumerate(cells):
            if value >= 1.0:
                ink = "white" if value > 35.0 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=ink)
        axes.set_yticks(np.arange(len(unknowns)), unknowns)
        names = [name.replace(".", " ").replace("_", " ") for name in shares]
        axes.set_xticks(np.arange(len(shares)), names, rotation=60.0, ha="right")
        axes.set_title("What decides each claim and number: share of the variance, %")
    caption = "Share of the variance of an outcome that an unknown explains alone."
    return Drawing("decides", figure, [axes], caption)
