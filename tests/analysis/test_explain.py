"""What `explain` says: against reloaded configurations, the theory's numbers, plain eigenvalues, and time."""

import csv
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.overrides import SMOOTH

import tendonrepro as tr
from tendonrepro.analysis.explain import explain, first_views, load_to_error, loads, run_margins, worst
from tendonrepro.analysis.margins import ChannelMargins, border_distance, with_tendons
from tendonrepro.configuration.load import load_config
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import build_loops, run_views
from tendonrepro.files import to_json
from tendonrepro.physics.disturbance import sine_disturbance
from tendonrepro.physics.linear_loop import decay_rate, loop_matrix
from tendonrepro.simulation.loop import DesiredMotion
from tendonrepro.simulation.stepper import simulate

DELAY = "manipulator.actuator.output_delay=1"
APPLIED = "control.readings.stored_torque=applied"
DEGREES = "control.readings.gain_unit=law_in_degrees"


@cache
def loaded(*overrides, controllers=None):
    return load_config("plain", "compare", overrides=overrides, controllers=controllers)


@cache
def found(*overrides, controllers=None):
    return explain(loaded(*overrides, controllers=controllers))


class TestMargins:
    def test_radius_and_decay_are_those_of_the_loop(self):
        for view, held in zip(found().views.values(), found().margins.values(), strict=True):
            matrices = [loop_matrix(q, view.plant, view.law, view.delay) for q in found().postures]
            radius = np.abs(np.linalg.eigvals(matrices)).max()
            decay = decay_rate(list(found().postures), view.plant, view.law, view.delay)
            assert held.of_run["spectral_radius"] == pytest.approx(radius, rel=1e-12)
            assert held.of_run["decay"] == pytest.approx(decay, rel=1e-9)

    def test_delay_leaves_plain_estimation_alternating(self):
        """docs/findings.md: at 500 Hz 0.13 1/s with Controller 2, and no such mode with Controller 1."""
        views = run_views(loaded(DELAY, APPLIED).config)
        two, one = (
            run_margins(views[run], found().postures, 3.0).of_run for run in ("controller_2", "controller_1")
        )
        assert two["ringing_decay"] == pytest.approx(0.126, abs=5e-3)
        assert two["ringing_hz"] == pytest.approx(500.0)
        assert one["ringing_hz"] < 20.0
        assert one["decay"] == pytest.approx(2.01, abs=0.02)

    def test_worst_takes_each_number_by_itself(self):
        a = ChannelMargins(True, 3.0, 10.0, 0.2, 1.0, 1.0, 4.0, 0.01, 50.0)
        b = ChannelMargins(True, 2.0, 12.0, np.nan, np.nan, 1.5, 5.0, 0.005, 40.0)
        assert worst([a, b]) == ChannelMargins(True, 2.0, 12.0, 0.2, 1.0, 1.0, 4.0, 0.005, 40.0)
        lost = worst([a, b._replace(stable=False)])
        assert not lost.stable
        assert np.isnan(lost.gain_margin)
        assert lost.loop_gain == 40.0


class TestWhatIf:
    @pytest.mark.parametrize(
        ("change", "key", "ratio"),
        [
            ("control.readings.weights=extrapolating", "weights=extrapolating", [0.9, 0.8]),
            (DELAY, "output_delay=1", [1.1, 1.2]),
        ],
    )
    def test_is_what_the_changed_configuration_gives(self, change, key, ratio):
        what = found().what_if[key]
        for run, view in run_views(loaded(change).config).items():
            decay = decay_rate(list(found().postures), view.plant, view.law, view.delay)
            assert what["decay"][run] == pytest.approx(decay, rel=1e-9)
        np.testing.assert_allclose(what["ratio"]["c1_c2"], ratio)


class TestMap:
    def test_border_of_tendon_damping(self):
        """docs/theory.md has the smallest multiples of the nominal damping; shipped is five times that."""
        borders = found().borders
        middle = borders.factors.size // 2
        assert borders.factors[middle] == pytest.approx(1.0)
        known = {"controller_1": 2.444, "controller_2": 2.489, "controller_1_payload": 3.736}
        for run, multiple in known.items():
            column = borders.distance[run][:, middle]
            at = np.exp(np.interp(0.0, column, np.log(borders.factors)))
            assert at == pytest.approx(0.2 * multiple, rel=2e-3)
            view = found().views[run]
            for factor, stable in ((0.99 * at, False), (1.01 * at, True)):
                plant = with_tendons(view.plant, 1.0, factor)
                assert (decay_rate(list(found().postures), plant, view.law) > 0.0) == stable

    def test_distance_of_a_known_border_and_of_none(self):
        x, y = np.geomspace(0.1, 10.0, 5), np.geomspace(0.1, 10.0, 9)
        distance = border_distance(lambda a, b: np.log(b) - 0.3 * np.log(a), x, y)
        wanted = np.log(y)[:, np.newaxis] - 0.3 * np.log(x)
        np.testing.assert_allclose(distance, wanted, atol=1e-3)
        np.testing.assert_allclose(border_distance(lambda a, _: np.ones_like(a), x, x), np.log(100.0))


