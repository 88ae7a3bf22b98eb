"""Figures of what decides a verdict."""

import numpy as np
import pytest
from support.made_claims import NAMES, ranking_of

from tendonrepro.verdicts.figures import draw_ratio_against_unknowns, draw_tornado, running_median


class TestFigures:
    def test_bars_below_the_floor_are_grey(self, draws):
        ranking = ranking_of(draws, 3.0 * draws[:, 0] + draws[:, 2])
        axes = draw_tornado("C2", ranking).axes[0]
        bars = axes.patches
        assert [round(bar.get_width(), 6) for bar in bars] == [
            round(row["index"], 6) for row in ranking["rows"]
        ]
        colours = [bar.get_facecolor() for bar in bars]
        assert colours[0] == colours[1] != colours[2] == colours[3]
        assert [label.get_text() for label in axes.get_yticklabels()][:2] == ["a", "c"]

    def test_ratio_and_its_line(self, draws):
        ratio = 1.0 + 0.2 * draws[:, 0]
        figure = draw_ratio_against_unknowns(NAMES, draws, ratio, 1.1, "C1/C2", log=(True,) * 4)
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert [axes.get_xlabel() for axes in shown] == list(NAMES)
        assert all(axes.get_xscale() == "log" for axes in shown)
        for axes in shown:
            levels = [line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
            assert levels == [1.1, 1.0]

    def test_running_median(self):
        x = np.random.default_rng(1).permutation(np.arange(400.0))
        middle, median = running_median(x, 2.0 * x)
        assert len(middle) == 20
        assert (np.diff(middle) > 0.0).all()
        assert median == pytest.approx(2.0 * middle)
        assert len(running_median(x[:9], x[:9])[0]) == 0
        assert len(running_median(x[:35], x[:35])[0]) == 3
