"""What plants that fit the fitted numbers say about the others, and what the fit says about the plants."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.identification.misfit import METRICS, Outcome, Printed, log_misfit, switched_by
from tendonrepro.monte_carlo.box import Box
from tendonrepro.monte_carlo.shares import FEW, MOST
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS

CENTRAL = (5.0, 50.0, 95.0)
"""Percentiles of the near-optimal plants."""

FEWEST = 20
"""Near-optimal plants below which nothing is said about their spread."""

AT_BOUND = 0.01
"""Share of a row's range within which the best plant counts as at its bound."""

_UNDIVERGED = [STATUSES.index(name) for name in ("ok", "ringing")]


def number_rows(
    best: Outcome, near: Outcome, printed: Printed, fitted: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Every printed number beside that of the best plant and the range of the near-optimal ones.

    One that was not fitted is ``reached`` when it lies in the central 90 % of the near-optimal plants,
    ``rare`` when only among all of them, ``not_reached`` when none goes so far; or ``too_few_plants``.
    """
    rows = []
    for place in np.ndindex(printed.values.shape):
        r, m, i = place
        ours, goal, half = (float(held[place]) for held in (best.sizes[0], printed.values, printed.half))
        sizes = near.sizes[near.ok[:, r], r, m, i]
        low, median, high = _percentiles(sizes)
        rows.append(
            {
                "run": RUNS[r],
                "metric": METRICS[m],
                "joint": printed.joints[i],
                "printed_deg": goal,
                "ours_deg": ours,
                "ratio": ours / goal,
                "rounding_units": abs(ours - goal) / half,
                "inside_rounding": bool(abs(ours - goal) <= half),
                "near_low_deg": low,
                "near_median_deg": median,
                "near_high_deg": high,
                "verdict": "fitted" if RUNS[r] in fitted else _reached(sizes, goal, half),
            }
        )
    return rows


def _percentiles(values: Array) -> tuple[float, float, float]:
    if values.size < FEWEST:
        return (float("nan"),) * 3
    low, median, high = np.percentile(values, CENTRAL)
    return float(low), float(median), float(high)


def _reached(sizes: Array, printed: float, half: float) -> str:
    if sizes.size < FEWEST:
        return "too_few_plants"
    low, _, high = _percentiles(sizes)
    if low - half <= printed <= high + half:
        return "reached"
    return "rare" if sizes.min() - half <= printed <= sizes.max() + half else "not_reached"


def shape_rows(best: Outcome, printed: Printed) -> list[dict[str, Any]]:
    """What of the best plant needs no scale: order of the controllers and RMSE over MAE, beside the print."""
    rows = []
    for i, joint in enumerate(printed.joints):
        tables = {"ours": best.sizes[0, ..., i], "printed": printed.values[..., i]}
        row: dict[str, Any] = {"joint": joint}
        for name, sizes in tables.items():
            for m, metric in enumerate(METRICS):
                order = np.argsort(sizes[: len(CONTROLLERS), m], kind="stable")
                row[f"{name}_order_{metric}"] = " < ".join(str(k + 1) for k in order)
            for r, run in enumerate(RUNS):
                row[f"{name}_rmse_over_mae_{run}"] = float(sizes[r, 1] / sizes[r, 0])
        rows.append(row)
    return rows


def order_rows(near: Outcome, printed: Printed) -> list[dict[str, Any]]:
    """Share of the near-optimal plants on which the printed order of the controllers holds.

    Of all three controllers and of each two, per metric, joint and for both joints. A run that diverged or
    was not resolved comes last. The verdict has the thresholds of the claims.
    """
    sizes = np.where(np.isin(near.status, _UNDIVERGED)[..., np.newaxis, np.newaxis], near.sizes, np.inf)
    groups = [CONTROLLERS, *combinations(CONTROLLERS, 2), (CONTROLLERS[0], "controller_1_payload")]
    return [row for group in groups for row in _order_of(group, sizes, printed)]


def _order_of(group: tuple[str, ...], sizes: Array, printed: Printed) -> Iterator[dict[str, Any]]:
    places = [RUNS.index(run) for run in group]
    for m, metric in enumerate(METRICS):
        holds, orders = [], []
        for i in range(len(printed.joints)):
            by_size = np.argsort(printed.values[places, m, i], kind="stable")
            ours = sizes[:, [places[k] for k in by_size], m, i]
            holds.append((ours[:, 1:] > ours[:, :-1]).all(axis=1))
            orders.append([group[k] for k in by_size])
        holds.append(np.all(holds, axis=0))
        names = [*(f"joint_{joint}" for joint in printed.joints), "both"]
        for name, held, order in zip(names, holds, [*orders, None], strict=True):
            share = float(held.mean()) if held.size >= FEWEST else float("nan")
            yield {
                "runs": list(group),
                "metric": metric,
                "joint": name,
                "printed_order": order,
                "share": share,
                "verdict": order_verdict(share),
            }


def order_verdict(share: float) -> str:
    """Word for a share of plants: ``agrees``, ``contradicted``, ``depends_on_plant``, ``too_few_plants``."""
    if np.isnan(share):
        return "too_few_plants"
    return "agrees" if share >= MOST else "contradicted" if share <= FEW else "depends_on_plant"


def parameter_rows(box: Box, best: Array, near: Array) -> list[dict[str, Any]]:
    """What the fit says about each row of the box, from the best point (P,) and the near ones (N, P).

    ``width`` is that of the central 90 % of the near-optimal plants over 90 % of the row's range on its own
    scale: about 1 where nothing is said, 0 where the number is known. A choice has ``shares``. What the
    best plant has switched off is at no bound.
    """
    enough = len(near) >= FEWEST
    ends = np.percentile(near, CENTRAL, axis=0) if enough else np.full((3, best.size), np.nan)
    spread = box.values(ends) if enough else ends
    value = box.values(best[np.newaxis])[0]
    chosen = box.values(near) if enough else near[:0]
    off = [p for p in range(best.size) if box.choices[p].size and value[p] == 0.0]
    idle = set().union(*(switched_by(box.names[p]) for p in off))
    rows = []
    for p, name in enumerate(box.names):
        is_choice = box.choices[p].size > 0
        rows.append(
            {
                "name": name,
                "unit": box.units[p],
                "low": float(box.low[p]),
                "high": float(box.high[p]),
                "best": _word(box, p, float(value[p])),
                "searched": bool(box.free[p]),
                "choice": is_choice,
                "best_unit": float(best[p]),
                "at_bound": None if name in idle or is_choice or not box.free[p] else _bound(float(best[p])),
                "near_low": None if is_choice else float(spread[0, p]),
                "near_median": None if is_choice else float(spread[1, p]),
                "near_high": None if is_choice else float(spread[2, p]),
                "near_unit": ends[:, p].tolist(),
                "width": float((ends[2, p] - ends[0, p]) / 0.9),
                "shares": _shares(box, p, chosen[:, p]) if is_choice and enough else None,
            }
        )
    return rows


def _word(box: Box, row: int, value: float) -> float | str:
    return box.words[row][int(value)] if box.words[row] else value


def _bound(unit: float) -> str | None:
    return "low" if unit < AT_BOUND else "high" if unit > 1.0 - AT_BOUND else None


def _shares(box: Box, row: int, chosen: Array) -> dict[str, float]:
    return {str(_word(box, row, float(value))): float((chosen == value).mean()) for value in box.choices[row]}


def pareto_rows(
    measured: Outcome, printed: Printed, fitted: tuple[str, ...]
) -> dict[str, list[dict[str, Any]]]:
    """Plants that no other plant beats in both of two misfits, among those on which all runs are ok.

    Controller 2, or what was fitted, against the others, and joint against joint; the first misfit rises.
    """
    two = [RUNS.index("controller_2")] if len(fitted) == len(RUNS) else [RUNS.index(run) for run in fitted]
    rest = [r for r in range(len(RUNS)) if r not in two]
    of_runs = [_part(measured, printed, chosen, slice(None)) for chosen in (two, rest)]
    every = list(range(len(RUNS)))
    of_joints = [_part(measured, printed, every, slice(i, i + 1)) for i in range(2)]
    well = np.asarray(measured.ok.all(axis=1))
    names = [f"joint_{joint}" for joint in printed.joints[:2]]
    return {
        "controller_2_against_others": _front(of_runs, ("controller_2", "others"), well),
        f"{names[0]}_against_{names[1]}": _front(of_joints, (names[0], names[1]), well),
    }


def _part(measured: Outcome, printed: Printed, runs: list[int], joints: slice) -> Array:
    part = Outcome(measured.sizes[:, runs][..., joints], measured.status[:, runs], measured.lasted[:, runs])
    return log_misfit(part, printed.values[runs][..., joints])


def _front(misfits: list[Array], names: tuple[str, str], allowed: NDArray[np.bool_]) -> list[dict[str, Any]]:
    first, second = misfits
    order = np.lexsort((second, first))
    front: list[dict[str, Any]] = []
    for plant in order[allowed[order]]:
        if not front or second[plant] < front[-1][names[1]]:
            front.append({"plant": int(plant), names[0]: float(first[plant]), names[1]: float(second[plant])})
    return front
