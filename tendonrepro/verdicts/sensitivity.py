"""Which unknowns decide an outcome: first-order indices from draws at hand, with a floor of chance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.monte_carlo.shares import LEAST_PLANTS

RESAMPLES = 50
SHUFFLES = 40
SEED = 20260515
FLOOR_QUANTILE = 0.95
LEAST_OTHERS = 20

# The method's usual ten harmonics fit more of the noise of a few hundred plants.
_HARMONICS = 6


class Influence(TypedDict):
    """One row of the box: its first-order index and half the width of the index's 95 % bootstrap interval."""

    name: str
    index: float
    half_width: float


class Ranking(TypedDict):
    """Rows by index, the largest first; the floor of chance; what single rows leave unexplained."""

    rows: list[Influence]
    noise_floor: float
    unexplained: float
    draws: int


def ranked(names: Sequence[str], draws: Array, outcome: Array) -> Ranking | None:
    """Rank unknowns by how much of an outcome's variance (N,) each alone explains, from draws (N, P).

    First-order indices by RBD-FAST (SALib), which needs the draws in no special order and of their values
    only the order. The noise floor is the 95 % quantile, over shuffles of the outcome, of the largest index
    of all rows. None with too few finite outcomes, `LEAST_PLANTS`, or when fewer than 20 of them differ from
    the commonest: a bootstrap of so rare an outcome may well not hold it at all.
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
    largest = [_largest_index(draws, rng.permutation(outcome)) for _ in range(SHUFFLES)]
    rows: list[Influence] = [
        {"name": name, "index": float(index), "half_width": float(half)}
        for name, index, half in zip(names, found["S1"], found["S1_conf"], strict=True)
    ]
    rows.sort(key=lambda row: -row["index"])
    floor = float(np.quantile(largest, FLOOR_QUANTILE))
    explained = sum(row["index"] for row in rows if row["index"] > floor)
    return {
        "rows": rows,
        "noise_floor": floor,
        "unexplained": max(1.0 - explained, 0.0),
        "draws": len(outcome),
    }


def _largest_index(draws: Array, outcome: Array) -> float:
    """Largest index of all rows, without the bootstrap."""
    from SALib.analyze import rbd_fast

    raw = [
        rbd_fast.compute_first_order(rbd_fast.permute_outputs(column, outcome), _HARMONICS)
        for column in draws.T
    ]
    return float(rbd_fast.unskew_S1(max(raw), _HARMONICS, len(outcome)))
