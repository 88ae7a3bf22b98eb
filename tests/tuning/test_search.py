"""The search on a plant whose best gains are known: a unit mass under PD, with a linear-quadratic cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from tendonrepro.physics.control import Surface
from tendonrepro.tuning import bench
from tendonrepro.tuning.bench import PUBLISHED, RANGES, Candidate, Performance, TrialPlants, TunedLaw
from tendonrepro.tuning.search import Seen, Tuning, TuningEffort, best, costs

PRICE = 1e-6
"""Of the squared acceleration, against the squared error."""
PD = TunedLaw("pd", "PD", {name: RANGES[name] for name in ("K_d", "K_p")}, Surface.PD)
A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def cost(K_d: float, K_p: float) -> float:
    """From an error of 1 at rest: the integral of ``e² + PRICE u²``."""
    gain = np.array([[K_p, K_d]])
    P = solve_continuous_lyapunov((A - B @ gain).T, -(np.diag([1.0, 0.0]) + PRICE * gain.T @ gain))
    return float(P[0, 0])


def measured(_: TrialPlants, candidates: Sequence[Candidate]) -> Performance:
    gains = [(float(one.gains["K_d"][0]), float(one.gains["K_p"][0])) for one in candidates]
    costs = np.array([cost(*pair) for pair in gains])
    stable = np.ones((len(gains), 3), dtype=bool)
    return Performance(np.tile(costs[:, None, None], (1, 3, 2)), np.array([K_p for _, K_p in gains]), stable)


@pytest.fixture(autouse=True)
def _on_the_unit_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "measure", measured)


def searched(cap: float, generations: int = 40) -> list[list[Seen]]:
    plants: Any = SimpleNamespace(alpha=np.zeros(2))
    effort = TuningEffort(searches=4, generations=generations, population=8)
    return [*Tuning({"pd": PD}, [cap], plants, effort, (1, 0)).run([PUBLISHED]).values()]


def test_every_search_finds_the_optimum_of_riccati() -> None:
    P = solve_continuous_are(A, B, np.diag([1.0, 0.0]), np.array([[PRICE]]))
    K_p, K_d = (B.T @ P / PRICE)[0]
    for seen in searched(np.inf):
        found = best(seen, np.inf)
        assert found is not None
        gains = PD.values(found.unit, 2)
        assert found.error == pytest.approx(np.log(P[0, 0]), abs=1e-4)
        assert (gains["K_p"], gains["K_d"]) == pytest.approx((K_p, K_d), rel=0.03)


def test_under_a_cap_the_optimum_lies_on_it() -> None:
    cap = 100.0
    lowest = minimize_scalar(lambda K_d: cost(K_d, cap), bounds=(1.0, 100.0), method="bounded")
    for seen in searched(cap):
        found = best(seen, cap)
        assert found is not None
        assert found.error == pytest.approx(np.log(lowest.fun), abs=5e-3)
        assert 0.97 * cap < found.roughness <= cap


def test_an_unstable_place_is_never_the_best_and_costs_more_than_any_error() -> None:
    good, bad = (
        Seen(np.zeros(1), error, 1.0, np.array([True, True, is_stable]))
        for error, is_stable in ((0.0, True), (-5.0, False))
    )
    assert best([bad, good], np.inf) is good
    assert best([bad], np.inf) is best([good], 0.5) is None
    (cheap,), (dear,), (rough,) = costs([good], 1.0), costs([bad], 1.0), costs([good], 0.5)
    assert cheap < rough < dear


def test_gains_are_handed_on_but_not_to_searches_alone() -> None:
    """Of two laws that are one, the second begins farther off."""
    far = {name: bounds._replace(start=bounds.high) for name, bounds in PD.gains.items()}
    laws = {"pid": replace(PD, name="pid"), "tdc": replace(PD, name="tdc", gains=far)}
    plants: Any = SimpleNamespace(alpha=np.zeros(2))
    seen = Tuning(laws, [np.inf], plants, TuningEffort(2, 2, 4), (1, 0)).run([PUBLISHED])
    errors = {key: min(place.error for place in places) for key, places in seen.items()}
    for key in (key for key in errors if key.law == "tdc"):
        source = errors[key._replace(law="pid")]
        assert errors[key] > source + 0.1 if key.alone else errors[key] == pytest.approx(source, abs=1e-9)
    spent = {len(places) for key, places in seen.items() if key.alone}
    assert len(spent) == 1
