"""The search against known optima and brute force, killed and resumed."""

import io
import itertools
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.made_plants import QUIET, Killed

from tendonrepro.console import Talk
from tendonrepro.identification import search as identify_search
from tendonrepro.identification.search import Effort, Evaluated, search

EFFORT = Effort(generations=40, population=24, seeds=3, tolerance=0.05, smooth=(True,) * 6)
ROWS = 6
OPTIMUM = np.array([0.3, 0.62])


def two_numbers(units):
    """Two numbers that depend on the first three of six unknowns."""
    residuals = np.stack(
        [units[:, 0] - OPTIMUM[0], units[:, 1] + 0.5 * units[:, 2] ** 2 - OPTIMUM[1]], axis=1
    )
    return Evaluated(np.sqrt((residuals**2).mean(axis=1)), residuals)


def initial(effort=EFFORT, rows=ROWS):
    return np.random.default_rng(5).random((effort.seeds, effort.population, rows))


def searched(path, misfit=two_numbers, effort=EFFORT, identity="a"):
    return search(initial(effort), misfit, effort, 1, path, identity, QUIET)


def _forgeries(arrays):
    """Images of a state where one array is missing or another one."""
    others = [None, 3, "text", np.zeros(2), np.zeros((3, 3, 3), complex)]
    for name, other in itertools.product(arrays, others):
        stream = io.BytesIO()
        kept = {key: value for key, value in arrays.items() if key != name}
        np.savez(stream, **kept if other is None else kept | {name: other})
        yield stream.getvalue()


