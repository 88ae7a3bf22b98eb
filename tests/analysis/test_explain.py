"""What `explain` says: against reloaded configurations, the theory's numbers, plain eigenvalues, and time."""

import csv
import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.overrides import SMOOTH

import tendonrepro as tr
from tendonrepro.analysis.explain import explain, load_to_error, worst
from tendonrepro.analysis.figures import curves, draw_margins
from tendonrepro.analysis.margins import ChannelMargins
from tendonrepro.configuration.load import load_config
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import build_loops, run_views
from tendonrepro.files import to_json
from tendonrepro.physics.linear_loop import decay_rate, loop_matrix
from tendonrepro.physics.loads import sine_disturbance
from tendonrepro.simulation.loop import DesiredMotion
from tendonrepro.simulation.stepper import simulate

DELAY = "manipulator.actuator.output_delay=1"
APPLIED = "control.readings.stored_torque=applied"
DEGREES = "control.readings.gain_unit=law_in_degrees"
L = 1e-3  # s


@cache
def loaded(*overrides):
    return load_config("plain", "compare", overrides=overrides)


@cache
def found(*overrides):
    return explain(loaded(*overrides))


def drawn(*overrides):
    of = found(*overrides)
    return draw_margins(of.joints, of.views, of.margins, of.postures[1], of.origin).axes


def decay_of(view):
    return decay_rate(list(found().postures), view.plant, view.law, view.delay)


def test_radius_and_decay_are_those_of_the_loop():
    for run, view in found().views.items():
        matrices = [loop_matrix(q, view.plant, view.law, view.delay) for q in found().postures]
        radius = np.abs(np.linalg.eigvals(matrices)).max()
        assert found().modes[run]["spectral_radius"] == pytest.approx(radius, rel=1e-12)
        assert found().modes[run]["decay"] == pytest.approx(decay_of(view), rel=1e-9)


def test_the_print_stands_beside_the_ratios_of_the_paper_s_arm_alone():
    printed = {"c1_c2": [0.311 / 0.375, 0.261 / 0.292], "c2_c3": [0.375 / 0.436, 0.292 / 0.349]}
    assert found().printed == {pair: pytest.approx(ratios) for pair, ratios in printed.items()}
    assert found("manipulator.name=mine").printed == {}


def test_delay_leaves_plain_estimation_alternating():
    """docs/findings.md: at 500 Hz 0.13 1/s with Controller 2, and no such mode with Controller 1."""
    two, one = (found(DELAY, APPLIED).modes[run] for run in ("controller_2", "controller_1"))
    assert two["ringing_decay"] == pytest.approx(0.126, abs=5e-3)
    assert two["ringing_hz"] == pytest.approx(500.0)
    assert one["ringing_hz"] < 20.0
    assert one["decay"] == pytest.approx(2.01, abs=0.02)


def test_worst_takes_each_number_by_itself():
    a = ChannelMargins(True, 3.0, 10.0, 1.0, 4.0, 0.01, 50.0)
    b = ChannelMargins(True, 2.0, 12.0, 1.5, 5.0, 0.005, 40.0)
    none = ChannelMargins(True, np.nan, np.nan, 9.0, 9.0, 9.0, 60.0)
    assert worst([a, b, none]) == ChannelMargins(True, 2.0, 12.0, 1.0, 4.0, 0.005, 40.0)
    lost = worst([a, b._replace(stable=False)])
    assert not lost.stable
    assert np.isnan(lost.gain_margin)
    assert lost.loop_gain == 40.0


@pytest.mark.parametrize(
    ("change", "key", "ratio"),
    [
        ("control.readings.weights=extrapolating", "weights=extrapolating", [0.9, 0.8]),
        (DELAY, "output_delay=1", [1.1, 1.2]),
    ],
)
def test_a_change_is_what_the_changed_configuration_gives(change, key, ratio):
    what = found().changes[key]
    for run, view in run_views(loaded(change).config).items():
        assert what["decay"][run] == pytest.approx(decay_of(view), rel=1e-9)
    np.testing.assert_allclose(what["ratio"]["c1_c2"], ratio)


