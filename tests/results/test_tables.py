from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.synthetic import S_INV, S, make_compare_file, make_decouple_file

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.console import without_controls
from tendonrepro.experiments.run import experiment_result
from tendonrepro.files import shipped
from tendonrepro.results.paper import base_of_paper, with_what_they_are
from tendonrepro.results.paper_tables import (
    COLUMNS,
    TableRow,
    controller_rows,
    coupling_rows,
    decoupling_rows,
    load_rows,
    made_tables,
    motor_rows,
    paper_controller_rows,
    paper_load_rows,
    start_rows,
    table_data,
)
from tendonrepro.results.records import PlantRecord, PlantValue, Trace, TraceFile
from tendonrepro.results.summary import ranking, tracking_errors
from tendonrepro.results.tables import Table, rounded


def frame_of(rows: Callable[[TraceFile], Iterator[TableRow]], file: TraceFile) -> pd.DataFrame:
    return pd.DataFrame(list(rows(file)))


def write_tables(file: TraceFile, folder: Path) -> list[Path]:
    return [path for table in made_tables(file) for path in table.write(folder)]


def with_plant(file: TraceFile, **arrays: np.ndarray | None) -> TraceFile:
    """The file with some plant values replaced or, for None, removed."""
    values = dict(file.plant.values)
    for name, array in arrays.items():
        if array is None:
            del values[name]
        else:
            values[name] = dataclasses.replace(values[name], value=array)
    return dataclasses.replace(file, plant=PlantRecord(values, {}))


def test_table_1_agrees_with_the_print_to_its_digits() -> None:
    frame = frame_of(coupling_rows, make_decouple_file()).set_index("quantity")
    assert len(frame) == 18
    assert frame["difference"].abs().max() < 0.5e-4
    assert frame.loc["D_23/D_3", "printed_as"] == "35/37"
    assert frame.loc["S_31", "printed_as"] == "0.2479"
    assert frame.loc["S_31", "ours"] == pytest.approx(-30.0 / 121.0)
    assert frame.loc["S_inv_21", "ours"] == pytest.approx(-35.0 / 37.0)


def test_table_1_of_a_record_of_the_moving_joints_alone() -> None:
    whole = frame_of(coupling_rows, make_decouple_file()).set_index("quantity")
    file = with_plant(make_decouple_file(), S=S[1:, 1:], S_inv=S_INV[1:, 1:])
    part = frame_of(coupling_rows, file).set_index("quantity")
    assert len(part) == 9
    pd.testing.assert_frame_equal(part, whole.loc[part.index])


def another(file: TraceFile, what: str) -> TraceFile:
    """The file of another arm, of other joints, with other gains, or of another motion."""
    if what == "motion":
        other = file.config_yaml.replace("[8, 8]", "[7, 8]", 1)
        return with_what_they_are(dataclasses.replace(file, config_yaml=other))
    if what == "arm":
        plant = PlantRecord(file.plant.values, {"arm": "SYNTHETIC"})
        return with_what_they_are(dataclasses.replace(file, plant=plant))
    if what == "coupling":
        return with_what_they_are(with_plant(file, S=2.0 * S, S_inv=0.5 * S_INV))

    def change(trace: Trace) -> dict[str, Any]:
        if what == "joints":
            return {"joint": (1, 2)}
        return {"attributes": {**trace.attributes, "gains": {"lam": [8.0, 9.0]}}}

    runs = {name: dataclasses.replace(trace, **change(trace)) for name, trace in file.runs.items()}
    return with_what_they_are(dataclasses.replace(file, runs=runs))


