"""The search against known optima and brute force, and identification against a made-up stepper."""

from __future__ import annotations

import csv
import json
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from tendonrepro.config.ensemble import load_ensemble
from tendonrepro.config.load import load_config
from tendonrepro.config.models.readings import RUNS, reading
from tendonrepro.config.published import PrintedNumber, published
from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.ensemble.box import make_box, scrambled_sobol
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.identify import search as identify_search
from tendonrepro.identify.command import run_identify
from tendonrepro.identify.judge import (
    number_rows,
    order_rows,
    order_verdict,
    parameter_rows,
    pareto_rows,
    ratio_rows,
)
from tendonrepro.identify.misfit import (
    Bench,
    Measured,
    acting_units,
    log_misfit,
    printed_numbers,
    rounding_misfit,
)
from tendonrepro.identify.report import identify_text
from tendonrepro.identify.search import Effort, Found, search
from tendonrepro.identify.state import load_state
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import Batch
from tendonrepro.simulation.streaming import STATISTICS

QUIET = Talk(quiet=True)
OK, RINGING, DIVERGED, UNRESOLVED = range(len(STATUSES))
EFFORT = Effort(generations=40, population=24, seeds=3, tolerance=0.05, smooth=(True,) * 6)
ROWS = 6
OPTIMUM = np.array([0.3, 0.62])


def two_numbers(units):
    """Two numbers that depend on the first three of six unknowns."""
    residuals = np.stack(
        [units[:, 0] - OPTIMUM[0], units[:, 1] + 0.5 * units[:, 2] ** 2 - OPTIMUM[1]], axis=1
    )
    return Found(np.sqrt((residuals**2).mean(axis=1)), residuals)


def initial(effort=EFFORT, rows=ROWS):
    return np.random.default_rng(5).random((effort.seeds, effort.population, rows))


def searched(path, misfit=two_numbers, effort=EFFORT, identity="a"):
    return search(initial(effort), misfit, effort, 1, path, identity, QUIET)


class Killed(BaseException):
    """What no handler catches."""


