"""MATLAB files of every version: structs, cells, tables, timeseries and logs as tables of columns."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support import matlab_bytes as made

from tendonrepro.dataset.nested import read_matlab
from tendonrepro.dataset.read import read_file

SAMPLES = Path(os.environ.get("TENDONREPRO_MATLAB_SAMPLES", "nowhere"))
TIMES = np.linspace(0.0, 0.9, 10)
WAVES = np.stack([np.sin(TIMES), np.cos(TIMES)], axis=1)
WRITERS = {
    "5": made.classic,
    "7": partial(made.classic, packed=True),
    "objects 7": partial(made.objects, version="v7"),
    "objects 7.3": partial(made.objects, version="v7.3"),
}
NESTED = pytest.mark.parametrize("version", WRITERS)
OBJECTS = pytest.mark.parametrize("version", ["objects 7", "objects 7.3"])


def written(folder, version, **variables):
    read = read_matlab(WRITERS[version](folder / "SYNTHETIC.mat", variables))
    return {table.name: table for table in read if table}


@NESTED
def test_arrays_and_structs(tmp_path, version):
    run = {"t": TIMES[:, np.newaxis], "q": WAVES, "gain": np.array([[3.0]]), "note": "words"}
    found = written(tmp_path, version, t=TIMES[:, np.newaxis], q_d=WAVES.T, data={"c1": run, "c2": run})
    assert list(found) == ["", "data.c1", "data.c2"]
    assert list(found["data.c1"]) == ["t", "q[1]", "q[2]"]
    assert_array_equal(found["data.c2"]["q[2]"], WAVES[:, 1])
    assert_array_equal(found[""]["q_d[1]"], WAVES[:, 0])


MATRICES = np.moveaxis(WAVES.reshape(10, 2, 1) * np.ones(1), 0, -1)


@OBJECTS
@pytest.mark.parametrize(
    ("stored", "times"),
    [
        ({"data": WAVES, "time": TIMES}, TIMES),
        ({"data": WAVES, "uniform": (2.0, 0.5, 10)}, 2.0 + 0.5 * np.arange(10)),
        ({"data": WAVES, "time": TIMES, "time_unit": "milliseconds"}, 1e-3 * TIMES),
        ({"data": WAVES.T, "time": TIMES, "time_first": False}, TIMES),
        ({"data": MATRICES, "time": TIMES, "time_first": False}, TIMES),
        ({"storage": WAVES.T.copy(), "time": TIMES}, TIMES),
    ],
)
def test_timeseries(tmp_path, version, stored, times):
    (found,) = written(tmp_path, version, ts=made.timeseries(**stored, name="q2", unit="deg")).values()
    assert list(found) == ["time (s)", "q2[1] (deg)", "q2[2] (deg)"]
    assert_allclose(found["time (s)"], times)
    assert_array_equal(found["q2[2] (deg)"], WAVES[:, 1])


@OBJECTS
def test_timeseries_of_one_clock_are_one_table(tmp_path, version):
    log = made.record(
        q2=made.timeseries(WAVES[:, :1], TIMES),
        e2=made.timeseries(WAVES[:, 1:], TIMES),
        other=made.timeseries(WAVES, 2.0 * TIMES),
    )
    found = written(tmp_path, version, log=log)
    assert [list(columns) for columns in found.values()] == [
        ["time (s)", "q2", "e2"],
        ["time (s)", "other[1]", "other[2]"],
    ]


def logged(*elements):
    """A data set as MATLAB R2020a to R2025b write it: what its base classes hold lies under ``any``."""
    storage = made.thing(
        "Simulink.SimulationData.Storage.RamDatasetStorage",
        Version=np.array([[2.0]]),
        Elements=np.empty((0, 0), dtype=object),
        any=made.record(Version=np.array([[2.0]]), Elements=made.cells(*elements)),
    )
    base = made.record(Name="logsout", Version=np.array([[3.0]]), Storage=storage)
    return made.thing("Simulink.SimulationData.Dataset", Version_=np.array([[3.0]]), Name="", any=base)


def signal(name, values):
    """An element of a log."""
    path = made.thing("Simulink.SimulationData.BlockPath", path="SYNTHETIC/Plant/Mux")
    return made.thing(
        "Simulink.SimulationData.Signal", PropagatedName="", BlockPath=path, Values=values, Name=name
    )


@OBJECTS
def test_an_output_with_a_bus_and_signals_without_a_name(tmp_path, version):
    bus = made.record(q2=made.timeseries(WAVES[:, :1], TIMES), q3=made.timeseries(WAVES[:, 1:], TIMES))
    elements = signal("desired", bus), signal("", made.timeseries(WAVES[:, :1], TIMES))
    data = made.record(logsout=logged(*elements), tout=TIMES[:, None])
    out = made.thing("Simulink.SimulationOutput", Data=data)
    found = written(tmp_path, version, out=out)
    assert [list(columns) for columns in found.values()] == [
        ["tout"],
        ["time (s)", "desired q2", "desired q3", "Mux"],
    ]


REAL = {
    "simulink_dataset_two_series.mat": {"2026-01-31_16-44-26_MyPilger5_1_F6000": 3953, "doppelsinus": 5013},
    "simulink_simulationoutput_logsout.mat": {
        **dict.fromkeys(["Motor1Vel signal1", "Motor1Pos[1]", "Motor1Pos[2]", "Motor2Pos[2]"], 5001),
        **dict.fromkeys(["Motor1Vel Speed", "Motor1Cur", "Motor2Cur"], 501),
    },
    "simulink_scope_struct.mat": dict.fromkeys(
        ["YAW ANGLE REFERENCE (deg)", "POSITION XY Y CONTROL (m)"], 1501
    ),
    "simulink_out_sigstream.mat": dict.fromkeys(["stream 0", "stream 13"], 304),
}


@pytest.mark.parametrize("name", REAL)
def test_logs_that_simulink_wrote(name):
    if not (SAMPLES / name).exists():
        pytest.skip("no real MATLAB files: see TENDONREPRO_MATLAB_SAMPLES in docs/architecture.md")
    sources, _ = read_file(SAMPLES / name, name)
    found = {column: len(values) for source in sources for column, values in source.items()}
    assert found | REAL[name] == found


def test_dspace_captures_have_a_clock_for_each_raster(tmp_path):
    rasters = {"Fast": TIMES, "Slow": 2.0 * TIMES}
    clocks = made.records(*({"Name": name, "Data": time[None, :]} for name, time in rasters.items()))
    signals = made.records(
        {"Name": '"Model Root"/"Arm"/"q2_d"', "Data": WAVES[:, :1].T, "Unit": "deg", "XIndex": 2.0},
        {"Name": '"Model Root"/"Arm"/"q2"', "Data": WAVES[:, 1:].T, "Unit": "deg", "XIndex": 1.0},
    )
    slow, fast = written(
        tmp_path, "7", run=made.record(X=clocks, Y=signals, Description="SYNTHETIC")
    ).values()
    assert [*slow, *fast] == ["time (s)", "q2_d (deg)", "time (s)", "q2 (deg)"]
    assert_array_equal(slow["time (s)"], 2.0 * TIMES)
    assert_array_equal(fast["q2 (deg)"], WAVES[:, 1])


def test_scopes_with_title_and_legend(tmp_path):
    signals = made.records(
        {
            "values": WAVES,
            "label": made.cells("Time (s)", "Angle (deg)"),
            "title": "JOINT 2 (deg)",
            "legend": made.cells("REFERENCE", "ACTUAL"),
        }
    )
    (found,) = written(tmp_path, "7", log=made.record(time=TIMES[:, None], signals=signals)).values()
    assert list(found) == ["time (s)", "JOINT 2 REFERENCE (deg)", "JOINT 2 ACTUAL (deg)"]


def test_signals_of_three_dimensions_are_columns(tmp_path):
    blocks = np.arange(40.0).reshape(2, 2, 10)
    signals = made.records({"values": blocks, "label": "q"})
    (found,) = written(tmp_path, "7", log=made.record(time=TIMES[:, None], signals=signals)).values()
    assert list(found) == ["time (s)", "q[1,1]", "q[1,2]", "q[2,1]", "q[2,2]"]
    assert_array_equal(found["q[2,1]"], blocks[1, 0])


def test_what_is_no_signal_is_named(tmp_path):
    variables = {"q": WAVES, "gain": np.array([[3.0]]), "short": np.arange(3.0), "wide": np.ones((60, 50))}
    first, *_ = read_matlab(WRITERS["7"](tmp_path / "SYNTHETIC.mat", variables))
    lines = " ".join(first.notes)
    assert all(name in lines for name in ("gain", "short (1×3)", "wide (60×50)"))


@OBJECTS
def test_tables(tmp_path, version):
    rows = pd.to_timedelta(TIMES, unit="s").rename("Time")
    plain = pd.DataFrame({"q": TIMES, "count": np.arange(10, dtype=np.int32), "who": ["a"] * 10})
    found = written(tmp_path, version, plain=plain, timed=pd.DataFrame({"q": TIMES}, index=rows))
    assert set(found["plain"]) >= {"q", "count"}
    assert_allclose(found["timed"]["time (s)"], TIMES, atol=1e-9)


def test_without_the_package_arrays_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("tendonrepro.dataset.nested.matio", None)
    found = written(tmp_path, "objects 7", q=WAVES, ts=made.timeseries(WAVES, TIMES))
    assert list(found[""]) == ["q[1]", "q[2]"]


def test_one_broken_variable_does_not_stop_the_rest(tmp_path, monkeypatch):
    matio = pytest.importorskip("matio")
    whole = matio.load_from_mat

    def failing(path, *, variable_names, **options):
        if "a" in variable_names:
            raise NotImplementedError
        return whole(path, variable_names=variable_names, **options)

    monkeypatch.setattr(matio, "load_from_mat", failing)
    found = written(tmp_path, "objects 7.3", a=made.timeseries(WAVES, TIMES), b=WAVES)
    assert list(found[""]) == ["b[1]", "b[2]"]
