"""Both searches against known optima, killed and resumed, and what they leave alone."""

from collections import Counter

import numpy as np
import pytest
from support.made_plants import Killed

from tendonrepro.identification.optimisers import SEARCHES, Evaluated, SearchPoints, cma_es, least_squares

ROWS = 6
BUDGET = 600
OPTIMUM = np.array([0.3, 0.62])
EVERY = np.ones(ROWS, dtype=bool)
EACH = pytest.mark.parametrize("search", SEARCHES.values(), ids=SEARCHES)


def two_numbers(units):
    """Two numbers that depend on the first three of six unknowns."""
    residuals = np.stack(
        [units[:, 0] - OPTIMUM[0], units[:, 1] + 0.5 * units[:, 2] ** 2 - OPTIMUM[1]], axis=1
    )
    return Evaluated(np.sqrt((residuals**2).mean(axis=1)), residuals)


def one_number(residuals):
    return Evaluated(np.abs(residuals), np.asarray(residuals)[:, np.newaxis])


def beyond(units):
    return one_number(units[:, 0] - 1.2)


def searched(path, search, misfit=two_numbers, rows=EVERY, smooth=EVERY, starts=None):
    """What was looked at, in order, and the misfits."""
    starts = np.random.default_rng(5).random((40, ROWS)) if starts is None else starts
    look = SearchPoints(misfit, ROWS, BUDGET, path, lambda _: None)
    search(starts, rows, smooth, look, 1)
    return look.seen


@EACH
def test_optimum_beyond_a_bound_ends_at_it(tmp_path, search):
    seen = searched(tmp_path / "kept.npy", search, beyond)
    assert seen[1].min() == pytest.approx(0.2, abs=0.005)


@EACH
def test_points_stay_in_the_cube_and_within_the_effort_and_other_rows_stay(tmp_path, search):
    rows, starts = np.arange(ROWS) != 2, np.random.default_rng(5).random((40, ROWS))
    points, misfits = searched(tmp_path / "kept.npy", search, rows=rows, starts=starts)
    assert misfits.min() < 1e-3
    assert points[np.argmin(misfits), 0] == pytest.approx(OPTIMUM[0], abs=2e-3)
    assert points.min() >= 0.0
    assert points.max() <= 1.0
    assert len(points) <= BUDGET
    assert {*points[:, 2]} <= {*starts[:, 2]}


def test_least_squares_leave_choices_as_they_are_and_cma_es_moves_them(tmp_path):
    """A choice that is wrong costs a half; the other five rows cannot make up for it."""
    smooth, starts = np.arange(ROWS) != 4, np.full((3, ROWS), 0.6)
    starts[:, 4] = 0.55

    def with_choice(units):
        wrong = np.where(units[:, 4] < 0.5, 0.0, 0.5)
        return one_number(wrong + (units[:, 0] - OPTIMUM[0]) ** 2)

    fixed, moved = (
        searched(tmp_path / f"{search.__name__}.npy", search, with_choice, EVERY, smooth, starts)
        for search in (least_squares, cma_es)
    )
    assert {*fixed[0][:, 4]} == {0.55}
    assert fixed[1].min() == pytest.approx(0.5, abs=1e-2)
    assert moved[1].min() < 0.05


def test_a_slope_into_a_run_that_ends_badly_stops_no_other_row(tmp_path):
    """One row may not be moved at all, in the direction in which its slope is asked."""
    start = np.full((1, ROWS), 0.5)

    def cliff(units):
        found = two_numbers(units)
        return Evaluated(np.where(units[:, 5] > 0.51, 20.0, found.misfits), found.residuals)

    assert searched(tmp_path / "kept.npy", least_squares, cliff, starts=start)[1].min() < 1e-3


def test_rows_that_do_nothing_cost_one_slope(tmp_path):
    """Of six rows three act: the first slopes take six points, further ones three, once Broyden's end."""
    sizes = []

    def counted(units):
        sizes.append(len(units))
        return two_numbers(units)

    searched(tmp_path / "kept.npy", least_squares, counted, starts=np.full((1, ROWS), 0.9))
    assert sizes[:2] == [1, ROWS]
    assert {*sizes[2:]} == {3, sizes[2]}
    assert sizes.count(3) == 1


@EACH
def test_killed_and_resumed_looks_at_the_same(tmp_path, search):
    calls, deaths = Counter(), [1, 3, 4, 12]

    def mortal(units):
        calls["all"] += 1
        if calls["all"] in deaths:
            raise Killed
        return two_numbers(units)

    for _ in deaths:
        with pytest.raises(Killed):
            searched(tmp_path / "cut.npy", search, mortal)
    resumed = searched(tmp_path / "cut.npy", search, mortal)
    whole = searched(tmp_path / "whole.npy", search)
    np.testing.assert_array_equal(resumed[0], whole[0])
    np.testing.assert_array_equal(resumed[1], whole[1])
    searched(tmp_path / "cut.npy", search, None)


def test_a_budget_below_one_step_looks_at_nothing(tmp_path):
    look = SearchPoints(two_numbers, ROWS, 1, tmp_path / "few.npy", lambda _: None)
    cma_es(np.full((4, ROWS), 0.5), EVERY, EVERY, look, 1)
    points, misfits = look.seen
    assert points.shape == (0, ROWS)
    assert misfits.shape == (0,)