class TestSearch:
    def test_finds_a_known_optimum(self, tmp_path):
        unit, misfit = searched(tmp_path / "s.npz").best()
        assert misfit < 1e-4
        assert two_numbers(unit[np.newaxis]).misfits[0] == misfit
        assert unit[0] == pytest.approx(OPTIMUM[0], abs=2e-4)

    def test_finds_one_that_no_regression_shows(self, tmp_path):
        """Wells of equal depth around the deepest, and residuals that say nothing."""

        def wells(units):
            away = units[:, :2] - np.array([0.81, 0.23])
            misfits = np.sqrt((away**2 + 0.02 * (1.0 - np.cos(8.0 * np.pi * away))).mean(axis=1))
            return Found(misfits, np.zeros((len(units), 2)))

        unit, misfit = searched(tmp_path / "s.npz", wells, replace(EFFORT, generations=80)).best()
        assert misfit < 0.01
        np.testing.assert_allclose(unit[:2], [0.81, 0.23], atol=0.01)

    def test_optimum_beyond_a_bound_ends_at_it(self, tmp_path):
        def beyond(units):
            residuals = units[:, :1] - np.array([1.2])
            return Found(np.abs(residuals[:, 0]), residuals)

        unit, misfit = searched(tmp_path / "s.npz", beyond).best()
        assert 0.2 <= misfit < 0.205
        assert unit[0] > 0.99

    def test_members_stay_in_the_cube_and_never_get_worse(self, tmp_path):
        state = searched(tmp_path / "s.npz", effort=replace(EFFORT, tolerance=0.0))
        assert state.units.min() >= 0.0
        assert state.units.max() <= 1.0
        assert (np.diff(state.history, axis=0) <= 0.0).all()
        assert state.history.shape == (EFFORT.generations + 1, EFFORT.seeds)

    def test_near_optimal_members_cover_what_brute_force_finds(self, tmp_path):
        effort = replace(EFFORT, generations=80, population=64, seeds=4, tolerance=0.1)
        state = searched(tmp_path / "s.npz", effort=effort)
        near = state.near(0.1)
        assert len(near) > 0.9 * effort.population * effort.seeds
        every = np.random.default_rng(0).random((400_000, ROWS))
        allowed = every[two_numbers(every).misfits <= 0.1]
        ends = [np.percentile(units, [5, 50, 95], axis=0) for units in (near, allowed)]
        np.testing.assert_allclose(*ends, atol=0.12)
        width = ends[0][2] - ends[0][0]
        assert width[0] == pytest.approx((ends[1][2] - ends[1][0])[0], rel=0.2)
        assert width[3:].min() > 0.75  # three unknowns that nothing depends on

    def test_only_the_last_quarter_leaves_the_tolerance(self, tmp_path):
        state = searched(tmp_path / "s.npz", effort=replace(EFFORT, tolerance=0.3))
        assert np.median(state.spread_misfits) > 0.05
        assert np.median(state.misfits) < 0.01

    @pytest.mark.parametrize("deaths", [[1], [2, 9, 10, 31], [41]])
    def test_killed_and_resumed_ends_the_same(self, tmp_path, deaths):
        whole = searched(tmp_path / "whole.npz")
        calls = Counter()

        def mortal(units):
            calls["all"] += 1
            if calls["all"] in deaths:
                raise Killed
            return two_numbers(units)

        path = tmp_path / "cut.npz"
        for _ in deaths:
            with pytest.raises(Killed):
                searched(path, mortal)
        resumed = searched(path, mortal)
        for name in ("units", "misfits", "residuals", "spread_units", "spread_misfits", "history"):
            np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
        assert resumed.random == whole.random
        assert calls["all"] == EFFORT.generations + 1 + len(deaths)

    def test_finished_search_is_not_run_again(self, tmp_path):
        path = tmp_path / "s.npz"
        first = searched(path)

        def never(_):
            raise AssertionError

        np.testing.assert_array_equal(searched(path, never).units, first.units)

    @pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip", None])
    def test_damaged_or_foreign_state_is_not_taken_up(self, tmp_path, capsys, damage):
        path = tmp_path / "s.npz"
        first = searched(path)
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2] if damage is None else damage)
        assert load_state(path, "a", Talk()) is None
        assert "is damaged" in capsys.readouterr().err
        path.write_bytes(content)
        assert load_state(path, "b", Talk()) is None
        assert "another search" in capsys.readouterr().err
        assert load_state(path, "a", Talk()).random == first.random

    def test_seeds_know_nothing_of_each_other(self, tmp_path):
        alone = search(initial()[:1], two_numbers, replace(EFFORT, seeds=1), 1, tmp_path / "1", "a", QUIET)
        np.testing.assert_array_equal(alone.units[0], searched(tmp_path / "3").units[0])

    def test_steps_fold_at_the_bounds(self):
        folded = identify_search._reflected(np.array([-0.2, 0.4, 1.3, 2.7, -1.5]))
        np.testing.assert_allclose(folded, [0.2, 0.4, 0.7, 0.0, 0.5])


def measured(sizes, status=OK, lasted=1.0):
    """Plants with all four runs; `sizes` (N, 4, 2, 2)."""
    sizes = np.asarray(sizes, dtype=float)
    shape = sizes.shape[:2]
    return Measured(sizes, np.broadcast_to(np.int8(status), shape), np.broadcast_to(lasted, shape))


def paper(**changed):
    """The paper with some numbers changed, by ids with ``__`` for a point."""
    held = published()
    entries = dict(held.entries)
    for name, value in changed.items():
        entries[name.replace("__", ".")] = entries[name.replace("__", ".")].model_copy(
            update={"value": value}
        )
    return replace(held, entries=MappingProxyType(entries))


PRINTED = printed_numbers(published(), (2, 3))