@pytest.mark.parametrize(
    "change",
    ["", "manipulator.name=x", "manipulator.routing.winch_diameter=[37, 37, 38]", "control.gains.lam=[8, 9]",
     "runs.controller_1_payload.payload=0.3",
     "runs.controller_2.start_offset={value: [0.5, 0], unit: deg, source: 'assumed: a test'}",
     "runs.controller_2.friction_scale={value: 1.2, unit: '1', source: 'assumed: a test'}"],
)  # fmt: skip
def test_plants_are_of_the_paper_when_their_base_is(change: str) -> None:
    overrides = [f"base.{change}"] if change else ["base.sampling_period=2"]
    assert base_of_paper(load_ensemble(None, overrides=overrides).compare) == (not change)


@pytest.mark.parametrize("what", ["arm", "coupling", "joints", "gains", "motion"])
def test_the_print_stands_beside_the_paper_s_experiment_alone(what: str, tmp_path: Path) -> None:
    file = another(make_compare_file(step=0.05), what)
    assert "printed" in write_tables(make_compare_file(step=0.05), tmp_path)[0].read_text()
    texts = [path.read_text() for path in write_tables(file, tmp_path)]
    assert not any("printed" in text or "ratio" in text for text in texts)
    found = [one["agrees"] for metrics in ranking(file).values() for one in metrics.values()]
    assert found == [None] * 4
    assert all(np.isnan(table_data(file)["printed"]["table2"]["controller_1"]["mae_deg"]))


def test_table_2_has_ours_printed_and_their_ratio() -> None:
    file = make_compare_file()
    frame = frame_of(controller_rows, file).set_index(["run", "joint"])
    assert list(frame.index) == [(f"controller_{k}", joint) for k in (1, 2, 3) for joint in (2, 3)]
    e = np.rad2deg(file.runs["controller_3"]["e"][:, 1])
    row = frame.loc[("controller_3", 3)]
    assert row["mae_deg"] == pytest.approx(np.abs(e).mean())
    assert row["rmse_deg"] == pytest.approx(math.sqrt((e**2).mean()))
    assert (row["mae_printed_deg"], row["rmse_printed_deg"]) == (0.266, 0.349)
    assert row["mae_ratio"] == pytest.approx(np.abs(e).mean() / 0.266)
    assert row["rmse_ratio"] == pytest.approx(math.sqrt((e**2).mean()) / 0.349)
    assert set(frame["status"]) == {"ok"}


def test_errors_over_windows() -> None:
    file = make_compare_file(diverged={"controller_2": 10.0})
    windows = table_data(file)["windows"]
    assert list(windows) == ["after_first_period", "period_1", "period_2", "after_2_s"]
    e = np.rad2deg(file.runs["controller_1"]["e"][900:, 0])
    assert windows["period_2"]["controller_1"]["mae_deg"][0] == pytest.approx(np.abs(e).mean())
    settled = np.rad2deg(file.runs["controller_1"]["e"][file.runs["controller_1"].time >= 2.0 - 1e-9, 0])
    assert windows["after_2_s"]["controller_1"]["rmse_deg"][0] == pytest.approx(
        math.sqrt((settled**2).mean())
    )
    reached = [window for window in windows if "controller_2" in windows[window]]
    assert reached == ["after_first_period", "period_1", "after_2_s"]
    assert np.isnan(windows["after_first_period"]["controller_2"]["mae_deg"]).all()
    assert np.isfinite(windows["period_1"]["controller_2"]["mae_deg"]).all()


