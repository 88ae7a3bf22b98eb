"""Misfits by hand, and what a bench simulates."""

import numpy as np
import pytest
from support.made_plants import DIVERGED, OK, PRINTED, RINGING, UNRESOLVED, loaded, made_up, measured

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import reading
from tendonrepro.identification.misfit import Bench, Simulated, log_misfit, rounding_misfit
from tendonrepro.identification.space import space_of


class TestMisfit:
    def test_printed_numbers_stand_in_their_places(self):
        values = dict(zip(RUNS, PRINTED.values.tolist(), strict=True))
        assert values["controller_2"] == [[0.289, 0.240], [0.375, 0.292]]
        assert values["controller_1_payload"] == [[0.264, 0.227], [0.325, 0.265]]
        np.testing.assert_allclose(PRINTED.half, 0.0005)

    def test_both_units(self):
        """Ten per cent more on every number, and on one of two: log 1.1 and its root mean square."""
        ours = measured([1.1 * PRINTED.values, PRINTED.values])
        np.testing.assert_allclose(log_misfit(ours, PRINTED), [np.log(1.1), 0.0], atol=1e-12)
        one = PRINTED.values.copy()
        one[0, 0, 0] += 0.004
        assert rounding_misfit(one, PRINTED) == pytest.approx(8.0 / 4.0)

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


class TestBench:
    def test_everything_acts_in_the_stubs(self):
        """Else a population that agrees on a row needs code of its own, which takes a minute to compile."""
        space = space_of(loaded())
        box = space.box
        found = dict(zip(box.names, box.values(space.acting()).T, strict=True))
        both = box.rows[box.names.index("friction_sides")].words.index("both")
        assert set(found["friction_sides"]) == {both}
        steps, disturbance = found.pop("torque_resolution_acts"), found["disturbance"]
        assert all((values == 1.0).all() for name, values in found.items() if name.endswith("_acts"))
        assert len({*zip(steps, disturbance, strict=True)}) == 6

    def test_large_batches_are_cut_and_stubs_left_out(self, monkeypatch):
        sizes = []

        def counting(loops, limits):
            sizes.append(len(loops))
            return made_up(loops, limits)

        monkeypatch.setattr("tendonrepro.identification.misfit.PLANTS_AT_ONCE", 16)
        space = space_of(loaded())
        bench = Bench(space, "whole", counting)
        found = bench.measure(space.box.points(1, 0, 0, 20), reading({}), RUNS[1:3])
        assert (found.sizes.shape, found.status.shape) == ((20, 2, 2, 2), (20, 2))
        stubs = 2 * len(space.acting())
        assert sizes == [16 * 2 + stubs, 4 * 2 + stubs]
