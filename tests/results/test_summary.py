from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from support.synthetic import S_INV, S, make_compare_file, make_decouple_file

from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import (
    decoupling_errors,
    ranking,
    sizes_deg,
    table_data_compare,
    table_data_decouple,
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

    def test_no_sample_left(self) -> None:
        assert np.isnan(sizes_deg(np.full((2, 3), math.nan))["rmse"]).tolist() == [True] * 3

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

    def test_decoupling_errors_are_calculated_minus_measured(self) -> None:
        trace = make_decouple_file().runs["decouple"]
        shifted = {**trace.variables, "q_calculated": trace["q_encoder"] - np.deg2rad([0.1, 0.2, 0.3])}
        sizes = decoupling_errors(dataclasses.replace(trace, variables=shifted))
        for values in sizes.values():
            assert values == pytest.approx([0.1, 0.2, 0.3])


class TestRanking:
    def test_the_printed_order(self) -> None:
        file = constant_errors({"controller_1": (1, 1), "controller_2": (2, 2), "controller_3": (3, 3)})
        for joint in ("joint_2", "joint_3"):
            for metric in ("mae", "rmse"):
                order = ["controller_1", "controller_2", "controller_3"]
                assert ranking(file)[joint][metric] == {"order": order, "agrees": True}

    def test_each_joint_has_its_own_order(self) -> None:
        file = constant_errors({"controller_1": (1, 2), "controller_2": (2, 1), "controller_3": (3, 3)})
        found = ranking(file)
        assert found["joint_2"]["mae"]["agrees"]
        assert found["joint_3"]["mae"] == {
            "order": ["controller_2", "controller_1", "controller_3"],
            "agrees": False,
        }

    def test_equal_errors_are_not_the_printed_order(self) -> None:
        file = constant_errors({"controller_1": (1, 1), "controller_2": (1, 2), "controller_3": (3, 3)})
        assert not ranking(file)["joint_2"]["rmse"]["agrees"]
        assert ranking(file)["joint_3"]["rmse"]["agrees"]

    def test_a_diverged_run_is_last_however_small_its_error_was(self) -> None:
        file = make_compare_file(diverged={"controller_1": 0.02})
        found = ranking(file)["joint_2"]["mae"]
        assert found["order"][-1] == "controller_1"
        assert not found["agrees"]

    def test_two_diverged_runs_agree_with_nothing(self) -> None:
        found = ranking(make_compare_file(diverged={"controller_2": 5.0, "controller_3": 5.0}))
        assert not found["joint_2"]["mae"]["agrees"]

    def test_a_run_less_is_left_out(self) -> None:
        file = constant_errors({"controller_1": (1, 1), "controller_3": (3, 3)})
        assert ranking(file)["joint_2"]["mae"] == {"order": ["controller_1", "controller_3"], "agrees": True}

    def test_one_controller_has_no_rank(self) -> None:
        assert ranking(make_compare_file(runs=["controller_1", "controller_1_payload"])) == {}


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

    def test_values_are_those_of_the_error(self) -> None:
        file = make_compare_file()
        e = np.rad2deg(file.runs["controller_2"]["e"])
        row = table_data_compare(file)["table2"]["controller_2"]
        assert row["mae_deg"] == pytest.approx(np.abs(e).mean(axis=0))
        assert row["rmse_deg"] == pytest.approx(np.sqrt((e**2).mean(axis=0)))
        payload = np.rad2deg(file.runs["controller_1_payload"]["e"])
        loaded = table_data_compare(file)["table3"]["with_load"]
        assert loaded["max_deg"] == pytest.approx(np.abs(payload).max(axis=0))

    def test_missing_runs_leave_their_keys_out(self) -> None:
        data = table_data_compare(make_compare_file(runs=["controller_1", "controller_3"]))
        assert set(data["table2"]) == {"controller_1", "controller_3"}
        assert set(data["table3"]) == {"no_load"}

    def test_a_law_of_the_users_own_is_in_table_2(self) -> None:
        data = table_data_compare(make_compare_file(runs=["controller_1", "mine"]))
        assert set(data["table2"]) == {"controller_1", "mine"}

    def test_a_diverged_run_shows_what_it_reached(self) -> None:
        data = table_data_compare(make_compare_file(diverged={"controller_2": 7.3}))
        assert data["status"]["controller_2"] == "diverged"
        assert data["table2"]["controller_2"]["max_deg"][0] > 10.0
        assert "controller_2" not in data["windows"]["period_1"]

    def test_a_number_that_is_not_finite_is_null(self) -> None:
        file = make_compare_file(runs=["controller_1"])
        trace = file.runs["controller_1"]
        broken = with_error(trace, np.full_like(trace["e"], math.nan))
        data = table_data_compare(dataclasses.replace(file, runs={"controller_1": broken}))
        assert data["table2"]["controller_1"]["mae_deg"] == [None, None]


class TestDataOfDecouple:
    def test_keys_of_the_contract(self) -> None:
        data = table_data_decouple(make_decouple_file())
        assert data["S"] == S.tolist()
        assert data["S_inv"] == S_INV.tolist()
        assert list(data["errors"]) == ["joint_1", "joint_2", "joint_3"]
        assert all(set(row) == {"mae_deg", "rmse_deg", "max_deg"} for row in data["errors"].values())
        assert data["status"] == {"decouple": "ok", "pull_tendon_1": "ok"}
        json.dumps(data, allow_nan=False)

    def test_values_are_those_of_the_difference(self) -> None:
        trace = make_decouple_file().runs["decouple"]
        difference = np.rad2deg(trace["q_calculated"] - trace["q_encoder"])
        rows = table_data_decouple(make_decouple_file())["errors"]
        for index, joint in enumerate((1, 2, 3)):
            expected = np.abs(difference[:, index])
            assert rows[f"joint_{joint}"]["mae_deg"] == pytest.approx(expected.mean())
            assert rows[f"joint_{joint}"]["max_deg"] == pytest.approx(expected.max())

    def test_without_the_run_there_are_no_errors(self) -> None:
        file = make_decouple_file()
        file = dataclasses.replace(file, runs={"pull_tendon_1": file.runs["pull_tendon_1"]})
        assert table_data_decouple(file)["errors"] == {}
