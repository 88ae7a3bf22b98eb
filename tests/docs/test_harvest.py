"""What `make findings` takes over of searches and an ensemble, what it refuses, and what it then says."""

import importlib
import json
import math

import pytest
from support.pages import DOCS, NEEDS_DOCS

pytestmark = NEEDS_DOCS
BUDGET = {"generations": 66, "population": 48, "seeds": 4, "evaluations": 16080, "unknowns": 10, "rows": []}
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


@pytest.fixture
def generate(monkeypatch):
    """docs/generate.py, which makes the pages."""
    monkeypatch.syspath_prepend(DOCS)
    return importlib.import_module("generate")


def searched(folder, misfits, **budget):
    """What `identify` leaves, with a misfit by interpretation."""
    readings = [
        {
            "name": name,
            "misfit_log": misfit,
            "misfit_by_seed": [misfit, misfit + 0.002],
            "seeds_agree": False,
            "rows_searched": ["amplitude"],
            "best_shape": SHAPE,
            "numbers": [{"ratio": math.exp(misfit)}],
            "parameters": [{"name": "amplitude", "at_bound": "low"}],
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


def test_of_two_beginnings_the_nearer_stands_in_the_table_and_ships(harvest, tmp_path):
    (tmp_path / "results" / "identify.json").write_text('{"readings": []}', encoding="utf-8")
    from_draws = {"from_draws_of": "an ensemble"}
    harvest.take_closest(searched(tmp_path / "arm", {"printed": 0.9, "motion=ramp": 0.2}))
    harvest.take_closest(searched(tmp_path / "draw", {"printed": 0.1, "motion=ramp": 0.3}, **from_draws))
    stored = harvest.stored("identify")
    assert [(held["name"], held["misfit_log"], held["begun_at"]) for held in stored["readings"]] == [
        ("printed", 0.1, "draw"),
        ("motion=ramp", 0.2, "arm"),
    ]
    assert [held["misfit_log"] for held in stored["farther"]] == [0.3, 0.9]
    assert "printed" in harvest.CLOSEST.read_text(encoding="utf-8")
    # Taken over once more, nothing changes, and a farther search ships no plant.
    harvest.CLOSEST.write_text("kept", encoding="utf-8")
    harvest.take_closest(tmp_path / "arm")
    assert harvest.stored("identify") == stored
    assert harvest.CLOSEST.read_text(encoding="utf-8") == "kept"


@pytest.mark.parametrize(("misfit", "rows"), [(0.1, 1), (0.0975, 2)])
def test_a_changed_equation_has_a_row_where_it_is_closer_by_more_than_the_scatter(
    harvest, generate, tmp_path, misfit, rows
):
    """The standard deviation of two searches that end 0.002 apart is 0.0014."""
    (tmp_path / "results" / "identify.json").write_text('{"readings": []}', encoding="utf-8")
    harvest.take_closest(searched(tmp_path / "one", {"printed": 0.1, "weights=extrapolating": misfit}))
    drawn = {"misfit_log": dict.fromkeys(("printed", "weights=extrapolating"), 0.2)}
    (tmp_path / "results" / "draws.json").write_text(json.dumps(drawn), encoding="utf-8")
    text = generate.made(
        "the_closest", **generate.of_searches(harvest.stored("identify")), stored=harvest.stored
    )
    cells = [line for line in text.splitlines() if line.startswith("| ") and "`" in line.split("|")[2]]
    assert len(cells) == rows
    assert "16,080" in text


def row(compared, estimator, probability, low, high, loss):
    return {
        **{"compared": compared, "numbers": 12, "estimator": estimator, "log_loss": loss},
        **{"probability": probability, "low": low, "high": high, "recalibrated": 0.5, "right": 0.9},
    }


def test_the_range_is_over_all_estimators_and_kernels_have_one_column(generate):
    rows = [
        row("ratios between runs", "kernel of 2 %", 0.9, 0.8, 0.99, 0.6),
        row("ratios between runs", "kernel of 10 %", 0.7, 0.6, 0.75, 0.2),
        row("ratios between runs", "extra trees", 0.5, 0.4, 0.55, 0.1),
        row("all ratios", "extra trees", 1e-9, 1e-9, 0.3, 0.1),
    ]
    found = generate.of_tables({"rows": rows})
    assert found["estimators"] == ["kernel", "extra trees"]
    assert dict(found["compared"]) == {
        "12 ratios between runs": ["60 to 99", "40 to 55"],
        "12 all ratios": ["", "0 to 30"],
    }
    assert (generate.reach(found["between"]), generate.reach(found["all"])) == ("40 to 99 %", "0 to 30 %")


def test_a_group_of_made_up_papers_has_its_lowest_and_highest_rate(generate):
    def of(reading, share, papers=200, noise=0.02):
        return {"reading": reading, "noise": noise, "papers": papers, "false_contradicted": {"share": share}}

    rows = [
        of("printed", 0.01),
        of("encoder=ideal", 0.02),
        of("feedback=motor", 0.26),
        of("starts=apart", 0.1),
    ]
    rows += [of("weights=extrapolating", 1.0), of("printed", 0.03, noise=0.05)]
    found = generate.of_papers({"readings": rows, "noise": 0.02})
    cells = [generate.extent(group, "false_contradicted") for _, group in found["papers"]]
    assert cells == ["1 %", "3 %", "2 to 26 %", "10 %", "100 %"]
    assert found["unsaid"] == 0.26
