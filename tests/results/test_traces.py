from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray
from numpy.typing import NDArray
from scipy.io import loadmat
from support.synthetic import S_INV, S, make_compare_file, make_decouple_file

from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import sha256_of
from tendonrepro.results import traces
from tendonrepro.results.figures.catalogue import draw
from tendonrepro.results.paper_tables import made_tables
from tendonrepro.results.records import SCHEMA_VERSION, VARIABLES, PlantRecord, PlantValue, TraceFile
from tendonrepro.results.traces import dataset_of, export_traces, read_traces, write_traces

Array = NDArray[np.float64]

TEXTS = [field.name for field in dataclasses.fields(TraceFile) if field.name not in ("runs", "plant")]


def same_bits(a: Array, b: Array) -> bool:
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def assert_same(a: TraceFile, b: TraceFile) -> None:
    assert [getattr(a, name) for name in TEXTS] == [getattr(b, name) for name in TEXTS]
    assert list(a.runs) == list(b.runs)
    for x, y in zip(a.runs.values(), b.runs.values(), strict=True):
        assert (x.name, x.joint) == (y.name, y.joint)
        assert x.attributes == y.attributes
        assert same_bits(x.time, y.time)
        assert list(x.variables) == list(y.variables)
        assert all(same_bits(x[name], y[name]) for name in x.variables)
    assert a.plant.attributes == b.plant.attributes
    assert list(a.plant.values) == list(b.plant.values)
    for name, p in a.plant.values.items():
        q = b.plant.values[name]
        assert same_bits(p.value, q.value)
        assert (p.units, p.source, p.long_name) == (q.units, q.source, q.long_name)


COMPARE = make_compare_file(step=0.05, runs=("controller_1", "controller_2"), diverged={"controller_2": 7.3})
both = pytest.mark.parametrize("file", [COMPARE, make_decouple_file(step=0.05)], ids=["compare", "decouple"])


@pytest.fixture(scope="module")
def compare_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_traces_to(tmp_path_factory.mktemp("compare"), COMPARE)


def write_traces_to(folder: Path, file: TraceFile) -> Path:
    write_traces(folder / "traces.h5", file)
    return folder / "traces.h5"


class TestRoundTrip:
    @both
    def test_what_is_written_is_read(self, file: TraceFile, tmp_path: Path) -> None:
        assert_same(read_traces(write_traces_to(tmp_path, file)), file)

    def test_a_list_of_one_number_stays_a_list(self, tmp_path: Path) -> None:
        single = {"status": "ringing", "status_joints": [3], "gains": {"lam": [8.0]}}
        attributes = COMPARE.runs["controller_1"].attributes | single
        run = dataclasses.replace(COMPARE.runs["controller_1"], attributes=attributes)
        file = dataclasses.replace(COMPARE, runs={"controller_1": run})
        read = read_traces(write_traces_to(tmp_path, file))
        assert_same(read, file)
        assert read.runs["controller_1"].told_status.endswith("joint 3")


def test_equal_contents_give_equal_bytes(compare_path: Path, tmp_path: Path) -> None:
    assert sha256_of(write_traces_to(tmp_path, COMPARE)) == sha256_of(compare_path)


def test_the_layout_is_that_of_the_contract(compare_path: Path) -> None:
    with h5py.File(compare_path) as root:
        expected = {"Conventions": "CF-1.11", "source": "simulated", "schema_version": SCHEMA_VERSION}
        assert {name: root.attrs[name] for name in expected} == expected
        promised = "title tendonrepro_version config_yaml config_sha256 manifest_json created"
        assert set(promised.split()) <= set(root.attrs)
        run = root["controller_1"]
        assert run["joint"][()].tolist() == [2, 3]
        assert run["time"].attrs["units"] == "s"
        for name in COMPARE.runs["controller_1"].variables:
            assert [dim[0].name for dim in run[name].dims] == ["/controller_1/time", "/controller_1/joint"]
            assert (run[name].attrs["units"], run[name].attrs["long_name"]) == VARIABLES[name]
        assert run.attrs["gain_alpha"].tolist() == [0.1, 0.2]
        assert (run.attrs["reading_weights"], run.attrs["reference_period"]) == ("interpolating", 9.0)
    with xarray.open_dataset(compare_path, group="plant") as plant:
        assert (plant["K_s"].shape, plant["gravity"].dims) == ((2, 2), ())
        assert (plant["mass"].attrs["units"], plant["mass"].attrs["source"]) == ("kg", "assumed: test")


