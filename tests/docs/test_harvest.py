"""What `make findings` takes over of searches and an ensemble, what it refuses, and what it then says."""

import importlib
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from support.pages import DOCS, NEEDS_DOCS

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS, published
from tendonrepro.identification.bench import printed_numbers
from tendonrepro.physics.metrics import STATUSES

pytestmark = NEEDS_DOCS
BUDGET = {"budget": 600, "draws": 300, "evaluations": 1952, "rows": []}
SHAPE = [{"joint": joint, "ours_order_mae": "1 < 2 < 3", "ours_order_rmse": "1 < 2 < 3"} for joint in (2, 3)]


@pytest.fixture
def harvest(tmp_path, monkeypatch):
    """docs/harvest.py, with stored results and the shipped plant in a scratch folder."""
    monkeypatch.syspath_prepend(DOCS)
    module = importlib.import_module("harvest")
    monkeypatch.setattr(importlib.import_module("stored_results"), "RESULTS", tmp_path / "results")
    monkeypatch.setattr(module, "CLOSEST", tmp_path / "closest.yaml")
    (tmp_path / "results").mkdir()
    return module


def repeated(search, misfit):
    """What one search leaves of one interpretation."""
    spread = {"low": misfit - 0.001, "high": misfit + 0.001, "in_order": 0.25, "seen": misfit - 0.002}
    return {"search": search, "misfit_log": misfit} | spread


def searched(folder, misfits, **budget):
    """What `identify` leaves, with a misfit by interpretation."""
    readings = [
        {
            "name": name,
            "misfit_log": misfit,
            "searches": [repeated("CMA-ES", misfit), repeated("least squares", 1.5 * misfit)],
            "rows_searched": ["amplitude"],
            "best_shape": SHAPE,
            "numbers": [{"ratio": math.exp(misfit)}],
            "parameters": [{"name": "amplitude", "at_bound": "low", "best": 0.3}],
        }
        for name, misfit in misfits.items()
    ]
    found = BUDGET | budget | {"fit": "all", "window": "whole", "readings": readings}
    (folder / "plants").mkdir(parents=True)
    for name in misfits:
        (folder / "plants" / f"{name}.yaml").write_text(f"title: {name}\n", encoding="utf-8")
    (folder / "identify.json").write_text(json.dumps(found), encoding="utf-8")
    (folder / "manifest.json").write_text('{"config": {"ensemble_sha256": "a"}}', encoding="utf-8")
    return folder


def names(harvest):
    return {held["name"] for held in harvest.stored("identify")["readings"]}


def test_searches_of_one_budget_add_up_and_the_closest_keeps_every_equation(harvest, tmp_path):
    (tmp_path / "results" / "identify.json").write_text('{"readings": [{"name": "old"}]}', encoding="utf-8")
    changed = "weights=extrapolating"
    harvest.take_closest(searched(tmp_path / "one", {"printed": 0.2, changed: 0.1}))
    assert names(harvest) == {"printed", changed}
    assert "printed" in harvest.CLOSEST.read_text(encoding="utf-8")
    harvest.take_closest(searched(tmp_path / "two", {"motion=ramp": 0.05}))
    assert names(harvest) == {"printed", changed, "motion=ramp"}
    assert "motion=ramp" in harvest.CLOSEST.read_text(encoding="utf-8")
    # Shorter ones are no reason to lose those; longer ones replace them.
    with pytest.raises(SystemExit):
        harvest.take_closest(searched(tmp_path / "short", {"printed": 0.01}, evaluations=100))
    harvest.take_closest(searched(tmp_path / "long", {"printed": 0.15}, evaluations=30000))
    assert names(harvest) == {"printed"}


def test_no_plant_ships_whose_errors_are_of_motors_nor_a_farther_one(harvest, tmp_path):
    harvest.take_closest(searched(tmp_path / "one", {"printed": 0.2, "feedback=motor": 0.1}))
    assert "printed" in harvest.CLOSEST.read_text(encoding="utf-8")
    harvest.CLOSEST.write_text("kept", encoding="utf-8")
    harvest.take_closest(searched(tmp_path / "two", {"motion=ramp": 0.3}))
    assert harvest.CLOSEST.read_text(encoding="utf-8") == "kept"
    assert [held["name"] for held in harvest.stored("identify")["readings"]] == [
        "feedback=motor",
        "printed",
        "motion=ramp",
    ]


def test_the_nearest_draws_of_an_ensemble_are_ones_that_end_well(harvest):
    """Beside each search stands how near the draws come without one; every fourth diverges here."""
    goal = printed_numbers(published(), (2, 3))
    draws = np.random.default_rng(5).random((80, 7))
    sizes = np.exp(draws[:, :1, np.newaxis, np.newaxis]) * goal.values
    diverged = np.arange(80) % 4 == 0
    ensemble = SimpleNamespace(
        draws=draws,
        statistic=lambda run, _, name: np.deg2rad(sizes[:, RUNS.index(run), METRICS.index(name)]),
        status=lambda run, _: np.where(diverged & (run == RUNS[-1]), STATUSES.index("diverged"), 0),
    )
    nearest = harvest.nearest_draws(ensemble, goal, "printed")
    stable = draws[~diverged]
    np.testing.assert_array_equal(nearest, stable[np.argsort(stable[:, 0])][: harvest.NEAREST])
