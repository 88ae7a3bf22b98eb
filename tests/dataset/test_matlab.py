"""MATLAB files of every version: what was written is what is read, and nothing else breaks."""

from __future__ import annotations

import os
import struct
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from support import ROOT
from support import matlab_bytes as made

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.guard import Limits, read_guarded
from tendonrepro.dataset.readers.matlab.file import read_matlab
from tendonrepro.dataset.readers.matlab.objects import load_objects, quiet
from tendonrepro.dataset.readers.matlab.walk import Walk
from tendonrepro.dataset.readers.signals import Found, Signal, Source, Unreadable

SAMPLES = Path(os.environ.get("TENDONREPRO_MATLAB_SAMPLES", ROOT / "tests/matlab_samples"))
TIMES = np.linspace(0.0, 0.9, 10)
HEAD = b"MATLAB 5.0 MAT-file, SYNTHETIC".ljust(116) + bytes(8) + b"\x00\x01IM"
WAVES = np.stack([np.sin(TIMES), np.cos(TIMES)], axis=1)


def signals(found: Found) -> dict[str, Signal]:
    return {signal.path: signal for signal in found.signals}


def skipped(found: Found) -> dict[str, str]:
    return {part.path: f"{part.reason}; {part.advice}" for part in found.skipped}


def sample(name: str) -> Found:
    path = SAMPLES / name
    if not path.exists():
        pytest.skip("needs the files written by MATLAB itself")
    return read_matlab(path)


# --- plain values ---------------------------------------------------------------------------------


def writers() -> dict[str, Callable[[Path, Mapping[str, Any]], Path]]:
    return {
        "5": made.classic,
        "7": lambda path, variables: made.classic(path, variables, packed=True),
        "4": lambda path, variables: made.classic(path, variables, version="4"),
        "7.3": made.hdf,
    }


@pytest.mark.parametrize("version", ["4", "5", "7", "7.3"])
def test_plain_arrays_of_every_version(tmp_path: Path, version: str) -> None:
    path = writers()[version](
        tmp_path / "SYNTHETIC.mat", {"t": TIMES[:, None], "q": WAVES, "row": TIMES[None, :]}
    )
    found = read_matlab(path)
    assert found.kind == f"MATLAB {version}"
    got = signals(found)
    assert list(got) == ["t", "q", "row"] if version != "7.3" else sorted(got) == ["q", "row", "t"]
    np.testing.assert_array_equal(got["t"].values, TIMES)
    np.testing.assert_array_equal(got["q"].values, WAVES)
    np.testing.assert_array_equal(got["row"].values, TIMES)
    assert got["q"].time is None
    assert got["q"].group == ""
    assert not found.skipped


@pytest.mark.parametrize("version", ["5", "7", "7.3"])
@pytest.mark.parametrize("kind", ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "float32"])
def test_types_are_told_as_stored(tmp_path: Path, version: str, kind: str) -> None:
    values = np.array([[0, 1, 100, 7, 3]], kind)
    got = signals(read_matlab(writers()[version](tmp_path / "SYNTHETIC.mat", {"counts": values})))["counts"]
    assert got.dtype == kind
    np.testing.assert_array_equal(got.values, values.ravel())


@pytest.mark.parametrize("version", ["5", "7", "7.3"])
def test_structs_cells_and_texts(tmp_path: Path, version: str) -> None:
    inner = {"q": WAVES, "unit": "deg"}
    run: dict[str, Any] = {"log": inner, "title": "payload 0.2 kg"}
    cell = [TIMES[:, None], "note", {"e": TIMES[:, None]}]
    stored = {"run": run, "c": cell if version == "7.3" else made.cells(*cell)}
    found = read_matlab(writers()[version](tmp_path / "SYNTHETIC.mat", stored))
    got = signals(found)
    assert set(got) == {"run/log/q", "c[1]", "c[3]/e"}
    assert got["run/log/q"].group == "run/log"
    assert found.texts == {"run/log/unit": "deg", "run/title": "payload 0.2 kg", "c[2]": "note"}


def test_struct_arrays_count_from_one(tmp_path: Path) -> None:
    runs = ({"q": k * WAVES, "load": 0.2 * k, "name": f"run {k}"} for k in (1.0, 2.0))
    found = read_matlab(made.classic(tmp_path / "SYNTHETIC.mat", {"data": made.records(*runs)}))
    got = signals(found)
    assert set(got) == {"data[1]/q", "data[2]/q", "data/load"}
    np.testing.assert_array_equal(got["data[2]/q"].values, 2.0 * WAVES)
    np.testing.assert_array_equal(got["data/load"].values, [0.2, 0.4])
    assert got["data[1]/q"].group == "data[1]"
    assert found.texts == {"data[1]/name": "run 1.0", "data[2]/name": "run 2.0"}


