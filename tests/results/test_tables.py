"""Tables of known runs: ours, the print, what is plausible, and how each is written."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.synthetic import S_INV, S, make_compare_file, make_decouple_file

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.experiments.run import experiment_result
from tendonrepro.files import shipped
from tendonrepro.results.paper import base_of_paper, with_what_they_are
from tendonrepro.results.paper_tables import COLUMNS, coupling_rows, made_tables, table_data
from tendonrepro.results.records import PlantValue, TraceFile
from tendonrepro.results.tables import Table

PRINT = {
    "controller_1": ("0.261/0.219", "0.311/0.261"),
    "controller_2": ("0.289/0.240", "0.375/0.292"),
    "controller_3": ("0.305/0.266", "0.436/0.349"),
    "no_load": ("0.261/0.219", "0.311/0.261"),
    "with_load": ("0.264/0.227", "0.325/0.265"),
}
"""Tables 2 and 3 as the paper's text shows them: MAE and RMSE."""


def tables_of(file: TraceFile) -> dict[str, Table]:
    return {table.name: table for table in made_tables(file)}


def frame(file: TraceFile, name: str, *index: str) -> pd.DataFrame:
    return pd.DataFrame(list(tables_of(file)[name].rows)).set_index([*index])


def with_plant(file: TraceFile, **arrays: np.ndarray) -> TraceFile:
    known = file.plant.values
    values = {name: replace(known[name], value=array) for name, array in arrays.items()}
    return replace(file, plant=replace(file.plant, values={**known, **values}))


def with_attributes(file: TraceFile, **attributes: object) -> TraceFile:
    runs = {
        name: replace(run, attributes={**run.attributes, **attributes}) for name, run in file.runs.items()
    }
    return replace(file, runs=runs)


def test_table_1_agrees_with_the_print_to_its_digits() -> None:
    found = frame(make_decouple_file(), "table1", "quantity")
    assert len(found) == 18
    assert found["difference"].abs().max() < 0.5e-4
    assert found.loc["D_23/D_3", "printed_as"] == "35/37"
    assert found.loc["S_31", ["printed_as", "ours"]].tolist() == ["0.2479", pytest.approx(-30.0 / 121.0)]
    assert found.loc["S_inv_21", "ours"] == pytest.approx(-35.0 / 37.0)
    part = with_plant(make_decouple_file(), S=S[1:, 1:], S_inv=S_INV[1:, 1:])
    moving = pd.DataFrame(list(coupling_rows(part))).set_index("quantity")
    assert len(moving) == 9
    pd.testing.assert_frame_equal(moving, found.loc[moving.index])


def another(file: TraceFile, what: str) -> TraceFile:
    """The file of another arm, of other joints, with other gains, or of another motion."""
    if what == "motion":
        file = replace(file, config_yaml=file.config_yaml.replace("[8, 8]", "[7, 8]", 1))
    elif what == "arm":
        file = replace(file, plant=replace(file.plant, attributes={"arm": "SYNTHETIC"}))
    elif what == "coupling":
        file = with_plant(file, S=2.0 * S, S_inv=0.5 * S_INV)
    elif what == "gains":
        file = with_attributes(file, gains={"lam": [8.0, 9.0]})
    else:
        file = replace(file, runs={name: replace(run, joint=(1, 2)) for name, run in file.runs.items()})
    return with_what_they_are(file)


@pytest.mark.parametrize("what", ["arm", "coupling", "joints", "gains", "motion"])
def test_the_print_stands_beside_the_paper_s_experiment_alone(what: str) -> None:
    own, other = make_compare_file(step=0.05), another(make_compare_file(step=0.05), what)
    assert "printed" in tables_of(own)["table2"].csv()
    for table in made_tables(other):
        assert not any("printed" in text or "ratio" in text for text in (table.csv(), table.md()))
    data = table_data(other)
    assert [one["agrees"] for metrics in data["ranking"].values() for one in metrics.values()] == [None] * 4
    assert np.isnan(data["printed"]["table2"]["controller_1"]["mae_deg"]).all()


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


