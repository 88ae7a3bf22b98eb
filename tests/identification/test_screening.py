"""Rows that matter, on made-up numbers that depend on a few."""

from dataclasses import replace

import numpy as np
import pytest
from support.made_plants import PRINTED, loaded, measured

from tendonrepro.configuration.models.readings import reading
from tendonrepro.identification.misfit import Bench, log_misfit, log_residuals
from tendonrepro.identification.search import Evaluated, rows_that_matter, with_switches
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol

BOX = make_box(loaded().config)
NOMINAL = dict(zip(BOX.names, BOX.nominal, strict=True))


def chosen(log_factor):
    """Names that are searched where every number is the printed one times exp(log_factor(values by name))."""

    def look(units):
        values = dict(zip(BOX.names, BOX.values(units).T, strict=True))
        factor = np.exp(log_factor(values))
        ours = measured(factor[:, np.newaxis, np.newaxis, np.newaxis] * PRINTED.values)
        residuals = log_residuals(ours, PRINTED.values).reshape(len(units), -1)
        return Evaluated(log_misfit(ours, PRINTED.values), residuals)

    rows = rows_that_matter(BOX, look, scrambled_sobol(BOX, 1, 0, 0, 256))
    return {name for name, is_searched in zip(BOX.names, rows, strict=True) if is_searched}


def test_a_row_that_changes_the_numbers_is_searched():
    """The best draws have other values than the nominal ones."""
    felt = chosen(lambda values: np.log(values["winch_viscous"] / 4.0) + values["motion"] - 3.0)
    assert felt == {"winch_viscous", "motion"}


@pytest.mark.parametrize(("change", "is_searched"), [(0.09, False), (0.11, True)])
def test_ten_per_cent_are_felt(change, is_searched):
    """The best draws have another motion than the nominal one, with which every number is larger."""
    felt = chosen(lambda values: change * (values["motion"] == NOMINAL["motion"]))
    assert (felt == {"motion"}) == is_searched


def test_where_none_is_felt_all_are_searched():
    assert chosen(lambda values: 0.0 * values["winch_viscous"]) == set(BOX.names)


def test_a_size_comes_with_its_switch():
    felt = chosen(lambda values: 0.5 * np.log(values["torque_resolution"]))
    assert felt == {"torque_resolution", "torque_resolution_acts"}
    names = ("reducer_efficiency", "reducer_loss_acts", "pulley_loss", "pulley_loss_acts")
    names += ("disturbance", "disturbance_torque", "posture")
    found = with_switches(names, np.array([True, False, False, False, False, True, True]))
    np.testing.assert_array_equal(found, [True, True, False, False, True, True, True])


def test_held_rows_keep_their_nominal_value_to_the_last_bit():
    bench = Bench(loaded().base, BOX, "whole", None)
    rows = np.array([name == "winch_viscous" for name in BOX.names])
    config = bench.searching(rows).config(np.full(len(BOX.names), 0.9), reading({}))
    nominal = replace(BOX, free=np.zeros_like(rows)).values(np.full((1, len(BOX.names)), 0.9))[0]
    draw = dict(zip(BOX.names, nominal, strict=True))
    assert config.manipulator.tensioner.force.si == draw["tensioner_force"]
    assert config.manipulator.links.mass.value[1] == draw["link_mass_2"]
    assert config.manipulator.winches.viscous.value[1] == pytest.approx(
        BOX.values(np.full((1, len(BOX.names)), 0.9))[0, BOX.names.index("winch_viscous")]
    )