@pytest.mark.parametrize(
    ("overrides", "run", "multiples"),
    [
        ((), "controller_1", (2.444, 3.736)),
        ((), "controller_2", (2.489, 3.788)),
        ((), "controller_3", (2.490, 3.790)),
        (("control.readings.weights=extrapolating",), "controller_1", (2.493, 3.789)),
    ],
)
def test_border_of_tendon_damping(overrides, run, multiples):
    """docs/theory.md has the smallest multiples of the nominal damping, without payload and with it."""
    for payload, multiple in zip((0.0, 0.2), multiples, strict=True):
        for factor, stable in ((0.999, False), (1.001, True)):
            damping = f"manipulator.tendons.damping_factor={factor * multiple}"
            config = loaded(*overrides, f"runs.{run}.payload={payload}", damping).config
            assert (decay_of(run_views(config)[run]) > 0.0) == stable


@pytest.mark.parametrize("hertz", [2.0, 10.0, 40.0])
def test_a_sine_on_the_whole_arm_leaves_the_error_of_its_load(hertz):
    """A small load, so that the arm stays linear; after two seconds nothing is left of the start."""
    limit = "manipulator.actuator.torque_limit=[99, 99, 99]"
    held = loaded(*SMOOTH, limit)
    loop = dict(build_loops(held.config, held.folder))["controller_1"]
    still = np.zeros((4001, 2))
    reference = DesiredMotion(L * np.arange(len(still)), still, still, still)
    plant = loop.plant._replace(disturbance=sine_disturbance(np.array([0.0, 1e-4]), hertz))
    run = simulate(replace(loop, plant=plant, reference=reference))
    late = slice(2000, 4000)
    angle = 2.0 * np.pi * hertz * run["time"][late]
    amplitude = np.hypot(*(2.0 * np.mean(run["e"][late, 1] * wave(angle)) for wave in (np.sin, np.cos)))
    view = run_views(held.config)["controller_1"]
    expected = load_to_error(view, np.zeros(2), np.array([2.0 * np.pi * hertz * L]))
    assert amplitude / 1e-4 == pytest.approx(abs(expected[0, 1, 1]), rel=0.01)


def test_files_of_an_unstable_loop_have_no_margins(tmp_path):
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
    assert {"figures/explain_margins.pdf", "explain.json", "tables/explain.csv"} <= outputs.keys()


def test_what_cannot_be_explained_is_refused(tmp_path):
    with pytest.raises(TendonreproError, match="Singular"):
        tr.explain("plain", set=["manipulator.links.mass.value.2=1e17"], out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    with pytest.raises(UsageError, match="compare"):
        explain(load_config(None, "decouple"))


def test_figure_has_the_responses_and_their_gain_margins():
    panels = drawn()
    for k in range(2):
        (line,) = (line for line in panels[k].lines if line.get_label() == "Controller 2")
        hertz, channels = curves(found().views["controller_2"], found().postures[1])
        np.testing.assert_array_equal(line.get_xydata(), np.stack([hertz, np.abs(channels[k])], axis=1))
        places = [line.get_xdata()[0] for line in panels[k].lines if line.get_marker() == "o"]
        assert places == [margins[k].gain_margin_hz for margins in found().margins.values()]
        phases = [line.get_ydata() for line in panels[2 + k].lines if len(line.get_xdata()) > 2]
        assert all(-270.0 < phase[0] <= 90.0 for phase in phases)


def test_a_pole_on_the_unit_circle_leaves_the_other_curves_their_room():
    """With this delay the gain of plain estimation has no end at 500 Hz."""
    panel = drawn(DELAY, APPLIED)[0]
    assert panel.get_ylim()[1] < 1e5 < max(np.max(line.get_ydata()) for line in panel.lines)
