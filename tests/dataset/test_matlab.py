"""MATLAB files of every version: structs, cells, tables, timeseries and logs as tables of columns."""

import os
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support import matlab_bytes as made

from tendonrepro.dataset.arrays import Unreadable, tables_of
from tendonrepro.dataset.matlab import read_matlab
from tendonrepro.dataset.read import read_file

SAMPLES = Path(os.environ.get("TENDONREPRO_MATLAB_SAMPLES", "nowhere"))
TIMES = np.linspace(0.0, 0.9, 10)
WAVES = np.stack([np.sin(TIMES), np.cos(TIMES)], axis=1)
WRITERS = {
    "5": made.classic,
    "7": partial(made.classic, packed=True),
    "7.3": made.hdf,
    "objects 7": partial(made.objects, version="v7"),
    "objects 7.3": partial(made.objects, version="v7.3"),
}
NESTED = pytest.mark.parametrize("version", ["5", "7", "7.3"])
OBJECTS = pytest.mark.parametrize("version", ["objects 7", "objects 7.3"])


def written(folder, version, **variables):
    tree, _ = read_matlab(WRITERS[version](folder / "SYNTHETIC.mat", variables))
    return tables_of(tree).tables


@NESTED
def test_arrays_and_structs(tmp_path, version):
    run = {"t": TIMES[:, np.newaxis], "q": WAVES, "gain": np.array([[3.0]]), "note": "words"}
    found = written(tmp_path, version, t=TIMES[:, np.newaxis], q_d=WAVES.T, data={"c1": run, "c2": run})
    assert list(found) == ["", "data.c1", "data.c2"]
    assert list(found["data.c1"]) == ["t", "q[1]", "q[2]"]
    assert_array_equal(found["data.c2"]["q[2]"], WAVES[:, 1])
    assert_array_equal(found[""]["q_d[1]"], WAVES[:, 0])


def test_struct_arrays_count_from_one(tmp_path):
    runs = made.records({"t": TIMES, "q2": WAVES[:, 0]}, {"t": TIMES, "q2": WAVES[:, 1]})
    found = written(tmp_path, "5", runs=runs)
    assert_array_equal(found["runs.2"]["q2"], WAVES[:, 1])


def test_structures_with_time(tmp_path):
    signals = made.records({"values": WAVES, "label": "qd"}, {"values": TIMES[:, None], "label": "e2"})
    found = written(tmp_path, "7", log=made.record(time=TIMES[:, None], signals=signals))
    assert list(found["log"]) == ["time (s)", "qd[1]", "qd[2]", "e2"]


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


@OBJECTS
def test_a_dataset_of_simulink(tmp_path, version):
    elements = [
        made.thing(
            "Simulink.SimulationData.Signal",
            Name=name,
            PropagatedName="",
            Values=made.timeseries(k * WAVES[:, :1], TIMES),
        )
        for k, name in enumerate(["q2", "q2_d"], start=1)
    ]
    log = made.thing("Simulink.SimulationData.Dataset", Name="logsout", Elements=made.cells(*elements))
    (found,) = written(tmp_path, version, logsout=log).values()
    assert list(found) == ["time (s)", "q2", "q2_d"]
    assert_array_equal(found["q2_d"], 2.0 * WAVES[:, 0])


@OBJECTS
def test_tables(tmp_path, version):
    rows = pd.to_timedelta(TIMES, unit="s").rename("Time")
    plain = pd.DataFrame({"q": TIMES, "count": np.arange(10, dtype=np.int32), "who": ["a"] * 10})
    found = written(tmp_path, version, plain=plain, timed=pd.DataFrame({"q": TIMES}, index=rows))
    assert set(found["plain"]) >= {"q", "count"}
    assert_allclose(found["timed"]["time (s)"], TIMES, atol=1e-9)


def test_without_the_package_arrays_are_read(tmp_path, monkeypatch):
    monkeypatch.setattr("tendonrepro.dataset.matlab.matio", None)
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


@pytest.mark.parametrize("data", [b"", b"this is no MATLAB file" * 10, b"\x89HDF\r\n\x1a\n"])
def test_other_files_are_refused(tmp_path, data):
    path = tmp_path / "SYNTHETIC.mat"
    path.write_bytes(data)
    with pytest.raises(Unreadable):
        read_file(path, "SYNTHETIC.mat")


@pytest.mark.parametrize("path", sorted(SAMPLES.glob("*.mat")), ids=lambda path: path.name)
def test_files_of_other_labs_are_read_or_refused(path):
    try:
        sources = read_file(path, path.name)
    except Unreadable:
        return
    assert all(source.columns for source in sources)
