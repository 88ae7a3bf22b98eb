"""Shares of the box and quantiles over it, each with an interval from independent scramblings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import permutations
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import published
from tendonrepro.monte_carlo.data import EnsembleData
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS

METRICS = ("mae", "rmse")
QUANTILES: Mapping[str, float] = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
RATIOS: Mapping[str, tuple[int, int]] = {"ratio_c1_c2": (0, 1), "ratio_c2_c3": (1, 2)}
"""Numerator and denominator by their places in `CONTROLLERS`."""

RATIO_NAMES: Mapping[str, str] = {"ratio_c1_c2": "C1/C2", "ratio_c2_c3": "C2/C3"}

PLANT_SETS = ("all_ok", "diverged_last")
"""The two sets of plants that every ranking is given over.

``all_ok``: plants on which the three laws are ``ok``. ``diverged_last``: all on which not all three diverged;
a law that did has an infinite error, so that it comes last and two that did are not in order; a law that
rings is ranked by the error it has. Plants that the integrator could not resolve are in neither, and are
counted.
"""

LEAST_PLANTS = 100
"""Plants below which nothing is concluded: no verdict on a claim, a reading or the printed ranking."""

LEAST_SCRAMBLINGS = 8
"""Scramblings with plants below which there is no interval."""

NEAR = 2.0
"""Factor of a printed error within which one of ours counts as of its size."""

MOST, FEW = 0.95, 0.05
"""Shares that confirm a direction, or confirm its opposite."""

TIE = 0.05
"""Relative difference up to which two errors count as alike."""

_CONFIDENCE = 0.95

Flags: TypeAlias = NDArray[np.bool_]
Ends: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Share:
    """Part of some plants on which a statement holds, with its interval over the scramblings.

    Attributes
    ----------
    share : float
        NaN without plants.
    interval : tuple of float, or None
        None with fewer than `LEAST_SCRAMBLINGS` scramblings.
    plants : int
        The number counted.
    """

    share: float
    interval: Ends | None
    plants: int

    def as_row(self) -> dict[str, Any]:
        """Plain data with the interval's ends apart."""
        low, high = self.interval or (None, None)
        share = self.share if self.plants else None
        return {"share": share, "low": low, "high": high, "plants": self.plants}


@dataclass(frozen=True)
class Spread:
    """Median and central 90 % of a number, with intervals of both ends over the scramblings."""

    median: float
    low: float
    high: float
    low_interval: Ends | None
    high_interval: Ends | None
    plants: int


def share_of(hits: Flags, replicate: NDArray[np.int64], counted: Flags | None = None) -> Share:
    """Share of the counted plants that are hits, with its interval.

    The interval is Student's, 95 %, from the scatter of the scramblings. Each scrambling counts by its number
    of plants (the linearised ratio estimator), so one with few counted plants cannot distort it; with equal
    numbers it is the plain t interval of their means. Where no scrambling differs from 0 or 1 there is no
    scatter, and the open end is where a share would show no exception among so many plants once in 20 times.

    Parameters
    ----------
    hits : bool array (N,)
    replicate : int array (N,)
        Number of the scrambling.
    counted : bool array (N,), optional
        Plants that count; all if not given.
    """
    counted = np.ones_like(hits) if counted is None else counted
    places = np.unique(replicate, return_inverse=True)[1]
    plants = np.bincount(places, counted)
    found = np.bincount(places, hits & counted)
    total = int(plants.sum())
    share = float(found.sum() / total) if total else float("nan")
    if np.count_nonzero(plants) < LEAST_SCRAMBLINGS:
        return Share(share, None, total)
    if share in {0.0, 1.0}:
        reach = 1.0 - (1.0 - _CONFIDENCE) ** (1.0 / total)
    else:
        reach = _half_width((found - share * plants) / plants.mean())
    return Share(share, (max(share - reach, 0.0), min(share + reach, 1.0)), total)


def _half_width(values: Array) -> float:
    """Half the width of the t interval of a mean."""
    count = len(values)
    t = float(stdtrit(count - 1, 0.5 + 0.5 * _CONFIDENCE))
    return t * float(np.std(values, ddof=1)) / float(np.sqrt(count))


