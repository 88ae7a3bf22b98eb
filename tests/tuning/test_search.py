"""The search on a plant whose best gains are known: a unit mass under PD, with a linear-quadratic cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov
from scipy.optimize import minimize_scalar

from tendonrepro.physics.control import Surface
from tendonrepro.tuning.bench import Candidate, Measured
from tendonrepro.tuning.laws import RANGES, TunedLaw
from tendonrepro.tuning.search import Effort, Key, Search, tune

PRICE = 1e-6
"""Of the squared acceleration, against the squared error."""
PD = TunedLaw("pd", "PD", {name: RANGES[name] for name in ("K_d", "K_p")}, Surface.PD)
A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


def cost(K_d: float, K_p: float) -> float:
    """From an error of 1 at rest: the integral of ``e² + PRICE u²``."""
    gain = np.array([[K_p, K_d]])
    P = solve_continuous_lyapunov((A - B @ gain).T, -(np.diag([1.0, 0.0]) + PRICE * gain.T @ gain))
    return float(P[0, 0])


def measure(candidates: Sequence[Candidate]) -> Measured:
    gains = [(float(one.gains["K_d"][0]), float(one.gains["K_p"][0])) for one in candidates]
    costs = np.array([cost(*pair) for pair in gains])
    stable = np.ones((len(gains), 3), dtype=bool)
    return Measured(np.tile(costs[:, None, None], (1, 3, 2)), np.array([K_p for _, K_p in gains]), stable)


def searched(cap: float, generations: int = 40) -> list[Search]:
    found = tune([PD], [("none", False)], [cap], measure, np.zeros(2), Effort(4, generations, 8), (1, 0))
    return [found[Key("pd", "none", False, k)] for k in range(4)]


def test_every_search_finds_the_optimum_of_riccati() -> None:
    P = solve_continuous_are(A, B, np.diag([1.0, 0.0]), np.array([[PRICE]]))
    K_p, K_d = (B.T @ P / PRICE)[0]
    for search in searched(np.inf):
        place = search.best(np.inf)
        assert place is not None
        gains = PD.values(search.units[place], 2)
        assert search.smallest(np.inf) == pytest.approx(np.log(P[0, 0]), abs=1e-4)
        assert gains["K_p"] == pytest.approx(K_p, rel=0.03)
        assert gains["K_d"] == pytest.approx(K_d, rel=0.03)


def test_under_a_cap_the_optimum_lies_on_it() -> None:
    cap = 100.0
    best = minimize_scalar(lambda K_d: cost(K_d, cap), bounds=(1.0, 100.0), method="bounded")
    for search in searched(cap):
        place = search.best(cap)
        assert place is not None
        assert search.smallest(cap) == pytest.approx(np.log(best.fun), abs=5e-3)
        assert 0.97 * cap < search.roughness[place] <= cap
        assert not search.gains_without_margin(cap)


def test_the_same_seed_searches_the_same() -> None:
    assert [one.error for one in searched(np.inf, 4)] == [one.error for one in searched(np.inf, 4)]
