"""How much Controllers 1 to 3 may differ by theory, and how near that comes to Tables 2 and 3.

``python docs/bounds.py [REPORTS]`` writes ``docs/results/bounds.json``, in about two minutes: linear arms from the ranges,
and the ratios on the plants of the ensemble in the folder of reports. docs/theory.md derives the bounds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression
from stored_results import store

from tendonrepro.analysis.explain import ratio_range, slow_ratio
from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.configuration.models.readings import SHOWN
from tendonrepro.experiments.loops import View, build_reference, run_views
from tendonrepro.identification.bench import printed_numbers
from tendonrepro.monte_carlo.data import EnsembleData, read_ensemble
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.physics.linear_loop import stroke
from tendonrepro.physics.metrics import STATUSES

_SMALL_DEG = 1e-3
"""An error at which the surface of Controllers 1 and 2 has its slope at rest."""

DRAWS = 512
"""Arms that are linearised, the first of the ranges."""

FREE = ("reference_acceleration=absent", "motion=ramp")
"""Interpretations in which Controllers 1 and 2 share an error that the estimate does not make: nothing orders them."""


def bounds(ensemble: EnsembleData, draws: int = DRAWS) -> dict[str, Any]:
    """All that is stored."""
    linear = linear_bounds(draws)
    return {
        "linear": linear,
        "ensemble": {"draws": len(ensemble), "readings": dict(largest_ratios(ensemble))},
        "misfit_log": least_misfits(linear["controller_3_over_2"]["all_joints"][1]),
    }


def linear_bounds(draws: int) -> dict[str, Any]:
    """Ranges of the ratio of errors over the linear arms on which Controllers 1 to 3 are stable."""
    arms = [found for found in _ranges(draws) if found]
    pairs = {}
    for name in arms[0]:
        low, high = (np.array([getattr(arm[name], key) for arm in arms]) for key in ("of_joints", "all_joints"))
        pairs[name] = {
            "low": low[:, 0].min(axis=0).tolist(),
            "high": low[:, 1].max(axis=0).tolist(),
            "all_joints": [high[:, 0].min(), high[:, 1].max()],
        }
    return {"draws": draws, "stable": len(arms), "below_hz": _ringing_hz()} | pairs


def _ringing_hz() -> float:
    return float(load_config(None, "compare").config.status.ringing_frequency.si)


def _ranges(draws: int) -> Iterator[dict[str, Any] | None]:
    """Ranges by pair of each arm; None of one on which a loop grows."""
    loaded = load_ensemble(None)
    population = population_of(loaded)
    for values in population.sample(int(loaded.config.seed.si), 0, 0, draws):
        config = population.configured(values)
        postures = stroke(build_reference(config.reference, config, loaded.base.folder).q_d)
        one, two, three = (run_views(config)[run] for run in RUNS[:3])
        found = {
            "controller_3_over_2": ratio_range(three, two, postures, _ringing_hz()),
            "controller_1_over_2": ratio_range(one, two, postures, _ringing_hz()),
        }
        yield None if None in found.values() else found


def largest_ratios(ensemble: EnsembleData) -> Iterator[tuple[str, Any]]:
    """RMSE of Controller 3 over 2 on the plants on which both are stable: largest, and 95 and 99 % of them, by joint."""
    for name in SHOWN:
        if name not in ensemble.readings:
            continue
        pair = RUNS[1:3]
        ok = np.all([ensemble.status(run, name) == STATUSES.index("ok") for run in pair], axis=0)
        of_2, of_3 = (ensemble.statistic(run, name, "rmse")[ok] for run in pair)
        if ok.any():
            ratio = of_3 / of_2
            quantiles = {f"{q:g}": np.quantile(ratio, q, axis=0).tolist() for q in (0.5, 0.95, 0.99)}
            yield name, {"plants": int(ok.sum()), "largest": ratio.max(axis=0).tolist()} | quantiles


def least_misfits(most: float) -> dict[str, float]:
    """Least misfit to Tables 2 and 3, see `identification.bench`, that the bounds allow, by interpretation.

    Controller 3's RMSE is at most `most` times Controller 2's, unless Delta is in degrees; Controller 1's is at least that
    of Controller 2, unless both share another error. Mean errors are free. ``slow loads`` has both ratios, of all errors,
    exactly as slow loads make them.
    """
    goal = printed_numbers(published(), (2, 3))
    logs = np.log(goal.values)[:3]  # controllers, metrics, joints
    of_rmse = logs[:, METRICS.index("rmse")]
    shifted = of_rmse[::-1] + np.array([-np.log(most), 0.0, 0.0])[:, np.newaxis]
    bounded = {"printed": (shifted,), **{name: (shifted[:2],) for name in FREE}, "Delta_unit=deg": (of_rmse[1::-1],)}

    def misfit(squares: float) -> float:
        return float(np.sqrt(squares / goal.numbers))

    found = {name: misfit(sum(map(_unordered, parts))) for name, parts in bounded.items()}
    exact = logs - np.log(_slow_ratios())[:, np.newaxis]
    return found | {"slow loads": misfit(float(np.sum((exact - exact.mean(axis=0)) ** 2)))}


def _unordered(logs: Array) -> float:
    """Least sum of squares by which columns (K, n) have to move to rise from row to row."""
    return float(sum(np.sum((column - isotonic_regression(column).x) ** 2) for column in logs.T))


def _slow_ratios() -> Array:
    """Errors of Controllers 1 to 3 under a slow load, over that of Controller 2, (3, n)."""
    views: Mapping[str, View] = run_views(load_config(None, "compare").config)
    runs: Sequence[View] = [views[run] for run in RUNS[:3]]
    return np.array([slow_ratio(view, runs[1], _SMALL_DEG) for view in runs])


if __name__ == "__main__":
    reports = Path(sys.argv[1] if len(sys.argv) > 1 else "reports")
    store("bounds.json", bounds(read_ensemble(reports / "ensemble")))