@pytest.mark.parametrize("diverged", [False, True])
def test_tables_2_and_3_have_ours_the_print_and_their_ratio_long_and_as_printed(diverged: bool) -> None:
    file = make_compare_file(diverged={"controller_3": 4.0} if diverged else {})
    rows = {"table2": ["controller_1", "controller_2", "controller_3"], "table3": ["no_load", "with_load"]}
    titles = ["Proposed (Controller 1)", "Controller 2", "Controller 3", "No load", "With load"]
    for table, names in rows.items():
        found = frame(file, table, "run" if table == "table2" else "load", "joint")
        assert [*found.index] == [(name, joint) for name in names for joint in (2, 3)]
        markdown, latex = tables_of(file)[table].md(), tables_of(file)[table].tex()
        for name in names:
            run = {"no_load": "controller_1", "with_load": "controller_1_payload"}.get(name, name)
            e = np.rad2deg(file.runs[run]["e"]) * (np.nan if diverged and run == "controller_3" else 1.0)
            sizes = {"mae": np.abs(e).mean(axis=0), "rmse": np.sqrt((e**2).mean(axis=0))}
            cells = [titles.pop(0)]
            for (metric, ours), printed in zip(sizes.items(), PRINT[name], strict=True):
                theirs = [float(number) for number in printed.split("/")]
                assert found.loc[name, f"{metric}_deg"].tolist() == pytest.approx(ours, nan_ok=True)
                assert found.loc[name, f"{metric}_printed_deg"].tolist() == theirs
                assert found.loc[name, f"{metric}_ratio"].tolist() == pytest.approx(
                    ours / theirs, nan_ok=True
                )
                ends = found.loc[name, [f"{metric}_low_deg", f"{metric}_high_deg"]].to_numpy()
                cells.append("/".join("--" if math.isnan(size) else f"{size:.3f}" for size in ours))
                cells += [printed, "/".join(f"{low:.2g}-{high:.2g}" for low, high in ends)]
            cells += [found.loc[name, "status"].iloc[0]] * diverged
            assert f"| {' | '.join(cells)} |" in markdown
            assert rf"{' & '.join(cells)} \\" in latex


def test_windows_and_the_start_that_may_be_left_out() -> None:
    file = make_compare_file(diverged={"controller_2": 10.0, "controller_3": 4.0})
    data, time = table_data(file), file.runs["controller_1"].time
    e = np.abs(np.rad2deg(file.runs["controller_1"]["e"]))
    windows = data["windows"]
    assert [*windows] == ["after_first_period", "period_1", "period_2", "after_2_s"]
    assert windows["period_2"]["controller_1"]["mae_deg"] == pytest.approx(e[900:].mean(axis=0))
    settled = np.sqrt((e[time >= 2.0 - 1e-9] ** 2).mean(axis=0))
    assert windows["after_2_s"]["controller_1"]["rmse_deg"] == pytest.approx(settled)
    reached = [window for window in windows if "controller_2" in windows[window]]
    assert reached == ["after_first_period", "period_1", "after_2_s"]
    assert np.isnan(windows["after_first_period"]["controller_2"]["mae_deg"]).all()
    assert np.isfinite(windows["period_1"]["controller_2"]["mae_deg"]).all()

    late = with_attributes(file, errors_from=5.0)
    found, kept = table_data(late), e[time >= 5.0 - 1e-9].mean(axis=0)
    assert (data["errors_from"], found["errors_from"]) == (0.0, 5.0)
    assert set(windows) ^ set(found["windows"]) == {"whole"}
    assert found["table2"]["controller_1"]["mae_deg"] == pytest.approx(kept)
    assert found["windows"]["whole"]["controller_1"]["mae_deg"] == pytest.approx(e.mean(axis=0))
    assert np.isnan(found["table2"]["controller_3"]["mae_deg"]).all(), "it ended before"
    cells = frame(late, "without_start", "run").loc["Controller 1"]
    for column, sizes in {"whole": e.mean(axis=0), "settled": kept}.items():
        assert cells[f"mae_{column}_pair"] == "/".join(f"{size:.3f}" for size in sizes)
    assert "Controller 2" in frame(file, "without_start", "run").index


def test_the_range_of_plausible_plants_is_that_of_the_ledger() -> None:
    stored = json.loads((shipped("docs") / "results" / "claims.json").read_text())
    boxes = {claim["id"]: claim["evidence"].get("box") for claim in stored["claims"]}
    file = make_compare_file()
    for row in tables_of(file)["table2"].rows:
        for metric in ("mae", "rmse"):
            box = boxes[f"table2.{row['run']}.{metric}.joint_{row['joint']}"]
            assert (row[f"{metric}_low_deg"], row[f"{metric}_high_deg"]) == (box["low"], box["high"])
    assert "mae_low_deg" not in tables_of(another(file, "motion"))["table2"].csv()
    others: list[dict[str, Any]] = [
        {"readings": {"weights": "extrapolating"}},
        {"errors_from": 2.0},
        {"start_offset": [0.0, 0.01]},
        {"friction_scale": 1.2},
    ]
    for other in others:
        table = tables_of(with_attributes(file, **other))["table2"]
        assert not any("mae_low_deg" in row for row in table.rows)
        assert all(row["mae_printed_deg"] for row in table.rows)
        assert "plausible" not in table.md()
    assert sum("plausible" in table.caption for table in made_tables(file)) == 2


