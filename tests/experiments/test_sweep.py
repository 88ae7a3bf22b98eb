"""Sweeps: against the theory, single runs, and what the command line was asked for."""

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.overrides import SMOOTH, one_stroke, quantity

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.errors import ConfigError, UsageError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.sweep.command import load_sweep, run_sweep, simulate_sweep
from tendonrepro.experiments.sweep.figures import draw_lines, draw_map
from tendonrepro.experiments.sweep.points import parse_over, split_values, unit_of
from tendonrepro.experiments.sweep.report import COLUMNS, point_rows, table_rows
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.store import read_manifest
from tendonrepro.simulation.batch import simulate_batch

ALPHA = "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"
PERIOD = "sampling_period=0.5,1,2"
ONE = "reference.periods=1"
UNSTABLE = "manipulator.tendons.damping_factor=3,5"


SLOW = (*SMOOTH, one_stroke(8))
QUIET = Talk(quiet=True)


@cache
def swept(*over, overrides=(ONE,), controllers=(1, 2)):
    return simulate_sweep(load_sweep(Request(overrides=overrides, controllers=controllers), over), QUIET)


def ratios(data, pair="c1_c2"):
    return np.array([point["ratio"][pair] for point in data["points"]])


def mae(data, run):
    return np.array([point["runs"][run]["mae_deg"] for point in data["points"]])


class TestTheory:
    """Errors of a slowly changing load: e = w L dH / (M_bar lam k), docs/theory.md."""

    def test_alpha_makes_the_error_larger_by_one_plus_alpha(self):
        data = swept(ALPHA, overrides=SLOW)
        w = 1.0 + np.array(data["keys"][0]["numbers"])
        # As tests/analysis/test_small_signal.py: of first order in 1/T, and 6 % of w - 1, common to both.
        np.testing.assert_array_less(np.abs(ratios(data) - w), 0.025 / 8.0 + 0.06 * (w - 1.0) + 1e-12)
        assert np.all(ratios(data)[0] == 1.0)
        np.testing.assert_allclose([p["predicted_ratio"]["c1_c2"] for p in data["points"]], w, rtol=1e-12)

    @pytest.mark.parametrize(
        ("over", "power"), [(PERIOD, 1.0), ("control.gains.M_bar=[0.01,0.01],[0.02,0.02]", -1.0)]
    )
    def test_error_goes_with_L_over_M_bar(self, over, power):
        data = swept(over, overrides=SLOW)
        x, e = np.array(data["keys"][0]["numbers"]), mae(data, "controller_2")
        slopes = np.diff(np.log(e), axis=0) / np.diff(np.log(x), axis=0)
        # The plant's own answer to the error is of the order of 1/T. Common to all laws, ½ (λ + k) M_bar
        # is 5 % of joint 3's load, D_m, at the printed M_bar and 10 % at twice that.
        np.testing.assert_allclose(slopes, power, atol=0.11 if power < 0.0 else 0.06)


class TestRun:
    @pytest.mark.parametrize(("over", "place"), [(ALPHA, 1), (PERIOD, 0), (PERIOD, 2)])
    def test_point_is_the_single_run_bit_for_bit(self, over, place):
        """A mixed batch must not change a point, whatever the others' sampling periods."""
        data = swept(over)
        point = data["points"][place]
        step = (f"solver.max_step={data['keys'][0]['texts'][place]}",) if over == PERIOD else ()
        loaded = load_config(None, "compare", overrides=(ONE, point["label"], *step), controllers=(1, 2))
        loops = dict(build_loops(loaded.config, loaded.folder))
        alone = simulate_batch(list(loops.values()), loaded.config.status)
        for k, run in enumerate(loops):
            found = point["runs"][run]
            assert found["status"] == STATUSES[alone.status[k]]
            assert found["status_time_s"] == alone.status_time[k]
            for name, (statistic, _, factor) in COLUMNS.items():
                np.testing.assert_array_equal(found[name], factor * alone.statistics[statistic][k])

    def test_diverged_run_is_kept_and_marked(self):
        data = swept(UNSTABLE, controllers=(1,))
        name = "manipulator.tendons.damping_factor=3 controller_1_payload"
        assert data["diverged"] == [name]
        assert data["status"][name] == "diverged"
        ended = data["points"][0]["runs"]["controller_1_payload"]
        assert 0.0 < ended["status_time_s"] < 7.6
        assert np.isfinite(ended["mae_deg"]).all()
        assert next(point_rows(data))["status"] == ["C1 payload diverged"]
        assert {row["status"] for row in table_rows(data)} == {"ok", "diverged"}
        panel = draw_lines(data).axes[0]
        (cross,) = (line for line in panel.lines if line.get_marker() == "x" and len(line.get_xdata()))
        assert cross.get_xdata().tolist() == [3.0]
        (line,) = (line for line in panel.lines if line.get_label() == "Controller 1 payload")
        lasted = data["points"][1]["runs"]["controller_1_payload"]["mae_deg"][0]
        np.testing.assert_array_equal(line.get_ydata(), [np.nan, lasted])

    def test_two_keys_make_every_pair(self):
        data = swept(ALPHA, PERIOD)
        assert [tuple(point["places"]) for point in data["points"]] == [
            (i, j) for i in range(3) for j in range(3)
        ]
        alone = swept(ALPHA)
        for i in range(3):
            assert data["points"][3 * i + 1]["runs"] == alone["points"][i]["runs"]
        panels = draw_map(data).axes
        assert [panel.get_title() for panel in panels] == [
            "(a) Ratio of MAE C1/C2, joint 2", "(b) Ratio of MAE C1/C2, joint 3",
        ]  # fmt: skip
        written = [text.get_text() for text in panels[1].texts]
        assert written == [f"{point['ratio']['c1_c2'][1]:.2f}" for point in data["points"]]


