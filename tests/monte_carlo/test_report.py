"""Tables say what the numbers are, and figures show them at their places."""

import csv
import io
from itertools import pairwise

import numpy as np
import pytest
from support.made_ensemble import DIVERGED, JOINTS, PLANTS, READINGS, box, ensemble, random_errors, whole

from tendonrepro.configuration.models.readings import parse_reading
from tendonrepro.monte_carlo.figures import draw_ratios, ensemble_figures, ratio_axis
from tendonrepro.monte_carlo.report import common_slow_ratio, ensemble_tables, population_summary
from tendonrepro.monte_carlo.shares import printed_ratios
from tendonrepro.results.figures.style import journal_style, open_figure


@pytest.mark.parametrize(
    ("reading", "joint_2"),
    [
        ("weights=swapped", 1.9),
        ("output_delay=1", 1.1),
        ("stored_torque=applied+output_delay=2", 3.1 / 3.0),
        ("stored_torque=applied+hardware=drawn", np.nan),
        ("estimate_filter=estimate", np.nan),
    ],
)
def test_theory_knows_what_makes_the_estimate_older(reading, joint_2):
    """Against the age that the law itself says, see tests/explain; of eight draws of the box."""
    draws = box().sample(1, 0, 0, 8)
    plants = [(box().configured(draw), box().named(draw)) for draw in draws]
    assert common_slow_ratio(plants, parse_reading(reading))[0] == pytest.approx(joint_2, nan_ok=True)


def test_the_table_has_the_numbers_of_the_summary(mixed, tmp_path):
    summary = whole(mixed)
    (table,) = ensemble_tables(summary)
    table.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"readings_box.csv", "readings_box.md"}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "readings_box.csv").read_text())))
    assert [row["reading"] for row in rows] == list(READINGS)
    for row, reading in zip(rows, summary["populations"]["box"]["readings"], strict=True):
        order = reading["share_c1_lt_c2_lt_c3"]["all_ok"]["mae_and_rmse"]["both"]
        assert [float(row[f"order{end}"]) for end in ("", "_low", "_high")] == [
            order[key] for key in ("share", "low", "high")
        ]
        median = reading["ratio_c2_c3"]["all_ok"]["mae"]["joint_3"]["median"]["value"]
        assert float(row["c2_c3_joint_3_median"]) == median
        assert float(row["stable_controller_2"]) == reading["status"]["controller_2"]["ok"]["share"]
    text, terminal = (tmp_path / "readings_box.md").read_text(), table.text()
    assert all(f"| {name} |" in text and name in terminal for name in READINGS)


@pytest.fixture(scope="module")
def nowhere_stable():
    """A summary without plants on which to conclude anything."""
    return whole(ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8)))


def test_ratios_show_median_print_and_theory(mixed):
    summary = population_summary(box(), mixed)
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


def test_figures_are_drawn_without_plants_too(nowhere_stable):
    drawn = {name: draw() for name, draw in ensemble_figures(nowhere_stable).items()}
    assert {drawing.stem for drawing in drawn.values()} == drawn.keys() == {"ratios_box"}
    drawn["ratios_box"].figure.draw_without_rendering()


@pytest.mark.parametrize("ends", [(0.999, 1.02), (0.97, 1.4), (0.5, 2.6), (0.02, 4.5), (3.0, 70.0)])
def test_ticks_of_a_ratio_have_room_and_one_of_them_is_1(ends):
    with journal_style():
        panel = open_figure(50.0, 50.0).subplots()
        ratio_axis(panel)
        panel.set_xlim(ends)
        panel.figure.draw_without_rendering()
        ticks = [label for label in panel.get_xticklabels() if label.get_text()]
        boxes = [tick.get_window_extent() for tick in ticks]
    assert len(ticks) >= 2
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
    assert ("1" in [tick.get_text() for tick in ticks]) == (ends[0] < 1.0)