def quantiles_of(values: Array, replicate: NDArray[np.int64]) -> dict[str, Any]:
    """Quantiles over plants (M,), each with the t interval of the scramblings' own quantiles around it.

    A quantile is always the value of one of the plants (inverted distribution function), so infinite values
    do no harm; NaN would. What is undefined is None.
    """
    if len(values) == 0:
        nothing = {"value": None, "low": None, "high": None}
        return {name: dict(nothing) for name in QUANTILES} | {"lowest": None, "highest": None, "plants": 0}
    levels = list(QUANTILES.values())
    pooled = np.quantile(values, levels, method="inverted_cdf")
    parts = [values[replicate == number] for number in np.unique(replicate)]
    each = np.array([np.quantile(part, levels, method="inverted_cdf") for part in parts])
    result: dict[str, Any] = {}
    for place, name in enumerate(QUANTILES):
        value, column = float(pooled[place]), each[:, place]
        enough = len(column) >= LEAST_SCRAMBLINGS and bool(np.isfinite(column).all())
        reach = _half_width(column) if enough else None
        interval = (None, None) if reach is None else (value - reach, value + reach)
        result[name] = {"value": value, "low": interval[0], "high": interval[1]}
    extremes = {"lowest": float(values.min()), "highest": float(values.max())}
    return result | extremes | {"plants": len(values)}


def spread_of(values: Array, replicate: NDArray[np.int64]) -> Spread:
    """Median and central 90 % of a number over plants.

    Parameters
    ----------
    values : array (K,)
        One per plant judged, K > 0, finite.
    replicate : int array (K,)
        Scrambling each plant belongs to.
    """
    found = quantiles_of(values, replicate)
    low, high = found["q05"], found["q95"]
    around = [None if end["low"] is None else (end["low"], end["high"]) for end in (low, high)]
    return Spread(found["median"]["value"], low["value"], high["value"], around[0], around[1], len(values))


def reading_summary(data: EnsembleData, reading: str) -> dict[str, Any]:
    """What one reading makes of the claims: shares, ratios, statuses, agreement with the printed ratios.

    Rankings and ratios are given over each of `PLANT_SETS`, then by metric, then for ``both`` joints or each;
    ``rmse_over_mae``, which has no scale, by run over plants on which the three laws are ``ok``.
    """
    status = np.array([data.status(run, reading) for run in CONTROLLERS])
    counted = _plants(status)
    # Metric, controller, plant, joint.
    errors = np.array([[data.statistic(run, reading, metric) for run in CONTROLLERS] for metric in METRICS])
    errors[:, status == STATUSES.index("diverged")] = np.inf
    result: dict[str, Any] = {"name": reading, "status": status_shares(data, reading)}
    for key, hold in RANKINGS.items():
        flags = [hold(sizes) for sizes in errors]
        held = dict(zip(METRICS, flags, strict=True)) | {"mae_and_rmse": flags[0] & flags[1]}
        result[key] = {
            plants: {metric: _shares(data, hits, data.replicate, kept) for metric, hits in held.items()}
            for plants, kept in counted.items()
        }
    for key, pair in RATIOS.items():
        result[key] = {
            plants: {
                metric: _ratio_quantiles(data, sizes, pair, kept, printed_ratios(pair, metric, data.joints))
                for metric, sizes in zip(METRICS, errors, strict=True)
            }
            for plants, kept in counted.items()
        }
    result["joint_3_over_2"] = _joints_apart(data, reading, counted["all_ok"])
    result |= _shapes(data, reading, counted["all_ok"])
    return result | {"agreement": agreement(result, data.joints)}


def _joints_apart(data: EnsembleData, reading: str, kept: Flags) -> dict[str, Any]:
    """Error of the last joint over that of the first, by controller and metric."""
    found: dict[str, Any] = {}
    for run in CONTROLLERS:
        found[run] = {}
        for metric in METRICS:
            size = data.statistic(run, reading, metric)
            counted = kept & (size[:, 0] > 0.0)
            ratio = size[counted, -1] / size[counted, 0]
            found[run][metric] = quantiles_of(ratio, data.replicate[counted])
    return found


