"""Figures show the numbers of the summary at their places."""

import numpy as np
from support.made_ensemble import DIVERGED, JOINTS, PLANTS, ensemble, random_errors, whole

from tendonrepro.monte_carlo.figures import draw_ratios, ensemble_figures
from tendonrepro.monte_carlo.report import population_summary
from tendonrepro.monte_carlo.shares import printed_ratios


def test_ratios_show_median_print_and_theory(mixed):
    summary = population_summary(mixed)
    drawn = draw_ratios("box", summary)
    assert [panel.get_title(loc="left") for panel in drawn.axes] == [
        f"{ratio}, joint {joint}" for ratio in ("C1/C2", "C2/C3") for joint in JOINTS
    ]
    for i, panel in enumerate(drawn.axes[:2]):
        held = {
            (float(x), float(y))
            for line in panel.lines
            for x, y in zip(np.atleast_1d(line.get_xdata()), np.atleast_1d(line.get_ydata()), strict=True)
        }
        for row, reading in enumerate(summary["readings"]):
            joint = f"joint_{JOINTS[i]}"
            assert (reading["ratio_c1_c2"]["all_ok"]["mae"][joint]["median"]["value"], row) in held
            assert (reading["theory"][joint], row) in held
        assert printed_ratios((0, 1), "mae", JOINTS)[i] in {x for x, _ in held}
    (legend,) = drawn.axes[0].figure.legends
    told = {text.get_text() for text in legend.get_texts()}
    assert told == {"central 90 %", "central 50 %", "median", "slow errors", "printed"}
    # The first reading is on top.
    low, high = drawn.axes[0].get_ylim()
    assert low > high


def test_figures_are_drawn_without_plants_too():
    data = ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8))
    drawn = {name: draw() for name, draw in ensemble_figures(whole(data)).items()}
    assert {drawing.stem for drawing in drawn.values()} == drawn.keys() == {"ratios_box"}
    drawn["ratios_box"].figure.draw_without_rendering()
