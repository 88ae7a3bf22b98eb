"""Identification against a made-up stepper; and a made-up paper from a known plant, identified back."""

import csv
import json
import math
import re
from collections import Counter
from pathlib import Path
from statistics import fmean

import numpy as np
import pytest
from support.made_plants import Killed, made_up, made_up_paper
from support.pages import tables_of

from tendonrepro.commands import COMMANDS
from tendonrepro.configuration.load import load_config, shipped_file
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.console import QUIET
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.identification import bench
from tendonrepro.identification import study as identify_study
from tendonrepro.identification.bench import Bench, Simulated
from tendonrepro.reporting.contents import quantities
from tendonrepro.studies.lifecycle import carry_out

FULL = {"budget": 300}
TINY = {"budget": 10}


def cheap(bench, plants, held, runs):
    """The made-up stepper without its loops: it needs the values alone."""
    del held
    values = dict(zip(bench.box.names, plants.T, strict=True))
    viscous, stroke = values["winch_viscous"], values["amplitude"]
    base = 0.4 * viscous[:, np.newaxis] * np.stack([stroke, 2.0 * stroke**2], axis=1)
    base *= 2.0 if bench.window == "late" else 1.0
    both = np.stack([base, 1.25 * base], axis=1)
    sizes = np.stack([both * (0.9 if run.startswith("controller_1") else 1.0) for run in runs], axis=1)
    return Simulated(sizes, np.zeros(sizes.shape[:2], np.int8), np.ones(sizes.shape[:2]))


def identified(out, *, measure=cheap, paper=None, dry_run=False, force=False, jobs=1, **asked):
    with pytest.MonkeyPatch.context() as patch:
        if measure:
            patch.setattr(Bench, "measure", measure)
        patch.setattr(identify_study, "simulate_batch", made_up)
        asked = FULL | asked | {"jobs": jobs}
        patch.setattr(bench, "published", lambda: paper or made_up_paper())
        study = COMMANDS["identify"].prepare(**asked, out=out, force=force)
        return carry_out(study, QUIET, dry_run=dry_run).data


def lucky(bench, plants, held, runs):
    """As `cheap`, but light links err by chance, and heavy ones have an RMSE that is half too large."""
    found = cheap(bench, plants, held, runs)
    row = next(row for row, name in enumerate(bench.box.names) if name.startswith("link_mass"))
    mass, middle = plants[:, row], bench.box.values(np.full((1, len(bench.box.names)), 0.5))[0, row]
    factors = np.ones(found.sizes.shape)
    factors[mass < middle] *= np.exp(3.0 * np.abs(np.sin(1e9 * mass[mass < middle])))[:, None, None, None]
    factors[mass >= middle, :, 1] *= 1.5
    return found._replace(sizes=found.sizes * factors)


def test_an_arm_that_came_near_by_luck_does_not_hide_one_that_repeats(tmp_path):
    found = identified(tmp_path / "out", measure=lucky)["readings"][0]
    assert min(search["seen"] for search in found["searches"]) < 0.15
    assert 0.19 < found["misfit_log"] < 0.25


READINGS = "printed,weights=extrapolating,phi_branch=power"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("identify") / "out"
    return out, identified(out, readings=READINGS)


def test_the_rows_that_are_named_are_searched_and_no_other(tmp_path):
    rows = "winch_viscous, offset_controller_2_joint_3,winch_viscous"
    data = identified(tmp_path / "out", rows=rows, **TINY)
    searched = set(data["readings"][0]["rows_searched"])
    assert searched == {"winch_viscous", "offset_controller_2_joint_3"}


def test_fitted_numbers_come_back(run):
    _, data = run
    first = data["readings"][0]
    assert first["fits"]
    assert first["misfit_log"] < 0.005
    fitted = [row for row in first["numbers"] if row["fitted"]]
    assert {row["run"] for row in fitted} == {"controller_2"}
    assert [row["ratio"] for row in fitted] == pytest.approx([1.0] * 4, abs=0.01)
    # In the made-up stepper these follow from the fitted ones.
    assert [row["ratio"] for row in first["numbers"]] == pytest.approx([1.0] * 16, abs=0.03)


def test_readings_that_do_not_change_what_is_fitted_share_a_search(run):
    _, data = run
    assert [held["search"] for held in data["readings"]] == ["printed", "printed", "phi_branch=power"]
    assert data["searches"] == ["printed", "phi_branch=power"]


