"""Identification against a made-up stepper."""

import csv
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from support.made_plants import QUIET, Killed, made_up, made_up_paper

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.request import Request
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.identification.command import run_identify
from tendonrepro.identification.misfit import Bench, Outcome
from tendonrepro.identification.report import identify_text

FULL = {"generations": 40, "population": 16, "seeds": 3}
TINY = {"generations": 1, "population": 5, "seeds": 1}


def cheap(bench, units, held, runs):
    """The made-up stepper without its loops: it needs the values alone."""
    del held
    values = dict(zip(bench.box.names, bench.box.values(units).T, strict=True))
    viscous, stroke = values["winch_viscous"], values["amplitude"]
    base = 0.4 * viscous[:, np.newaxis] * np.stack([stroke, 2.0 * stroke**2], axis=1)
    base *= 2.0 if bench.window == "late" else 1.0
    both = np.stack([base, 1.25 * base], axis=1)
    sizes = np.stack([both * (0.9 if run.startswith("controller_1") else 1.0) for run in runs], axis=1)
    return Outcome(sizes, np.zeros(sizes.shape[:2], np.int8), np.ones(sizes.shape[:2]))


def identified(out, *, measure=cheap, paper=None, dry_run=False, force=False, jobs=1, **asked):
    with pytest.MonkeyPatch.context() as patch:
        if measure:
            patch.setattr(Bench, "measure", measure)
        request = Request(out=out, dry_run=dry_run, force=force)
        asked = FULL | asked | {"jobs": jobs, "simulate": made_up}
        return run_identify(request, QUIET, **asked, paper=paper or made_up_paper())


def printed_as(law, sizes):
    return {
        f"table2.{law}.{metric}.joint_{joint}": size for metric, size in sizes.items() for joint in (2, 3)
    }


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("identify") / "out"
    return out, identified(out, readings="printed,weights=extrapolating,phi_branch=power")


