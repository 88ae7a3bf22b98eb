"""Traces in other formats hold what the trace file holds; two results differ in what was changed alone."""

from dataclasses import replace
from shutil import copy

import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat
from support.command import answer
from support.synthetic import FEW, make_compare_file

from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results import export
from tendonrepro.results.difference import difference, difference_text
from tendonrepro.results.export import export_traces
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.traces import write_traces

FILE = make_compare_file(**FEW, runs=("controller_1", "controller_2"))
NAME, RUN = next(iter(FILE.runs.items()))


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


def between(folder, first, second):
    """What differs between two files, or files of one run alone."""
    for place, held in (("a", first), ("b", second)):
        file = held if isinstance(held, TraceFile) else replace(FILE, runs={NAME: held})
        write_traces(folder / place / "traces.h5", file)
    return difference(folder / "a", folder / "b")


def with_variables(run: Trace, **variables):
    return replace(run, variables={**run.variables, **variables})


def test_equal_results_differ_in_nothing(folder):
    found = between(folder, FILE, FILE)
    assert found["same"]
    assert not any(found[kind] for kind in ("config", "versions", "runs", "metrics", "traces"))
    assert "have the same" in difference_text(found)


def test_one_changed_sample_is_found_in_trace_and_metric(folder):
    e = RUN["e"].copy()
    e[7, 1] += 1e-3
    found = between(folder, FILE, replace(FILE, runs={**FILE.runs, NAME: with_variables(RUN, e=e)}))
    assert not found["same"]
    (row,) = found["traces"]
    assert (row["run"], row["variable"], row["from_s"]) == (NAME, "e", RUN.time[7])
    assert row["largest"] == pytest.approx(1e-3)
    assert {(row["joint"], row["metric"]) for row in found["metrics"]} >= {(RUN.joint[1], "mae_deg")}
    assert {row["joint"] for row in found["metrics"]} == {RUN.joint[1]}
    assert not found["config"]
    assert "metrics:" in difference_text(found)


def test_changed_key_version_and_status_are_named(folder):
    ringing = replace(RUN, attributes={**RUN.attributes, "status": "ringing"})
    text = FILE.config_yaml + "extra: {value: 3}\n"
    other = replace(FILE, config_yaml=text, tendonrepro_version="9.9", runs={**FILE.runs, NAME: ringing})
    found = between(folder, FILE, other)
    assert found["config"] == [{"key": "extra.value", "first": None, "second": 3}]
    assert [row["key"] for row in found["versions"]] == ["tendonrepro"]
    assert [row["second"] for row in found["runs"]] == ["ringing"]
    assert not found["traces"]


def test_missing_runs_variables_and_samples_are_told(folder):
    kept = {name: values[:-3] for name, values in RUN.variables.items() if name != "s"}
    short = replace(RUN, time=RUN.time[:-3], variables=kept)
    found = between(folder, short, FILE)
    assert {row["key"] for row in found["runs"]} == set(FILE.runs) - {NAME}
    shapes = {row["variable"]: (row["shape_first"][0], row["shape_second"][0]) for row in found["traces"]}
    assert shapes["s"] == (0, len(RUN.time))
    assert shapes["e"] == (len(short.time), len(RUN.time))


@pytest.mark.parametrize(
    ("change", "variable"), [({"time": RUN.time + 0.5}, "time"), ({"joint": (1, 2)}, "joint")]
)
def test_equal_values_at_other_times_or_of_other_joints_differ(folder, change, variable):
    (row,) = between(folder, RUN, replace(RUN, **change))["traces"]
    assert row["variable"] == variable


def test_exit_code_says_whether_anything_differs(folder):
    assert answer("diff", ".", ".", cwd=folder)["same"] is True
    write_traces(folder / "other" / "traces.h5", replace(FILE, tendonrepro_version="9.9"))
    assert answer("diff", ".", "other", cwd=folder, code=1)["same"] is False


def test_missing_samples_are_equal_and_hide_no_change(folder):
    ours = RUN["tau_m"].copy()
    ours[3] = np.nan
    theirs = ours.copy()
    theirs[9, 0] += 0.5
    e = np.where(np.isnan(ours), np.nan, 0.0)
    first, second = (with_variables(RUN, tau_m=values, e=e) for values in (ours, theirs))
    assert between(folder, first, first)["same"]
    (row,) = between(folder, first, second)["traces"]
    assert (row["largest"], row["from_s"]) == (pytest.approx(0.5), RUN.time[9])