@pytest.mark.parametrize("many", [False, True])
def test_structure_with_time(tmp_path: Path, many: bool) -> None:
    logged = [{"values": WAVES, "dimensions": 2.0, "label": "q"}]
    if many:
        # A vector signal of two, logged as 1x2 matrices.
        stacked = np.moveaxis(WAVES[:, None, :], 0, -1)
        logged.append({"values": stacked, "dimensions": np.array([[1.0, 2.0]]), "label": "qd"})
    logged[0]["blockName"] = "m/Controller 1"
    for element in logged[1:]:
        element["blockName"] = "m/Reference"
    simout = made.record(time=TIMES[:, None], signals=made.records(*logged), blockName="m/To Workspace")
    found = read_matlab(made.classic(tmp_path / "SYNTHETIC.mat", {"simout": simout}))
    got = signals(found)
    place = "simout/signals[1]" if many else "simout/signals"
    assert found.texts[f"{place}/blockName"] == "m/Controller 1"
    assert found.texts["simout/blockName"] == "m/To Workspace"
    first = got["simout/signals[1]/values" if many else "simout/signals/values"]
    assert (first.label, first.group) == ("q", "simout")
    assert first.time is not None
    np.testing.assert_array_equal(first.time, TIMES)
    np.testing.assert_array_equal(first.values, WAVES)
    if many:
        np.testing.assert_array_equal(got["simout/signals[2]/values"].values, WAVES)


def test_structure_without_time_keeps_its_values(tmp_path: Path) -> None:
    simout = made.record(time=made.EMPTY, signals=made.record(values=WAVES, label="q"))
    got = signals(read_matlab(made.classic(tmp_path / "SYNTHETIC.mat", {"simout": simout})))
    assert got["simout/signals/values"].time is None


numbers = arrays(
    st.sampled_from([np.float64, np.float32, np.int16, np.uint8, np.int32]),
    array_shapes(min_dims=2, max_dims=2, min_side=2, max_side=5),
)
names = st.from_regex(r"[a-zA-Z][a-zA-Z0-9_]{0,20}", fullmatch=True)


@given(variables=st.dictionaries(names, numbers, min_size=1, max_size=4), packed=st.booleans())
def test_what_is_written_is_read(tmp_path_factory: Any, variables: dict[str, Any], packed: bool) -> None:
    path = tmp_path_factory.mktemp("mat") / "SYNTHETIC.mat"
    # A name of 22 letters is none that is drawn.
    found = read_matlab(made.classic(path, {**variables, "s" * 22: variables}, packed=packed))
    got = signals(found)
    assert len(got) == 2 * len(variables)
    for name, values in variables.items():
        for place in (name, f"{'s' * 22}/{name}"):
            np.testing.assert_array_equal(got[place].values, values.astype(float))
            assert got[place].dtype == str(values.dtype)
    assert not found.skipped


def test_files_of_big_endian_machines(tmp_path: Path) -> None:
    """Byte by byte; nothing at hand writes them."""

    def part(kind: int, body: bytes) -> bytes:
        return struct.pack(">II", kind, len(body)) + body + bytes(-len(body) % 8)

    flags, shape = part(6, struct.pack(">II", 6, 0)), part(5, struct.pack(">ii", 10, 1))
    matrix = part(14, flags + shape + part(1, b"t") + part(9, TIMES.astype(">f8").tobytes()))
    (tmp_path / "SYNTHETIC_5.mat").write_bytes(HEAD[:124] + b"\x01\x00MI" + matrix)
    old = struct.pack(">5I", 1000, 10, 1, 0, 2) + b"t\0" + TIMES.astype(">f8").tobytes()
    (tmp_path / "SYNTHETIC_4.mat").write_bytes(old)
    for version in "54":
        found = read_matlab(tmp_path / f"SYNTHETIC_{version}.mat")
        assert found.kind == f"MATLAB {version}"
        np.testing.assert_array_equal(signals(found)["t"].values, TIMES)


# --- objects --------------------------------------------------------------------------------------

VERSIONS = pytest.mark.parametrize("version", ["v7", "v7.3"])


@VERSIONS
def test_timeseries(tmp_path: Path, version: str) -> None:
    series = made.timeseries(WAVES, TIMES, name="q2", unit="deg")
    found = read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"ts": series}, version))
    got = signals(found)["ts"]
    assert (got.label, got.unit) == ("q2", "deg")
    np.testing.assert_array_equal(got.values, WAVES)
    np.testing.assert_array_equal(got.time, TIMES)
    assert not found.skipped


