"""The search against known optima, killed and resumed; rows that matter, on numbers that depend on a few."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.made_plants import PRINTED, Killed, loaded, measured

from tendonrepro.configuration.models.readings import reading
from tendonrepro.identification.misfit import Bench, log_misfit, log_residuals
from tendonrepro.identification.search import (
    UNKNOWNS,
    Effort,
    Evaluated,
    Found,
    Plants,
    rows_that_matter,
    search,
    with_switches,
)
from tendonrepro.monte_carlo.box import make_box, scrambled_sobol

EFFORT = Effort(generations=30, population=24, seeds=3)
ROWS = 6
OPTIMUM = np.array([0.3, 0.62])
EVERY = np.ones(ROWS, dtype=bool)


def two_numbers(units):
    """Two numbers that depend on the first three of six unknowns."""
    residuals = np.stack(
        [units[:, 0] - OPTIMUM[0], units[:, 1] + 0.5 * units[:, 2] ** 2 - OPTIMUM[1]], axis=1
    )
    return Evaluated(np.sqrt((residuals**2).mean(axis=1)), residuals)


def beyond(units):
    residuals = units[:, :1] - np.array([1.2])
    return Evaluated(np.abs(residuals[:, 0]), residuals)


def searched(folder, misfit=two_numbers, effort=EFFORT, rows=EVERY):
    starts = np.random.default_rng(5).random((effort.seeds, effort.population, ROWS))

    def plants(name):
        return Plants(misfit, ROWS, effort.plants, folder / f"{name}.npy", lambda _: None)

    return search(starts, rows, rows, plants, effort, 1)


def test_finds_a_known_optimum(tmp_path):
    found = searched(tmp_path)
    assert found.misfit < 1e-4
    assert two_numbers(found.closest[np.newaxis]).misfits[0] == found.misfit
    assert found.closest[0] == pytest.approx(OPTIMUM[0], abs=2e-4)


def test_optimum_beyond_a_bound_ends_at_it(tmp_path):
    found = searched(tmp_path, beyond)
    assert found.misfit == pytest.approx(0.2, abs=0.005)
    assert found.closest[0] > 0.99


def test_points_stay_in_the_cube_and_within_the_effort_and_other_rows_stay(tmp_path):
    rows = np.arange(ROWS) != 2
    seen = []

    def watched(units):
        seen.append(units)
        return two_numbers(units)

    found = searched(tmp_path, watched, EFFORT, rows)
    starts = np.random.default_rng(5).random((EFFORT.seeds, EFFORT.population, ROWS))
    points = np.concatenate(seen)
    assert found.misfit < 1e-4
    assert points.min() >= 0.0
    assert points.max() <= 1.0
    assert 0.9 * EFFORT.plants * EFFORT.seeds < len(points) <= EFFORT.evaluations
    assert set(points[:, 2]) == set(starts[..., 2].ravel())


def test_killed_and_resumed_ends_the_same(tmp_path):
    calls, deaths = Counter(), [1, 12, 13, 51, 100]

    def mortal(units):
        calls["all"] += 1
        if calls["all"] in deaths:
            raise Killed
        return two_numbers(units)

    for _ in deaths:
        with pytest.raises(Killed):
            searched(tmp_path / "cut", mortal)
    resumed = searched(tmp_path / "cut", mortal)
    whole = searched(tmp_path / "whole")
    for name in ("closest", "misfit", "points", "misfits"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
    searched(tmp_path / "cut", None)


def test_seeds_agree_to_five_per_cent():
    found = [Found(OPTIMUM, 1.0, OPTIMUM, np.array([1.0, most])) for most in (1.04, 1.06)]
    assert [one.agree for one in found] == [True, False]


BOX = make_box(loaded().config)
NOMINAL = dict(zip(BOX.names, BOX.nominal, strict=True))


def chosen(log_factor, most=UNKNOWNS):
    """Names that are searched where every number is the printed one times exp(log_factor(values by name))."""

    def look(units):
        values = dict(zip(BOX.names, BOX.values(units).T, strict=True))
        factor = np.exp(log_factor(values))
        ours = measured(factor[:, np.newaxis, np.newaxis, np.newaxis] * PRINTED.values)
        residuals = log_residuals(ours, PRINTED.values).reshape(len(units), -1)
        return Evaluated(log_misfit(ours, PRINTED.values), residuals)

    rows = rows_that_matter(BOX, look, scrambled_sobol(BOX, 1, 0, 0, 256), most)
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


def test_where_none_is_felt_as_many_as_allowed_are_searched():
    assert len(chosen(lambda values: 0.0 * values["winch_viscous"])) == UNKNOWNS


def test_something_is_searched_even_where_the_strongest_row_needs_its_switch():
    assert len(chosen(lambda values: 0.0 * values["winch_viscous"], most=0)) >= 1


def test_of_many_that_are_felt_the_strongest_are_searched():
    """Each counts with its switch; one whose switch does not fit any more is left for the next."""
    weights = dict(
        zip(["winch_viscous", "link_mass_2", "link_mass_3", "amplitude"], (3.0, 2.5, 2.0, 1.5), strict=True)
    )
    felt = chosen(
        lambda values: sum(w * np.log(values[name] / NOMINAL[name]) for name, w in weights.items()), most=3
    )
    assert felt == {"winch_viscous", "link_mass_2", "link_mass_3"}


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