def test_the_start_may_be_left_out_of_the_tables() -> None:
    whole = make_compare_file(diverged={"controller_3": 4.0})
    runs = {
        name: dataclasses.replace(trace, attributes=trace.attributes | {"errors_from": 5.0})
        for name, trace in whole.runs.items()
    }
    file, e = dataclasses.replace(whole, runs=runs), whole.runs["controller_1"]["e"]
    data = table_data(file)
    assert (table_data(whole)["errors_from"], data["errors_from"]) == (0.0, 5.0)
    assert set(table_data(whole)["windows"]) ^ set(data["windows"]) == {"whole"}
    kept = np.rad2deg(np.abs(e[whole.runs["controller_1"].time >= 5.0 - 1e-9])).mean(axis=0)
    assert data["table2"]["controller_1"]["mae_deg"] == pytest.approx(kept)
    assert data["windows"]["whole"]["controller_1"]["mae_deg"] == pytest.approx(
        np.rad2deg(np.abs(e)).mean(axis=0)
    )
    assert np.isnan(data["table2"]["controller_3"]["mae_deg"]).all(), "it ended before"
    rows = {row["run"]: row for row in start_rows(file)}
    assert rows["Controller 1"]["mae_settled_pair"] == "/".join(f"{size:.3f}" for size in kept)
    cells = {row["mae_whole_pair"] for row in start_rows(file)}
    assert cells < {row["mae_whole_pair"] for row in start_rows(whole)}


def test_table_3_prints_both_loads() -> None:
    frame = frame_of(load_rows, make_compare_file()).set_index(["load", "joint"])
    assert list(frame.index) == [(load, joint) for load in ("no_load", "with_load") for joint in (2, 3)]
    assert frame["rmse_printed_deg"].tolist() == [0.311, 0.261, 0.325, 0.265]
    assert frame["mae_printed_deg"].tolist() == [0.261, 0.219, 0.264, 0.227]


def test_tables_2_and_3_in_the_paper_s_layout(tmp_path: Path) -> None:
    file = make_compare_file(diverged={"controller_3": 4.0})
    write_tables(file, tmp_path)
    sizes = {name: tracking_errors(trace)["whole"] for name, trace in file.runs.items()}
    # Cells of the print as its text shows them.
    table2 = {
        "Proposed (Controller 1)": ("controller_1", "0.261/0.219", "0.311/0.261", "ok"),
        "Controller 2": ("controller_2", "0.289/0.240", "0.375/0.292", "ok"),
        "Controller 3": ("controller_3", "0.305/0.266", "0.436/0.349", "diverged at 4.00 s"),
    }
    table3 = {
        "No load": ("controller_1", "0.261/0.219", "0.311/0.261", "ok"),
        "With load": ("controller_1_payload", "0.264/0.227", "0.325/0.265", "ok"),
    }
    rows = {"table2": paper_controller_rows(file), "table3": paper_load_rows(file)}
    for stem, expected in (("table2", table2), ("table3", table3)):
        cells = pd.DataFrame(list(rows[stem])).dropna(axis="columns", how="all")
        frame = cells[[name for name in COLUMNS if name in cells]].set_index("paper_row")
        assert list(frame.index) == list(expected)
        md, tex = ((tmp_path / f"{stem}.{suffix}").read_text() for suffix in ("md", "tex"))
        for title, (run, mae, rmse, status) in expected.items():
            row = frame.loc[title]
            assert (row["mae_printed_pair"], row["rmse_printed_pair"], row["status"]) == (mae, rmse, status)
            for metric in ("mae", "rmse"):
                ours = "/".join(rounded(float(x), ".3f") for x in sizes[run][metric])
                assert row[f"{metric}_pair"] == ours
            assert f"| {title} | {' | '.join(row)} |" in md
            assert rf"{title} & {' & '.join(row)} \\" in tex


