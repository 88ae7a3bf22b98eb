from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.synthetic import S_INV, S, make_compare_file, make_decouple_file

from tendonrepro.experiments.report import results_text
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import (
    ranking,
    ranking_rows,
    sizes_deg,
    table_data_compare,
    table_data_decouple,
    tension_sizes,
    tensions,
    tracking_errors,
)

Array = NDArray[np.float64]


def with_error(trace: Trace, e: Array) -> Trace:
    return dataclasses.replace(trace, variables={**trace.variables, "e": e})


def constant_errors(degrees: dict[str, tuple[float, float]]) -> TraceFile:
    """A file whose runs have a constant error on joints 2 and 3."""
    file = make_compare_file(runs=list(degrees))
    runs = {
        name: with_error(trace, np.deg2rad(np.tile(degrees[name], (len(trace.time), 1))))
        for name, trace in file.runs.items()
    }
    return dataclasses.replace(file, runs=runs)


class TestSizes:
    def test_degrees_per_joint(self) -> None:
        sizes = sizes_deg(np.deg2rad([[3.0, 0.0], [-4.0, 1.0]]))
        assert sizes["mae"] == pytest.approx([3.5, 0.5])
        assert sizes["rmse"] == pytest.approx([math.sqrt(12.5), math.sqrt(0.5)])
        assert sizes["max"] == pytest.approx([4.0, 1.0])

    @pytest.mark.parametrize("broken", [math.nan, math.inf])
    def test_samples_from_the_first_broken_one_on_are_left_out(self, broken: float) -> None:
        e = np.deg2rad([[1.0, 2.0], [3.0, 2.0], [5.0, broken], [500.0, 500.0]])
        assert sizes_deg(e)["mae"] == pytest.approx([2.0, 2.0])
        assert sizes_deg(e)["max"] == pytest.approx([3.0, 2.0])
        assert np.isnan(sizes_deg(np.full((2, 3), broken))["rmse"]).tolist() == [True] * 3

    def test_windows_use_the_period_of_the_run(self) -> None:
        trace = make_compare_file().runs["controller_1"]
        e = np.zeros_like(trace["e"])
        e[trace.time >= 9.0] = np.deg2rad(2.0)
        found = tracking_errors(with_error(trace, e))
        assert found["period_1"]["mae"].tolist() == [0.0, 0.0]
        assert found["period_2"]["mae"] == pytest.approx([2.0, 2.0])
        assert found["after_first_period"]["max"] == pytest.approx([2.0, 2.0])
        # 900 of the 1801 samples lie before.
        assert found["whole"]["mae"] == pytest.approx([2.0 * 901 / 1801] * 2)


C1, C2, C3 = "controller_1", "controller_2", "controller_3"


class TestRanking:
    @pytest.mark.parametrize(
        ("errors", "joint", "order", "agrees"),
        [
            ({C1: (1, 1), C2: (2, 2), C3: (3, 3)}, 2, [C1, C2, C3], True),
            ({C1: (1, 2), C2: (2, 1), C3: (3, 3)}, 2, [C1, C2, C3], True),
            ({C1: (1, 2), C2: (2, 1), C3: (3, 3)}, 3, [C2, C1, C3], False),
            ({C1: (1, 1), C2: (1, 2), C3: (3, 3)}, 2, [C1, C2, C3], False),  # equal errors are no order
            ({C1: (1, 1), C2: (1, 2), C3: (3, 3)}, 3, [C1, C2, C3], True),
            ({C1: (1, 1), C3: (3, 3)}, 2, [C1, C3], True),
        ],
    )
    def test_each_joint_has_its_own_order(
        self, errors: dict[str, tuple[float, float]], joint: int, order: list[str], agrees: bool
    ) -> None:
        found = ranking(constant_errors(errors))[f"joint_{joint}"]
        assert found["mae"] == found["rmse"] == {"order": order, "agrees": agrees}

    def test_a_diverged_run_is_last_however_small_its_error_was(self) -> None:
        found = ranking(make_compare_file(diverged={C1: 0.02}))["joint_2"]["mae"]
        assert found["order"][-1] == C1
        assert not found["agrees"]

    def test_two_diverged_runs_agree_with_nothing_and_one_run_has_no_rank(self) -> None:
        file = make_compare_file(diverged={C2: 5.0, C3: 5.0})
        found = ranking(file)
        assert not found["joint_2"]["mae"]["agrees"]
        told = ranking_rows(found, {name: trace.status for name, trace in file.runs.items()})
        assert told[0] == ("joint 2 MAE", "1, 2, 3", "2 and 3 diverged")
        assert ranking(make_compare_file(runs=[C1, "controller_1_payload"])) == {}