class TestMisfit:
    def test_printed_numbers_stand_in_their_places(self):
        assert PRINTED.values.shape == (4, 2, 2)
        np.testing.assert_array_equal(
            PRINTED.values[RUNS.index("controller_2")], [[0.289, 0.240], [0.375, 0.292]]
        )
        np.testing.assert_array_equal(
            PRINTED.values[RUNS.index("controller_1_payload")], [[0.264, 0.227], [0.325, 0.265]]
        )
        np.testing.assert_allclose(PRINTED.half, 0.0005)

    def test_both_units(self):
        """Ten per cent more on every number, and on one of two: log 1.1 and its root mean square."""
        ours = measured([1.1 * PRINTED.values, PRINTED.values])
        np.testing.assert_allclose(log_misfit(ours, PRINTED.values), [np.log(1.1), 0.0], atol=1e-12)
        one = PRINTED.values.copy()
        one[0, 0, 0] += 0.004
        units = rounding_misfit(one[np.newaxis], PRINTED.values, PRINTED.half)
        assert units[0] == pytest.approx(8.0 / 4.0)

    def test_what_ends_badly_is_worse_than_any_that_ends_well_and_is_ordered(self):
        poor = measured([30.0 * PRINTED.values])
        nothing = np.full((1, 4, 2, 2), np.nan)
        rising = [
            log_misfit(poor, PRINTED.values),
            log_misfit(measured([PRINTED.values], RINGING), PRINTED.values),
            log_misfit(measured([30.0 * PRINTED.values], RINGING), PRINTED.values),
            log_misfit(measured([PRINTED.values], DIVERGED, 0.9), PRINTED.values),
            log_misfit(measured(nothing, DIVERGED, 0.1), PRINTED.values),
            log_misfit(measured(nothing, UNRESOLVED, 0.0), PRINTED.values),
        ]
        assert np.isfinite(rising).all()
        assert (np.diff(np.concatenate(rising)) > 0.0).all()

    def test_one_run_out_of_four_counts_by_its_end(self):
        status = np.array([[OK, OK, DIVERGED, OK]], dtype=np.int8)
        mixed = Measured(PRINTED.values[np.newaxis], status, np.full((1, 4), 0.5))
        assert log_misfit(mixed, PRINTED.values)[0] == pytest.approx(25.0 / 2.0)


def plants(*, factor=1.0, spread=0.05, count=200):
    """Plants around the printed numbers, `spread` in log, every number by itself."""
    noise = np.random.default_rng(3).uniform(-spread, spread, (count, 4, 2, 2))
    return measured(factor * PRINTED.values * np.exp(noise))