@VERSIONS
@pytest.mark.parametrize(
    ("stored", "times"),
    [
        ({"uniform": (2.0, 0.5, len(WAVES))}, 2.0 + 0.5 * np.arange(len(WAVES))),
        ({"time": 1000.0 * TIMES, "time_unit": "milliseconds"}, TIMES),
    ],
)
def test_times_of_a_timeseries(tmp_path: Path, version: str, stored: dict[str, Any], times: Any) -> None:
    series = made.timeseries(WAVES, **stored)
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"ts": series}, version)))["ts"]
    np.testing.assert_allclose(got.time, times)


@pytest.mark.parametrize("matrix", [False, True])
def test_timeseries_with_time_last(tmp_path: Path, matrix: bool) -> None:
    stored = np.moveaxis(WAVES.reshape(10, 2, 1) * np.ones(3), 0, -1) if matrix else WAVES.T
    series = made.timeseries(stored, TIMES, time_first=False)
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"ts": series}, "v7")))["ts"]
    expected = np.tile(WAVES, 3) if matrix else WAVES
    np.testing.assert_array_equal(got.values, expected)
    assert ("column by column" in got.note) == matrix


def test_square_timeseries_follow_their_own_word(tmp_path: Path) -> None:
    square = np.arange(9.0).reshape(3, 3)
    for time_first, expected in ((True, square), (False, square.T)):
        series = made.timeseries(square, [0.0, 1.0, 2.0], time_first=time_first)
        got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"ts": series}, "v7")))["ts"]
        np.testing.assert_array_equal(got.values, expected)


@VERSIONS
@pytest.mark.parametrize("stored", [WAVES.T, np.arange(9.0).reshape(3, 3), TIMES[None, :]])
def test_streaming_storage_is_turned(tmp_path: Path, version: str, stored: np.ndarray) -> None:
    series = made.timeseries(None, TIMES[: stored.shape[1]], storage=stored.copy())
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"ts": series}, version)))["ts"]
    np.testing.assert_array_equal(got.values, np.squeeze(stored.T))
    np.testing.assert_array_equal(got.time, TIMES[: stored.shape[1]])


@VERSIONS
def test_struct_of_timeseries(tmp_path: Path, version: str) -> None:
    log = made.record(q=made.timeseries(WAVES, TIMES), e=made.timeseries(0.1 * WAVES, TIMES))
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"log": log}, version)))
    assert {path: signal.group for path, signal in got.items()} == {"log/q": "log", "log/e": "log"}


def dataset(*named: tuple[str, Any]) -> Any:
    elements = [
        made.thing("Simulink.SimulationData.Signal", Name=name, PropagatedName="", Values=values)
        for name, values in named
    ]
    return made.thing("Simulink.SimulationData.Dataset", Name="logsout", Elements=made.cells(*elements))


@VERSIONS
def test_dataset(tmp_path: Path, version: str) -> None:
    series = [made.timeseries(k * WAVES, TIMES, unit="rad") for k in (1.0, 2.0, 3.0)]
    log = dataset(("q2", series[0]), ("q2", series[1]), ("", series[2]))
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"logsout": log}, version)))
    assert set(got) == {"logsout/q2", "logsout/q2 (2)", "logsout/element 3"}
    assert got["logsout/q2"].label == "q2"
    assert got["logsout/q2"].unit == "rad"
    np.testing.assert_array_equal(got["logsout/q2 (2)"].values, 2.0 * WAVES)


@VERSIONS
def test_the_block_of_a_logged_signal(tmp_path: Path, version: str) -> None:
    element = made.thing(
        "Simulink.SimulationData.Signal",
        Name="q2",
        BlockPath=made.record(Path="m/Controller 1/arm"),
        Values=made.timeseries(WAVES, TIMES),
    )
    log = made.thing("Simulink.SimulationData.Dataset", Elements=made.cells(element))
    found = read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"logsout": log}, version))
    assert set(signals(found)) == {"logsout/q2"}
    assert found.texts == {"logsout/q2/block": "m/Controller 1/arm"}


@VERSIONS
def test_simulation_output(tmp_path: Path, version: str) -> None:
    structure = made.record(
        time=TIMES[:, None], signals=made.record(values=WAVES, dimensions=2.0, label="tau")
    )
    data = made.record(tout=TIMES[:, None], ts=made.timeseries(WAVES, TIMES), simout=structure)
    out = made.thing("Simulink.SimulationOutput", Data=data, Metadata=made.record(stop=10.0))
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"out": out}, version)))
    assert {"out/tout", "out/ts", "out/simout/signals/values"} <= set(got)
    np.testing.assert_array_equal(got["out/simout/signals/values"].time, TIMES)
    assert not any("stop" in path for path in got)