class TestOwnLaw:
    def test_the_packages_own_law_as_a_foreign_one_comes_to_the_same(self, tmp_path):
        """SciPy and a trace against the batch and its sums, in every number that a sweep shows."""
        file = tmp_path / "own.py"
        file.write_text("from tendonrepro.physics.control import command as mine\n")
        # A limit that is reached, in a motion that rests at its ends.
        limits = (*SMOOTH, ONE, "reference.hold=0.1", "reference.rise=0.4")
        limits += ("manipulator.actuator.torque_limit=[20, 8, 3]",)
        request = Request(overrides=limits, controllers=(1, 2))
        sweep = load_sweep(request, ["control.gains.alpha=[0,0],[0.1,0.2]"], [f"{file}:mine"])
        data = simulate_sweep(sweep, QUIET)
        assert data["runs"] == [*sweep.points[0].config.runs, "mine", "mine_payload"]
        for point in data["points"]:
            ours, theirs = (point["runs"][name] for name in ("controller_1", "mine"))
            assert theirs["status"] == ours["status"]
            for name in COLUMNS:
                # The acceleration in epsilon feels the batch's wider steps most; its spectrum is of blocks.
                rtol, atol = {"epsilon_rms": (5e-3, 0.0), "fast_share": (0.0, 1e-3)}.get(name, (1e-5, 1e-9))
                np.testing.assert_allclose(theirs[name], ours[name], rtol, atol, err_msg=name)
        assert np.all(np.array(ours["overshoot_deg"]) > 0.0)
        assert 0.0 < max(ours["saturated"]) < 1.0
        assert load_sweep(request, [ALPHA]).base.sha256 != sweep.base.sha256


class TestFiles:
    def test_results_are_complete(self, tmp_path):
        found = run_sweep(Request(None, tmp_path, [ONE], controllers=[1, 2]), [ALPHA], QUIET)
        manifest = read_manifest(tmp_path)
        figures = {f"figures/sweep.{suffix}" for suffix in ("pdf", "svg", "png")}
        assert {"sweep.json", "tables/sweep.csv", "tables/points.md", *figures} <= set(manifest["outputs"])
        assert manifest["command"] == "sweep"
        assert manifest["over"] == [ALPHA]
        assert manifest["config"]["sha256"] == found["config_sha256"]
        with (tmp_path / "tables" / "sweep.csv").open(newline="") as stream:
            table = list(csv.DictReader(stream))
        assert len(table) == 3 * 3 * 2
        assert table[2]["control.gains.alpha"] == "[0,0]"
        assert float(table[2]["mae_deg"]) == found["points"][0]["runs"]["controller_2"]["mae_deg"][0]
        stored = json.loads((tmp_path / "sweep.json").read_text())
        assert stored["points"][1]["values"] == {"control.gains.alpha": [0.1, 0.2]}
        assert "| [0.3,0.4] | controller_1 | 3 | ok |" in (tmp_path / "tables" / "sweep.md").read_text()

    def test_other_results_are_refused(self, tmp_path):
        (tmp_path / "manifest.json").write_text(
            '{"config": {"sha256": "0"}, "tendonrepro_version": "0", "outputs": {}}'
        )
        with pytest.raises(UsageError, match="another configuration"):
            run_sweep(Request(None, tmp_path, [ONE], controllers=[1]), [ALPHA], QUIET)
        for force in (False, True):
            tried = Request(None, tmp_path, [ONE], controllers=[1], dry_run=True, force=force)
            assert run_sweep(tried, [ALPHA], QUIET)["dry_run"]

    def test_dry_run_writes_nothing(self, tmp_path):
        out = tmp_path / "none"
        found = run_sweep(Request(None, out, [ONE], controllers=[1], dry_run=True), [PERIOD], QUIET)
        assert not out.exists()
        assert found["samples"] == {
            "sampling_period=0.5": 15201, "sampling_period=1": 7601, "sampling_period=2": 3801,
        }  # fmt: skip

    def test_identity_is_that_of_values_and_configuration(self):
        digests = {
            load_sweep(Request(overrides=overrides), over).base.sha256
            for over in ([ALPHA], [PERIOD], [ALPHA, PERIOD])
            for overrides in ((), (ONE,))
        }
        assert len(digests) == 6
        assert load_sweep(Request(), [ALPHA]).base.sha256 in digests

    def test_standard_input_is_read_once(self, monkeypatch, tmp_path):
        text = load_config(None, "compare").yaml_text
        path = tmp_path / "given.yaml"
        path.write_text(text)
        with path.open() as stream:
            monkeypatch.setattr("sys.stdin", stream)
            assert len(load_sweep(Request("-"), [ALPHA]).points) == 3