class TestJudge:
    def test_numbers_within_the_range_are_reached(self):
        rows = number_rows(measured([PRINTED.values]), plants(), PRINTED, ("controller_2",))
        verdicts = Counter((row["run"] == "controller_2", row["verdict"]) for row in rows)
        assert verdicts == {(True, "fitted"): 4, (False, "reached"): 12}
        assert all(row["inside_rounding"] and row["ratio"] == 1.0 for row in rows)

    def test_a_falsified_number_is_not_reached(self):
        lied = printed_numbers(paper(table2__controller_1__mae__joint_2=0.183), (2, 3))
        rows = number_rows(measured([PRINTED.values]), plants(), lied, ("controller_2",))
        wrong = [(row["run"], row["metric"], row["joint"]) for row in rows if row["verdict"] == "not_reached"]
        assert wrong == [("controller_1", "mae", 2)]
        row = next(row for row in rows if row["verdict"] == "not_reached")
        assert not row["inside_rounding"]
        assert row["rounding_units"] == pytest.approx((0.261 - 0.183) / 0.0005)

    def test_rare_lies_outside_the_central_part(self):
        near = plants()
        edge = replace(PRINTED, values=PRINTED.values * np.exp(0.048), half=1e-6 * PRINTED.half)
        assert {row["verdict"] for row in number_rows(near, near, edge, ())} == {"rare"}

    def test_runs_that_are_not_ok_are_left_out_of_ranges(self):
        near = plants()
        status = np.zeros((200, 4), dtype=np.int8)
        status[:190, 0] = RINGING
        rows = number_rows(near, Measured(near.sizes, status, near.lasted), PRINTED, ("controller_2",))
        assert {row["verdict"] for row in rows if row["run"] == "controller_1"} == {"too_few_plants"}

    def test_order_agrees_is_contradicted_or_depends(self):
        def verdicts(near, printed=PRINTED):
            return {(tuple(r["runs"]), r["metric"], r["joint"]): r for r in order_rows(near, printed)}

        three = ("controller_1", "controller_2", "controller_3")
        clear = plants(spread=0.01)
        assert verdicts(clear)[three, "mae", "both"]["verdict"] == "agrees"
        swapped = PRINTED.values.copy()
        swapped[[0, 2]] = swapped[[2, 0]]
        contrary = verdicts(clear, replace(PRINTED, values=swapped))[three, "rmse", "joint_2"]
        assert contrary["verdict"] == "contradicted"
        assert contrary["printed_order"] == list(reversed(three))
        found = verdicts(plants(spread=0.2))[three, "mae", "joint_3"]
        assert found["verdict"] == "depends_on_plant"
        sizes = plants(spread=0.2).sizes[:, :3, 0, 1]
        assert found["share"] == pytest.approx(
            ((sizes[:, 0] < sizes[:, 1]) & (sizes[:, 1] < sizes[:, 2])).mean()
        )

    def test_a_diverged_run_comes_last(self):
        near = plants(spread=0.01)
        status = np.zeros((200, 4), dtype=np.int8)
        status[:50, 0] = DIVERGED
        rows = order_rows(Measured(near.sizes, status, near.lasted), PRINTED)
        pair = next(row for row in rows if row["runs"] == ["controller_1", "controller_2"])
        assert pair["share"] == pytest.approx(0.75)

    def test_too_few_plants_say_nothing(self):
        rows = order_rows(plants(count=5), PRINTED)
        assert {row["verdict"] for row in rows} == {"too_few_plants"}
        assert order_verdict(0.95) == "agrees"
        assert order_verdict(0.05) == "contradicted"

    def test_ratios(self):
        row = ratio_rows(plants(spread=1e-9), PRINTED)[0]
        assert row["printed"] == pytest.approx(0.261 / 0.289)
        assert row["near_median"] == pytest.approx(row["printed"], rel=1e-6)

    def test_pareto_front_is_what_no_plant_beats(self):
        near = plants(count=60)
        front = pareto_rows(near, PRINTED, ("controller_2",))["controller_2_against_others"]
        two = log_misfit(measured(near.sizes[:, [1]]), PRINTED.values[[1]])
        rest = log_misfit(measured(near.sizes[:, [0, 2, 3]]), PRINTED.values[[0, 2, 3]])
        unbeaten = {
            k
            for k in range(60)
            if not ((two <= two[k]) & (rest <= rest[k]) & ((two < two[k]) | (rest < rest[k]))).any()
        }
        assert {point["plant"] for point in front} == unbeaten
        assert len(front) > 1


@cache
def loaded():
    return load_ensemble(None)


class TestParameters:
    def test_widths_bounds_and_shares(self):
        box = make_box(loaded().config)
        near = np.random.default_rng(1).random((4000, len(box.names)))
        known, choice = box.names.index("winch_viscous"), box.names.index("motion")
        near[:, known] = 0.5 + 0.1 * (near[:, known] - 0.5)
        best = np.full(len(box.names), 0.5)
        best[known], best[box.names.index("posture")] = 0.995, 0.004
        rows = {row["name"]: row for row in parameter_rows(box, best, near)}
        assert rows["winch_viscous"]["width"] == pytest.approx(0.1, rel=0.05)
        assert rows["winch_viscous"]["near_median"] == pytest.approx(1.0, rel=0.02)  # middle of 0.2 to 5, log
        assert rows["posture"]["width"] == pytest.approx(1.0, abs=0.03)
        at = {name: row["at_bound"] for name, row in rows.items() if row["at_bound"]}
        assert at == {"winch_viscous": "high", "posture": "low"}
        assert sum(rows["motion"]["shares"].values()) == pytest.approx(1.0)
        assert set(rows["motion"]["shares"]) == set(box.words[choice])
        assert rows["motion"]["best"] in box.words[choice]