def test_motors_have_torque_tension_and_a_limit_by_their_joints() -> None:
    file = make_compare_file()
    limit = PlantValue(np.array([0.0, 4.0, 5.0]), "N m", "test", "limit")
    plant = replace(file.plant, values={**file.plant.values, "actuator_torque_limit": limit})
    found = frame(replace(file, plant=plant), "torque", "run")
    assert {"least_N", "at_s", "slack_s"} <= {*found.columns}
    assert len(found) == 8
    torque = file.runs["controller_1"]["tau_m"]
    rows = found.loc["controller_1"]
    assert rows["rms_Nm"].tolist() == pytest.approx(np.sqrt((torque**2).mean(axis=0)))
    assert rows["peak_Nm"].tolist() == pytest.approx(np.abs(torque).max(axis=0))
    assert rows["step_rms_Nm"].tolist() == pytest.approx(np.sqrt((np.diff(torque, axis=0) ** 2).mean(axis=0)))
    # Power is the same, so motors 2 and 3 give S' tau.
    motors = np.abs(torque @ S[1:, 1:])
    assert rows["at_limit"].tolist() == [(motors[:, 0] >= 4.0).mean(), (motors[:, 1] >= 5.0).mean()]
    assert (rows["at_limit"] > 0.0).all()


def test_numbers_of_the_decoupling_experiment() -> None:
    file = make_decouple_file()
    trace = file.runs["decouple"]
    difference = np.rad2deg(trace["q_calculated"] - trace["q_encoder"])
    sizes = {"mae_deg": np.abs(difference).mean(axis=0), "max_deg": np.abs(difference).max(axis=0)}
    sizes["rmse_deg"] = np.sqrt((difference**2).mean(axis=0))
    found, data = frame(file, "decoupling_errors", "joint"), table_data(file)
    for name, size in sizes.items():
        assert found[name].tolist() == pytest.approx(size)
        assert [data["errors"][f"joint_{joint}"][name] for joint in (1, 2, 3)] == pytest.approx(size)
    assert (data["S"], data["S_inv"]) == (S.tolist(), S_INV.tolist())
    assert data["status"] == {"decouple": "ok", "pull_tendon_1": "ok"}


def test_missing_runs_leave_their_keys_out_and_a_law_of_the_users_own_is_in_table_2() -> None:
    data = table_data(make_compare_file(runs=["controller_1", "controller_3", "mine"]))
    assert set(data["table2"]) == {"controller_1", "controller_3", "mine"}
    assert set(data["table3"]) == {"no_load"}
    assert data["table3"]["no_load"] == data["table2"]["controller_1"]
    assert data["printed"]["table2"]["controller_1"]["mae_deg"] == [0.261, 0.219]


ODD = [{"Name": "a-b|c", "x_1": -1.5}, {"Name": "~^\\", "x_1": None}]
HEADINGS = {"Name": ("Name", ""), "x_1": ("x_1", ".1f")}


def test_latex() -> None:
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


def test_markdown_csv_and_terminal() -> None:
    assert Table("table9", "50 % of S_inv", ODD, HEADINGS).md().splitlines() == [
        "50 % of S_inv",
        "",
        "| Name | x_1 |",
        "| :--- | ---: |",
        r"| a-b\|c | -1.5 |",
        r"| ~^\ | -- |",
    ]
    zero = Table("x", "x", [{"difference": -1e-17}], {"difference": COLUMNS["difference"]})
    assert "| 0.000000 |" in zero.md(), "a zero has no sign"
    rows = [{"a_b": 1.23456789, "fits": True}, {"seeds": [1, 2], "a_b": float("nan")}]
    table = Table("x", "x", rows)
    assert table.csv() == "a_b,fits,seeds\n1.23456789,True,\n,,1; 2\n"
    assert table.text().splitlines()[1:] == ["  a b  fits  seeds", "1.235  yes   --", "   --  --    1, 2"]
    odd = Table("x", "x", [{"name": "q\a", "n": 1}, {"name": "q2", "n": 2}]).text().splitlines()[1:]
    assert len({*map(len, odd)}) == 1, "a control character shifts no column"


def test_the_terminal_shows_tables_and_what_a_linear_loop_tells() -> None:
    file = replace(make_compare_file(), manifest={"growing_hz": {"controller_1": 4.5}})
    text = str(experiment_result(file))
    for table in made_tables(file):
        assert table.text() in text
    assert "controller_1 at 4.5 Hz" in text
