"""Numbers of plants beside the printed ones, on plants made around the print."""

import numpy as np
import pytest
from support.made_plants import PRINTED, RINGING, loaded, plants

from tendonrepro.configuration.published import published
from tendonrepro.identification.figures import draw_numbers
from tendonrepro.identification.goal import printed_numbers
from tendonrepro.identification.report import number_rows, parameter_rows, shape_rows
from tendonrepro.monte_carlo.population import population_of


def test_numbers_of_the_first_plant_and_the_range_of_all_whose_run_is_ok():
    near, goal = plants(), printed_numbers(published(), (2, 3), "controller_2")
    status = near.status.copy()
    status[10:, 0] = RINGING
    near = near._replace(status=status)
    rows = number_rows(near, goal)
    assert [row["fitted"] for row in rows].count(True) == 4
    sizes = near.sizes.reshape(len(near.sizes), -1)
    np.testing.assert_array_equal([row["ours_deg"] for row in rows], sizes[0])
    np.testing.assert_allclose([row["ratio"] for row in rows], sizes[0] / PRINTED.values.ravel())
    np.testing.assert_array_equal([row["lowest_deg"] for row in rows[4:]], sizes[:, 4:].min(axis=0))
    assert rows[0]["highest_deg"] == sizes[:10, 0].max()
    status[:, 0] = RINGING
    assert np.isnan(number_rows(near, goal)[0]["highest_deg"])


def test_fitted_numbers_are_told_from_others_in_grey_print_too():
    rows = [*number_rows(plants(), printed_numbers(published(), (2, 3), "controller_2"))]
    (panel,) = draw_numbers(rows, "printed", "", "the print").axes
    filled = {
        line.get_ydata()[0]: line.get_markerfacecolor() != "white"
        for line in panel.lines
        if line.get_marker() == "o" and len(line.get_ydata())
    }
    assert filled == {place: row["fitted"] for place, row in enumerate(rows)}


def test_parameters_have_values_words_and_bounds():
    box = population_of(loaded())
    best = np.full(len(box.names), 0.5)
    place = {name: k for k, name in enumerate(box.names)}
    best[place["winch_viscous"]], best[place["posture"]] = 0.995, 0.004
    # At their ends, and off.
    off = {"pulley_loss": "pulley_loss_acts", "link_coulomb": "friction_sides", "clearance": "clearance_at"}
    for name, switch in (off | {"disturbance_torque": "disturbance"}).items():
        best[place[name]], best[place[switch]] = 1.0, 0.0
    rows = {row["name"]: row for row in parameter_rows(box, best)}
    assert rows["winch_viscous"]["best"] == pytest.approx(0.2 * 25.0**0.995)
    at = {name: row["at_bound"] for name, row in rows.items() if row["at_bound"]}
    assert at == {"winch_viscous": "high", "posture": "low"}
    assert rows["motion"]["best"] in box.rows[place["motion"]].words
    held = box.freeing(np.zeros(len(box.names), dtype=bool))
    assert not any(row["at_bound"] for row in parameter_rows(held, best))


def test_order_and_shape_of_the_print():
    row = shape_rows(plants(), PRINTED)[0]
    assert row["printed_order_mae"] == row["printed_order_rmse"] == "1 < 2 < 3"
    assert row["printed_rmse_over_mae_controller_1"] == pytest.approx(0.311 / 0.261)