def test_the_range_of_plausible_plants_is_that_of_the_ledger() -> None:
    stored = json.loads((shipped("docs") / "results" / "claims.json").read_text())
    boxes = {claim["id"]: claim["evidence"].get("box") for claim in stored["claims"]}
    file = make_compare_file()
    for row in controller_rows(file):
        for metric in ("mae", "rmse"):
            box = boxes[f"table2.{row['run']}.{metric}.joint_{row['joint']}"]
            assert (row[f"{metric}_low_deg"], row[f"{metric}_high_deg"]) == (box["low"], box["high"])
    # Table 3 prints Controller 1 of Table 2 again.
    of_2, of_3 = next(controller_rows(file)), next(load_rows(file))
    assert of_2["mae_low_deg"] == of_3["mae_low_deg"]
    assert not any("mae_low_deg" in row for row in controller_rows(another(file, "motion")))
    for other in (
        {"readings": {"weights": "extrapolating"}},
        {"errors_from": 2.0},
        {"start_offset": [0.0, 0.01]},
        {"friction_scale": 1.2},
    ):
        runs = {
            name: dataclasses.replace(trace, attributes={**trace.attributes, **other})
            for name, trace in file.runs.items()
        }
        changed = dataclasses.replace(file, runs=runs)
        rows = controller_rows(changed)
        assert all("mae_low_deg" not in row and row["mae_printed_deg"] > 0.0 for row in rows)
        # Nor does a caption explain what is not there.
        assert not any("plausible" in table.caption for table in made_tables(changed))
    assert sum("plausible" in table.caption for table in made_tables(file)) == 2


def test_motors_have_torque_tension_and_a_limit_by_their_joints() -> None:
    file = make_compare_file()
    limit = PlantValue(np.array([0.0, 4.0, 5.0]), "N m", "test", "limit")
    plant = PlantRecord({**file.plant.values, "actuator_torque_limit": limit}, {})
    frame = frame_of(motor_rows, dataclasses.replace(file, plant=plant))
    assert {"rms_Nm", "least_N", "at_s", "slack_s"} <= set(frame.columns)
    assert len(frame) == 8
    # Power is the same, so motors 2 and 3 give S' tau.
    motors = np.abs(file.runs["controller_1"]["tau_m"] @ S[1:, 1:])
    assert frame["at_limit"][:2].tolist() == [(motors[:, 0] >= 4.0).mean(), (motors[:, 1] >= 5.0).mean()]
    assert (frame["at_limit"] > 0.0).all()


def test_table_of_the_decoupling_experiment() -> None:
    file = make_decouple_file()
    frame = frame_of(decoupling_rows, file).set_index("joint")
    trace = file.runs["decouple"]
    difference = np.rad2deg(trace["q_calculated"] - trace["q_encoder"])
    assert frame["mae_deg"].tolist() == pytest.approx(np.abs(difference).mean(axis=0))
    assert frame["max_deg"].tolist() == pytest.approx(np.abs(difference).max(axis=0))
    assert frame["rmse_deg"].tolist() == pytest.approx(np.sqrt((difference**2).mean(axis=0)))
    assert frame.index.tolist() == [1, 2, 3]
    assert frame_of(decoupling_rows, dataclasses.replace(file, runs={})).empty


ODD = [{"Name": "a-b|c", "x_1": -1.5}, {"Name": "~^\\", "x_1": None}]
HEADINGS = {"Name": ("Name", ""), "x_1": ("x_1", ".1f")}


class TestTypesetting:
    def test_latex(self) -> None:
        assert Table("table9", "50 % of S_inv & <more>", ODD, HEADINGS).tex().splitlines() == [
            r"\begin{table}",
            r"\centering",
            r"\caption{50 \% of S\_inv \& \textless{}more\textgreater{}}",
            r"\label{tab:table9}",
            r"\begin{tabular}{lr}",
            r"\toprule",
            r"Name & x\_1 \\",
            r"\midrule",
            r"a-b|c & $-$1.5 \\",
            r"\textasciitilde{}\textasciicircum{}\textbackslash{} & -- \\",
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
        ]

    def test_markdown(self) -> None:
        assert Table("table9", "50 % of S_inv & <more>", ODD, HEADINGS).md().splitlines() == [
            "50 % of S_inv & <more>",
            "",
            "| Name | x_1 |",
            "| :--- | ---: |",
            r"| a-b\|c | -1.5 |",
            r"| ~^\ | -- |",
        ]
        difference = {"difference": COLUMNS["difference"]}
        assert "| 0.000000 |" in Table("x", "x", [{"difference": -1e-17}], difference).md(), (
            "a zero has no sign"
        )

    def test_columns_come_from_the_rows_where_none_are_given(self) -> None:
        rows = [{"a_b": 1.23456789, "fits": True}, {"seeds": [1, 2], "a_b": float("nan")}]
        assert Table("x", "x", rows).csv() == "a_b,fits,seeds\n1.23456789,True,\n,,1; 2\n"
        assert Table("x", "x", rows).md().splitlines()[2:] == [
            "| a b | fits | seeds |",
            "| ---: | :--- | :--- |",
            "| 1.235 | yes | -- |",
            "| -- | -- | 1, 2 |",
        ]
        shown = ["  a b  fits  seeds", "1.235  yes   --", "   --  --    1, 2"]
        assert Table("x", "x", rows).text().splitlines()[1:] == shown

    def test_control_characters_of_a_name_shift_no_column_of_a_terminal(self) -> None:
        rows = [{"name": "q\a", "n": 1}, {"name": "q2", "n": 2}]
        lines = without_controls(Table("x", "x", rows).text()).splitlines()[1:]
        assert len({*map(len, lines)}) == 1


