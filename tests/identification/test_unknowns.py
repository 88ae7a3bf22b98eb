"""Which rows are searched, on numbers that depend on a few of them in a known way."""

import numpy as np
import pytest
from support.made_plants import PRINTED, loaded, measured

from tendonrepro.identification.misfit import log_misfit, log_residuals
from tendonrepro.identification.search import Evaluated, held_unit, rows_that_explain
from tendonrepro.monte_carlo.population import holding_base, population_of

BOX = holding_base(population_of(loaded()))
HELD = held_unit(BOX)
FEW = 3


def chosen(logs, most=10):
    """Names that are searched, and how near choosing them came.

    Every number is the printed one times exp of its `logs`, each a function (N,) of unit values by name.
    """
    seen = []

    def look(units):
        values = dict(zip(BOX.names, units.T, strict=True))
        factors = np.exp(np.broadcast_arrays(*logs(values))).reshape(4, 2, 2, -1)
        ours = measured(np.moveaxis(factors, -1, 0) * PRINTED.values)
        residuals = log_residuals(ours, PRINTED).reshape(len(units), -1)
        seen.append(log_misfit(ours, PRINTED))
        return Evaluated(seen[-1], residuals)

    rows, point = rows_that_explain(BOX, look, most)
    np.testing.assert_array_equal(point[~rows], HELD[~rows])
    return {name for name, is_searched in zip(BOX.names, rows, strict=True) if is_searched}, seen


def off(values, name, share):
    """Zero where a range is so far from where it is held."""
    return values[name] - HELD[BOX.names.index(name)] - share


def test_the_rows_that_explain_what_is_missing_are_searched():
    """Eight numbers need one row, eight another; a third one moves all of them, but only away or back."""

    def logs(values):
        one, two = off(values, "winch_viscous", -0.2), off(values, "amplitude", 0.3)
        return [one] * 8 + [two] * 8

    found, seen = chosen(logs)
    assert found == {"winch_viscous", "amplitude"}
    assert min(map(min, seen)) < 1e-6


def test_rows_of_one_direction_do_not_crowd_out_another():
    """Eight rows move the same numbers, and more strongly than the one that moves the others."""
    alike = [name for name in BOX.names if name.startswith("offset")]

    def logs(values):
        common = sum(3.0 * off(values, name, 0.0) for name in alike) - 2.0
        return [common] * 8 + [0.5 * off(values, "posture", 0.2)] * 8

    found, _ = chosen(logs, most=FEW)
    assert "posture" in found
    assert found & set(alike)


def test_what_was_chosen_first_goes_where_others_make_up_for_it():
    """One row moves all numbers alike and explains most alone; three others together explain all."""
    numbers, names = np.arange(16), ("amplitude", "posture", "link_mass_2")
    weights = [1.0 + 0.8 * np.sin(speed * numbers) for speed in (1.0, 2.3, 0.4)]

    def logs(values):
        alike = -off(values, "winch_viscous", 0.0)
        parts = [off(values, name, 0.085) for name in names]
        return [alike + sum(w[k] * part for w, part in zip(weights, parts, strict=True)) for k in numbers]

    found, seen = chosen(logs, most=len(names))
    assert found == {*names}
    assert min(map(min, seen)) < 1e-3


def test_a_choice_that_explains_is_made():
    place = BOX.names.index("disturbance")

    def logs(values):
        word = np.minimum(values["disturbance"] * 3, 2).astype(int)
        return [np.where(word == int(HELD[place] * 3), 0.5, 0.0)] * 16

    found, seen = chosen(logs)
    assert found == {"disturbance"}
    assert min(map(min, seen)) == 0.0


def test_what_only_acts_after_a_choice_is_found_after_it():
    """The rise moves nothing while the motion has none."""
    row = BOX.names.index("motion")
    kinds = len(BOX.rows[row].choices)
    other = (int(HELD[row] * kinds) + 1) % kinds

    def logs(values):
        rises = (values["motion"] * kinds).astype(int) == other
        return [np.where(rises, off(values, "rise", 0.2), 1.0)] * 16

    found, seen = chosen(logs)
    assert found == {"motion", "rise"}
    assert min(map(min, seen)) < 1e-6


@pytest.mark.parametrize("most", [1, FEW])
def test_no_more_than_are_asked_for(most):
    names = ("winch_viscous", "amplitude", "posture", "link_mass_2", "link_mass_3")

    def logs(values):
        # Each number needs a row of its own.
        return [off(values, names[k % len(names)], 0.2) for k in range(16)]

    found, _ = chosen(logs, most=most)
    assert len(found) == most
    assert found < set(names)


def test_something_is_searched_where_nothing_helps():
    found, _ = chosen(lambda values: [0.3 + 0.0 * values["posture"]] * 16)
    assert len(found) == 1