def _plants(status: NDArray[np.int8]) -> dict[str, Flags]:
    resolved = (status != STATUSES.index("unresolved")).all(axis=0)
    rankable = resolved & ~(status == STATUSES.index("diverged")).all(axis=0)
    return {"all_ok": (status == STATUSES.index("ok")).all(axis=0), "diverged_last": rankable}


def _in_order(errors: Array) -> Flags:
    return np.asarray((errors[0] < errors[1]) & (errors[1] < errors[2]))


def _ordered(order: tuple[int, ...], errors: Array) -> Flags:
    return _in_order(errors[list(order)])


def _first_is_best(errors: Array) -> Flags:
    return np.asarray((errors[0] < errors[1]) & (errors[0] < errors[2]))


def _first_is_worst(errors: Array) -> Flags:
    return np.asarray((errors[0] > errors[1]) & (errors[0] > errors[2]))


def _last_two_tie(errors: Array) -> Flags:
    with np.errstate(invalid="ignore"):
        return np.asarray(abs(errors[1] - errors[2]) <= TIE * np.maximum(errors[1], errors[2]))


ORDERS: Mapping[str, tuple[int, ...]] = {
    "share_" + "_lt_".join(f"c{place + 1}" for place in order): order for order in permutations(range(3))
}
"""The six orders of the controllers by their places in `CONTROLLERS`, the smallest error first."""

RANKINGS: Mapping[str, Callable[[Array], Flags]] = {
    **{name: partial(_ordered, order) for name, order in ORDERS.items()},
    "share_c1_best": _first_is_best,
    "share_c1_worst": _first_is_worst,
    "share_c2_ties_c3": _last_two_tie,
}
"""What may hold of the errors of the three controllers, (3, N, n), on each plant and joint."""


def _shapes(data: EnsembleData, reading: str, kept: Flags) -> dict[str, Any]:
    """RMSE over MAE of every controller, the share on which it rises as printed, and a plant's distance.

    Its growth is that of the last controller over that of the first. The distance of a plant is the root mean
    square of log(ours/printed) over what Table 2 says without a scale: the ratios C1/C2 and C2/C3 of the MAE
    and each RMSE/MAE, per joint. Beside it the shares on which other results of the paper hold on all joints,
    alone, with the printed order, and all together: Controller 1's torque has the smallest steps, RMSE/MAE
    rises; and that of the reverse order where every MAE is within a factor `NEAR` of the print.
    """
    mae, rmse, step = (
        np.array([data.statistic(run, reading, name)[kept] for run in CONTROLLERS])
        for name in (*METRICS, "torque_step_rms")
    )
    shape = np.divide(rmse, mae, out=np.full_like(mae, np.nan), where=mae > 0.0)
    defined = np.isfinite(shape).all(axis=(0, 2))
    plants = data.replicate[kept]
    replicate, ratios = plants[defined], shape[:, defined]
    printed = [printed_ratios(pair, "mae", data.joints) for pair in RATIOS.values()]
    printed += [[printed_shape(run, joint) for joint in data.joints] for run in CONTROLLERS]
    ours = np.concatenate([mae[:-1, defined] / mae[1:, defined], ratios])
    distance = np.sqrt((np.log(ours / np.array(printed)[:, np.newaxis]) ** 2).mean(axis=(0, 2)))
    order, smoother = _in_order(mae) & _in_order(rmse), _first_is_best(step)
    together = {
        "share_c1_smoother": smoother,
        "share_order_and_smoother": order & smoother,
        "share_order_and_rise": order & _in_order(shape),
        "share_order_rise_and_smoother": order & _in_order(shape) & smoother,
    }
    sizes = np.array([published().per_joint(f"table2.{run}.mae", data.joints) for run in CONTROLLERS])
    times = np.rad2deg(mae) / sizes[:, np.newaxis]
    near = np.asarray(((times <= NEAR) & (times >= 1.0 / NEAR)).all(axis=(0, 2)))
    reverse = np.asarray((_in_order(mae[::-1]) & _in_order(rmse[::-1])).all(axis=1))
    return {
        "share_reverse_near_print": share_of(reverse, plants, near).as_row(),
        "rmse_over_mae": {
            run: {
                f"joint_{joint}": quantiles_of(ratios[place, :, i], replicate)
                | {"printed": printed_shape(run, joint)}
                for i, joint in enumerate(data.joints)
            }
            for place, run in enumerate(CONTROLLERS)
        },
        "rmse_over_mae_growth": {
            f"joint_{joint}": quantiles_of(ratios[-1, :, i] / ratios[0, :, i], replicate)
            for i, joint in enumerate(data.joints)
        },
        "share_rmse_over_mae_rises": _shares(data, _in_order(ratios), replicate),
        "distance": quantiles_of(distance, replicate),
    } | {name: share_of(np.asarray(hits.all(axis=1)), plants).as_row() for name, hits in together.items()}