def made_up(loops, limits, *, threads):
    """A stepper of a few unknowns: size by motor damping and link length, order by the law's weights."""
    del limits, threads
    sizes = np.array([_size(loop) for loop in loops])
    zeros = np.zeros((len(loops), 2))
    values = dict.fromkeys(STATISTICS, zeros) | {
        "mae": np.deg2rad(sizes[:, 0]), "rmse": np.deg2rad(sizes[:, 1])
    }  # fmt: skip
    values |= {"mae_late": 2.0 * values["mae"], "rmse_late": 2.0 * values["rmse"]}
    ends = np.array([loop.reference.time[-1] for loop in loops])
    return Batch(values, np.zeros(len(loops), np.int8), ends, np.full(len(loops), 2))


def _size(loop):
    """MAE and RMSE in degrees, (2, 2); Controller 1's is smaller by a share that no plant changes."""
    law, plant = loop.controller.law, loop.plant
    stroke = float(np.ptp(loop.reference.q_d[:, 1]))
    base = 0.4 * float(plant.drive.friction.viscous[0]) * np.array([stroke, 2.0 * stroke**2])
    two_weights = law.weights[1] != 0.0
    factor = 0.9 if two_weights.any() else 1.0
    return np.array([base, 1.25 * base]) * factor


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
    return Measured(sizes, np.zeros(sizes.shape[:2], np.int8), np.ones(sizes.shape[:2]))


def made_up_paper(**changed):
    """Printed numbers that the made-up stepper gives for a plant in the middle of the box."""
    base = 0.2 * np.array([1.0, 1.0])
    values = {}
    for run, factor in zip(RUNS, (0.9, 1.0, 1.0, 0.9), strict=True):
        table = "table3.with_load" if run == "controller_1_payload" else f"table2.{run}"
        for metric, more in (("mae", 1.0), ("rmse", 1.25)):
            for joint, size in zip((2, 3), base, strict=True):
                values[f"{table}.{metric}.joint_{joint}"] = round(float(factor * more * size), 3)
    return paper(**{name.replace(".", "__"): value for name, value in (values | changed).items()})


