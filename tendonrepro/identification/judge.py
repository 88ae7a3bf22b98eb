"""Numbers of plants beside the printed ones, and rows of the box."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.identification.misfit import METRICS, Printed, Simulated
from tendonrepro.identification.search import switched_by
from tendonrepro.monte_carlo.box import Box
from tendonrepro.results.summary import CONTROLLERS

AT_BOUND = 0.01
"""Share of a row's range within which the best plant counts as at its bound."""


def number_rows(plants: Simulated, printed: Printed, fitted: tuple[str, ...]) -> list[dict[str, Any]]:
    """Every printed number, that of the first plant, and the range of those whose run is ok."""
    rows = []
    for (r, m, i), goal in np.ndenumerate(printed.values):
        ours = float(plants.sizes[0, r, m, i])
        sizes = plants.sizes[plants.ok[:, r], r, m, i]
        low, high = (sizes.min(), sizes.max()) if sizes.size else (np.nan, np.nan)
        rows.append(
            {
                "run": RUNS[r],
                "metric": METRICS[m],
                "joint": printed.joints[i],
                "fitted": RUNS[r] in fitted,
                "printed_deg": float(goal),
                "ours_deg": ours,
                "ratio": ours / float(goal),
                "lowest_deg": float(low),
                "highest_deg": float(high),
            }
        )
    return rows


def shape_rows(best: Simulated, printed: Printed) -> list[dict[str, Any]]:
    """Order of the controllers and RMSE over MAE, ours and printed."""
    rows = []
    for i, joint in enumerate(printed.joints):
        row: dict[str, Any] = {"joint": joint}
        for name, sizes in {"ours": best.sizes[0, ..., i], "printed": printed.values[..., i]}.items():
            for m, metric in enumerate(METRICS):
                order = np.argsort(sizes[: len(CONTROLLERS), m], kind="stable")
                row[f"{name}_order_{metric}"] = " < ".join(str(k + 1) for k in order)
            for r, run in enumerate(RUNS):
                row[f"{name}_rmse_over_mae_{run}"] = float(sizes[r, 1] / sizes[r, 0])
        rows.append(row)
    return rows


def parameter_rows(box: Box, units: Array) -> list[dict[str, Any]]:
    """Value of every row of the box at points (N, P), the best first.

    What the best plant has switched off is at no bound.
    """
    values, best = box.values(units), units[0]
    off = [p for p, choices in enumerate(box.choices) if choices.size and values[0, p] == 0.0]
    idle = set().union(*(switched_by(box.names[p]) for p in off))
    rows = []
    for p, name in enumerate(box.names):
        is_choice, words = box.choices[p].size > 0, box.words[p]
        found = [words[int(value)] if words else float(value) for value in values[:, p]]
        can_lean = box.free[p] and not is_choice and name not in idle
        rows.append(
            {
                "name": name,
                "unit": box.units[p],
                "low": float(box.low[p]),
                "high": float(box.high[p]),
                "searched": bool(box.free[p]),
                "choice": is_choice,
                "best": found[0],
                "at_bound": _bound(best[p]) if can_lean else None,
                "plants": found,
            }
        )
    return rows


def _bound(unit: float) -> str | None:
    return "low" if unit < AT_BOUND else "high" if unit > 1.0 - AT_BOUND else None
