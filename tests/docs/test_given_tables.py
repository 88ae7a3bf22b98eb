"""Naming an interpretation by the ratios of its errors does as well as theory allows, and no better."""

import importlib
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm
from support.pages import DOCS, NEEDS_DOCS

from tendonrepro.configuration.published import published
from tendonrepro.errors import UsageError

pytestmark = NEEDS_DOCS
PLANTS = 400
TABLES = {
    "controller_1": "table2.controller_1",
    "controller_2": "table2.controller_2",
    "controller_3": "table2.controller_3",
    "controller_1_payload": "table3.with_load",
}


@pytest.fixture
def naming(monkeypatch):
    """docs/given_tables.py."""
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("given_tables")


class Held(SimpleNamespace):
    def __len__(self):
        return PLANTS


def ensemble(shifts, spread=0.0, unstable=()):
    """Plants with the published errors times any size; the logarithms of Controller 1 are shifted."""

    def statistic(run, name, metric):
        rng = np.random.default_rng([ord(letter) for letter in run + name + metric])
        sizes = np.random.default_rng(7).lognormal(0.0, 1.0, (PLANTS, 1))
        printed = [published().number(f"{TABLES[run]}.{metric}.joint_{joint}") for joint in (2, 3)]
        shift = shifts[name] * (run == "controller_1")
        return sizes * printed * np.exp(shift + spread * rng.standard_normal((PLANTS, 2)))

    def status(run, name):
        del run
        return np.full(PLANTS, 2 if name in unstable else 0, np.int8)

    return Held(joints=(2, 3), statistic=statistic, status=status)


def test_the_same_ratios_cannot_be_told_apart(naming):
    found = naming.given_tables(ensemble({"a": 0.0, "b": 0.0}), ["a", "b"])
    assert found.probability == pytest.approx([0.5, 0.5], abs=1e-6)
    assert found.accuracy == pytest.approx(0.5, abs=0.05)
    assert found.typical > 0.5


def test_ratios_far_apart_are_named_and_sure(naming):
    found = naming.given_tables(ensemble({"a": 0.0, "b": 0.3}), ["a", "b"])
    assert found.probability == pytest.approx([1.0, 0.0], abs=1e-6)
    assert (found.accuracy, found.sure, found.accuracy_when_sure) == (1.0, 1.0, 1.0)
    assert found.confused == pytest.approx(np.eye(2))


def test_accuracy_is_that_of_the_best_rule_for_two_normal_clouds(naming):
    """Four errors shifted by d; the mean over the runs takes a quarter: they lie sqrt(3) d apart."""
    shift = 0.04
    found = naming.given_tables(ensemble({"a": 0.0, "b": shift}), ["a", "b"])
    best = norm.cdf(0.5 * np.sqrt(3.0) * shift / naming.NOISE)
    assert found.accuracy == pytest.approx(best, abs=0.03)
    for held in found.calibration:
        if held.plants > 50:
            assert held.right == pytest.approx(held.probability, abs=0.1)


def test_ratios_like_none_are_said_to_be_like_none(naming):
    found = naming.given_tables(ensemble({"a": 0.5, "b": 0.9}), ["a", "b"])
    assert found.typical == 0.0


def test_what_is_stable_too_seldom_is_left_out(naming):
    data = ensemble({"a": 0.0, "b": 0.3, "c": 0.0}, unstable=("c",))
    found = naming.given_tables(data, ["a", "c", "b"])
    assert (found.names, found.left_out) == (("a", "b"), ("c",))
    assert found.plants.tolist() == [PLANTS, PLANTS]
    with pytest.raises(UsageError):
        naming.given_tables(data, ["a", "c"])


def test_another_size_of_all_errors_changes_nothing(naming):
    data = ensemble({"a": 0.0, "b": 0.02}, spread=0.01)
    larger = Held(**vars(data) | {"statistic": lambda *names: 3.0 * data.statistic(*names)})
    first, second = naming.given_tables(data, ["a", "b"]), naming.given_tables(larger, ["a", "b"])
    assert second.probability == pytest.approx(first.probability, rel=1e-9)
    assert second.accuracy == first.accuracy
