"""Which unknowns decide an outcome: sensitivity indices by SALib."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from itertools import product
from typing import TypedDict

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, Published, published
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.monte_carlo.shares import LEAST_PLANTS
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.formulas import NUMBERS, ErrorOf
from tendonrepro.verdicts.from_ensemble import numbers_of
from tendonrepro.verdicts.plants import EnsemblePlants
from tendonrepro.verdicts.rules import Mask
from tendonrepro.verdicts.statements import claim_on, together

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
LEAST_FITTED = 300
"""Plants below which no surrogate is fitted."""
MOST_TOTAL = 2.0
"""Total index beyond which a surrogate is no fit; it is at most 1 where it is one."""
SURROGATE = 8
"""The strongest unknowns, which have a total index."""


class Influence(TypedDict):
    """First-order index (RBD-FAST) of an unknown, half its 95 % bootstrap interval, and its total index."""

    name: str
    index: float
    half_width: float
    total: float | None


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
    from SALib.analyze import rbd_fast

    rng = np.random.default_rng(SEED)
    # Equal values of an unknown must not keep the order of the sequence they were drawn in.
    order = rng.permutation(len(outcome))
    draws, outcome = draws[order], outcome[order]
    problem = {"num_vars": len(names), "names": list(names)}
    indices = rbd_fast.analyze(problem, draws, outcome, M=_HARMONICS, num_resamples=RESAMPLES, seed=rng)
    rows: list[Influence] = [
        {"name": name, "index": float(index), "half_width": float(half), "total": None}
        for name, index, half in zip(names, indices["S1"], indices["S1_conf"], strict=True)
    ]
    rows.sort(key=lambda row: -row["index"])
    for row, total in zip(rows, _totals([row["name"] for row in rows], names, draws, outcome), strict=False):
        row["total"] = total
    if noise_floor is None:
        largest = [_largest_index(draws, rng.permutation(outcome)) for _ in range(SHUFFLES)]
        noise_floor = float(np.quantile(largest, FLOOR_QUANTILE))
    left = max(1.0 - sum(row["index"] for row in rows if row["index"] > noise_floor), 0.0)
    return {"rows": rows, "noise_floor": noise_floor, "unexplained": left, "draws": len(outcome)}


def rankings(data: EnsembleData) -> dict[str, Influences]:
    """Rank what decides some claims, the ratio of Controllers 1 and 2, and printed errors."""
    plants = EnsemblePlants(data, PRINTED)

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
        values, judged = _outcome(EnsemblePlants(data, PRINTED), paper, identifier)
    except DataMissingError:
        return None
    return ranked(data.names, data.draws[judged], values[judged])


def _outcome(plants: EnsemblePlants, paper: Published, identifier: str) -> tuple[Array, Mask]:
    """1 or 0 of a claim, a number or its logarithm if all are positive; and the plants judged; (N,) each."""
    rule = paper.judgements[identifier].rule
    if rule in NUMBERS:
        values, judged = numbers_of(plants, paper, identifier)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(values) if (values[judged] > 0.0).all() else values, judged
    claim = claim_on(plants, paper, rule)
    ways = map(together, claim.measures.values())
    deciding = max(ways, key=lambda holds: np.count_nonzero(holds[claim.judged]))
    return deciding.astype(np.float64), claim.judged


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
        # Its fit runs away where two choices that are rare together meet in few plants.
        warnings.simplefilter("ignore", RuntimeWarning)
        analysis = hdmr.analyze(problem, X, outcome, maxorder=2, K=1, seed=SEED)
    totals = np.zeros(len(chosen))
    totals[free] = analysis["ST"][: X.shape[1]]
    return totals.tolist() if (np.abs(totals) <= MOST_TOTAL).all() else []


def _largest_index(draws: Array, outcome: Array) -> float:
    from SALib.analyze import rbd_fast

    raw = [
        rbd_fast.compute_first_order(rbd_fast.permute_outputs(column, outcome), _HARMONICS)
        for column in draws.T
    ]
    return float(rbd_fast.unskew_S1(max(raw), _HARMONICS, len(outcome)))
