"""Misfits by hand, what a bench simulates, and numbers of plants beside the printed ones."""

import numpy as np
import pytest
from support.made_plants import (
    DIVERGED,
    OK,
    PRINTED,
    RINGING,
    UNRESOLVED,
    loaded,
    made_up,
    measured,
    plants,
)

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import reading
from tendonrepro.configuration.published import published
from tendonrepro.identification.bench import (
    MOVED,
    Bench,
    Simulated,
    acting,
    bench_of,
    in_order,
    log_misfit,
    printed_numbers,
)
from tendonrepro.identification.figures import draw_numbers
from tendonrepro.identification.report import number_rows, parameter_rows, shape_rows
from tendonrepro.monte_carlo.population import population_of


class TestMisfit:
    def test_printed_numbers_stand_in_their_places(self):
        values = dict(zip(RUNS, PRINTED.values.tolist(), strict=True))
        assert values["controller_2"] == [[0.289, 0.240], [0.375, 0.292]]
        assert values["controller_1_payload"] == [[0.264, 0.227], [0.325, 0.265]]
        np.testing.assert_allclose(PRINTED.half, 0.0005)

    def test_is_the_root_mean_square_of_logs(self):
        ours = measured([1.1 * PRINTED.values, PRINTED.values])
        np.testing.assert_allclose(log_misfit(ours, PRINTED), [np.log(1.1), 0.0], atol=1e-12)
        one = PRINTED.values.copy()
        one[0, 0, 0] *= 1.1
        assert log_misfit(measured([one]), PRINTED) == pytest.approx(np.log(1.1) / 4.0)

    def test_what_ends_badly_is_worse_than_any_that_ends_well_and_is_ordered(self):
        poor = measured([30.0 * PRINTED.values])
        nothing = np.full((1, 4, 2, 2), np.nan)
        rising = [
            log_misfit(poor, PRINTED),
            log_misfit(measured([PRINTED.values], RINGING), PRINTED),
            log_misfit(measured([30.0 * PRINTED.values], RINGING), PRINTED),
            log_misfit(measured([PRINTED.values], DIVERGED, 0.9), PRINTED),
            log_misfit(measured(nothing, DIVERGED, 0.1), PRINTED),
            log_misfit(measured(nothing, UNRESOLVED, 0.0), PRINTED),
        ]
        assert np.isfinite(rising).all()
        assert (np.diff(np.concatenate(rising)) > 0.0).all()

    def test_one_run_out_of_four_counts_by_its_end(self):
        status = np.array([[OK, OK, DIVERGED, OK]], dtype=np.int8)
        mixed = Simulated(PRINTED.values[np.newaxis], status, np.full((1, 4), 0.5))
        assert log_misfit(mixed, PRINTED)[0] == pytest.approx(25.0 / 2.0)

    def test_an_order_holds_in_every_column_and_of_runs_that_end_well(self):
        """Of plants as printed, with two errors exchanged, and with a run that rings."""
        exchanged = PRINTED.values.copy()
        exchanged[[0, 1], 1, 1] = exchanged[[1, 0], 1, 1]
        sizes = [PRINTED.values, exchanged, PRINTED.values]
        status = np.full((3, 4), OK, np.int8)
        status[2, 1] = RINGING
        ours = Simulated(np.array(sizes), status, np.ones((3, 4)))
        np.testing.assert_array_equal(in_order(ours, PRINTED), [True, False, False])
        alone = printed_numbers(published(), (2, 3), "controller_2").sought
        assert len(alone.compared) == 1


class TestBench:
    def test_everything_acts_in_the_stubs(self):
        """Else a population that agrees on a row needs code of its own, which takes a minute to compile."""
        box = bench_of(loaded()).box
        found = dict(zip(box.names, box.values(acting(box)).T, strict=True))
        both = box.rows[box.names.index("friction_sides")].words.index("both")
        assert set(found["friction_sides"]) == {both}
        steps, disturbance = found.pop("torque_resolution_acts"), found["disturbance"]
        assert all((values == 1.0).all() for name, values in found.items() if name.endswith("_acts"))
        assert len({*zip(steps, disturbance, strict=True)}) == 6

    def test_large_batches_are_cut_and_stubs_left_out(self, monkeypatch):
        sizes, batches = [], []

        def counting(loops):
            sizes.append(len(loops))
            batches.append(made_up(loops))
            return batches[-1]

        monkeypatch.setattr("tendonrepro.identification.bench.PLANTS_AT_ONCE", 16)
        bench = bench_of(loaded(), "whole", counting)
        found = bench.measure(bench.box.sample(1, 0, 0, 20), reading({}), RUNS[1:3])
        assert (found.sizes.shape, found.status.shape) == ((20, 2, 2, 2), (20, 2))
        stubs = 2 * len(acting(bench.box))
        assert sizes == [16 * 2 + stubs, 4 * 2 + stubs]
        in_rad = batches[0].statistics["rmse"][: 16 * 2].reshape(16, 2, 2)
        np.testing.assert_allclose(found.sizes[:16, :, 1], np.rad2deg(in_rad))

    def test_repeats_move_masses_by_a_millionth_and_nothing_else(self):
        bench, seen = bench_of(loaded(), "whole", made_up), []

        class Watched(Bench):
            def measure(self, values, reading, runs):
                seen.append(values)
                return bench.measure(values, reading, runs)

        few = bench.box.sample(1, 0, 0, 2)
        repeats = Watched(bench.box, "whole", made_up).repeated(few, reading({}), PRINTED, 20, [3])
        assert repeats.misfits.shape == repeats.ordered.shape == (2, 20)
        (values,) = seen
        before = np.repeat(few, 20, axis=0)
        of_masses = np.array([name.startswith("link_mass") for name in bench.box.names])
        np.testing.assert_array_equal(values[:, ~of_masses], before[:, ~of_masses])
        assert np.std(values[:, of_masses] / before[:, of_masses]) == pytest.approx(MOVED, rel=0.3)
        again = bench.repeated(few, reading({}), PRINTED, 20, [3])
        np.testing.assert_array_equal(again.misfits, repeats.misfits)
        np.testing.assert_array_equal(repeats.median, np.median(repeats.misfits, axis=1))


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