class TestLoads:
    """The limit of slow loads, and a sine on the whole arm in time."""

    L = 1e-3  # s

    @staticmethod
    @cache
    def smooth():
        limit = "manipulator.actuator.torque_limit=[99, 99, 99]"
        held = load_config("plain", "compare", overrides=(*SMOOTH, limit))
        return held, first_views(run_views(held.config))

    def test_of_slow_loads_the_ratio_is_that_of_the_ages_and_slopes(self):
        moving = np.stack([np.sin(np.pi * self.L * np.arange(8000))] * 2, axis=1)
        found = loads(self.smooth()[1], np.zeros(2), moving)
        one, two, three = (found.error[f"controller_{k}"][:, 0] for k in (1, 2, 3))
        assert one / two == pytest.approx([1.1, 1.2], rel=1e-3)
        # lambda beta over lambda eta gamma_1, with gamma_1 = (2 - b) Delta^(b - 1).
        assert two / three == pytest.approx(2.0 / (1.5 * 1.1 * 0.2**-0.1), rel=1e-3)
        assert found.motion_hz == pytest.approx(0.5, abs=0.2)
        assert 5.0 < found.mode_hz < 20.0

    @pytest.mark.parametrize("hertz", [2.0, 10.0, 40.0])
    def test_a_sine_on_the_whole_arm_leaves_that_error(self, hertz):
        """A small load, so that the arm stays linear; after two seconds nothing is left of the start."""
        held, views = self.smooth()
        loop = dict(build_loops(held.config, held.folder))["controller_1"]
        still = np.zeros((4001, 2))
        reference = DesiredMotion(self.L * np.arange(len(still)), still, still, still)
        plant = loop.plant._replace(disturbance=sine_disturbance(np.array([0.0, 1e-4]), hertz))
        run = simulate(replace(loop, plant=plant, reference=reference))
        late = slice(2000, 4000)
        angle = 2.0 * np.pi * hertz * run["time"][late]
        amplitude = np.hypot(*(2.0 * np.mean(run["e"][late, 1] * wave(angle)) for wave in (np.sin, np.cos)))
        expected = load_to_error(views["controller_1"], np.zeros(2), np.array([2.0 * np.pi * hertz * self.L]))
        assert amplitude / 1e-4 == pytest.approx(abs(expected[0, 1, 1]), rel=0.01)

    def test_a_loop_that_grows_has_no_error_per_load(self):
        view = self.smooth()[1]["controller_1"]
        growing = view._replace(law=view.law._replace(M_bar=30.0 * view.law.M_bar))
        assert load_to_error(growing, np.zeros(2), np.array([0.1])) is None


class TestFiles:
    def test_an_unstable_loop_has_no_margins(self, tmp_path):
        data = tr.explain("plain", set=[DEGREES], controllers=[2], out=tmp_path).data
        stored = json.loads(to_json(data))
        assert stored["gain_margin"] == {"controller_2": [None, None]}
        assert stored["spectral_radius"]["controller_2"] > 1.0
        assert stored["predicted_ratio_holds"] is False
        assert stored["predicted_ratio"] == {"c1_c2": None, "c2_c3": None}
        rows = list(csv.DictReader((tmp_path / "tables/explain.csv").read_text().splitlines()))
        assert [row["joint"] for row in rows] == ["2", "3"]
        assert rows[0]["gain_margin"] == ""
        assert float(rows[0]["spectral_radius"]) == data["spectral_radius"]["controller_2"]
        outputs = json.loads((tmp_path / "manifest.json").read_text())["outputs"]
        assert {"figures/explain_map.pdf", "explain.json", "tables/explain.csv"} <= outputs.keys()

    @pytest.mark.slow
    def test_a_motion_at_rest_has_no_bandwidth(self):
        rest = explain(loaded("reference.amplitude=0"))
        assert rest.loads.motion_hz == 0.0

    def test_an_arm_that_numbers_cannot_hold_is_told_in_a_sentence(self, tmp_path):
        heavy = ["manipulator.links.mass.value.2=1e17"]
        with pytest.raises(TendonreproError, match="Singular"):
            tr.explain("plain", set=heavy, out=tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_decoupling_has_no_controllers(self):
        with pytest.raises(UsageError, match="compare"):
            explain(load_config(None, "decouple"))
