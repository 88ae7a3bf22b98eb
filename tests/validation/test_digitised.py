"""Curves read off our own Figure 14: motion and residual come out at their known values. SYNTHETIC."""

import json
from itertools import zip_longest

import numpy as np
import pytest

import tendonrepro as tr
from tendonrepro.console import QUIET
from tendonrepro.dataset.ingestion import run_ingest, run_inspect
from tendonrepro.results.traces import read_traces

MOTION = {"reference.periods": 1, "reference.rise": 1.6, "reference.hold": 0.8}
OFFSET = 0.2
"""By which the errors that are read off differ from our simulation, deg."""
ANGLE_ERROR, ERROR_ERROR = 0.05, 0.01
"""Of a reader with a mouse, one standard deviation, deg."""


@pytest.fixture(scope="module")
def ours():
    file = tr.compare("plain", set=MOTION, controllers=[1]).traces
    return file.runs["controller_1"]


def curves(ours):
    """Points of six curves, as somebody clicks them: unevenly, and not quite on the line."""
    rng = np.random.default_rng(4)
    end = ours.time[-1]
    for number, joint in enumerate(ours.joint):
        for name, key, error, apart in (
            (f"fig14{'ab'[number]} q_d {joint} deg", "q_d", ANGLE_ERROR, 0.0),
            (f"fig14{'cd'[number]} controller 1 e {joint} deg", "e", ERROR_ERROR, OFFSET),
        ):
            count = int(rng.integers(90, 120))
            times = np.sort(np.concatenate([[0.0, end], rng.uniform(0.0, end, count - 2)]))
            exact = np.rad2deg(np.interp(times, ours.time, ours[key][:, number]))
            noise = rng.normal(scale=error, size=count) * (times > 0.0)
            yield name, times, exact + apart + noise


def web_plot_digitizer(folder, held):
    """Its table of all curves: names over pairs of columns, which have their own lengths."""
    columns = []
    for name, times, values in held:
        columns += [[name, "X", *times.tolist()], ["", "Y", *values.tolist()]]
    rows = [",".join(map(str, row)) for row in zip_longest(*columns, fillvalue="")]
    (folder / "SYNTHETIC_all.csv").write_text("\n".join(rows))


def svgdigitizer(folder, held):
    """A data package for each curve."""
    for number, (name, times, values) in enumerate(held):
        path = folder / f"curve_{number}.csv"
        np.savetxt(path, np.column_stack([times, values]), "%.5f", ",", header="t,y", comments="")
        fields = [{"name": key, "type": "number", "unit": unit} for key, unit in (("t", "s"), ("y", "deg"))]
        resource = {"name": name.removesuffix(" deg"), "path": path.name, "schema": {"fields": fields}}
        path.with_suffix(".json").write_text(json.dumps({"resources": [resource]}))


@pytest.fixture(scope="module", params=[web_plot_digitizer, svgdigitizer])
def validated(request, ours, tmp_path_factory):
    """What validate says of a digitised figure, with the folder and the mapping."""
    folder = tmp_path_factory.mktemp("digitised")
    files = folder / "SYNTHETIC"
    files.mkdir()
    request.param(files, list(curves(ours)))
    mapping, measured = folder / "m.yaml", folder / "measured.h5"
    run_inspect([files], mapping, force=True)
    run_ingest([files], mapping, measured, force=True, dry_run=False, talk=QUIET)
    found = tr.validate(measured, "plain", out=folder / "out", force=True).data
    return found, folder, mapping.read_text()


def test_the_motion_is_that_of_the_figure(validated, ours):
    found, folder, mapping = validated
    assert "reading_error_deg" in mapping
    trace = read_traces(folder / "measured.h5").runs["controller_1"]
    apart = np.rad2deg(trace["q_d"][:, 0] - np.interp(trace.time, ours.time, ours["q_d"][:, 0]))
    assert np.sqrt((apart**2).mean()) < ANGLE_ERROR
    motion = np.loadtxt(folder / "out" / "reference.csv", delimiter=",", skiprows=1)
    exact = np.rad2deg(np.interp(motion[:, 0], ours.time, ours["q_d"][:, 0]))
    assert np.abs(motion[:, 1] - exact).max() < 4.0 * ANGLE_ERROR
    assert found["reference"]["joints"] == [2, 3]


def test_the_residual_is_the_known_one_within_its_band(validated):
    rows = {row["joint"]: row for row in validated[0]["residuals"]["rows"]}
    for joint in (2, 3):
        row = rows[joint]
        assert row["e_rms_low_deg"] <= OFFSET <= row["e_rms_high_deg"]
        assert row["e_rms_deg"] == pytest.approx(OFFSET, abs=0.02)
        assert row["e_rms_high_deg"] - row["e_rms_deg"] == pytest.approx(row["reading_error_deg"])