def test_files(run):
    out, data = run
    names = set(json.loads((out / "manifest.json").read_text())["outputs"])
    wanted = {f"tables/identify_{stem}.csv" for stem in ("readings", "numbers", "parameters")}
    assert {name for name in names if name.endswith(".csv")} == wanted
    with (out / "tables" / "identify_parameters.csv").open(encoding="utf-8") as lines:
        rows = [row for row in csv.DictReader(lines) if row["reading"] == "printed"]
    assert {row["name"]: row["known"] for row in rows if row["known"]} == {
        row["name"]: row["known"] for row in data["readings"][0]["known"]
    }
    assert wanted | {"figures/identify_numbers.pdf", "identify.json", "identified.yaml"} <= names
    assert not any(name.startswith("search") for name in names)
    stored = json.loads((out / "identify.json").read_text())
    assert stored["readings"][0]["misfit_log"] == data["readings"][0]["misfit_log"]
    config = (out / "identified.yaml").read_text(encoding="utf-8")
    assert "draw from the box" not in config
    tree = load_config(out / "identified.yaml", "compare").tree
    sources = [held["source"] for _, held in quantities(tree) if held["source"].startswith("identified: ")]
    assert len(sources) > 30
    assert all(source.startswith("identified: Controller 2 of Table 2, misfit ") for source in sources)
    assert {path.stem for path in (out / "plants").iterdir()} == {held["name"] for held in stored["readings"]}


def test_a_shorter_list_goes_on_with_what_was_searched(run, tmp_path):
    """Of a killed run those that are done are not searched again, whatever else was asked for."""
    calls = Counter()

    def counting(*given):
        calls["all"] += 1
        if "phi_branch=power" in given[2].name and calls["limit"]:
            raise Killed
        return cheap(*given)

    calls["limit"] = 1
    with pytest.raises(Killed):
        identified(tmp_path / "out", measure=counting, readings=READINGS)
    made, calls["limit"] = calls["all"], 0
    found = identified(tmp_path / "out", measure=counting, readings="printed")
    # Three kinds of repeats of each search, and what the best plant gives, beside the print.
    assert calls["all"] - made == 2 * 3 + 1
    np.testing.assert_equal(found["readings"], run[1]["readings"][:1])


@pytest.mark.slow
def test_searches_side_by_side_find_the_same(tmp_path):
    asked = TINY | {"measure": None, "readings": "printed,phi_branch=power"}
    one, two = (identified(tmp_path / str(jobs), jobs=jobs, **asked) for jobs in (1, 2))
    np.testing.assert_equal(one["readings"], two["readings"])


@pytest.mark.slow
@pytest.mark.parametrize(("window", "factor"), [("whole", 1.0), ("late", 2.0)])
def test_written_config_gives_the_same_numbers(tmp_path, window, factor):
    """Errors after the first period are twice as large in the made-up stepper."""
    asked = TINY | {"measure": None, "fit": "all", "window": window}
    data = identified(tmp_path / "out", readings="printed,phi_branch=power", **asked)
    best = min(data["readings"], key=lambda held: held["misfit_log"])
    loops = dict(build_loops(load_config(data["config"], "compare").config, Path()))
    batch = made_up([loops[name] for name in RUNS])
    whole = np.rad2deg(np.stack([batch.statistics[name] for name in ("mae", "rmse")], axis=1)).ravel()
    np.testing.assert_allclose(factor * whole, [row["ours_deg"] for row in best["numbers"]], rtol=1e-12)


def test_a_fit_misses_by_two_per_cent_at_most(tmp_path):
    """MAE and RMSE of a joint go together in the made-up stepper."""
    name = "table2.controller_2.mae.joint_2"
    paper = made_up_paper(**{name: 1.1 * made_up_paper().number(name)})
    (held,) = identified(tmp_path / "out", paper=paper)["readings"]
    assert 0.02 < held["misfit_log"] < 0.06
    assert not held["fits"]
    assert not any(row["determined"] for row in held["known"])


def test_dry_run_writes_nothing(tmp_path):
    data = identified(tmp_path / "out", dry_run=True, readings="default", fit="all")
    assert not (tmp_path / "out").exists()
    assert data["evaluations"] == 150 + 2 * (300 + 300 + 6 * 15 + 64), "draws, two searches, and repeats"
    assert len(data["readings"]) >= len(data["searches"]) > 10
    assert data["cost"]["experiments"] == data["evaluations"] * 4 * len(data["searches"]), "four runs a plant"


@pytest.mark.parametrize("asked", [{"budget": 0}, {"jobs": 0}, {"rows": "winch_viscosity"}])
def test_what_cannot_be_asked(tmp_path, asked):
    with pytest.raises(UsageError) as caught:
        identified(tmp_path / "out", **asked)
    assert caught.value.where == f"--{next(iter(asked))}"


@pytest.mark.slow
def test_misfit_of_the_shipped_closest_plant_is_the_one_that_its_heading_states():
    """By the other stepper, and by arithmetic of its own."""
    heading = read_text(shipped_file("closest"))
    data = tables_of("closest")
    assert set(data["status"].values()) == {"ok"}
    printed = data["printed"]
    pairs = [(data["table2"][run], held) for run, held in printed["table2"].items()]
    pairs.append((data["table3"]["with_load"], printed["table3"]["with_load"]))
    logs = [
        math.log(ours / theirs)
        for mine, papers in pairs
        for metric in ("mae_deg", "rmse_deg")
        for ours, theirs in zip(mine[metric], papers[metric], strict=True)
    ]
    assert len(logs) == 16
    (misfit,) = re.findall(r"Misfit ([\d.]+),", heading)
    assert math.sqrt(fmean(log**2 for log in logs)) == pytest.approx(float(misfit), abs=0.003)
