"""Sweeps: against the theory, single runs, and what the command line was asked for."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.command import answer, run
from support.overrides import SMOOTH, one_stroke, quantity

import tendonrepro as tr
from tendonrepro.configuration.load import load_config, shipped_folder
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.console import QUIET
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments import sweep
from tendonrepro.experiments.figures import draw_sweep
from tendonrepro.experiments.loops import build_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.store import read_manifest
from tendonrepro.simulation.batch import simulate_batch

ALPHA = "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"
PERIOD = "sampling_period=0.5,1,2"
ONE = "reference.periods=1"


@cache
def swept(*over, overrides=(ONE,), controllers=(1, 2)):
    return sweep.simulate(sweep.load_grid(over, "plain", overrides=overrides, controllers=controllers), QUIET)


def by_point(rows, column, **keys):
    """A column of rows by point and joint, (P, 2)."""
    kept = [row[column] for row in rows if all(row[key] == value for key, value in keys.items())]
    return np.array(kept, dtype=float).reshape(-1, 2)


@pytest.mark.parametrize(
    ("over", "power"), [(PERIOD, 1.0), ("control.gains.M_bar=[0.01,0.01],[0.02,0.02]", -1.0)]
)
def test_error_goes_with_L_over_M_bar(over, power):
    """Of a slowly changing load: e = w L dH / (M_bar lam k), docs/theory.md."""
    found = swept(over, overrides=(*SMOOTH, one_stroke(8)))
    x, e = found.grid.axes[0].numbers, by_point(found.points, "controller_2")
    slopes = np.diff(np.log(e), axis=0) / np.diff(np.log(x), axis=0)
    # The plant's own answer to the error is of the order of 1/T. Common to all laws, ½ (λ + k) M_bar is 5 %
    # of joint 3's load, D_m, at the printed M_bar and 10 % at twice that.
    np.testing.assert_allclose(slopes, power, atol=0.11 if power < 0.0 else 0.06)


class TestRun:
    @pytest.mark.parametrize(("over", "place", "more"), [(ALPHA, 1, ()), (PERIOD, 2, ("solver.max_step=2",))])
    def test_point_is_the_single_run_bit_for_bit(self, over, place, more):
        found = swept(over)
        label = found.grid.points[place].label
        loaded = load_config("plain", "compare", overrides=(ONE, label, *more), controllers=(1, 2))
        loops = dict(build_loops(loaded.config, loaded.folder))
        alone = simulate_batch(list(loops.values()))
        rows = iter(found.rows[place * 2 * len(loops) :])
        for r, name in enumerate(loops):
            for k, joint in enumerate((2, 3)):
                row, sizes = next(rows), {size: alone.statistics[size][r, k] for size in sweep.IN_SI}
                for size, statistic in sweep.IN_DEGREES.items():
                    sizes[size] = np.rad2deg(alone.statistics[statistic][r, k])
                assert (row["run"], row["joint"]) == (name, joint)
                assert row["status"] == STATUSES[alone.status[r]]
                assert row["status_time_s"] == alone.status_time[r]
                assert {size: row[size] for size in sizes} == sizes

    def test_diverged_run_is_kept_and_marked(self):
        over = "manipulator.tendons.damping_factor=3,5"
        found = swept(over, controllers=(1,))
        lost = [row for row in found.rows if row["status"] == "diverged"]
        assert [(row["manipulator.tendons.damping_factor"], row["run"]) for row in lost] == [
            ("3", "controller_1_payload")
        ] * 2
        assert all(0.0 < row["status_time_s"] < 7.6 and np.isfinite(row["mae_deg"]) for row in lost)
        assert found.points[0]["status"] == ["controller_1_payload diverged"]
        crosses = [line for line in draw_sweep(found).axes["a"].lines if line.get_marker() == "x"]
        assert [line.get_xdata().tolist() for line in crosses] == [[], [3.0]]

    def test_ratio_is_of_the_errors_where_both_runs_lasted(self):
        found = swept("manipulator.tendons.damping_factor=1,5")
        assert found.points[0]["status"] != "ok"
        one, two, ratio = (by_point(found.points, name) for name in ("controller_1", "controller_2", "c1_c2"))
        np.testing.assert_array_equal(ratio, [[np.nan] * 2, one[1] / two[1]])

    def test_two_keys_make_every_pair(self):
        found, alone = swept(ALPHA, PERIOD), swept(ALPHA)
        names = ("mae_deg", "torque_rms", "controller_1")
        for name in names[:2]:
            pairs = by_point(found.rows, name, run="controller_1")
            np.testing.assert_array_equal(pairs[1::3], by_point(alone.rows, name, run="controller_1"))
        labels = [text.get_text() for text in draw_sweep(found).axes["c"].get_xticklabels()]
        assert labels[5] == "[0.1,0.2], 2"


class TestFiles:
    def test_results_are_complete(self, tmp_path):
        result = tr.sweep([ALPHA], "plain", set=[ONE], controllers=[1, 2], out=tmp_path)
        found, manifest = result.data, read_manifest(tmp_path)
        figures = {f"figures/sweep.{suffix}" for suffix in ("pdf", "png")}
        assert {"sweep.json", "tables/sweep.csv", "tables/points.md", *figures} <= set(manifest["outputs"])
        assert manifest["over"] == [ALPHA]
        assert manifest["config"]["sha256"] == found["config_sha256"]
        table = result.tables["sweep"]
        assert len(table) == 3 * 3 * 2
        stored = json.loads((tmp_path / "sweep.json").read_text())
        assert table["mae_deg"].tolist() == [row["mae_deg"] for row in stored["rows"]]

    def test_dry_run_checks_every_point_and_writes_nothing(self, tmp_path):
        words = ["sweep", "--config", "plain", "--dry-run", "--out", "none", "--over"]
        assert answer(*words, PERIOD, "--set", ONE, cwd=tmp_path)["dry_run"]
        assert not (tmp_path / "none").exists()
        steep = answer(*words, "reference.amplitude=[33,33],[150,33]", cwd=tmp_path, code=2)
        assert steep["error"]["where"].startswith("--over reference.amplitude=")
        # Standard input, too, is read once.
        text = load_config("plain", "compare").yaml_text
        done = run("sweep", "--config", "-", "--dry-run", "--over", PERIOD, cwd=tmp_path, stdin=text)
        assert done.returncode == 0


class TestValues:
    @pytest.mark.parametrize("over", ["", "a=1,2 b=1,2 c=1,2", "a=1,2 a=3,4", "sampling_period", "a=1"])
    def test_form_is_checked(self, over):
        with pytest.raises(UsageError):
            sweep.parse_over(over.split())

    def test_a_wrong_value_is_named_with_all_its_mistakes(self):
        over = ["control.gains.alpha=[0.1,0.2],[0,2]", "sampling_period=1,0.7"]
        with pytest.raises(ConfigError, match=r"0\.7 ms") as caught:
            sweep.load_grid(over)
        assert caught.value.where == "--over control.gains.alpha=[0.1,0.2] sampling_period=0.7"
        with pytest.raises(ConfigError, match=r"control\.gains\.alpha\.value\.1"):
            sweep.load_grid(over[:1])

    @pytest.mark.parametrize("key", ["sampling_period", "sampling_period.value"])
    def test_the_longest_step_follows_the_sampling_period_in_its_unit(self, key):
        step = f"solver.max_step={quantity(0.001, 's')}"
        grid = sweep.load_grid([f"{key}=0.5,1"], overrides=[step])
        assert grid.axes[0].unit == "ms"
        assert [point.loaded.config.solver.max_step.si for point in grid.points] == [0.0005, 0.001]

    def test_what_cannot_be_compared_is_refused(self):
        run = f"{{a: {{law: controller_1, payload: {quantity(0, 'kg')}}}}}"
        for over, given in (
            (f"runs={run},{run.replace('{a:', '{b:')}", {}),
            ("errors_from=0,1", {}),
            ("control.gains.lam=4,5", {"overrides": ["errors_from=1"]}),
            ("seed=1,2", {"seed": 3}),
            ("seed.value=1,2", {"seed": 3}),
        ):
            with pytest.raises(UsageError):
                sweep.load_grid([over], "plain", **given)
        assert len(sweep.load_grid(["seed=1,2"]).points) == 2

    def test_files_of_all_points_are_inputs(self, tmp_path):
        arms = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
        for arm in arms:
            arm.write_text(read_text(shipped_folder() / "lumidouce_ii.yaml"), encoding="utf-8")
        assert set(arms) <= {*sweep.load_grid([f"manipulator={arms[0]},{arms[1]}"]).base.inputs}

    def test_numbers_are_those_of_each_joint(self):
        for over, numbers in (
            ("control.gains.alpha=[0,0.5],[0.1,0.6]", [[0.0, 0.5], [0.1, 0.6]]),
            ("runs.controller_1.payload=0,0.2", [[0.0, 0.0], [0.2, 0.2]]),
            ("manipulator.winches.viscous=[1,2,3],[4,5,6]", [[2.0, 3.0], [5.0, 6.0]]),
            ("control.gains.alpha=[0,0],[0.1,0]", None),
            ("control.readings.weights=interpolating,'a,b'", None),
        ):
            (values,) = sweep.parse_over([over]).values()
            np.testing.assert_array_equal(sweep.numbers_per_joint(values, 2), numbers)


class TestFigures:
    def test_lines_show_the_numbers(self):
        found = swept(PERIOD)
        panels = draw_sweep(found).axes
        (line,) = (line for line in panels["b"].lines if line.get_label() == "Controller 2")
        np.testing.assert_array_equal(line.get_ydata(), by_point(found.points, "controller_2")[:, 1])
        np.testing.assert_array_equal(line.get_xdata(), [0.5, 1.0, 2.0])
        assert panels["d"].get_xlabel() == "sampling_period (ms)"
        shown = {line.get_label(): line.get_ydata() for line in panels["d"].lines}
        np.testing.assert_array_equal(shown["C1/C2"], by_point(found.points, "c1_c2")[:, 1])

    @pytest.mark.parametrize(
        ("numbers", "scale", "x"),
        [
            (None, "linear", [0.0, 1.0, 2.0]),
            ([1.0, 3.0, 2.0], "linear", [1.0, 2.0, 3.0]),
            ([0.1, 1.0, 10.0], "log", [0.1, 1.0, 10.0]),
        ],
    )
    def test_axis_of_the_values(self, numbers, scale, x):
        """Decades ask for a logarithmic axis, numbers stand in their order, and no line joins words."""
        found = swept(PERIOD)
        axis = replace(found.grid.axes[0], numbers=numbers and np.transpose([numbers, numbers]))
        panel = draw_sweep(replace(found, grid=replace(found.grid, axes=[axis]))).axes["a"]
        assert panel.get_xscale() == scale
        (line,) = (line for line in panel.lines if line.get_label() == "Controller 1")
        assert line.get_xdata().tolist() == x
        assert (line.get_linestyle() == "None") == (numbers is None)


@pytest.mark.parametrize(
    ("more", "unread"), [((), 1), (("control.readings.reference_acceleration=fed_forward,late",), 0)]
)
def test_a_key_that_no_point_reads_is_named(more, unread):
    found = sweep.load_grid(("control.reference_lag=10,20", *more), overrides=(ONE,))
    assert len(found.base.remarks) == unread
