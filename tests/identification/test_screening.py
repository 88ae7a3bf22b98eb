"""Rows that matter, on made-up numbers that depend on a few."""

from dataclasses import replace

import numpy as np
import pytest
from support.made_plants import PRINTED, loaded, measured

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import reading
from tendonrepro.identification import misfit as screening
from tendonrepro.identification.misfit import Bench, nominal_unit, rows_that_matter, with_switches
from tendonrepro.monte_carlo.box import make_box

BOX = make_box(loaded().config)
NOMINAL = dict(zip(BOX.names, BOX.nominal, strict=True))


def chosen(monkeypatch, log_factor):
    """Names that are searched where every number is the printed one times exp(log_factor(values by name))."""

    def measure(bench, units, case, runs):
        del case, runs
        values = dict(zip(bench.box.names, bench.box.values(units).T, strict=True))
        factor = np.exp(log_factor(values))
        return measured(factor[:, np.newaxis, np.newaxis, np.newaxis] * PRINTED.values)

    monkeypatch.setattr(Bench, "measure", measure)
    bench = Bench(loaded().base, BOX, "whole", None)
    rows = rows_that_matter(bench, reading({}), RUNS, PRINTED.values, 1)
    return {name for name, is_searched in zip(BOX.names, rows, strict=True) if is_searched}


def test_nominal_unit_gives_the_nominal_values():
    found = BOX.values(nominal_unit(BOX)[np.newaxis])[0]
    np.testing.assert_allclose(found, BOX.nominal, rtol=1e-12)


def test_a_row_that_changes_the_numbers_is_searched(monkeypatch):
    """The best draws have other values than the nominal ones."""
    felt = chosen(monkeypatch, lambda values: np.log(values["winch_viscous"] / 4.0) + values["motion"] - 3.0)
    assert felt == {"winch_viscous", "motion"}


def test_a_row_that_hardly_does_is_not(monkeypatch):
    """The whole range of the link's mass makes three per cent."""
    felt = chosen(
        monkeypatch,
        lambda values: np.log(values["winch_viscous"] / 4.0) + 0.02 * np.log(values["link_mass_2"]),
    )
    assert felt == {"winch_viscous"}


@pytest.mark.parametrize(("change", "is_searched"), [(0.09, False), (0.11, True)])
def test_ten_per_cent_are_felt(monkeypatch, change, is_searched):
    """The best draws have another motion than the nominal one, with which every number is larger."""
    felt = chosen(monkeypatch, lambda values: change * (values["motion"] == NOMINAL["motion"]))
    assert (felt == {"motion"}) == is_searched


def test_where_none_is_felt_all_are_searched(monkeypatch):
    assert chosen(monkeypatch, lambda values: 0.0 * values["winch_viscous"]) == set(BOX.names)


def test_a_size_comes_with_its_switch(monkeypatch):
    felt = chosen(monkeypatch, lambda values: 0.5 * np.log(values["torque_resolution"]))
    assert felt == {"torque_resolution", "torque_resolution_acts"}
    names = ("reducer_efficiency", "reducer_loss_acts", "pulley_loss", "pulley_loss_acts")
    names += ("disturbance", "disturbance_torque", "posture")
    found = with_switches(names, np.array([True, False, False, False, False, True, True]))
    np.testing.assert_array_equal(found, [True, True, False, False, True, True, True])


def test_every_switch_is_a_row():
    assert set(screening._SWITCHES).union(*screening._SWITCHES.values()) <= set(BOX.names)


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