@both
def test_netcdf4_reads_it(file: TraceFile, tmp_path: Path) -> None:
    """Warnings are errors throughout the suite, so this also shows that nothing warns."""
    with netCDF4.Dataset(write_traces_to(tmp_path, file)) as root:
        assert root.title == file.title
        for run in file.runs.values():
            group = root[run.name]
            assert set(group.dimensions) == {"time", "joint"}
            assert np.array_equal(group["q"][:], run["q"])
        assert np.allclose(root["plant/S_inv"][:] @ root["plant/S"][:], np.eye(3), atol=1e-15)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5000])


def be_a_csv(path: Path) -> None:
    path.write_text("time,q\n0,1\n")


@pytest.mark.parametrize("damage", [truncate, be_a_csv, Path.unlink])
def test_an_unusable_file_is_missing_data(tmp_path: Path, damage: Callable[[Path], None]) -> None:
    path = write_traces_to(tmp_path, dataclasses.replace(COMPARE, runs={}))
    damage(path)
    with pytest.raises(DataMissingError, match=r"traces\.h5") as caught:
        read_traces(path)
    assert caught.value.exit_code == 4


def test_a_limit_of_the_size_of_files_leaves_the_old_file(tmp_path: Path) -> None:
    """HDF5 itself would end the process, so nothing could be caught."""
    resource = pytest.importorskip("resource", reason="Windows has no such limits")
    path = write_traces_to(tmp_path, dataclasses.replace(COMPARE, runs={}))
    before, (soft, hard) = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before), hard))
    try:
        with pytest.raises(TendonreproError, match=r"traces\.h5") as caught:
            write_traces(path, COMPARE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.exit_code == 1
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [before]


def test_a_full_disk_is_seen_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: used._replace(free=1000))
    with pytest.raises(TendonreproError, match=r"traces\.h5"):
        write_traces(tmp_path / "new" / "traces.h5", COMPARE)
    assert not [*tmp_path.iterdir()]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: used._replace(total=0, free=0))
    write_traces(tmp_path / "traces.h5", COMPARE)


def test_a_file_is_read_where_no_lock_can_be_had(tmp_path: Path) -> None:
    """As on some network file systems; HDF5 asks the system for one, which flock then refuses."""
    write_traces(tmp_path / "traces.h5", COMPARE)
    held = (
        "import fcntl, sys; from pathlib import Path; from tendonrepro.results.traces import read_traces\n"
        "with open(sys.argv[1], 'rb') as file:\n"
        "    fcntl.flock(file, fcntl.LOCK_EX)\n"
        "    print(*read_traces(Path(sys.argv[1])).runs)"
    )
    done = subprocess.run(
        [sys.executable, "-c", held, str(tmp_path / "traces.h5")], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == list(COMPARE.runs)


def test_runs_of_a_version_that_did_not_say_what_they_are_say_it_when_read(tmp_path: Path) -> None:
    said = ("printed_row", "unloaded_run", "fitted_under")
    file = make_compare_file(step=0.05)
    assert file.runs["controller_2"].attributes["printed_row"] == "table2.controller_2"
    loaded = file.runs["controller_1_payload"].attributes
    assert (loaded["printed_row"], loaded["unloaded_run"]) == ("table3.with_load", "controller_1")
    silent = {
        name: dataclasses.replace(run, attributes={k: v for k, v in run.attributes.items() if k not in said})
        for name, run in file.runs.items()
    }
    write_traces(tmp_path / "traces.h5", dataclasses.replace(file, runs=silent))
    assert_same(read_traces(tmp_path), file)


def test_another_layout_is_named(tmp_path: Path) -> None:
    path = write_traces_to(tmp_path, dataclasses.replace(COMPARE, runs={}))
    with h5py.File(path, "r+") as root:
        root.attrs["schema_version"] = 7
    with pytest.raises(DataMissingError, match="7"):
        read_traces(path)


@pytest.fixture
def folder(tmp_path: Path, compare_path: Path) -> Path:
    shutil.copy(compare_path, tmp_path)
    return tmp_path


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_table_holds_every_sample(folder: Path, form: str) -> None:
    path = export_traces(folder, form)
    assert path == folder / f"traces.{form}"
    # From 3.1 on that is the default, and to ask for it a warning.
    older = tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1)
    exact: Any = {"float_precision": "round_trip"} if older else {}
    table = pd.read_csv(path, **exact) if form == "csv" else pd.read_parquet(path)
    for name, trace in COMPARE.runs.items():
        rows = table[table.run == name]
        for k, joint in enumerate(trace.joint):
            own = rows[rows.joint == joint]
            np.testing.assert_array_equal(own.time, trace.time)
            for key, values in trace.variables.items():
                np.testing.assert_array_equal(own[key], values[:, k])