class TestData:
    def test_numbers_of_the_comparison(self) -> None:
        file = make_compare_file()
        data = table_data(file)
        assert list(data["table2"]) == ["controller_1", "controller_2", "controller_3"]
        assert list(data["table3"]) == ["no_load", "with_load"]
        assert data["table3"]["no_load"] == data["table2"]["controller_1"]
        assert data["status"] == dict.fromkeys(file.runs, "ok")
        assert data["printed"]["table2"]["controller_1"]["mae_deg"] == [0.261, 0.219]
        torque = file.runs["controller_2"]["tau_m"]
        sizes = data["torque"]["controller_2"]
        assert sizes["rms_Nm"] == pytest.approx(np.sqrt((torque**2).mean(axis=0)))
        assert sizes["peak_Nm"] == pytest.approx(np.abs(torque).max(axis=0))
        assert sizes["step_rms_Nm"] == pytest.approx(np.sqrt((np.diff(torque, axis=0) ** 2).mean(axis=0)))

    def test_missing_runs_leave_their_keys_out_and_a_law_of_the_users_own_is_in_table_2(self) -> None:
        data = table_data(make_compare_file(runs=["controller_1", "controller_3", "mine"]))
        assert set(data["table2"]) == {"controller_1", "controller_3", "mine"}
        assert set(data["table3"]) == {"no_load"}

    def test_keys_and_values_of_the_decoupling_experiment(self) -> None:
        file = make_decouple_file()
        trace = file.runs["decouple"]
        shifted = {**trace.variables, "q_calculated": trace["q_encoder"] - np.deg2rad([0.1, 0.2, 0.3])}
        runs = {**file.runs, "decouple": dataclasses.replace(trace, variables=shifted)}
        data = table_data(dataclasses.replace(file, runs=runs))
        assert data["S"] == S.tolist()
        assert data["S_inv"] == S_INV.tolist()
        for name, size in (("joint_1", 0.1), ("joint_2", 0.2), ("joint_3", 0.3)):
            assert data["errors"][name] == pytest.approx(
                dict.fromkeys(("mae_deg", "rmse_deg", "max_deg"), size)
            )
        assert data["status"] == {"decouple": "ok", "pull_tendon_1": "ok"}


def test_the_terminal_shows_what_the_files_hold() -> None:
    growing = {"growing_hz": {"controller_1": 4.5}}
    result = experiment_result(dataclasses.replace(make_compare_file(), manifest=growing))
    text = str(result)
    file = make_compare_file()
    ranking_table = result.tables["ranking"].to_dict("records")
    for row in [*paper_controller_rows(file), *paper_load_rows(file), *ranking_table]:
        assert all(rounded(value) in text for value in row.values())
    assert "controller_1 at 4.5 Hz" in text