@VERSIONS
def test_tables(tmp_path: Path, version: str) -> None:
    import pandas as pd

    rows = pd.to_timedelta(TIMES, unit="s").rename("Time")
    stored = {
        "plain": pd.DataFrame({"q": TIMES, "count": np.arange(10, dtype=np.int32), "who": ["a"] * 10}),
        "timed": pd.DataFrame({"q": TIMES}, index=rows),
    }
    found = read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", stored, version))
    got = signals(found)
    assert set(got) == {"plain/q", "plain/count", "timed/q"}
    assert (got["plain/q"].label, got["plain/q"].group, got["plain/q"].values.ndim) == ("q", "plain", 1)
    np.testing.assert_allclose(got["timed/q"].time, TIMES, atol=1e-9)
    assert "plain/who" in skipped(found)


@VERSIONS
def test_dates_are_counted_from_the_first(tmp_path: Path, version: str) -> None:
    dates = np.datetime64("2026-03-01T10:00:00", "ns") + (TIMES * 1e9).astype("timedelta64[ns]")
    stored = {"when": dates[:, None], "since": (TIMES * 1e9).astype("timedelta64[ns]")[:, None]}
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", stored, version)))
    for name, note in (("when", "2026-03-01"), ("since", "durations")):
        np.testing.assert_allclose(got[name].values, TIMES, atol=1e-6)
        assert got[name].unit == "s"
        assert note in got[name].note


@VERSIONS
def test_a_log_with_nothing_inside_says_so(tmp_path: Path, version: str) -> None:
    log = made.thing("Simulink.SimulationData.Dataset", Name="logsout", Elements=made.EMPTY)
    found = read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"logsout": log}, version))
    assert "without signals" in skipped(found)["logsout"]


@VERSIONS
def test_user_classes_show_their_numbers(tmp_path: Path, version: str) -> None:
    rig = made.thing("lab.Rig", angle=WAVES, gains=made.record(kp=np.array([[1.0, 2.0]])))
    got = signals(read_matlab(made.objects(tmp_path / "SYNTHETIC.mat", {"rig": rig}, version)))
    assert set(got) == {"rig/angle", "rig/gains/kp"}


def test_plain_members_survive_without_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = made.record(ts=made.timeseries(WAVES, TIMES), raw=WAVES)
    path = made.objects(tmp_path / "SYNTHETIC.mat", {"log": log, "q": WAVES, "ts": log["ts"][0, 0]}, "v7")
    monkeypatch.setitem(sys.modules, "matio", None)
    found = read_matlab(path)
    assert set(signals(found)) == {"log/raw", "q"}
    assert "-struct" in skipped(found)["log/ts"]
    assert "mat-io" in skipped(found)["ts"]