class TestSearch:
    def test_finds_a_known_optimum(self, tmp_path):
        found = searched(tmp_path / "s.npz")
        unit, misfit = found.closest, found.misfit
        assert misfit < 1e-4
        assert two_numbers(unit[np.newaxis]).misfits[0] == misfit
        assert unit[0] == pytest.approx(OPTIMUM[0], abs=2e-4)

    def test_finds_one_that_no_regression_shows(self, tmp_path):
        """Wells of equal depth around the deepest, and residuals that say nothing."""

        def wells(units):
            away = units[:, :2] - np.array([0.81, 0.23])
            misfits = np.sqrt((away**2 + 0.02 * (1.0 - np.cos(8.0 * np.pi * away))).mean(axis=1))
            return Evaluated(misfits, np.zeros((len(units), 2)))

        found = searched(tmp_path / "s.npz", wells, replace(EFFORT, generations=80))
        unit, misfit = found.closest, found.misfit
        assert misfit < 0.01
        np.testing.assert_allclose(unit[:2], [0.81, 0.23], atol=0.01)

    def test_optimum_beyond_a_bound_ends_at_it(self, tmp_path):
        def beyond(units):
            residuals = units[:, :1] - np.array([1.2])
            return Evaluated(np.abs(residuals[:, 0]), residuals)

        found = searched(tmp_path / "s.npz", beyond)
        unit, misfit = found.closest, found.misfit
        assert misfit == pytest.approx(0.2, abs=0.005)
        assert unit[0] > 0.99

    def test_members_stay_in_the_cube_and_never_get_worse(self, tmp_path):
        seen = []

        def watched(units):
            seen.append(units)
            return two_numbers(units)

        found = searched(tmp_path / "s.npz", watched, replace(EFFORT, tolerance=0.0))
        points = np.concatenate(seen)
        assert points.min() >= 0.0
        assert points.max() <= 1.0
        assert len(points) <= EFFORT.evaluations
        assert (np.diff(found.history, axis=0) <= 0.0).all()
        assert found.history.shape == (EFFORT.generations + 1, EFFORT.seeds)

    def test_near_optimal_members_cover_what_brute_force_finds(self, tmp_path):
        effort = replace(EFFORT, generations=80, population=64, seeds=4, tolerance=0.1)
        state = searched(tmp_path / "s.npz", effort=effort)
        near = state.near(0.1)
        assert len(near) > 0.9 * effort.population * effort.seeds
        every = np.random.default_rng(0).random((400_000, ROWS))
        allowed = every[two_numbers(every).misfits <= 0.1]
        ends = [np.percentile(units, [5, 50, 95], axis=0) for units in (near, allowed)]
        np.testing.assert_allclose(*ends, atol=0.12)
        width = ends[0][2] - ends[0][0]
        assert width[0] == pytest.approx((ends[1][2] - ends[1][0])[0], rel=0.2)
        assert width[3:].min() > 0.75  # three unknowns that nothing depends on

    def test_what_has_spread_stays_at_the_tolerance(self, tmp_path):
        state = searched(tmp_path / "s.npz", effort=replace(EFFORT, tolerance=0.3))
        assert np.median(state.spread_misfits) > 0.05
        assert state.history[-1].max() < 1e-3

    @pytest.mark.parametrize("deaths", [[1], [2, 9, 10, 31], [130]])
    def test_killed_and_resumed_ends_the_same(self, tmp_path, deaths):
        whole_calls, calls = Counter(), Counter()

        def counted(units):
            whole_calls["all"] += 1
            return two_numbers(units)

        whole = searched(tmp_path / "whole.npz", counted)

        def mortal(units):
            calls["all"] += 1
            if calls["all"] in deaths:
                raise Killed
            return two_numbers(units)

        path = tmp_path / "cut.npz"
        for _ in deaths:
            with pytest.raises(Killed):
                searched(path, mortal)
        resumed = searched(path, mortal)
        for name in ("closest", "misfit", "spread_units", "spread_misfits", "history"):
            np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
        assert calls["all"] == whole_calls["all"] + len(deaths)

    def test_finished_search_is_not_run_again(self, tmp_path):
        path = tmp_path / "s.npz"
        first = searched(path)

        def never(_):
            raise AssertionError

        np.testing.assert_array_equal(searched(path, never).closest, first.closest)

    def test_damaged_or_foreign_state_is_not_taken_up(self, tmp_path, capsys):
        path, effort = tmp_path / "s-0.npz", replace(EFFORT, generations=1, seeds=1)

        def again(identity="a"):
            search(initial(effort), two_numbers, effort, 1, tmp_path / "s.npz", identity, Talk())
            return capsys.readouterr().err

        assert not again()
        content = path.read_bytes()
        for image in (b"", b"PK\x03\x04", content[:-100], b"none"):
            path.write_bytes(image)
            assert str(path) in again()
        assert not again()
        assert str(path) in again("b")

    def test_other_points_than_those_kept_are_looked_at(self, tmp_path):
        """What is kept is of an earlier way to search, by the same name."""
        path, effort = tmp_path / "s.npz", replace(EFFORT, generations=2)
        search(initial(effort) / 2.0, two_numbers, effort, 1, path, "a", QUIET)
        np.testing.assert_array_equal(
            searched(path, effort=effort).closest, searched(tmp_path / "new.npz", effort=effort).closest
        )

    def test_seeds_know_nothing_of_each_other(self, tmp_path):
        alone = search(initial()[:1], two_numbers, replace(EFFORT, seeds=1), 1, tmp_path / "1", "a", QUIET)
        np.testing.assert_array_equal(alone.history[:, 0], searched(tmp_path / "3").history[:, 0])

    def test_seeds_agree_within_five_per_cent_or_where_all_fit(self, tmp_path):
        state = searched(tmp_path / "s.npz", effort=replace(EFFORT, generations=1))

        def agree(*best):
            return replace(state, history=np.array([[9.0, 1.0], best])).agree(0.02)

        assert agree(0.1, 0.104)
        assert not agree(0.1, 0.106)
        assert agree(0.001, 0.02)

    def test_steps_fold_at_the_bounds(self):
        folded = identify_search._reflected(np.array([-0.2, 0.4, 1.3, 2.7, -1.5]))
        np.testing.assert_allclose(folded, [0.2, 0.4, 0.7, 0.0, 0.5])