def identified(
    out, *, measure=cheap, held=None, fit="controller_2", readings="printed", window="whole", **more
):
    given = FULL | {"dry_run": False, "force": False, "overrides": (), "seed": None} | more
    with pytest.MonkeyPatch.context() as patch:
        if measure:
            patch.setattr(Bench, "measure", measure)
        request = Request(
            None, out, given["overrides"], given["seed"], None, given["dry_run"], given["force"]
        )
        effort = {key: given[key] for key in ("generations", "population", "seeds")}
        asked = {"fit": fit, "readings": readings, "window": window}
        return run_identify(
            request, QUIET, **asked, **effort, simulate=made_up, paper=held or made_up_paper()
        )


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
        assert rows["winch_viscous"]["width"] < 0.75
        others = [row["width"] for name, row in rows.items() if name.startswith("link_length")]
        assert min(others) > rows["winch_viscous"]["width"]

    def test_files_and_manifest(self, run):
        out, data = run
        manifest = json.loads((out / "manifest.json").read_text())
        names = set(manifest["outputs"])
        stems = ("readings", "numbers", "order", "ratios", "parameters", "pareto")
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
        data = identified(tmp_path / "out", measure=None, readings="printed,phi_branch=power", **TINY)
        best = min(data["readings"], key=lambda held: held["misfit_log"])
        np.testing.assert_allclose(
            made_up_sizes(data), [row["ours_deg"] for row in best["numbers"]], rtol=1e-12
        )
        text = (tmp_path / "out" / "identified.yaml").read_text()
        assert "draw from the box" not in text
        assert f"identified: tendonrepro identify, misfit {best['misfit_log']:.2g}" in text
        assert f"reading {best['name']};" in text

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
        data = identified(tmp_path / "out", held=held)
        rows = data["readings"][0]["numbers"]
        wrong = {(r["run"], r["metric"], r["joint"]) for r in rows if r["verdict"] == "not_reached"}
        assert wrong == {("controller_1", "mae", 2)}
        assert "none of these plants reaches controller_1 MAE joint 2" in identify_text(data)

    @pytest.mark.slow
    def test_reversed_ranking_is_contradicted(self, tmp_path):
        changed = {
            f"table2.controller_1.{metric}.joint_{joint}": round(1.11 * more * 0.2, 3)
            for metric, more in (("mae", 1.0), ("rmse", 1.25))
            for joint in (2, 3)
        }
        data = identified(tmp_path / "out", held=made_up_paper(**changed))
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
        far = {
            f"table2.controller_2.{metric}.joint_{joint}": 30.0
            for metric in ("mae", "rmse")
            for joint in (2, 3)
        }
        data = identified(tmp_path / "out", held=made_up_paper(**far))
        assert data["conclusions"][0].startswith("No plausible plant found")
        assert not data["readings"][0]["fits"]
        assert data["readings"][0]["near_limit"] == pytest.approx(2.0 * data["readings"][0]["misfit_log"])
        at = {row["name"]: row["at_bound"] for row in data["readings"][0]["parameters"]}
        assert at["winch_viscous"] == "high"
        assert "at a bound" in identify_text(data)

    def test_dry_run_writes_nothing(self, tmp_path):
        data = identified(tmp_path / "out", dry_run=True, readings="default")
        assert not (tmp_path / "out").exists()
        assert data["evaluations"] == 41 * 16 * 3
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
    batch = made_up([loops[name] for name in RUNS], None, threads=1)
    return np.rad2deg(np.stack([batch.statistics[name] for name in ("mae", "rmse")], axis=1)).ravel()


class TestBench:
    def test_everything_acts_in_the_stubs(self):
        """Else a population that agrees on a row needs code of its own, which takes a minute to compile."""
        box = make_box(loaded().config)
        found = box.values(acting_units(box))
        names = list(box.names)
        switches = [
            k for k, name in enumerate(names) if name.endswith("_acts") and name != "torque_resolution_acts"
        ]
        assert (found[:, switches] == 1.0).all()
        assert {
            box.words[names.index("friction_sides")][int(k)] for k in found[:, names.index("friction_sides")]
        } == {"both"}
        branches = found[:, [names.index("disturbance"), names.index("torque_resolution_acts")]]
        assert len(np.unique(branches, axis=0)) == 6

    def test_large_batches_are_cut_and_stubs_left_out(self, monkeypatch):
        sizes = []

        def counting(loops, limits, *, threads):
            sizes.append(len(loops))
            return made_up(loops, limits, threads=threads)

        monkeypatch.setattr("tendonrepro.identify.misfit._PLANTS_AT_ONCE", 16)
        box = make_box(loaded().config)
        bench = Bench(loaded().base, box, "whole", counting, 1)
        found = bench.measure(
            scrambled_sobol(box, 1, 0, 0, 20), reading({}), ("controller_2", "controller_3")
        )
        assert found.sizes.shape == (20, 2, 2, 2)
        assert found.status.shape == (20, 2)
        stubs = 2 * len(acting_units(box))
        assert sizes == [16 * 2 + stubs, 4 * 2 + stubs]


def test_ids_of_the_paper_are_numbers():
    assert isinstance(published().quantity("table2.controller_2.mae.joint_2"), PrintedNumber)
