"""Which unknowns decide an outcome, by their sensitivity indices; and their picture.

An index is that of RBD-FAST: which share of an outcome's variance an unknown explains alone. Outcomes in the
order of an unknown, up through every second one and down through the rest, are one period of a function of
it. What the unknown explains is in the first harmonics.
Sources: Tarantola et al. 2006, doi:10.1016/j.ress.2005.06.003; Plischke 2010, doi:10.1016/j.ress.2009.11.005;
Tissot and Prieur 2012, doi:10.1016/j.ress.2012.06.010.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import product
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, RUNS, SECOND
from tendonrepro.configuration.models.readings import PRINTED, UNDER_READINGS
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.console import count_of
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure
from tendonrepro.verdicts.from_print import ErrorOf
from tendonrepro.verdicts.rules import Mask
from tendonrepro.verdicts.statements import Plants, claim_on, together

HARMONICS = 6
"""The method's usual ten fit more of the noise of a few hundred plants."""

NORMAL_95 = 1.959963984540054
"""Standard deviations on each side that hold 95 % of a normal distribution."""


def first_order_index(unknown: Array, outcome: Array) -> float:
    """Share of an outcome's variance (N,) that an unknown (N,) explains alone.

    What the harmonics catch by chance is taken off, so an index can lie a little below 0.
    """
    by_size = np.argsort(unknown)
    period = outcome[np.concatenate([by_size[::2], by_size[1::2][::-1]])]
    power = np.abs(np.fft.rfft(period - period.mean())[1:]) ** 2
    if len(outcome) % 2 == 0:
        # Every other frequency stands for its negative, too.
        power[-1] *= 0.5
    caught = power[:HARMONICS].sum() / power.sum()
    chance = 2.0 * HARMONICS / len(outcome)
    return float(caught - chance / (1.0 - chance) * (1.0 - caught))


def half_width(unknown: Array, outcome: Array, resamples: int, rng: np.random.Generator) -> float:
    """Half the 95 % interval of the index, by a bootstrap of half the plants, which is on the wide side."""
    plants = len(outcome)
    indices = np.empty(resamples)
    for k in range(resamples):
        chosen = rng.choice(plants, size=plants // 2)
        indices[k] = first_order_index(unknown[chosen], outcome[chosen])
    return float(NORMAL_95 * indices.std(ddof=1))


RESAMPLES = 50
SHUFFLES = 40
SEED = 20260515
FLOOR_QUANTILE = 0.95
LEAST_OTHERS = 20
"""Outcomes that differ from the commonest; a bootstrap of rarer ones may well hold none."""

DECIDED = ("C1", "C2", "C3", "C5", "C6", "E1")
"""Claims whose deciding unknowns are ranked with the ledger."""

Influences: TypeAlias = Json
"""Unknowns by their share of an outcome's variance, the largest first.

Of its ``rows`` each has ``name``, ``index`` and ``half_width``, half the 95 % interval of the index.

``noise_floor`` is the 95 % quantile over shuffles of the largest index, or the largest index of what
cannot act; ``unexplained`` is what rows above it leave; ``draws`` is their number.
"""


def ranked(
    names: Sequence[str], draws: Array, outcome: Array, inert: Collection[str] = ()
) -> Influences | None:
    """Rank unknowns by their share of an outcome's variance (N,), from draws (N, P).

    Those that are `inert` cannot act. What share they seem to have is the draws' doing, so it is no less than
    the noise floor.

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
    acts = np.array([name not in inert for name in names])
    rows = [
        {
            "name": name,
            "index": first_order_index(unknown, outcome),
            "half_width": half_width(unknown, outcome, RESAMPLES, rng),
        }
        for name, unknown in zip(np.array(names)[acts].tolist(), draws[:, acts].T, strict=True)
    ]
    rows.sort(key=lambda row: -row["index"])
    by_chance = [_largest_index(draws[:, acts], rng.permutation(outcome)) for _ in range(SHUFFLES)]
    of_inert = _largest_index(draws[:, ~acts], outcome)
    noise_floor = max(float(np.quantile(by_chance, FLOOR_QUANTILE)), of_inert)
    left = max(1.0 - sum(row["index"] for row in rows if row["index"] > noise_floor), 0.0)
    return {"rows": rows, "noise_floor": noise_floor, "unexplained": left, "draws": len(outcome)}


def rankings(data: EnsembleData) -> dict[str, Influences]:
    """Rank what decides some claims, the ratio of Controllers 1 and 2, and printed errors."""
    plants = Plants(data, PRINTED)
    rankings_of = {claim: _deciding(plants, data, claim) for claim in DECIDED}
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = {key: np.log(plants[key]) for key in product(RUNS, METRICS)}
        mae = logs[FIRST, "mae"]
        ratio, joint_3_over_2 = mae - logs[SECOND, "mae"], mae[:, -1] - mae[:, 0]
    for i, joint in enumerate(data.joints):
        rankings_of[f"ratio_joint_{joint}"] = _ranked(data, plants.ok(FIRST, SECOND), ratio[:, i])
    for (run, metric), errors in logs.items():
        for i, joint in enumerate(data.joints):
            rankings_of[ErrorOf(run, metric, joint).id] = _ranked(data, plants.ok(run), errors[:, i])
    rankings_of["joint_3_over_2"] = _ranked(data, plants.ok(FIRST), joint_3_over_2)
    return {name: ranking for name, ranking in rankings_of.items() if ranking is not None}


def _deciding(plants: Plants, data: EnsembleData, identifier: str) -> Influences | None:
    """Rank what decides a claim, by the measure that holds most often; None where nothing does."""
    try:
        claim = claim_on(plants, published(), published().judgements[identifier].rule)
    except DataMissingError:
        return None
    ways = map(together, claim.measures.values())
    most = max(ways, key=lambda holds: np.count_nonzero(holds[claim.judged]))
    return _ranked(data, claim.judged, most.astype(np.float64))


def _ranked(data: EnsembleData, kept: Mask, values: Array) -> Influences | None:
    """Rank by some plants of an ensemble under the equations as printed."""
    return ranked(data.names, data.draws[kept], values[kept], UNDER_READINGS)


def _largest_index(draws: Array, outcome: Array) -> float:
    return max((first_order_index(unknown, outcome) for unknown in draws.T), default=0.0)


SHOWN = 12
"""Unknowns in the picture."""

_PARTS = {"table2": "Table 2", "table3": "Table 3", "mae": "MAE", "rmse": "RMSE"}
"""Parts of an outcome's name as a reader knows them."""


def draw_influences(rankings: Mapping[str, Influences], plants: int) -> Drawing:
    """Draw the strongest unknowns' shares of each outcome's variance, over a number of plants."""
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
        names = [
            ", ".join(_PARTS.get(part, part.replace("_", " ")) for part in name.split(".")) for name in shares
        ]
        axes.set_xticks(np.arange(len(shares)), names, rotation=60.0, ha="right", rotation_mode="anchor")
        axes.set_title("What decides each claim and number: share of the variance, %")
    caption = "Share of the variance of an outcome that an unknown explains alone."
    return Drawing("decides", figure, [axes], caption, f"Simulated, {count_of(plants, 'plant')} of the box")
