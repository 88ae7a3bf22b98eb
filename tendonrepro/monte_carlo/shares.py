"""Shares and quantiles over the box, with intervals from independent scramblings: ``summary.json``.

Where there are no plants, or too few, a number is NaN, in a file null. Whoever reads one looks at ``plants``
first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations, product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit
from scipy.stats import binomtest

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.files import Json
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS

QUANTILES: Mapping[str, float] = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
RATIOS: Mapping[str, tuple[int, int]] = {"ratio_c1_c2": (0, 1), "ratio_c2_c3": (1, 2)}
"""Numerator and denominator by their places in `CONTROLLERS`."""

LEAST_PLANTS = 100
"""Plants below which nothing is concluded: no verdict on a claim, a reading or the printed ranking."""

LEAST_SCRAMBLINGS = 8
"""Scramblings with plants below which there is no interval."""

MOST, FEW = 0.95, 0.05
"""Shares that confirm a direction, or confirm its opposite."""

TIE = 0.05
"""Relative difference up to which two errors count as alike."""

_CONFIDENCE = 0.95

Flags: TypeAlias = NDArray[np.bool_]
Ends: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Share:
    """Part of some plants on which a statement holds; NaN without plants, see `share_of`."""

    share: float
    interval: Ends | None
    plants: int

    def as_row(self) -> Json:
        """Plain data."""
        low, high = self.interval or (np.nan, np.nan)
        return {"share": self.share, "low": low, "high": high, "plants": self.plants}


@dataclass(frozen=True)
class Spread:
    """Median and central 90 % of a number, with intervals of both ends."""

    median: float
    low: float
    high: float
    low_interval: Ends | None
    high_interval: Ends | None
    plants: int


def rate_of(hits: int, trials: int) -> Share:
    """Share of independent trials, with its exact binomial interval at 95 %; NaN without trials."""
    if not trials:
        return Share(np.nan, None, 0)
    ends = binomtest(hits, trials).proportion_ci(method="exact")
    return Share(hits / trials, (float(ends.low), float(ends.high)), trials)


def share_of(hits: Flags, replicate: NDArray[np.int64], counted: Flags | None = None) -> Share:
    """Share of the counted plants (N,) that are hits, with its interval; all count by default.

    The interval is Student's, 95 %, from the scatter of the scramblings. It is None with fewer than
    `LEAST_SCRAMBLINGS`. Each counts by its number of plants (the linearised ratio estimator). Where every
    plant is a hit, or none, the open end is the share that would show no exception once in 20 times.
    """
    counted = np.ones_like(hits) if counted is None else counted
    places = np.unique(replicate, return_inverse=True)[1]
    plants = np.bincount(places, counted)
    hit = np.bincount(places, hits & counted)
    total = int(plants.sum())
    share = float(hit.sum() / total) if total else float("nan")
    if np.count_nonzero(plants) < LEAST_SCRAMBLINGS:
        return Share(share, None, total)
    if share in {0.0, 1.0}:
        reach = 1.0 - (1.0 - _CONFIDENCE) ** (1.0 / total)
    else:
        reach = _half_width((hit - share * plants) / plants.mean())
    return Share(share, (max(share - reach, 0.0), min(share + reach, 1.0)), total)


def _half_width(values: Array) -> float:
    count = len(values)
    t = float(stdtrit(count - 1, 0.5 + 0.5 * _CONFIDENCE))
    return t * float(np.std(values, ddof=1)) / float(np.sqrt(count))


def quantiles_of(values: Array, replicate: NDArray[np.int64]) -> Json:
    """Quantiles over plants (M,), each with a t interval from the scramblings' own quantiles around it.

    A quantile is one plant's value, so infinite values do no harm; NaN would. What is undefined is NaN.
    """
    parts = [values, *(values[replicate == number] for number in np.unique(replicate))]
    # A row for each level: of all plants, then of each scrambling.
    levels = [*QUANTILES.values()]
    rows = np.full((len(levels), 1), np.nan)
    if len(values):
        rows = np.array([np.quantile(part, levels, method="inverted_cdf") for part in parts]).T
    quantiles: Json = {name: _with_interval(*row) for name, row in zip(QUANTILES, rows.tolist(), strict=True)}
    lowest, highest = (values.min(), values.max()) if len(values) else (np.nan, np.nan)
    return quantiles | {"lowest": float(lowest), "highest": float(highest), "plants": len(values)}


def _with_interval(value: float, *each: float) -> dict[str, float]:
    """A quantile of all plants, with its interval from those of the scramblings."""
    scattered = len(each) >= LEAST_SCRAMBLINGS and np.isfinite(each).all()
    reach = _half_width(np.array(each)) if scattered else np.nan
    return {"value": value, "low": value - reach, "high": value + reach}


def spread_of(values: Array, replicate: NDArray[np.int64]) -> Spread:
    """Median and central 90 % of finite values (K,), one per plant, K > 0."""
    quantiles = quantiles_of(values, replicate)
    low, high = quantiles["q05"], quantiles["q95"]
    around = [None if np.isnan(end["low"]) else (end["low"], end["high"]) for end in (low, high)]
    return Spread(
        quantiles["median"]["value"], low["value"], high["value"], around[0], around[1], len(values)
    )


def _all(flags: Flags, axis: int | tuple[int, ...] = 0) -> Flags:
    return np.asarray(flags.all(axis=axis))


def _in_order(errors: Array, order: tuple[int, ...] = (0, 1, 2)) -> Flags:
    sizes = errors[[*order]]
    return _all(sizes[:-1] < sizes[1:])


ORDERS: Mapping[str, tuple[int, ...]] = {
    "share_" + "_lt_".join(f"c{place + 1}" for place in order): order for order in permutations(range(3))
}
"""The six orders of the controllers by their places in `CONTROLLERS`, the smallest error first."""

RANKINGS: Mapping[str, Callable[[Array], Flags]] = {
    **{name: partial(_in_order, order=order) for name, order in ORDERS.items()},
    "share_c1_best": lambda errors: _all(errors[0] < errors[1:]),
    "share_c1_worst": lambda errors: _all(errors[0] > errors[1:]),
    "share_c2_lt_c1": lambda errors: errors[1] < errors[0],
    "share_c2_ties_c3": lambda errors: abs(errors[1] - errors[2]) <= TIE * np.maximum(errors[1], errors[2]),
}
"""What may hold of the errors of the three controllers, (3, N, n), on each plant and joint."""


@np.errstate(invalid="ignore")  # where two laws diverged
def reading_summary(data: EnsembleData, reading: str) -> Json:
    """What one reading makes of the claims; of another arm nothing that stands beside the print.

    Rankings and ratios are by set of `_plants`, then metric, then ``both`` joints or each. Rankings stand
    once more under ``without_start``: of errors without the first two seconds.
    """
    status = np.array([data.status(run, reading) for run in CONTROLLERS])
    counted = _plants(status)
    errors = _errors(data, reading, status)
    summary: Json = {
        "name": reading,
        "status": status_shares(data, reading),
        **_rankings(data, errors, counted),
        "without_start": _rankings(data, _errors(data, reading, status, "_settled"), counted),
        **{key: _ratios(data, pair, errors, counted) for key, pair in RATIOS.items()},
    }
    if not data.around:
        ok = counted["all_ok"]
        (mae, rmse), replicate = errors[:, :, ok], data.replicate[ok]
        steps = np.array([data.statistic(run, reading, "torque_step_rms")[ok] for run in CONTROLLERS])
        summary |= _beside_print(data.joints, mae, rmse, steps, replicate)
        summary["agreement"] = agreement(summary, data.joints)
    return summary


def _errors(data: EnsembleData, reading: str, status: NDArray[np.int8], part: str = "") -> Array:
    """Errors by metric, controller, plant and joint, of whole runs or a part; infinite where one diverged."""
    metrics = [f"{metric}{part}" for metric in METRICS]
    errors = np.array([[data.statistic(run, reading, metric) for run in CONTROLLERS] for metric in metrics])
    errors[:, status == STATUSES.index("diverged")] = np.inf
    return errors


def _rankings(data: EnsembleData, errors: Array, counted: Mapping[str, Flags]) -> Json:
    """Shares of each of `RANKINGS`, from errors as `_errors` gives them."""
    rankings: Json = {}
    for key, hold in RANKINGS.items():
        hits = dict(zip(METRICS, map(hold, errors), strict=True))
        hits["mae_and_rmse"] = hits["mae"] & hits["rmse"]
        rankings[key] = {
            plants: {
                metric: _shares(data.joints, flags, data.replicate, kept) for metric, flags in hits.items()
            }
            for plants, kept in counted.items()
        }
    return rankings


def _plants(status: NDArray[np.int8]) -> dict[str, Flags]:
    """The two sets of plants for every ranking, from statuses of the controllers, (3, N).

    ``all_ok``: the three laws are ``ok``. ``diverged_last``: not all three diverged. A law that did has an
    infinite error: it comes last, and two such are not in order. Unresolved plants are in neither.
    """
    resolved = (status != STATUSES.index("unresolved")).all(axis=0)
    rankable = resolved & ~(status == STATUSES.index("diverged")).all(axis=0)
    return {"all_ok": (status == STATUSES.index("ok")).all(axis=0), "diverged_last": rankable}


def _shares(
    joints: Sequence[int], flags: Flags, replicate: NDArray[np.int64], counted: Flags | None = None
) -> Json:
    """Shares over both joints together and each, from flags (N, n)."""
    each = {"both": _all(flags, axis=1)} | {f"joint_{joint}": flags[:, i] for i, joint in enumerate(joints)}
    return {name: share_of(hits, replicate, counted).as_row() for name, hits in each.items()}


def _ratios(data: EnsembleData, pair: tuple[int, int], errors: Array, counted: Mapping[str, Flags]) -> Json:
    """Quantiles of the ratio of two controllers' errors; none where both diverged."""
    ratios: Json = {plants: {} for plants in counted}
    for (plants, kept), (metric, sizes) in product(counted.items(), zip(METRICS, errors, strict=True)):
        above, below = sizes[[*pair]]
        ratio = above / below
        defined = kept & ~np.isnan(ratio[:, 0])
        printed = [] if data.around else printed_ratios(pair, metric, data.joints)
        ratios[plants][metric] = _by_joint(data.joints, ratio[defined], data.replicate[defined], printed)
    return ratios


