"""Two results differ in what was changed alone."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.command import answer
from support.synthetic import FEW, make_compare_file

import tendonrepro as tr
from tendonrepro.results.difference import difference, difference_text
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.traces import write_traces

FILE = make_compare_file(**FEW, runs=("controller_1", "controller_2"))
OTHER_VERSION = replace(FILE, manifest=FILE.manifest | {"tendonrepro_version": "9.9"})
NAME, RUN = next(iter(FILE.runs.items()))


def between(folder, first, second):
    """What differs between two files, or files of one run alone."""
    for place, held in (("a", first), ("b", second)):
        file = held if isinstance(held, TraceFile) else replace(FILE, runs={NAME: held})
        write_traces(folder / place / "traces.h5", file)
    return difference(folder / "a", folder / "b")


def with_variables(run: Trace, **variables):
    return replace(run, variables={**run.variables, **variables})


def test_one_changed_sample_is_found_in_trace_and_metric(tmp_path):
    e = RUN["e"].copy()
    e[7, 1] += 1e-3
    found = between(tmp_path, FILE, replace(FILE, runs={**FILE.runs, NAME: with_variables(RUN, e=e)}))
    assert not found["same"]
    (row,) = found["traces"]
    assert (row["run"], row["variable"], row["from_s"]) == (NAME, "e", RUN.time[7])
    assert row["largest"] == pytest.approx(1e-3)
    assert {(row["joint"], row["metric"]) for row in found["metrics"]} >= {(RUN.joint[1], "mae_deg")}
    assert {row["joint"] for row in found["metrics"]} == {RUN.joint[1]}
    assert not found["config"]
    assert "metrics:" in difference_text(found)


def test_changed_key_version_and_status_are_named(tmp_path):
    ringing = replace(RUN, attributes={**RUN.attributes, "status": "ringing"})
    text = FILE.config_yaml + "extra: {value: 3, rows: [[1, 2], [3, 4]]}\n"
    other = replace(OTHER_VERSION, config_yaml=text, runs={**FILE.runs, NAME: ringing})
    found = between(tmp_path, FILE, other)
    rows = {"extra.value": 3, "extra.rows.0": [1, 2], "extra.rows.1": [3, 4]}
    assert found["config"] == [{"key": key, "first": None, "second": value} for key, value in rows.items()]
    assert [row["key"] for row in found["versions"]] == ["tendonrepro"]
    assert [row["second"] for row in found["runs"]] == ["ringing"]
    assert not found["traces"]


def test_missing_runs_variables_and_samples_are_told(tmp_path):
    kept = {name: values[:-3] for name, values in RUN.variables.items() if name != "s"}
    short = replace(RUN, time=RUN.time[:-3], variables=kept)
    found = between(tmp_path, short, FILE)
    assert {row["key"] for row in found["runs"]} == set(FILE.runs) - {NAME}
    shapes = {row["variable"]: (row["shape_first"][0], row["shape_second"][0]) for row in found["traces"]}
    assert shapes["s"] == (0, len(RUN.time))
    assert shapes["e"] == (len(short.time), len(RUN.time))


@pytest.mark.parametrize(
    ("change", "variable"), [({"time": RUN.time + 0.5}, "time"), ({"joint": (1, 2)}, "joint")]
)
def test_equal_values_at_other_times_or_of_other_joints_differ(tmp_path, change, variable):
    (row,) = between(tmp_path, RUN, replace(RUN, **change))["traces"]
    assert row["variable"] == variable


def test_a_tolerance_hides_rounding_alone_and_is_zero_between_equal_versions(tmp_path):
    def nudged(share):
        variables = {"e": 1e6 * RUN["e"] * (1.0 + share), "q": RUN["q_d"] * (1.0 + share)}
        return replace(FILE, runs={**FILE.runs, NAME: with_variables(RUN, **variables)})

    base = replace(FILE, runs={**FILE.runs, NAME: with_variables(RUN, q=RUN["q_d"], e=1e6 * RUN["e"])})
    found = between(tmp_path, base, nudged(1e-9))
    assert found["tolerance"] == 0.0
    assert {row["variable"] for row in found["traces"]} == {"e", "q"}
    assert found["metrics"]
    assert difference(tmp_path / "a", tmp_path / "b", 1e-8)["same"]
    assert not difference(tmp_path / "a", tmp_path / "b", 1e-10)["same"]
    other = {"manifest": {**FILE.manifest, "solver": {"name": "compiled"}}}
    found = between(tmp_path, base, replace(nudged(1e-9), **other))
    assert [row["key"] for row in found["versions"]] == ["solver"]
    assert not found["traces"]
    assert not found["metrics"]
    assert between(tmp_path, base, replace(nudged(1e-4), **other))["traces"]


def test_exit_code_says_whether_anything_differs(tmp_path):
    write_traces(tmp_path / "traces.h5", FILE)
    assert answer("result", "diff", ".", ".", cwd=tmp_path)["same"] is True
    write_traces(tmp_path / "other" / "traces.h5", OTHER_VERSION)
    assert answer("result", "diff", ".", "other", cwd=tmp_path, code=1)["same"] is False


def test_missing_samples_are_equal_and_hide_no_change(tmp_path):
    ours = RUN["tau_m"].copy()
    ours[3] = np.nan
    theirs = ours.copy()
    theirs[9, 0] += 0.5
    e = np.where(np.isnan(ours), np.nan, 0.0)
    first, second = (with_variables(RUN, tau_m=values, e=e) for values in (ours, theirs))
    assert between(tmp_path, first, first)["same"]
    (row,) = between(tmp_path, first, second)["traces"]
    assert (row["largest"], row["from_s"]) == (pytest.approx(0.5), RUN.time[9])


def test_an_ensemble_stored_before_version_2_is_the_same_under_the_keys_of_today(tmp_path):
    """Its first population stood at the top, too."""
    box, firm = ({"plants": plants, "readings": [{"name": "printed"}]} for plants in (64, 16))
    summary = {"schema_version": 2, "draws": 64, "populations": {"box": box, "firm": firm}}
    summaries = {"new": summary, "old": {**summary, **box, "schema_version": 1}}
    for name, content in summaries.items():
        (tmp_path / name).mkdir()
        manifest = {"command": "ensemble", "config": {"sha256": "0"}}
        (tmp_path / name / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
        (tmp_path / name / "summary.json").write_text(json.dumps(content), encoding="utf-8")
    assert difference(tmp_path / "old", tmp_path / "new")["same"]
    assert tr.open(tmp_path / "old").data == summary