class TestValues:
    @pytest.mark.parametrize(
        ("text", "values"),
        [
            ("a,b", ["a", "b"]),
            ("[0,0], [0.1,0.2]", ["[0,0]", "[0.1,0.2]"]),
            ("{value: [1, 2], unit: s},3", ["{value: [1, 2], unit: s}", "3"]),
            ("'a,b',\"c,d\"", ["'a,b'", '"c,d"']),
            ("[1,2", ["[1,2"]),
            ("1,", ["1", ""]),
        ],
    )
    def test_commas_inside_brackets_and_quotes_do_not_split(self, text, values):
        assert split_values(text) == values

    @pytest.mark.parametrize(
        ("over", "words"),
        [
            ([], "one or two keys, not 0"),
            (["a=1,2", "b=1,2", "c=1,2"], "not 3"),
            (["sampling_period"], "not of the form"),
            (["=1,2"], "not of the form"),
            (["a..b=1,2"], "not of the form"),
            (["a=1,,2"], "not of the form"),
            (["a=1"], "at least two values"),
            (["a=1,2,1"], "the value 1 is given twice"),
            (["a=1,2", "a=3,4"], "a is given twice"),
            (["seed=1,2"], "also set by"),
        ],
    )
    def test_form_is_checked(self, over, words):
        with pytest.raises(UsageError, match=words):
            parse_over(over, taken=("seed",))

    def test_value_that_is_no_yaml_is_named(self):
        with pytest.raises(ConfigError) as caught:
            parse_over(["sampling_period=1,[2"])
        assert caught.value.where.startswith("--over sampling_period=[2:")

    def test_every_wrong_value_is_named_once(self):
        over = ["control.gains.alpha=[0,2],[0.1,0.2],[0,0,0]", "sampling_period=0.7,1"]
        with pytest.raises(ConfigError) as caught:
            load_sweep(Request(), over)
        assert caught.value.message.splitlines() == [
            "3 mistakes in the values",
            "--over control.gains.alpha=[0,2]: control.gains.alpha.value.1: "
            "must be at least 0 and at most 1, found 2",
            "--over sampling_period=0.7: reference: lasts 15.2 s, which must be a multiple of the "
            "sampling period, 0.7 ms",
            "--over control.gains.alpha=[0,0,0]: control.gains.alpha.value: "
            "must have 2 entries, one per moving joint, found 3",
        ]

    def test_step_that_follows_the_period_is_not_blamed(self):
        with pytest.raises(ConfigError) as caught:
            load_sweep(Request(), ["sampling_period=-1,1"])
        assert caught.value.message.splitlines() == [
            "1 mistake in the values",
            "--over sampling_period=-1: sampling_period.value: must be above 0 ms, found -1",
        ]
        with pytest.raises(ConfigError, match=r"max_step\.value: must divide the sampling period"):
            load_sweep(Request(), ["sampling_period=1,2", "solver.max_step=1,1.5"])

    def test_points_with_other_runs_and_keys_set_already_are_refused(self):
        with pytest.raises(UsageError, match="also set by --set"):
            load_sweep(Request(overrides=["sampling_period=1"]), [PERIOD])
        run = f"{{a: {{law: controller_1, payload: {quantity(0, 'kg')}}}}}"
        other = run.replace("{a:", "{b:")
        with pytest.raises(UsageError, match="the same runs"):
            load_sweep(Request(), [f"runs={run},{other}"])

    def test_numbers_are_those_of_each_joint(self):
        for over, numbers in (
            ("control.gains.alpha=[0,0.5],[0.1,0.6]", [[0.0, 0.5], [0.1, 0.6]]),
            ("runs.controller_1.payload=0,0.2", [[0.0, 0.0], [0.2, 0.2]]),
            ("manipulator.winches.viscous=[1,2,3],[4,5,6]", [[2.0, 3.0], [5.0, 6.0]]),
            ("control.gains.alpha=[0,0],[0.1,0]", None),
            ("control.readings.weights=interpolating,extrapolating", None),
        ):
            found = run_sweep(Request(out=Path("no such folder"), dry_run=True), [over], QUIET)
            assert found["keys"][0]["numbers"] == numbers

    def test_units(self):
        tree = load_config(None, "compare").tree
        assert unit_of("sampling_period", tree) == "ms"
        assert unit_of("control.gains.M_bar.value.0", tree) == "kg m2"
        assert unit_of("control.readings.weights", tree) is None