class TestDataOfCompare:
    def test_keys_of_the_contract(self) -> None:
        data = table_data_compare(make_compare_file())
        assert list(data["table2"]) == ["controller_1", "controller_2", "controller_3"]
        assert list(data["table3"]) == ["no_load", "with_load"]
        for row in (*data["table2"].values(), *data["table3"].values()):
            assert set(row) == {"mae_deg", "rmse_deg", "max_deg"}
            assert all(len(numbers) == 2 for numbers in row.values())
        assert data["status"] == dict.fromkeys(make_compare_file().runs, "ok")
        assert set(data["windows"]) == {"after_first_period", "period_1", "period_2"}
        assert set(data["windows"]["period_2"]) == set(data["status"])
        json.dumps(data, allow_nan=False)

    def test_missing_runs_leave_their_keys_out_and_a_law_of_the_users_own_is_in_table_2(self) -> None:
        data = table_data_compare(make_compare_file(runs=[C1, C3, "mine"]))
        assert set(data["table2"]) == {C1, C3, "mine"}
        assert set(data["table3"]) == {"no_load"}

    def test_a_number_that_is_not_finite_is_null(self) -> None:
        file = make_compare_file(runs=["controller_1"])
        trace = file.runs["controller_1"]
        broken = with_error(trace, np.full_like(trace["e"], math.nan))
        data = table_data_compare(dataclasses.replace(file, runs={"controller_1": broken}))
        assert data["table2"]["controller_1"]["mae_deg"] == [None, None]


class TestTension:
    """Joint torque that rope of known tension makes is told back as that tension."""

    @staticmethod
    def made(tension: Array, time: Array | None = None) -> tuple[TraceFile, Trace]:
        """A run of joints 2 and 3 whose tendons have some tensions, (T, 2)."""
        file = make_compare_file(runs=["controller_1"])
        trace = file.runs["controller_1"]
        # Tendon 2 turns joint 2 at 38.5 mm; tendon 3 pulls it back at 17.5 mm and turns joint 3 at 18.5 mm.
        torque = np.stack([0.0385 * tension[:, 0] - 0.0175 * tension[:, 1], 0.0185 * tension[:, 1]], axis=1)
        steps = np.arange(len(torque)) * 0.5 if time is None else time
        return file, dataclasses.replace(trace, time=steps, variables={"tau_s": torque})

    def test_of_known_rope(self) -> None:
        tension = np.array([[30.0, 6.0], [20.0, 5.0], [25.0, 7.0]])
        assert tensions(*self.made(tension)) == pytest.approx(tension)
        sizes = tension_sizes(*self.made(tension))
        assert sizes["least"] == pytest.approx([20.0, 5.0])
        assert sizes["at"].tolist() == [0.5, 0.5]
        assert sizes["slack"].tolist() == [0.0, 0.0]

    def test_time_without_pull_counts_pushing_and_slack(self) -> None:
        tension = np.array([[30.0, 0.0], [-1.0, 1e-12], [25.0, 7.0], [-1.0, 7.0]])
        sizes = tension_sizes(*self.made(tension, np.array([0.0, 0.1, 0.4, 1.0])))
        assert sizes["slack"] == pytest.approx([0.3, 0.4]), "what follows the last sample is not known"

    def test_a_run_that_ends_in_numbers_that_are_none(self) -> None:
        tension = np.array([[30.0, 6.0], [20.0, 5.0], [math.nan, 7.0]])
        assert tension_sizes(*self.made(tension))["least"] == pytest.approx([20.0, 5.0])
        assert tension_sizes(*self.made(np.full((2, 2), math.nan))) == {}

    def test_unknown_without_the_torque(self) -> None:
        file, trace = self.made(np.ones((2, 2)))
        measured = dataclasses.replace(trace, variables={"q_d": trace["tau_s"]})
        assert tensions(file, measured) is None
        assert table_data_compare(make_compare_file(without=["tau_s"]))["tension"] == {}

    def test_one_line_names_tendon_run_and_time(self) -> None:
        file, trace = self.made(np.array([[30.0, 6.0], [-2.0, 5.0], [25.0, 7.0]]))
        e = {"e": np.zeros((3, 2)), **trace.variables}
        made = dataclasses.replace(file, runs={"controller_1": dataclasses.replace(trace, variables=e)})
        data = table_data_compare(made) | {"experiment": "compare", "joints": [2, 3], "out": "here"}
        assert data["tension"]["controller_1"]["slack_s"] == pytest.approx([0.5, 0.0])
        (line,) = [one for one in results_text(data | {"growing_hz": {}}).splitlines() if "tension" in one]
        assert line == (
            "Least tension -2.00 N, of tendon 2 in controller_1 at 0.500 s; "
            "not pulling: controller_1 tendon 2 for 0.500 s"
        )


class TestDataOfDecouple:
    def test_keys_of_the_contract(self) -> None:
        data = table_data_decouple(make_decouple_file())
        assert data["S"] == S.tolist()
        assert data["S_inv"] == S_INV.tolist()
        assert list(data["errors"]) == ["joint_1", "joint_2", "joint_3"]
        assert all(set(row) == {"mae_deg", "rmse_deg", "max_deg"} for row in data["errors"].values())
        assert data["status"] == {"decouple": "ok", "pull_tendon_1": "ok"}
        json.dumps(data, allow_nan=False)

    def test_values_are_those_of_calculated_minus_measured(self) -> None:
        file = make_decouple_file()
        trace = file.runs["decouple"]
        shifted = {**trace.variables, "q_calculated": trace["q_encoder"] - np.deg2rad([0.1, 0.2, 0.3])}
        runs = {**file.runs, "decouple": dataclasses.replace(trace, variables=shifted)}
        rows = table_data_decouple(dataclasses.replace(file, runs=runs))["errors"]
        for name, size in (("joint_1", 0.1), ("joint_2", 0.2), ("joint_3", 0.3)):
            assert rows[name] == pytest.approx(dict.fromkeys(("mae_deg", "rmse_deg", "max_deg"), size))
        del runs["decouple"]
        assert table_data_decouple(dataclasses.replace(file, runs=runs))["errors"] == {}