def test_matlab_structures(folder: Path) -> None:
    held = loadmat(export_traces(folder / "traces.h5", "mat", folder / "mine.mat"), simplify_cells=True)
    for name, trace in COMPARE.runs.items():
        np.testing.assert_array_equal(held[name]["time"], trace.time)
        np.testing.assert_array_equal(held[name]["joint"], trace.joint)
        assert held[name]["status"] == trace.status
        for key, values in trace.variables.items():
            np.testing.assert_array_equal(held[name][key], values)
    assert held["units"]["time"] == "s"
    assert held["units"]["tau_m"] == "N m"


def test_what_is_not_exported(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = export_traces(folder, "csv")
    target.write_text("mine")
    with pytest.raises(UsageError, match="is there already"):
        export_traces(folder, "csv")
    assert target.read_text() == "mine"
    assert export_traces(folder, "csv", force=True).stat().st_size > 1000
    with pytest.raises(UsageError, match="xlsx"):
        export_traces(folder, "xlsx")
    with pytest.raises(UsageError, match=r"of the format mat ends in \.mat, found"):
        export_traces(folder, "mat", folder / "g.csv")
    with pytest.raises(DataMissingError, match=r"nothing\.h5"):
        export_traces(folder / "nothing.h5", "csv")
    monkeypatch.setattr(traces, "find_spec", lambda _: None)
    with pytest.raises(UsageError, match="pyarrow") as caught:
        export_traces(folder, "parquet")
    assert "tendonrepro[parquet]" in str(caught.value.hint)
    assert sorted(path.name for path in folder.iterdir()) == ["traces.csv", "traces.h5"]


def test_the_block_of_the_distal_joints_is_itself_an_inverse() -> None:
    arrays = {"S": S, "S_inv": S_INV, "K_s": S[1:, 1:]}
    record = PlantRecord({name: PlantValue(value, "1", "", "") for name, value in arrays.items()}, {})
    assert record.matrix("S", (2, 3)) @ record.matrix("S_inv", (2, 3)) == pytest.approx(np.eye(2), abs=1e-15)
    assert record.matrix("S_inv", (2, 3))[1] == pytest.approx([-35.0 / 37.0, 1.0])
    assert same_bits(record.matrix("K_s", (2, 3)), S[1:, 1:]), "one of the moving joints is taken as it is"
    assert same_bits(record.matrix("S", (1, 2, 3)), S)


def test_errors_of_motors_are_not_told_as_those_of_joints(tmp_path: Path) -> None:
    """In the file, in a dataset, above the tables and below the figures."""
    runs = {
        name: dataclasses.replace(run, attributes={**run.attributes, "readings": {"feedback": "motor"}})
        for name, run in COMPARE.runs.items()
    }
    of_motors, told = dataclasses.replace(COMPARE, runs=runs), []
    for file in (COMPARE, of_motors):
        with h5py.File(write_traces_to(tmp_path, file)) as stored:
            told.append({name: item.attrs["long_name"] for name, item in stored["controller_1"].items()})
        items = dataset_of(file.runs["controller_1"]).items()
        assert {str(name): item.attrs["long_name"] for name, item in items}.items() <= told[-1].items()
    assert {name for name in told[0] if told[0][name] != told[1][name]} == {"e", "q_encoder"}
    captions = [{table.name: table.caption for table in made_tables(file)} for file in (COMPARE, of_motors)]
    changed = {name for name in captions[0] if captions[0][name] != captions[1][name]}
    assert changed == {"table2", "table3", "without_start"}
    assert draw("fig14", COMPARE).caption != draw("fig14", of_motors).caption
