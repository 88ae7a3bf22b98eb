"""The pictures of `explain`, by their artists."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from matplotlib.colors import to_hex

from tendonrepro.analysis.explain import explain
from tendonrepro.analysis.figures import draw_loads, draw_map, draw_margins
from tendonrepro.configuration.load import load_config
from tendonrepro.results.figures.style import journal_style, stroke_of, strokes_of


@cache
def found():
    delayed = "manipulator.actuator.output_delay=1", "control.readings.stored_torque=applied"
    return explain(load_config("plain", "compare", overrides=delayed, controllers=(1, 2)))


@cache
def drawn(draw):
    with journal_style():
        figure = draw(found())
        figure.draw_without_rendering()
    return figure


class TestMargins:
    def test_curves_are_the_responses(self):
        axes = drawn(draw_margins).axes
        for k, joint in enumerate((2, 3)):
            assert axes[k].get_title("left") == f"({'ab'[k]}) Joint {joint}, gain"
            line = next(line for line in axes[k].lines if line.get_label() == "controller_2")
            np.testing.assert_array_equal(line.get_ydata(), np.abs(found().curves["controller_2"][1][k]))
            assert line.get_color() == stroke_of(2).colour

    def test_circles_lie_where_the_phase_crosses(self):
        axes = drawn(draw_margins).axes[0]
        places = sorted(line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o")
        wanted = sorted(held.joints[0].gain_margin_hz for held in found().margins.values())
        np.testing.assert_allclose(places, wanted)


def test_loads_have_a_curve_for_each_pair_on_each_joint():
    held = found().loads
    for k, axes in enumerate(drawn(draw_loads).axes):
        (curve,) = (line for line in axes.lines if len(line.get_xdata()) == held.hertz.size)
        expected = held.error["controller_1"][k] / held.error["controller_2"][k]
        np.testing.assert_allclose(curve.get_ydata(), expected)


def test_labels_of_six_joints_stay_apart():
    held, n = found(), 6
    error = {law: np.repeat(size[:1], n, axis=0) for law, size in held.loads.error.items()}
    many = replace(held, joints=tuple(range(1, n + 1)), loads=replace(held.loads, error=error))
    with journal_style():
        figure = draw_loads(many)
        figure.draw_without_rendering()
    labels = [axes.xaxis.label.get_window_extent() for axes in figure.axes]
    assert all(left.x1 < right.x0 for left, right in pairwise(labels))


def test_a_phase_near_a_half_turn_does_not_leave_the_panel():
    held = found()
    hertz, channels = held.curves["controller_2"]
    start = np.exp(1j * (np.deg2rad(170.0) - np.angle(-channels[:, :1])))
    turned = replace(held, curves={"controller_2": (hertz, channels * start)})
    with journal_style():
        axes = draw_margins(turned).axes[2]
    phase = axes.lines[-1].get_ydata()
    np.testing.assert_allclose(phase[0], -190.0)


def test_a_controller_alone_has_the_stroke_that_it_has_beside_others():
    alone = replace(found(), curves={"controller_2": found().curves["controller_2"]})
    with journal_style():
        (curve,) = (line for line in draw_margins(alone).axes[0].lines if line.get_label() == "controller_2")
    assert curve.get_color() == stroke_of(2).colour


class TestMap:
    def test_borders_are_drawn_in_their_strokes(self):
        axes = drawn(draw_map).axes[0]
        colours = {
            to_hex(collection.get_edgecolor()[0]).upper()
            for collection in axes.collections
            if len(collection.get_edgecolor())
        }
        runs = found().borders.distance
        assert {strokes_of(runs)[run].colour.upper() for run in runs} <= colours

    def test_nothing_stable(self):
        overrides = ("control.readings.torque_coordinates=motor_shaft",)
        lost = explain(load_config("plain", "compare", overrides=overrides, controllers=(2,)))
        with journal_style():
            draw_map(lost).draw_without_rendering()