def printed_shape(run: str, joint: int) -> float:
    """RMSE over MAE from Table 2; NaN where the joint is not printed."""
    rmse, mae = (published().per_joint(f"table2.{run}.{metric}", [joint])[0] for metric in ("rmse", "mae"))
    return rmse / mae


def _shares(
    data: EnsembleData, flags: Flags, replicate: NDArray[np.int64], kept: Flags | None = None
) -> dict[str, Any]:
    """Shares over both joints together and over each, from flags (N, n)."""
    joints = {f"joint_{joint}": flags[:, i] for i, joint in enumerate(data.joints)}
    each = {"both": np.asarray(flags.all(axis=1))} | joints
    return {name: share_of(hits, replicate, kept).as_row() for name, hits in each.items()}


def _ratio_quantiles(
    data: EnsembleData, errors: Array, pair: tuple[int, int], kept: Flags, printed: Sequence[float]
) -> dict[str, Any]:
    """Quantiles of a ratio for each joint; where both laws diverged there is none."""
    above, below = errors[pair[0]], errors[pair[1]]
    result: dict[str, Any] = {}
    for i, joint in enumerate(data.joints):
        defined = kept & (np.isfinite(above[:, i]) | np.isfinite(below[:, i])) & (below[:, i] > 0.0)
        ratio = above[defined, i] / below[defined, i]
        result[f"joint_{joint}"] = quantiles_of(ratio, data.replicate[defined]) | {"printed": printed[i]}
    return result


def printed_ratios(pair: tuple[int, int], metric: str, joints: Sequence[int]) -> list[float]:
    """Ratio of two controllers' printed errors, Table 2, for each joint; NaN where none is printed."""
    above, below = (published().per_joint(f"table2.{CONTROLLERS[place]}.{metric}", joints) for place in pair)
    return [a / b for a, b in zip(above, below, strict=True)]


def status_shares(data: EnsembleData, reading: str) -> dict[str, Any]:
    """Share of all plants on which each run ended in each status, with its ``count``."""
    result: dict[str, Any] = {}
    for run in data.runs:
        codes = data.status(run, reading)
        result[run] = {
            name: share_of(codes == code, data.replicate).as_row() | {"count": int((codes == code).sum())}
            for code, name in enumerate(STATUSES)
        }
    return result


def agreement(found: dict[str, Any], joints: Sequence[int]) -> dict[str, Any]:
    """Compare the printed ratios with what a reading gives over plants on which all laws are ``ok``.

    ``agrees`` when all are inside the central 90 %; ``cannot`` when one is beyond every plant; ``no plant``
    when there is none to compare with, ``too few`` below `LEAST_PLANTS`; else ``in part``.
    """
    every = {
        f"{key} {metric} joint {joint}": found[key]["all_ok"][metric][f"joint_{joint}"]
        for key in RATIOS
        for metric in METRICS
        for joint in joints
    }
    judged = {name: held for name, held in every.items() if held["plants"] and np.isfinite(held["printed"])}
    inside = [
        n for n, held in judged.items() if held["q05"]["value"] <= held["printed"] <= held["q95"]["value"]
    ]
    outside = [n for n in judged if n not in inside]
    beyond = [n for n, held in judged.items() if not held["lowest"] <= held["printed"] <= held["highest"]]
    verdict = "cannot" if beyond else "in part" if outside else "agrees" if inside else "no plant"
    plants = found["share_c1_lt_c2_lt_c3"]["all_ok"]["mae"]["both"]["plants"]
    if verdict != "no plant" and plants < LEAST_PLANTS:
        verdict = "too few"
    return {"verdict": verdict, "inside": inside, "outside": outside, "beyond": beyond}