def _by_joint(
    joints: Sequence[int], values: Array, replicate: NDArray[np.int64], printed: Sequence[float] = ()
) -> Json:
    """Quantiles of values (N, n) on each joint, beside the printed ones."""
    spreads = {f"joint_{joint}": quantiles_of(values[:, i], replicate) for i, joint in enumerate(joints)}
    for quantiles, number in zip(spreads.values(), printed, strict=False):
        quantiles["printed"] = number
    return spreads


def _beside_print(
    joints: Sequence[int], mae: Array, rmse: Array, steps: Array, replicate: NDArray[np.int64]
) -> Json:
    """Shapes of errors, whether Controller 1 is the smoothest, and a plant's distance from the print.

    Arrays are (3, N, n), of plants on which all controllers are ``ok``. The distance is the root mean square
    of log(ours/printed) over C1/C2 and C2/C3 of the MAE and each RMSE/MAE, per joint: they have no scale.
    """
    printed_mae, printed_rmse = (_printed_errors(metric, joints) for metric in METRICS)
    shape = rmse / mae
    scaleless = np.concatenate([mae[:-1] / mae[1:], shape])
    printed = np.concatenate([printed_mae[:-1] / printed_mae[1:], printed_rmse / printed_mae])
    apart = np.log(scaleless / printed[:, np.newaxis])
    return {
        "joint_3_over_2": {
            run: {
                metric: quantiles_of(sizes[place, :, -1] / sizes[place, :, 0], replicate)
                for metric, sizes in zip(METRICS, (mae, rmse), strict=True)
            }
            for place, run in enumerate(CONTROLLERS)
        },
        "rmse_over_mae_growth": _by_joint(joints, shape[-1] / shape[0], replicate),
        "share_rmse_over_mae_rises": _shares(joints, _in_order(shape), replicate),
        "distance": quantiles_of(np.sqrt((apart**2).mean(axis=(0, 2))), replicate),
        "share_c1_smoother": share_of(_all(steps[0] < steps[1:], axis=(0, 2)), replicate).as_row(),
    }