class TestRun:
    def test_fits_and_predicts(self, run):
        _, data = run
        first = data["readings"][0]
        assert first["misfit_log"] < 0.02
        assert first["fits"]
        assert data["judged"]
        for row in first["numbers"]:
            assert row["ratio"] == pytest.approx(1.0, abs=0.03)
            assert row["verdict"] in {"fitted", "reached", "rare", "too_few_plants"}
        assert {row["run"] for row in first["numbers"] if row["verdict"] == "fitted"} == {"controller_2"}

    def test_readings_that_do_not_change_what_is_fitted_share_a_search(self, run):
        _, data = run
        assert [held["search"] for held in data["readings"]] == ["printed", "printed", "phi_branch=power"]
        assert data["searches"] == ["printed", "phi_branch=power"]
        first, second = data["readings"][:2]
        assert first["misfit_log"] == second["misfit_log"]

    def test_identified_knows_what_matters(self, run):
        """Only the motor damping and the stroke make a size, so they alone are known."""
        _, data = run
        rows = {row["name"]: row for row in data["readings"][0]["parameters"]}
        assert all(row["searched"] for row in rows.values())
        assert rows["winch_viscous"]["width"] < 0.75
        others = [row["width"] for name, row in rows.items() if name.startswith("link_length")]
        assert min(others) > rows["winch_viscous"]["width"]

    def test_only_rows_that_matter_are_searched_where_nothing_is_judged(self, tmp_path):
        held = identified(tmp_path / "out", fit="all", **TINY)["readings"][0]
        rows = {row["name"]: row for row in held["parameters"]}
        searched = {name for name, row in rows.items() if row["searched"]}
        assert searched == set(held["rows_searched"]) <= {"winch_viscous", "amplitude"}
        assert searched
        kept = load_ensemble(None).config.box.link_length_2.nominal
        assert rows["link_length_2"]["best"] == kept

    def test_shape_of_the_best_plant(self, run):
        """The made-up stepper has RMSE/MAE of 1.25 in every printed number; what is ours follows stroke."""
        _, data = run
        for row in data["readings"][0]["best_shape"]:
            assert row["printed_rmse_over_mae_controller_2"] == pytest.approx(1.25, abs=0.01)
            assert row["ours_rmse_over_mae_controller_1"] == pytest.approx(1.25)
            assert row["printed_order_mae"] == row["ours_order_rmse"] == "1 < 2 < 3"

    @pytest.mark.slow
    def test_searches_side_by_side_find_the_same(self, tmp_path):
        asked = TINY | {"measure": None, "readings": "printed,phi_branch=power"}
        one, two = (identified(tmp_path / str(jobs), jobs=jobs, **asked) for jobs in (1, 2))
        np.testing.assert_equal(one["readings"], two["readings"])

    def test_files_and_manifest(self, run):
        out, data = run
        manifest = json.loads((out / "manifest.json").read_text())
        names = set(manifest["outputs"])
        stems = ("readings", "numbers", "shape", "order", "parameters", "pareto")
        assert {f"tables/identify_{stem}.{kind}" for stem in stems for kind in ("csv", "md")} < names
        figures = ("readings", "numbers", "parameters")
        assert {
            f"figures/identify_{stem}.{kind}" for stem in figures for kind in ("pdf", "svg", "png")
        } < names
        assert {"identify.json", "identified.yaml"} < names
        stored = json.loads((out / "identify.json").read_text())
        assert stored["readings"][0]["misfit_log"] == data["readings"][0]["misfit_log"]
        with (out / "tables" / "identify_numbers.csv").open() as stream:
            rows = list(csv.DictReader(stream))
        assert len(rows) == 16 * 3
        assert float(rows[0]["ours_deg"]) == data["readings"][0]["numbers"][0]["ours_deg"]

    @pytest.mark.slow
    def test_written_config_gives_the_same_numbers(self, tmp_path):
        data = identified(
            tmp_path / "out", measure=None, fit="all", readings="printed,phi_branch=power", **TINY
        )
        best = min(data["readings"], key=lambda held: held["misfit_log"])
        np.testing.assert_allclose(
            made_up_sizes(data), [row["ours_deg"] for row in best["numbers"]], rtol=1e-12
        )
        text = (tmp_path / "out" / "identified.yaml").read_text()
        assert "draw from the box" not in text
        assert f"identified: Tables 2 and 3, misfit {best['misfit_log']:.2g}" in text
        assert f"under the reading {best['name']}," in text
        assert "proves nothing" in text
        held = "held at its nominal value: "
        assert f"{held}link_mass" in text
        assert f"{held}winch_viscous" not in text

    def test_killed_in_the_middle_gives_the_same_files(self, run, tmp_path):
        _, data = run
        calls = Counter()

        def mortal(*given):
            calls["all"] += 1
            if calls["all"] in {5, 6, 60}:
                raise Killed
            return cheap(*given)

        again = {"measure": mortal, "readings": "printed,weights=extrapolating,phi_branch=power"}
        for _ in range(3):
            with pytest.raises(Killed):
                identified(tmp_path / "out", **again)
        found = identified(tmp_path / "out", **again)
        np.testing.assert_equal(found["readings"], data["readings"])
        assert not list((tmp_path / "out" / "search").glob(".*"))

    def test_falsified_number_shows(self, tmp_path):
        held = made_up_paper(**{"table2.controller_1.mae.joint_2": 0.126})
        data = identified(tmp_path / "out", paper=held)
        rows = data["readings"][0]["numbers"]
        wrong = {(r["run"], r["metric"], r["joint"]) for r in rows if r["verdict"] == "not_reached"}
        assert wrong == {("controller_1", "mae", 2)}
        assert "none of these plants reaches controller_1 MAE joint 2" in identify_text(data)

    @pytest.mark.slow
    def test_reversed_ranking_is_contradicted(self, tmp_path):
        changed = printed_as("controller_1", {"mae": 0.222, "rmse": 0.278})
        data = identified(tmp_path / "out", paper=made_up_paper(**changed))
        order = data["readings"][0]["order"]
        row = next(r for r in order if r["runs"] == ["controller_1", "controller_2"] and r["joint"] == "both")
        assert row["verdict"] == "contradicted"

    @pytest.mark.slow
    def test_all_sixteen_are_fitted_and_not_judged(self, tmp_path):
        data = identified(tmp_path / "out", fit="all", readings="printed,weights=extrapolating")
        assert data["judged"] is False
        assert data["searches"] == ["printed", "weights=extrapolating"]
        assert {row["verdict"] for held in data["readings"] for row in held["numbers"]} == {"fitted"}
        assert not any("printed order" in sentence for sentence in data["conclusions"])

    @pytest.mark.slow
    def test_window_chooses_the_statistics(self, tmp_path):
        """Errors after the first period are twice as large in the made-up stepper."""
        data = identified(tmp_path / "out", measure=None, window="late", **TINY)
        late = [row["ours_deg"] for row in data["readings"][0]["numbers"]]
        np.testing.assert_allclose(late, 2.0 * made_up_sizes(data), rtol=1e-9)

    def test_no_plausible_plant_is_an_answer(self, tmp_path):
        far = printed_as("controller_2", {"mae": 30.0, "rmse": 30.0})
        data = identified(tmp_path / "out", paper=made_up_paper(**far))
        assert data["conclusions"][0].startswith("No plausible plant found")
        assert not data["readings"][0]["fits"]
        assert data["readings"][0]["near_limit"] == pytest.approx(2.0 * data["readings"][0]["misfit_log"])
        at = {row["name"]: row["at_bound"] for row in data["readings"][0]["parameters"]}
        assert at["winch_viscous"] == "high"
        assert "at a bound" in identify_text(data)

    def test_dry_run_writes_nothing(self, tmp_path):
        data = identified(tmp_path / "out", dry_run=True, readings="default")
        assert not (tmp_path / "out").exists()
        assert data["evaluations"] == 41 * 16 * (3 + 1), "three seeds, and the polish of the best"
        assert len(data["readings"]) > len(data["searches"]) > 10
        assert "would write to" in identify_text(data)

    @pytest.mark.slow
    def test_other_results_are_not_overwritten(self, tmp_path):
        identified(tmp_path / "out", **TINY)
        with pytest.raises(UsageError, match="another configuration"):
            identified(tmp_path / "out", **TINY | {"generations": 2})
        identified(tmp_path / "out", **TINY | {"generations": 2}, force=True)

    @pytest.mark.parametrize(
        ("given", "match"),
        [
            ({"population": 4}, "at least 5"),
            ({"generations": 0}, "at least 1"),
            ({"seeds": 0}, "at least 1"),
            ({"population": 10**9}, "at most 2048"),
            ({"generations": 10**9}, "at most 100000"),
            ({"seeds": 10**6}, "at most 64"),
            ({"jobs": 0}, "number of processors"),
            ({"fit": "controller_1"}, "must be controller_2 or all"),
            ({"window": "first"}, "must be whole or late"),
            ({"readings": "wieghts=extrapolating"}, "no axis"),
            ({"readings": "sampling_period=2ms"}, "is a variation"),
        ],
    )
    def test_mistakes_are_named(self, tmp_path, given, match):
        with pytest.raises(UsageError, match=match):
            identified(tmp_path / "out", **given)


def made_up_sizes(data):
    """Errors over the whole run of the written configuration."""
    config = load_config(data["config"], "compare").config
    loops = dict(build_loops(config, Path()))
    batch = made_up([loops[name] for name in RUNS], None)
    return np.rad2deg(np.stack([batch.statistics[name] for name in ("mae", "rmse")], axis=1)).ravel()
