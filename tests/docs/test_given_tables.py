"""What estimators make of Tables 2 and 3 on plants whose interpretation is known."""

import importlib

import numpy as np
import pytest
from scipy.stats import norm
from support.pages import DOCS, NEEDS_DOCS

from tendonrepro.results.summary import NOISE
from tendonrepro.verdicts.planted import StableErrors

pytest.importorskip("sklearn")
pytestmark = NEEDS_DOCS
PLANTS = 200
KEPT, CHANGED = "printed", "weights=extrapolating"


@pytest.fixture
def given(monkeypatch):
    """docs/given_tables.py, with the two quickest of its estimators."""
    monkeypatch.syspath_prepend(DOCS)
    module = importlib.import_module("given_tables")
    quick = {name: module.ESTIMATORS[name] for name in ("kernel of 5 %", "quadratic logistic")}
    monkeypatch.setattr(module, "ESTIMATORS", quick)
    monkeypatch.setattr(module, "TREES", {})
    return module


def errors(given, shift, spread=0.0, seed=1, plants=PLANTS):
    """Plants with the published errors times any size; the logarithms of Controller 1 are shifted."""
    rng = np.random.default_rng(seed)
    logs = given.published_log_errors((2, 3)) + rng.normal(size=(plants, 1, 1, 1))
    logs = logs + spread * rng.standard_normal(logs.shape)
    logs[:, 0] += shift
    return np.deg2rad(np.exp(logs))


def probabilities(given, kept, changed):
    by_reading = {KEPT: kept, CHANGED: changed}
    plants = {name: np.arange(len(held)) for name, held in by_reading.items()}
    found = given.given_tables(StableErrors((2, 3), 1000, plants, by_reading))
    return found, {(row["compared"], row["estimator"]): row for row in found["rows"]}


def test_ratios_far_apart_are_told_apart_by_either(given):
    found, rows = probabilities(given, errors(given, 0.3), errors(given, 0.0))
    assert all(row["probability"] > 0.99 and row["right"] > 0.99 for row in rows.values())
    assert found["nearest"][given.BETWEEN] == pytest.approx(0.0, abs=1e-9)
    _, rows = probabilities(given, errors(given, 0.0), errors(given, 0.3))
    assert all(row["probability"] < 0.01 for row in rows.values())


def test_a_naming_is_as_good_as_theory_allows(given):
    """Four errors shifted by d; the mean over the runs takes a quarter: they lie sqrt(3) d apart in noise.

    MAE and RMSE share most of their noise, so that two of the four count.
    """
    shift = 0.03
    kept, changed = errors(given, 0.0, plants=600), errors(given, shift, seed=2, plants=600)
    _, rows = probabilities(given, kept, changed)
    best = norm.cdf(0.5 * np.sqrt(1.5) * shift / NOISE)
    assert rows[given.BETWEEN, "kernel of 5 %"]["right"] == pytest.approx(best, abs=0.04)


def test_joint_3_over_joint_2_counts_only_where_it_is_compared(given):
    """Ratios between runs are those of the paper under both; only one has its joint 3."""
    kept = errors(given, 0.0)
    kept[..., 1] *= 0.5
    found, rows = probabilities(given, kept, errors(given, 0.0, seed=2))
    assert rows[given.BETWEEN, "quadratic logistic"]["right"] < 0.6
    assert rows[given.ALL, "quadratic logistic"]["probability"] > 0.99
    assert [held["probability"] for held in found["counted"][2:]] == [1.0, 1.0]