def _printed_errors(metric: str, joints: Sequence[int]) -> Array:
    """Errors of every controller and joint in Table 2, deg."""
    return np.array([published().per_joint(f"{row_of(run)}.{metric}", joints) for run in CONTROLLERS])


def printed_ratios(pair: tuple[int, int], metric: str, joints: Sequence[int]) -> list[float]:
    """Ratio of two controllers' errors in Table 2 for each joint."""
    above, below = _printed_errors(metric, joints)[[*pair]]
    return [float(ratio) for ratio in above / below]


def status_shares(data: EnsembleData, reading: str) -> Json:
    """Share and ``count`` of plants by run and status."""
    return {
        run: {
            name: {**share_of(codes == code, data.replicate).as_row(), "count": int((codes == code).sum())}
            for code, name in enumerate(STATUSES)
        }
        for run in data.runs
        for codes in [data.status(run, reading)]
    }


def agreement(reading: Json, joints: Sequence[int]) -> Json:
    """Compare the printed ratios with a reading's over plants on which all laws are ``ok``.

    ``agrees``: all are inside the central 90 %. ``cannot``: one is beyond every plant.
    """
    judged = {
        f"{key} {metric} joint {joint}": ours
        for key, metric, joint in product(RATIOS, METRICS, joints)
        for ours in [reading[key]["all_ok"][metric][f"joint_{joint}"]]
        if ours["plants"]
    }
    inside = [
        n for n, ours in judged.items() if ours["q05"]["value"] <= ours["printed"] <= ours["q95"]["value"]
    ]
    outside = [n for n in judged if n not in inside]
    beyond = [n for n, ours in judged.items() if not ours["lowest"] <= ours["printed"] <= ours["highest"]]
    if not judged:
        verdict = "no plant"
    elif reading["share_c1_lt_c2_lt_c3"]["all_ok"]["mae"]["both"]["plants"] < LEAST_PLANTS:
        verdict = "too few"
    else:
        verdict = "cannot" if beyond else "in part" if outside else "agrees"
    return {"verdict": verdict, "inside": inside, "outside": outside, "beyond": beyond}
