"""Traces in other formats hold what the trace file holds; two results differ in what was changed alone."""

from dataclasses import replace
from shutil import copy

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat
from support.command import answer
from support.synthetic import make_compare_file

from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results import export
from tendonrepro.results.difference import difference, difference_text
from tendonrepro.results.export import export_traces
from tendonrepro.results.traces import write_traces

FILE = make_compare_file(step=0.05, runs=("controller_1", "controller_2"))


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "traces.h5"
    write_traces(path, FILE)
    return path


@pytest.fixture
def folder(tmp_path, stored):
    copy(stored, tmp_path)
    return tmp_path


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_table_holds_every_sample(folder, form):
    path = export_traces(folder, form)
    assert path == folder / f"traces.{form}"
    table = pd.read_csv(path) if form == "csv" else pd.read_parquet(path)
    for name, trace in FILE.runs.items():
        rows = table[table.run == name]
        for k, joint in enumerate(trace.joint):
            own = rows[rows.joint == joint]
            np.testing.assert_array_equal(own.time, trace.time)
            for key, values in trace.variables.items():
                np.testing.assert_array_equal(own[key], values[:, k])


def test_matlab_structures(folder):
    held = loadmat(export_traces(folder / "traces.h5", "mat", folder / "mine.mat"), simplify_cells=True)
    for name, trace in FILE.runs.items():
        np.testing.assert_array_equal(held[name]["time"], trace.time)
        np.testing.assert_array_equal(held[name]["joint"], trace.joint)
        assert held[name]["status"] == trace.status
        for key, values in trace.variables.items():
            np.testing.assert_array_equal(held[name][key], values)
    assert held["units"]["time"] == "s"
    assert held["units"]["tau_m"] == "N m"


def test_what_is_refused(folder, monkeypatch):
    target = export_traces(folder, "csv")
    target.write_text("mine")
    with pytest.raises(UsageError, match="is there already"):
        export_traces(folder, "csv")
    assert target.read_text() == "mine"
    assert export_traces(folder, "csv", force=True).stat().st_size > 1000
    with pytest.raises(UsageError, match="must be one of csv, parquet, mat, found 'xlsx'"):
        export_traces(folder, "xlsx")
    with pytest.raises(UsageError, match=r"of the format mat ends in \.mat, found"):
        export_traces(folder, "mat", folder / "g.csv")
    with pytest.raises(DataMissingError, match=r"nothing\.h5"):
        export_traces(folder / "nothing.h5", "csv")
    monkeypatch.setattr(export, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match="pyarrow") as caught:
        export_traces(folder, "parquet")
    assert "tendonrepro[parquet]" in str(caught.value.hint)
    assert sorted(path.name for path in folder.iterdir()) == ["traces.csv", "traces.h5"]


def changed(folder, **changes):
    """Folder with another trace file, of one run changed."""
    name, trace = next(iter(FILE.runs.items()))
    variables = dict(trace.variables) | changes.pop("variables", {})
    other = replace(
        trace, variables=variables, attributes=dict(trace.attributes) | changes.pop("attributes", {})
    )
    write_traces(
        folder / "other" / "traces.h5", replace(FILE, runs=dict(FILE.runs) | {name: other}, **changes)
    )
    return difference(folder, folder / "other")


def test_equal_results_differ_in_nothing(folder):
    found = changed(folder)
    assert found["same"]
    assert not any(found[kind] for kind in ("config", "versions", "runs", "metrics", "traces"))
    assert "have the same" in difference_text(found)


def test_one_changed_sample_is_found_in_trace_and_metric(folder):
    name, trace = next(iter(FILE.runs.items()))
    e = trace["e"].copy()
    e[7, 1] += 1e-3
    found = changed(folder, variables={"e": e})
    assert not found["same"]
    (row,) = found["traces"]
    assert (row["run"], row["variable"], row["from_s"]) == (name, "e", trace.time[7])
    assert row["largest"] == pytest.approx(1e-3)
    assert {(row["joint"], row["metric"]) for row in found["metrics"]} >= {(trace.joint[1], "mae_deg")}
    assert {row["joint"] for row in found["metrics"]} == {trace.joint[1]}
    assert not found["config"]
    assert "metrics:" in difference_text(found)


def test_changed_key_version_and_status_are_named(folder):
    text = FILE.config_yaml + "extra: {value: 3}\n"
    found = changed(folder, config_yaml=text, tendonrepro_version="9.9", attributes={"status": "ringing"})
    assert found["config"] == [{"key": "extra.value", "first": None, "second": 3}]
    assert [row["key"] for row in found["versions"]] == ["tendonrepro"]
    assert [row["second"] for row in found["runs"]] == ["ringing"]
    assert not found["traces"]


def test_missing_runs_variables_and_samples_are_told(folder):
    name, trace = next(iter(FILE.runs.items()))
    short = replace(
        trace, time=trace.time[:-3], variables={k: v[:-3] for k, v in trace.variables.items() if k != "s"}
    )
    write_traces(folder / "other" / "traces.h5", replace(FILE, runs={name: short}))
    found = difference(folder / "other", folder)
    assert {row["key"] for row in found["runs"]} == set(FILE.runs) - {name}
    shapes = {row["variable"]: (row["shape_first"][0], row["shape_second"][0]) for row in found["traces"]}
    assert shapes["s"] == (0, len(trace.time))
    assert shapes["e"] == (len(short.time), len(trace.time))


@pytest.mark.parametrize(
    ("change", "variable"),
    [(lambda run: {"time": run.time + 0.5}, "time"), (lambda _: {"joint": (1, 2)}, "joint")],
    ids=["time", "joint"],
)
def test_equal_values_at_other_times_or_of_other_joints_differ(folder, change, variable):
    name, trace = next(iter(FILE.runs.items()))
    run = replace(trace, variables={"tau_m": trace["tau_m"]})
    for place, one in (("a", run), ("b", replace(run, **change(run)))):
        write_traces(folder / place / "traces.h5", replace(FILE, runs={name: one}))
    (row,) = difference(folder / "a", folder / "b")["traces"]
    assert row["variable"] == variable


def test_exit_code_says_whether_anything_differs(folder):
    assert answer("diff", ".", ".", cwd=folder)["same"] is True
    changed(folder, tendonrepro_version="9.9")
    assert answer("diff", ".", "other", cwd=folder, code=1)["same"] is False


def test_missing_samples_are_equal_and_hide_no_change(folder):
    name, trace = next(iter(FILE.runs.items()))
    ours = trace["tau_m"].copy()
    ours[3] = np.nan
    theirs = ours.copy()
    theirs[9, 0] += 0.5
    for place, values in (("a", ours), ("b", ours), ("c", theirs)):
        run = replace(trace, variables={"tau_m": values, "e": np.where(np.isnan(values), np.nan, 0.0)})
        write_traces(folder / place / "traces.h5", replace(FILE, runs={name: run}))
    assert difference(folder / "a", folder / "b")["same"]
    (row,) = difference(folder / "a", folder / "c")["traces"]
    assert (row["largest"], row["from_s"]) == (pytest.approx(0.5), trace.time[9])
