"""What near-optimal plants say, on plants made around the print."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.made_plants import DIVERGED, PRINTED, RINGING, loaded, measured, plants
from support.other_print import with_numbers

from tendonrepro.configuration.published import published
from tendonrepro.identification.judge import (
    number_rows,
    order_rows,
    order_verdict,
    parameter_rows,
    pareto_rows,
)
from tendonrepro.identification.misfit import Outcome, log_misfit, printed_numbers
from tendonrepro.monte_carlo.box import make_box


class TestJudge:
    def test_numbers_within_the_range_are_reached(self):
        rows = number_rows(measured([PRINTED.values]), plants(), PRINTED, ("controller_2",))
        verdicts = Counter((row["run"] == "controller_2", row["verdict"]) for row in rows)
        assert verdicts == {(True, "fitted"): 4, (False, "reached"): 12}
        assert all(row["inside_rounding"] and row["ratio"] == 1.0 for row in rows)

    def test_a_falsified_number_is_not_reached(self):
        lied = printed_numbers(with_numbers(published(), {"table2.controller_1.mae.joint_2": 0.183}), (2, 3))
        rows = number_rows(measured([PRINTED.values]), plants(), lied, ("controller_2",))
        wrong = [(row["run"], row["metric"], row["joint"]) for row in rows if row["verdict"] == "not_reached"]
        assert wrong == [("controller_1", "mae", 2)]
        row = next(row for row in rows if row["verdict"] == "not_reached")
        assert not row["inside_rounding"]
        assert row["rounding_units"] == pytest.approx((0.261 - 0.183) / 0.0005)

    def test_rare_lies_outside_the_central_part(self):
        near = plants()
        edge = replace(PRINTED, values=PRINTED.values * np.exp(0.048), half=1e-6 * PRINTED.half)
        assert {row["verdict"] for row in number_rows(near, near, edge, ())} == {"rare"}

    def test_runs_that_are_not_ok_are_left_out_of_ranges(self):
        near = plants()
        status = np.zeros((200, 4), dtype=np.int8)
        status[:190, 0] = RINGING
        rows = number_rows(near, Outcome(near.sizes, status, near.lasted), PRINTED, ("controller_2",))
        assert {row["verdict"] for row in rows if row["run"] == "controller_1"} == {"too_few_plants"}

    def test_order_agrees_is_contradicted_or_depends(self):
        def verdicts(near, printed=PRINTED):
            return {(tuple(r["runs"]), r["metric"], r["joint"]): r for r in order_rows(near, printed)}

        three = ("controller_1", "controller_2", "controller_3")
        clear = plants(spread=0.01)
        assert verdicts(clear)[three, "mae", "both"]["verdict"] == "agrees"
        swapped = PRINTED.values.copy()
        swapped[[0, 2]] = swapped[[2, 0]]
        contrary = verdicts(clear, replace(PRINTED, values=swapped))[three, "rmse", "joint_2"]
        assert contrary["verdict"] == "contradicted"
        assert contrary["printed_order"] == list(reversed(three))
        found = verdicts(plants(spread=0.2))[three, "mae", "joint_3"]
        assert found["verdict"] == "depends_on_plant"
        sizes = plants(spread=0.2).sizes[:, :3, 0, 1]
        assert found["share"] == pytest.approx(
            ((sizes[:, 0] < sizes[:, 1]) & (sizes[:, 1] < sizes[:, 2])).mean()
        )

    def test_a_diverged_run_comes_last(self):
        near = plants(spread=0.01)
        status = np.zeros((200, 4), dtype=np.int8)
        status[:50, 0] = DIVERGED
        rows = order_rows(Outcome(near.sizes, status, near.lasted), PRINTED)
        pair = next(row for row in rows if row["runs"] == ["controller_1", "controller_2"])
        assert pair["share"] == pytest.approx(0.75)

    def test_too_few_plants_say_nothing(self):
        rows = order_rows(plants(count=5), PRINTED)
        assert {row["verdict"] for row in rows} == {"too_few_plants"}
        assert order_verdict(0.95) == "agrees"
        assert order_verdict(0.05) == "contradicted"

    def test_pareto_front_is_what_no_plant_beats(self):
        near = plants(count=60)
        front = pareto_rows(near, PRINTED, ("controller_2",))["controller_2_against_others"]
        two = log_misfit(measured(near.sizes[:, [1]]), PRINTED.values[[1]])
        rest = log_misfit(measured(near.sizes[:, [0, 2, 3]]), PRINTED.values[[0, 2, 3]])
        unbeaten = {
            k
            for k in range(60)
            if not ((two <= two[k]) & (rest <= rest[k]) & ((two < two[k]) | (rest < rest[k]))).any()
        }
        assert {point["plant"] for point in front} == unbeaten
        assert len(front) > 1


class TestParameters:
    def test_widths_bounds_and_shares(self):
        box = make_box(loaded().config)
        near = np.random.default_rng(1).random((4000, len(box.names)))
        known, choice = box.names.index("winch_viscous"), box.names.index("motion")
        near[:, known] = 0.5 + 0.1 * (near[:, known] - 0.5)
        best = np.full(len(box.names), 0.5)
        best[known], best[box.names.index("posture")] = 0.995, 0.004
        rows = {row["name"]: row for row in parameter_rows(box, best, near)}
        assert rows["winch_viscous"]["width"] == pytest.approx(0.1, rel=0.05)
        assert rows["winch_viscous"]["near_median"] == pytest.approx(1.0, rel=0.02)  # middle of 0.2 to 5, log
        assert rows["posture"]["width"] == pytest.approx(1.0, abs=0.03)
        at = {name: row["at_bound"] for name, row in rows.items() if row["at_bound"]}
        assert at == {"winch_viscous": "high", "posture": "low"}
        assert sum(rows["motion"]["shares"].values()) == pytest.approx(1.0)
        assert set(rows["motion"]["shares"]) == set(box.words[choice])
        assert rows["motion"]["best"] in box.words[choice]