class TestFigures:
    def test_lines_show_the_numbers(self):
        data = swept(PERIOD)
        panels = draw_lines(data).axes
        (line,) = (line for line in panels[1].lines if line.get_label() == "Controller 2")
        np.testing.assert_array_equal(line.get_ydata(), mae(data, "controller_2")[:, 1])
        np.testing.assert_array_equal(line.get_xdata(), [0.5, 1.0, 2.0])
        assert panels[3].get_xlabel() == "sampling_period (ms)"
        shown = {line.get_label(): line.get_ydata() for line in panels[3].lines}
        np.testing.assert_array_equal(shown["C1/C2"], ratios(data)[:, 1])
        predicted = [point["predicted_ratio"]["c1_c2"][1] for point in data["points"]]
        np.testing.assert_array_equal(shown["C1/C2, slow load"], predicted)

    @pytest.mark.parametrize(
        ("numbers", "scale", "x"),
        [
            (None, "linear", [0.0, 1.0, 2.0]),
            ([[1.0, 1.0], [3.0, 3.0], [2.0, 2.0]], "linear", [1.0, 2.0, 3.0]),
            ([[0.1, 0.1], [1.0, 1.0], [10.0, 10.0]], "log", [0.1, 1.0, 10.0]),
        ],
        ids=["words", "numbers", "decades"],
    )
    def test_axis_of_the_values(self, numbers, scale, x):
        """Decades ask for a logarithmic axis, numbers stand in their order, and no line joins words."""
        data = json.loads(json.dumps(swept(PERIOD)))
        data["keys"][0]["numbers"] = numbers
        panels = draw_lines(data).axes
        assert panels[0].get_xscale() == scale
        (line,) = (line for line in panels[0].lines if line.get_label() == "Controller 1")
        assert line.get_xdata().tolist() == x
        assert (line.get_linestyle() == "None") == (numbers is None)
        labels = [text.get_text() for text in panels[2].get_xticklabels()]
        assert labels == (["0.5", "1", "2"] if numbers is None else [f"{value:g}" for value in x])

    def test_ringing_run_has_an_open_marker(self):
        data = json.loads(json.dumps(swept(PERIOD)))
        data["points"][1]["runs"]["controller_1"]["status"] = data["status"]["x"] = "ringing"
        figure = draw_lines(data)
        drawn = (line for line in figure.axes[0].lines if len(line.get_xdata()))
        (dots,) = (line for line in drawn if line.get_markerfacecolor() == "white")
        assert dots.get_xdata().tolist() == [1.0]
        assert figure.legends[0].get_texts()[-1].get_text() == "ringing"

    def test_map_of_one_controller_has_its_errors_and_says_what_diverged(self):
        data = swept(UNSTABLE, "control.gains.alpha=[0.1,0.2],[0.1,0.3]", controllers=(1,))
        panels = draw_map(data).axes
        assert [panel.get_title().partition(",")[0] for panel in panels] == [
            "(a) Controller 1", "(b) Controller 1", "(c) Controller 1 payload", "(d) Controller 1 payload",
        ]  # fmt: skip
        for k, panel in enumerate(panels):
            run = ("controller_1", "controller_1_payload")[k // 2]
            found = [point["runs"][run] for point in data["points"]]
            assert [text.get_text() for text in panel.texts] == [
                "×" if one["status"] == "diverged"
                else f"{one['mae_deg'][k % 2]:#.3g}" + "~" * (one["status"] == "ringing")
                for one in found
            ]  # fmt: skip
        assert data["diverged"]
