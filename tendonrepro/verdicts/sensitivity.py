"""Which unknowns decide an outcome: sensitivity indices of SALib from draws at hand."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import Published, published
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.from_ensemble import outcome
from tendonrepro.verdicts.numbers import FIRST, LOADED, SECOND, ErrorOf
from tendonrepro.verdicts.plants import Plants
from tendonrepro.verdicts.rules import Mask

if TYPE_CHECKING:
    from tendonrepro.results.figures.style import Drawing

RESAMPLES = 50
SHUFFLES = 40
SEED = 20260515
FLOOR_QUANTILE = 0.95
LEAST_OTHERS = 20
"""Outcomes that differ from the commonest; a bootstrap of rarer ones may well hold none."""

# The method's usual ten harmonics fit more of the noise of a few hundred plants.
_HARMONICS = 6

DECIDED = ("C1", "C2", "C3", "C5", "C6", "E1")
"""Claims whose deciding unknowns are ranked with the ledger."""
SHOWN = 12
"""Unknowns in the picture."""
LEAST_FITTED = 300
"""Plants below which no surrogate is fitted."""
SURROGATE = 8
"""The strongest unknowns, which have a total index."""

Ranking: TypeAlias = dict[str, Any]
"""What `ranked` returns."""


def ranked(
    names: Sequence[str], draws: Array, outcome: Array, noise_floor: float | None = None
) -> Ranking | None:
    """Rank unknowns by how much of an outcome's variance (N,) each alone explains, from draws (N, P).

    First-order indices by RBD-FAST. `noise_floor` is that of another outcome on as many draws; by itself it
    is the 95 % quantile, over shuffles of the outcome, of the largest index.

    Returns
    -------
    dict or None
        ``rows``, the largest index first, each with ``name``, ``index``, ``half_width`` of its 95 % bootstrap
        interval, and of the strongest ``total``, alone or with one other; ``noise_floor``; ``unexplained`` by
        single rows above it; ``draws``. None with fewer finite outcomes than `LEAST_PLANTS`, or fewer others
        than `LEAST_OTHERS`.
    """
    finite = np.isfinite(outcome)
    draws, outcome = draws[finite], outcome[finite].astype(np.float64)
    commonest = np.unique(outcome, return_counts=True)[1].max(initial=0)
    if len(outcome) < LEAST_PLANTS or len(outcome) - commonest < LEAST_OTHERS:
        return None
    from SALib.analyze import rbd_fast

    rng = np.random.default_rng(SEED)
    # Equal values of an unknown must not keep the order of the sequence they were drawn in.
    order = rng.permutation(len(outcome))
    draws, outcome = draws[order], outcome[order]
    problem = {"num_vars": len(names), "names": list(names)}
    found = rbd_fast.analyze(problem, draws, outcome, M=_HARMONICS, num_resamples=RESAMPLES, seed=rng)
    rows: list[dict[str, Any]] = [
        {"name": name, "index": float(index), "half_width": float(half), "total": None}
        for name, index, half in zip(names, found["S1"], found["S1_conf"], strict=True)
    ]
    rows.sort(key=lambda row: -row["index"])
    for row, total in zip(rows, _totals([row["name"] for row in rows], names, draws, outcome), strict=False):
        row["total"] = total
    if noise_floor is None:
        largest = [_largest_index(draws, rng.permutation(outcome)) for _ in range(SHUFFLES)]
        noise_floor = float(np.quantile(largest, FLOOR_QUANTILE))
    left = max(1.0 - sum(row["index"] for row in rows if row["index"] > noise_floor), 0.0)
    return {"rows": rows, "noise_floor": noise_floor, "unexplained": left, "draws": len(outcome)}


def rankings(data: EnsembleData) -> dict[str, Ranking]:
    """Rank the unknowns that decide some claims, the ratio of Controllers 1 and 2, and the tables' numbers.

    A number's noise floor is that of the ratio, on about as many plants.
    """
    plants = Plants(data, PRINTED)
    found = {claim: deciding(data, published(), claim) for claim in DECIDED}
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(plants[FIRST, "mae"] / plants[SECOND, "mae"])
    for i, joint in enumerate(data.joints):
        found[f"ratio_joint_{joint}"] = _ranked(data, ratio[:, i], plants.ok(FIRST, SECOND))
    first = found[f"ratio_joint_{data.joints[0]}"]
    floor = None if first is None else first["noise_floor"]
    found |= {name: _ranked(data, values, kept, floor) for name, values, kept in _numbers(plants)}
    return {name: ranking for name, ranking in found.items() if ranking is not None}


def deciding(data: EnsembleData, paper: Published, identifier: str) -> Ranking | None:
    """Rank the unknowns that decide a verdict; None where there is nothing to rank."""
    try:
        values, judged = outcome(Plants(data, PRINTED), paper, identifier)
    except DataMissingError:
        return None
    return _ranked(data, values, judged)


def _ranked(data: EnsembleData, values: Array, kept: Mask, floor: float | None = None) -> Ranking | None:
    return ranked(data.names, data.draws[kept], values[kept], floor)


def _numbers(plants: Plants) -> Iterator[tuple[str, Array, Mask]]:
    """Yield the logarithm of every number of Tables 2 and 3, and of joint 3's error over joint 2's."""
    for run, metric in product((*CONTROLLERS, LOADED), ("mae", "rmse")):
        with np.errstate(divide="ignore"):
            errors = np.log(plants[run, metric])
        for i, joint in enumerate(plants.joints):
            yield ErrorOf(run, metric, joint).id, errors[:, i], plants.ok(run)
        if (run, metric) == (FIRST, "mae"):
            yield "joint_3_over_2", errors[:, -1] - errors[:, 0], plants.ok(run)


def _totals(strongest: Sequence[str], names: Sequence[str], draws: Array, outcome: Array) -> list[float]:
    """Total indices of the first `SURROGATE` unknowns, by HDMR."""
    from SALib.analyze import hdmr

    if len(outcome) < LEAST_FITTED:
        return []
    chosen = [names.index(name) for name in strongest[:SURROGATE]]
    X = draws[:, chosen]
    free = X.max(axis=0) > X.min(axis=0)
    X = X[:, free]
    problem = {
        "num_vars": X.shape[1],
        "names": np.array(names)[chosen][free].tolist(),
        "bounds": np.column_stack([X.min(axis=0), X.max(axis=0)]).tolist(),
    }
    with warnings.catch_warnings():
        # What SALib would have instead fails on unknowns that are choices.
        warnings.simplefilter("ignore", DeprecationWarning)
        found = hdmr.analyze(problem, X, outcome, maxorder=2, K=1, seed=SEED)
    totals = np.zeros(len(chosen))
    totals[free] = found["ST"][: X.shape[1]]
    return totals.tolist()


def _largest_index(draws: Array, outcome: Array) -> float:
    """Largest index, without the bootstrap."""
    from SALib.analyze import rbd_fast

    raw = [
        rbd_fast.compute_first_order(rbd_fast.permute_outputs(column, outcome), _HARMONICS)
        for column in draws.T
    ]
    return float(rbd_fast.unskew_S1(max(raw), _HARMONICS, len(outcome)))


def draw_influences(found: Mapping[str, Ranking]) -> Drawing:
    """Draw the share of each outcome's variance that the strongest unknowns explain."""
    from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure

    shares = {
        name: {row["name"]: row["index"] if row["total"] is None else row["total"] for row in held["rows"]}
        for name, held in found.items()
    }
    unknowns = sorted(
        next(iter(shares.values())), key=lambda name: -sum(held[name] for held in shares.values())
    )[:SHOWN]
    cells = np.array([[100.0 * held[name] for held in shares.values()] for name in unknowns])
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
    caption = "Share of the variance of an outcome that an unknown explains, alone or with one other."
    return Drawing("decides", figure, [axes], caption)