def test_plain_7_3_files_need_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers, structs, cells and texts are the same with mat-io and without."""
    values = {
        "t": TIMES[:, np.newaxis],
        "count": np.arange(40, dtype=np.int16).reshape(4, 10),
        "run": {"q": WAVES, "deep": {"note": "Controller 1", "e": WAVES[:, :1]}},
        "cell": [WAVES, {"x": TIMES[:, np.newaxis]}, "text"],
    }
    path = made.hdf(tmp_path / "SYNTHETIC.mat", values)
    whole = read_matlab(path)
    monkeypatch.setitem(sys.modules, "matio", None)
    alone = read_matlab(path)
    ours, theirs = signals(alone), signals(whole)
    assert set(ours) == set(theirs)
    for name, signal in ours.items():
        np.testing.assert_array_equal(signal.values, theirs[name].values)
        assert signal.dtype == theirs[name].dtype
    assert alone.texts == whole.texts
    assert len(ours) == 6


def test_objects_of_7_3_files_need_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made.objects(tmp_path / "SYNTHETIC.mat", {"q": WAVES, "ts": made.timeseries(WAVES, TIMES)}, "v7.3")
    monkeypatch.setitem(sys.modules, "matio", None)
    found = read_matlab(path)
    assert set(signals(found)) == {"q"}
    assert "mat-io" in skipped(found)["ts"]


def test_one_broken_object_does_not_stop_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = made.objects(tmp_path / "SYNTHETIC.mat", {"a": made.timeseries(WAVES, TIMES), "b": WAVES}, "v7.3")
    import matio

    whole = matio.load_from_mat

    def failing(path: str, *, variable_names: list[str], **options: Any) -> Any:
        if "a" in variable_names:
            message = "broken"
            raise NotImplementedError(message)
        return whole(path, variable_names=variable_names, **options)

    monkeypatch.setattr(matio, "load_from_mat", failing)
    found = read_matlab(path)
    assert list(signals(found)) == ["b"]
    assert "broken" in skipped(found)["a"]


# --- streamed logs --------------------------------------------------------------------------------


def test_streams_with_their_times_and_no_names(tmp_path: Path) -> None:
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {"x": TIMES}, [TIMES, WAVES, TIMES, np.arange(10.0)])
    got = signals(read_matlab(path))
    assert set(got) == {"x", "#sigstream#/1", "#sigstream#/3"}
    np.testing.assert_array_equal(got["#sigstream#/1"].values, WAVES)
    np.testing.assert_array_equal(got["#sigstream#/1"].time, TIMES)
    assert "without its name" in got["#sigstream#/1"].note


def test_streams_with_names(tmp_path: Path) -> None:
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {}, [WAVES[:, 0], TIMES, WAVES[:, 1]])
    with h5py.File(path, "r+") as file:
        for signal in (made.streamed_signal("q2", 0, (1.0, 0.1, 10.0)), made.streamed_signal("free", 2)):
            made.put(file, file["#refs#"], signal["Name"] + "_", signal)
    got = signals(read_matlab(path))
    assert got["#sigstream#/q2"].label == "q2"
    np.testing.assert_allclose(got["#sigstream#/q2"].time, 1.0 + 0.1 * np.arange(10))
    np.testing.assert_array_equal(got["#sigstream#/q2"].values, WAVES[:, 0])
    assert got["#sigstream#/free"].time is None
    assert set(got) == {"#sigstream#/q2", "#sigstream#/free", "#sigstream#/1"}


def test_a_broken_stream_is_skipped_alone(tmp_path: Path) -> None:
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {}, [TIMES, WAVES, TIMES])
    with h5py.File(path, "r+") as file:
        file["#sigstream#/0/#length#"][0] = 10**15
    found = read_matlab(path)
    assert set(signals(found)) == {"#sigstream#/1", "#sigstream#/2"}
    assert "stored" in skipped(found)["#sigstream#/0"]


# --- figures --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tree", "version"), [("hgS_070000", "v7"), ("hgS_050000", "v7"), ("hgS_070000", "v7.3")]
)
def test_figure(tmp_path: Path, tree: str, version: str) -> None:
    words = {"title": "Joint 2", "xlabel": "Time (s)", "ylabel": "q (deg)"}
    first = made.axes(made.line(TIMES, WAVES[:, 0], "Controller 1"), made.line(TIMES, WAVES[:, 1]), **words)
    second = made.axes(made.line(WAVES[:, 0], WAVES[:, 1], "orbit"), xlabel="x [mm]", ylabel="sin(x)")
    legend = made.axes(made.line([0.0, 1.0], [1.0, 1.0]), tag="legend")
    path = made.figure(tmp_path / "SYNTHETIC.fig", first, second, legend, tree=tree, version=version)
    found = read_matlab(path)
    assert found.kind == f"MATLAB figure (MATLAB {version[1:]})"
    assert not found.skipped
    got = signals(found)
    assert set(got) == {
        'axes 1/curve 1 "Controller 1"/y',
        "axes 1/curve 2/y",
        'axes 2/curve 1 "orbit"/x',
        'axes 2/curve 1 "orbit"/y',
    }
    curve = got['axes 1/curve 1 "Controller 1"/y']
    assert (curve.label, curve.unit, curve.group) == ("Controller 1", "deg", "axes 1")
    np.testing.assert_array_equal(curve.values, WAVES[:, 0])
    np.testing.assert_array_equal(curve.time, TIMES)
    assert got['axes 2/curve 1 "orbit"/x'].unit == "mm"
    assert got['axes 2/curve 1 "orbit"/y'].unit is None
    assert found.texts["axes 1/title"] == "Joint 2"


def test_words_of_a_figure(tmp_path: Path) -> None:
    def placed(node: Any, *position: float) -> Any:
        return {**node, "properties": made.record(Position=np.array([position]))}

    left, right = (
        placed(made.axes(made.line(TIMES, TIMES), title=title, xlabel="t (s)"), x, 0.1, 0.35, 0.8)
        for title, x in ((made.cells("Joint 2", "Controller 1"), 0.1), ("Joint 3", 0.6))
    )
    legends = [
        made.graphic("scribe.legend", String=made.cells(*words), Position=np.array([place]))
        for words, place in (
            (["Desired", "Actual"], [0.7, 0.7, 0.1, 0.1]),
            (["nowhere"], [0.48, 0.9, 0.02, 0.02]),
        )
    ]
    nodes = [left, right, *legends]
    root = made.records(made.graphic("figure", made.records(*nodes), Name="Fig 14"))
    found = read_matlab(made.classic(tmp_path / "SYNTHETIC.fig", {"hgS_070000": root}))
    assert found.texts == {
        "title": "Fig 14",
        "axes 1/title": "Joint 2 Controller 1",
        "axes 1/xlabel": "t (s)",
        "axes 2/title": "Joint 3",
        "axes 2/xlabel": "t (s)",
        "axes 2/legend": "Desired | Actual",
    }


def test_curves_that_turn_back_keep_their_x(tmp_path: Path) -> None:
    axes = made.axes(made.line(WAVES[:, 1], WAVES[:, 0]), made.line(np.zeros(10), TIMES))
    got = signals(read_matlab(made.figure(tmp_path / "SYNTHETIC.fig", axes)))
    assert set(got) == {f"axes 1/curve {k}/{name}" for k in (1, 2) for name in "xy"}
    np.testing.assert_array_equal(got["axes 1/curve 1/x"].values, WAVES[:, 1])
    assert got["axes 1/curve 1/x"].group == got["axes 1/curve 1/y"].group == "axes 1/curve 1"


@pytest.mark.parametrize(
    ("label", "factor"),
    [
        ("t [ms]", 1e3),
        ("t [msec]", 1e3),
        ("Time (us)", 1e6),
        ("时间 (秒)", 1.0),
        ("t (min)", 1 / 60),
        ("t", 1.0),
    ],
)
def test_figure_in_any_unit_of_time(tmp_path: Path, label: str, factor: float) -> None:
    axes = made.axes(made.line(factor * TIMES, TIMES), xlabel=label)
    (curve,) = read_matlab(made.figure(tmp_path / "SYNTHETIC.fig", axes)).signals
    assert curve.time is not None
    np.testing.assert_allclose(curve.time, TIMES)


# --- damage and hostility -------------------------------------------------------------------------


def every_kind(folder: Path) -> dict[str, bytes]:
    plain = {"t": TIMES, "s": {"q": WAVES, "who": "me"}, "c": made.cells(TIMES, "text")}
    files = {
        "5": made.classic(folder / "SYNTHETIC_5.mat", plain),
        "7": made.classic(folder / "SYNTHETIC_7.mat", plain, packed=True),
        "4": made.classic(folder / "SYNTHETIC_4.mat", {"t": TIMES, "q": WAVES}, version="4"),
        "objects": made.objects(
            folder / "SYNTHETIC_o.mat", {"ts": made.timeseries(WAVES, TIMES), "q": WAVES}, "v7"
        ),
        "figure": made.figure(folder / "SYNTHETIC.fig", made.axes(made.line(TIMES, TIMES), title="x")),
        "7.3": made.hdf(folder / "SYNTHETIC_h.mat", plain | {"c": [TIMES, "text"]}, [TIMES, WAVES]),
    }
    return {name: path.read_bytes() for name, path in files.items()}


def guarded(folder: Path, broken: Sequence[bytes]) -> list[Source]:
    """What becomes of broken files: each ends in signals, or in reasons of one line."""
    files = []
    for number, data in enumerate(broken):
        path = folder / f"SYNTHETIC_broken_{number}.mat"
        path.write_bytes(data)
        files.append((path, path.name))
    sources = read_guarded(files, Talk(quiet=True), Limits(seconds=10.0, memory=2**31))
    assert [source.name for source in sources] == [name for _, name in files]
    for source in sources:
        assert source.signals or source.skipped
        assert all(left.reason and "\n" not in left.reason for left in source.skipped)
        assert not any("its reader failed" in left.reason for left in source.skipped)
    return sources


def reasons(source: Source) -> dict[str, str]:
    return {left.path: left.reason for left in source.skipped}


def test_truncated_and_flipped_files(tmp_path: Path) -> None:
    broken = []
    draw = np.random.default_rng(20260515)
    for data in every_kind(tmp_path).values():
        broken += [data[:stop] for stop in range(1, len(data), len(data) // 40)]
        for _ in range(60):
            mutant = bytearray(data)
            for at in draw.integers(0, len(data), 1 + int(draw.integers(3))):
                mutant[at] = draw.integers(256)
            broken.append(bytes(mutant))
    sources = guarded(tmp_path, broken)
    assert sum(bool(source.signals) for source in sources) > 100


def element(kind: int, body: bytes) -> bytes:
    return kind.to_bytes(4, "little") + len(body).to_bytes(4, "little") + body + bytes(-len(body) % 8)


def matrix(name: str, rows: int, body: bytes, kind: int = 1) -> bytes:
    """A matrix of MATLAB 5, byte by byte; a cell array unless told otherwise."""
    dims = element(5, struct.pack("<ii", rows, 1))
    return element(14, element(6, kind.to_bytes(8, "little")) + dims + element(1, name.encode()) + body)


def test_damage_inside_a_variable_is_skipped_alone(tmp_path: Path) -> None:
    good, short = (
        matrix(name, rows, element(9, TIMES.tobytes()), 6) for name, rows in (("a", 10), ("b", 11))
    )
    packed = bytearray(made.classic(tmp_path / "SYNTHETIC.mat", {"a": TIMES}, packed=True).read_bytes())
    packed[170:180] = bytes(10)
    wrong, cut, whole = guarded(tmp_path, [HEAD + short + good, HEAD + good + short[:-50], bytes(packed)])
    for source in (wrong, cut):
        assert [signal.path for signal in source.signals] == ["a"]
        assert "cannot be read" in reasons(source)["b"]
    assert "broken MATLAB file" in reasons(whole)[""]


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is limited on Linux only")
def test_lies_about_sizes_end_in_a_reason(tmp_path: Path) -> None:
    """Sizes that nothing checks before the library does: the process that reads is limited."""
    deep = b""
    while len(deep) < 2**20:
        deep = matrix("", 1, deep)
    longest = bytearray(matrix("a", 10, element(9, TIMES.tobytes()), 6))
    longest[-84:-80] = (2**32 - 8).to_bytes(4, "little")
    rest = matrix("b", 10, element(9, TIMES.tobytes()), 6)
    zeros = matrix("", 2**30, element(2, bytes(2**26)), 9)
    bomb = element(15, zlib.compress(matrix("a", 1, zeros), 1))
    lies = {
        "cells": matrix("a", 2**31 - 1, b"") + rest,
        "cells inside": matrix("a", 1, matrix("", 2**31 - 1, b"")) + rest,
        "nested": matrix("a", 1, deep),
        "numbers": bytes(longest),
        "packed": bomb,
    }
    found = dict(zip(lies, guarded(tmp_path, [HEAD + lie for lie in lies.values()]), strict=True))
    assert not any(signal.path == "a" for source in found.values() for signal in source.signals)
    assert [signal.path for signal in found["cells"].signals] == ["b"]
    assert "too many" in reasons(found["cells"])["a"]
    assert [signal.path for signal in found["cells inside"].signals] == ["b"]
    assert "allocate" in reasons(found["cells inside"])["a"]
    assert "crashed" in reasons(found["nested"])[""]


def test_a_dataset_without_storage_is_not_allocated(tmp_path: Path) -> None:
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {"q": WAVES})
    with h5py.File(path, "r+") as file:
        node = file.create_dataset("huge", (10**6, 10**6), "f8", chunks=(100, 100))
        node.attrs["MATLAB_class"] = np.bytes_("double")
    found = read_matlab(path)
    assert list(signals(found)) == ["q"]
    assert "announces" in skipped(found)["huge"]


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_what_stands_for_objects_is_no_signal(tmp_path: Path, version: str) -> None:
    place = np.array([[0xDD000000, 2, 60000, 60000, 1, 1]], np.uint32).T
    found = read_matlab(writers()[version](tmp_path / "SYNTHETIC.mat", {"ts": place, "q": WAVES}))
    assert list(signals(found)) == ["q"]
    assert "properties" in skipped(found)["ts"]


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    other = made.hdf(tmp_path / "SYNTHETIC_other.mat", {"secret": WAVES})
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {"q": WAVES, "s": {"q": WAVES}, "d": {}})
    with h5py.File(path, "r+") as file:
        file["circle/self"] = file.require_group("circle")
        deep = file["d"]
        for _ in range(40):
            deep = deep.create_group("d")
        for group in (file, file["s"], deep):
            group["secret"] = h5py.ExternalLink(other.name, "/secret")
    found = read_matlab(path)
    assert list(signals(found)) == ["q"]
    assert set(skipped(found)) == {"s", "secret", "d", "circle"}
    assert all("another file" in reason for reason in skipped(found).values())
    with h5py.File(path, "r+") as file:
        file["#refs#/secret"] = h5py.ExternalLink(other.name, "/secret")
    with pytest.raises(Unreadable, match="another file"):
        read_matlab(path)


def test_many_values_are_bounded(tmp_path: Path) -> None:
    many = {f"v{k}": np.array([[1.0, 2.0]]) for k in range(6000)}
    found = read_matlab(made.classic(tmp_path / "SYNTHETIC.mat", {"s": many}))
    assert len(found.signals) == 5000
    assert "1000 more" in skipped(found)[""]


class Handle:
    """Stands for an object that can hold itself."""

    def __init__(self, **properties: Any) -> None:
        self.properties = properties


def test_objects_that_hold_each_other_are_visited_once() -> None:
    first = Handle(q=WAVES)
    first.properties["other"] = Handle(back=first)
    found = Found("MATLAB")
    Walk(found, lambda handle: handle.properties).visit("h", first)
    assert list(signals(found)) == ["h/q"]
    assert skipped(found) == {"h/other/back": "the same object as h; "}


def walked(path: str, value: Any) -> Found:
    found = Found("MATLAB")
    walk = Walk(found, lambda value: value)
    walk.visit(path, value)
    walk.finish()
    return found


def test_walks_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    deep: Any = TIMES
    for _ in range(40):
        deep = made.cells("x", deep)
    found = walked("deep", deep)
    assert not found.signals
    assert "left out" in skipped(found)[""]
    monkeypatch.setattr("tendonrepro.dataset.readers.matlab.walk._MOST_NODES", 10)
    found = walked("wide", made.cells(*[np.array([1.0, 2.0])] * 30))
    assert 0 < len(found.signals) < 10
    assert f"{30 - len(found.signals)} more" in skipped(found)[""]


@pytest.mark.parametrize(
    "data", [b"", b"hello, this is no MATLAB file" * 10, b"\x89HDF\r\n\x1a\n", HEAD[:100]]
)
def test_other_files_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "SYNTHETIC.mat"
    path.write_bytes(data)
    with pytest.raises(Unreadable, match="a broken MATLAB file"):
        read_matlab(path)


def test_objects_of_an_unreadable_file_are_lost(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.mat"
    path.write_bytes(HEAD + bytes(40))
    with quiet():
        (lost,) = load_objects(path, ["ts"]).values()
    assert "-struct" in lost.advice


# --- files written by MATLAB ----------------------------------------------------------------------


def test_real_basic_file() -> None:
    got = signals(sample("test_basic_v7.mat"))
    assert got["int16_array"].dtype == "int16"
    assert got["double_array"].values.shape == (2, 3)
    assert got["struct_array/id"].values.tolist() == [1.0, 2.0]


def test_real_tables() -> None:
    got = signals(sample("test_tables_v7.mat"))
    assert got["table_numeric/Var1"].values.tolist() == [1.1, 2.2, 3.3]
    assert got["timetable_with_attrs/data1"].unit == "m/s"
    assert got["timetable_duration/data1"].time is not None
    np.testing.assert_allclose(got["timetable_duration/data1"].time, [10.0, 20.0, 30.0])


@pytest.mark.parametrize("name", ["test_time_v7.mat", "test_time_v73.mat"])
def test_real_dates(name: str) -> None:
    got = signals(sample(name))
    np.testing.assert_allclose(got["dt_vector"].values, 86400.0 * np.arange(6))
    np.testing.assert_allclose(got["dur_array"].values, [[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]])


@pytest.mark.parametrize("name", ["test_corrupted_mcos_object_metadata.mat", "test_corrupted_subsystem.mat"])
def test_real_corrupted_files(name: str) -> None:
    found = sample(name)
    assert not found.signals
    assert "-struct" in skipped(found)["var"]


@pytest.mark.parametrize("version", ["v7", "v73"])
def test_real_user_classes(version: str) -> None:
    found = sample(f"test_user_defined_{version}.mat")
    assert found.texts["obj_with_nested_props/a/b"] == "Obj1"
    assert "same object" in skipped(found)["obj_handle_2"]


def test_real_others() -> None:
    assert signals(sample("test_enum_v7.mat"))["enum_array"].values.shape == (6,)
    assert set(skipped(sample("test_function_handles_v7.mat")).values()) == {"a function handle; "}
    assert sample("test_string_v7.mat").texts["string_scalar"] == "Hello"
    assert sample("test_maps_v7.mat").texts["dict_val_scalar/data/Value"] == "a | a | a"


def test_real_streams() -> None:
    got = signals(sample("simulink_out_sigstream.mat"))
    assert list(got) == [f"#sigstream#/{k}" for k in range(1, 14, 2)]
    for signal in got.values():
        assert signal.time is not None
        assert (signal.time[0], signal.time[-1], len(signal.values)) == (0.0, 10.0, 304)
    assert set(got["#sigstream#/1"].values) == {12.0}
    np.testing.assert_array_equal(got["#sigstream#/3"].values, got["#sigstream#/7"].values)


@pytest.mark.parametrize(
    ("name", "samples", "title", "unit"),
    [
        ("dcmotor_current.fig", 501, "DC Motor Armature Current", "A"),
        ("test_figure.fig", 63, "Simple Sine Wave", None),
    ],
)
def test_real_figures(name: str, samples: int, title: str, unit: str | None) -> None:
    found = sample(name)
    (curve,) = found.signals
    assert (len(curve.values), curve.unit, found.texts["axes 1/title"]) == (samples, unit, title)
    assert curve.time is not None
    if name == "test_figure.fig":
        np.testing.assert_allclose(curve.values, np.sin(curve.time))
