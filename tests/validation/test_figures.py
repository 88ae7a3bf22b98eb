"""Overlays show what was measured, below what was simulated, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support.measured_synthetic import CONTROLLERS, measured_trace
from support.synthetic import make_compare_file, make_decouple_file

from tendonrepro.results.figures.catalogue import FIGURES, draw
from tendonrepro.validation.report import draw_overlay, overlays

NAMES = [name for name in FIGURES if name != "fig06" and not name.startswith("joint_")]
"""None measured Figure 6, or joints beyond the third."""


@pytest.fixture(scope="module", name="file")
def _file():
    compare = make_compare_file(step=0.05, source="measured")
    decouple = make_decouple_file(step=0.05, source="measured")
    runs = {name: measured_trace(trace) for name, trace in {**compare.runs, **decouple.runs}.items()}
    return replace(compare, experiment="both", runs=runs)


def models(file):
    """Simulations of all runs, a little larger than these."""
    return {
        name: replace(trace, variables={key: 1.1 * values for key, values in trace.variables.items()})
        for name, trace in file.runs.items()
    }


@pytest.mark.parametrize("number", NAMES)
def test_panels_are_the_papers_and_no_curve_hides_the_other(number, file):
    assert overlays(file) == NAMES
    drawn = draw_overlay(number, file, models(file))
    plain = draw(number, file)
    assert set(drawn.axes) == set(plain.axes)
    for letter, axes in drawn.axes.items():
        assert axes.get_title(loc="left") == plain.axes[letter].get_title(loc="left")
        assert axes.get_ylabel() == plain.axes[letter].get_ylabel()
    over = {key: line for key, line in drawn.lines.items() if key[1].endswith(" simulated")}
    wanted = {(letter, f"{name} simulated") for letter, name in plain.lines if "esired" not in name}
    assert set(over) == wanted
    for (letter, name), line in over.items():
        below = drawn.lines[letter, name.removesuffix(" simulated")]
        assert below.get_linestyle() == "-" != line.get_linestyle()
        assert below.get_zorder() < line.get_zorder()
        assert below.get_linewidth() > 2.0 * line.get_linewidth()
        assert sum(to_rgb(below.get_color())) > sum(to_rgb(line.get_color()))
    assert drawn.figure.get_supxlabel() == "Measured, and simulated on the measured motion"
    assert "Thin, dashed: simulated" in [text.get_text() for text in drawn.figure.legends[0].get_texts()]


@pytest.mark.parametrize("number", ["fig14", "fig15"])
def test_a_joint_that_the_model_has_not_moves_no_curve_to_another(number, file):
    """Joint 1 was recorded while it was held; the model has joints 2 and 3."""

    def with_joint_1(trace):
        wider = {key: np.pad(values, ((0, 0), (1, 0))) for key, values in trace.variables.items()}
        return replace(trace, joint=(1, *trace.joint), variables=wider)

    runs = {name: with_joint_1(trace) for name, trace in file.runs.items() if name in CONTROLLERS}
    wide = replace(file, experiment="compare", runs=runs)
    drawn = draw_overlay(number, wide, models(file))
    over = [(letter, name) for letter, name in drawn.lines if name.endswith("simulated")]
    assert {drawn.axes[letter].get_title(loc="left")[4:11] for letter, _ in over} == {"Joint 2", "Joint 3"}
    for letter, name in over:
        below = np.asarray(drawn.lines[letter, name.removesuffix(" simulated")].get_ydata(), float)
        above = np.asarray(drawn.lines[letter, name].get_ydata(), float)
        assert above.max() == pytest.approx(1.1 * below.max(), rel=0.02)


def test_a_simulation_is_claimed_where_it_is_drawn(file):
    gone = make_compare_file(step=0.02, diverged={"controller_1": 5.0}).runs["controller_1"]
    alone = replace(file, runs={gone.name: file.runs[gone.name]})
    assert "controller_1 (diverged at 5.00 s)" in draw_overlay("fig14", alone, {gone.name: gone}).caption
    elsewhere = draw_overlay("fig10", file, {gone.name: gone})
    assert "diverged" not in elsewhere.caption
    assert elsewhere.figure.get_supxlabel() == "Measured"


def test_what_was_not_recorded_is_said_and_its_simulation_left_out(file):
    bare = {}
    for name in CONTROLLERS:
        kept = {key: value for key, value in file.runs[name].variables.items() if key != "H_hat"}
        bare[name] = replace(file.runs[name], variables=kept)
    drawn = draw_overlay("fig15", replace(file, runs=bare), {n: file.runs[n] for n in bare})
    assert not [name for letter, name in drawn.lines if letter in "cd"]
    assert drawn.axes["c"].texts[0].get_text() == "not recorded"
