"""The search against known optima, killed and resumed, and what it leaves alone."""

from collections import Counter

import numpy as np
import pytest
from support.made_plants import Killed, loaded

from tendonrepro.configuration.models.readings import reading
from tendonrepro.configuration.rows import values_of
from tendonrepro.identification.misfit import Bench
from tendonrepro.identification.search import (
    Evaluated,
    SearchEffort,
    SearchPoints,
    SearchResult,
    held_unit,
    search,
)
from tendonrepro.identification.space import space_of
from tendonrepro.monte_carlo.population import holding_base, population_of

EFFORT = SearchEffort(generations=30, population=24, seeds=3)
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
        return SearchPoints(misfit, ROWS, effort.plants, folder / f"{name}.npy", lambda _: None)

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


def test_a_known_point_is_polished_where_no_seed_comes_as_near(tmp_path):
    """A valley so narrow that few points do not find it; seeds do not know of it."""
    valley = np.full(ROWS, 0.875)

    def narrow(units):
        distance = np.abs(units - valley).max(axis=1)
        residuals = np.where(distance < 0.02, distance, 1.0 + distance)[:, np.newaxis]
        return Evaluated(np.abs(residuals[:, 0]), residuals)

    effort = SearchEffort(generations=2, population=8, seeds=2)
    starts = np.random.default_rng(5).random((2, 8, ROWS))
    near = valley + 0.01

    def plants(name):
        return SearchPoints(narrow, ROWS, effort.plants, tmp_path / f"{name}.npy", lambda _: None)

    found = search(starts, EVERY, EVERY, plants, effort, 1, near)
    assert found.misfit <= narrow(near[np.newaxis]).misfits[0]
    assert found.misfits.min() > 1.0


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
    found = [
        SearchResult(OPTIMUM, 1.0, OPTIMUM, np.array([1.0, most]), OPTIMUM, OPTIMUM) for most in (1.04, 1.06)
    ]
    assert [one.agree for one in found] == [True, False]


BOX = population_of(loaded())


def test_held_rows_keep_their_value_to_the_last_bit():
    bench = Bench(space_of(loaded()), "whole", None)
    rows = np.array([name == "winch_viscous" for name in BOX.names])
    config = bench.searching(rows).config(np.full(len(BOX.names), 0.9), reading({}))
    draw = values_of(loaded().compare, BOX.named(BOX.nominal))
    assert config.manipulator.tensioner.force.si == draw["tensioner_force"]
    assert config.manipulator.links.mass.value[1] == draw["link_mass_2"]
    assert config.manipulator.winches.viscous.value[1] == pytest.approx(
        BOX.values(np.full((1, len(BOX.names)), 0.9))[0, BOX.names.index("winch_viscous")]
    )


def test_the_point_of_what_is_held_has_its_values():
    """As near as the ranges allow: of an effect that is off, the size is any."""
    held = holding_base(BOX)
    values = BOX.values(held_unit(held)[np.newaxis])[0]
    np.testing.assert_allclose(values, np.clip(held.nominal, BOX.low, BOX.high), rtol=1e-9)
