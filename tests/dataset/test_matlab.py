"""MATLAB files of every version: what was written is what is read, and nothing else breaks."""

from __future__ import annotations

import os
import struct
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support import ROOT
from support import matlab_bytes as made

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.guard import Limits, read_guarded
from tendonrepro.dataset.readers.matlab.file import read_matlab
from tendonrepro.dataset.readers.matlab.walk import Walk
from tendonrepro.dataset.readers.signals import Found, Signal, Source, Unreadable

SAMPLES = Path(os.environ.get("TENDONREPRO_MATLAB_SAMPLES", ROOT / "tests/matlab_samples"))
TIMES = np.linspace(0.0, 0.9, 10)
HEAD = b"MATLAB 5.0 MAT-file, SYNTHETIC".ljust(116) + bytes(8) + b"\x00\x01IM"
WAVES = np.stack([np.sin(TIMES), np.cos(TIMES)], axis=1)
WRITERS: Mapping[str, Callable[[Path, Mapping[str, Any]], Path]] = {
    "5": made.classic,
    "7": partial(made.classic, packed=True),
    "7.3": made.hdf,
    "objects 7": partial(made.objects, version="v7"),
    "objects 7.3": partial(made.objects, version="v7.3"),
}
NESTED = pytest.mark.parametrize("version", ["5", "7", "7.3"])
OBJECTS = pytest.mark.parametrize("version", ["objects 7", "objects 7.3"])


def written(folder: Path, version: str, **variables: Any) -> Found:
    return read_matlab(WRITERS[version](folder / "SYNTHETIC.mat", variables))


def signals(found: Found) -> dict[str, Signal]:
    return {signal.path: signal for signal in found.signals}


def skipped(found: Found | Source) -> dict[str, str]:
    return {part.path: f"{part.reason}; {part.advice}" for part in found.skipped}


def sample(name: str) -> Found:
    path = SAMPLES / name
    if not path.exists():
        pytest.skip("needs the files written by MATLAB itself")
    return read_matlab(path)


@pytest.mark.parametrize("version", ["5", "7", "7.3"])
def test_plain_arrays_of_every_version(tmp_path: Path, version: str) -> None:
    grid = np.arange(12.0).reshape(3, 4)
    found = written(tmp_path, version, t=TIMES[:, None], q=WAVES, row=TIMES[None, :], grid=grid)
    assert found.kind == f"MATLAB {version}"
    got = signals(found)
    names = ["t", "q", "row", "grid"]
    assert list(got) == names if version != "7.3" else sorted(got) == sorted(names)
    for name, values in {"t": TIMES, "q": WAVES, "row": TIMES, "grid": grid}.items():
        assert_array_equal(got[name].values, values)
    assert (got["q"].time, got["q"].group) == (None, "")
    assert not found.skipped


@NESTED
def test_types_are_told_as_stored(tmp_path: Path, version: str) -> None:
    kinds = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "float32"]
    stored = {kind: np.array([[0, 1, 100, 7, 3]], kind) for kind in kinds}
    found = written(tmp_path, version, **stored, s=stored)
    assert len(found.signals) == 2 * len(kinds)
    assert not found.skipped
    for signal in found.signals:
        assert signal.dtype == signal.path.removeprefix("s/")
        assert_array_equal(signal.values, [0, 1, 100, 7, 3])


@NESTED
def test_structs_cells_and_texts(tmp_path: Path, version: str) -> None:
    run = {"log": {"q": WAVES, "unit": "deg"}, "title": "payload 0.2 kg"}
    cell = [TIMES[:, None], "note", {"e": TIMES[:, None]}]
    found = written(tmp_path, version, run=run, c=cell if "7.3" in version else made.cells(*cell))
    got = signals(found)
    assert set(got) == {"run/log/q", "c[1]", "c[3]/e"}
    assert got["run/log/q"].group == "run/log"
    assert found.texts == {"run/log/unit": "deg", "run/title": "payload 0.2 kg", "c[2]": "note"}


def test_plain_arrays_of_7_3_need_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = {"log": {"q": WAVES}, "title": "payload 0.2 kg"}
    path = WRITERS["7.3"](tmp_path / "SYNTHETIC.mat", {"t": TIMES[:, None], "run": run, "c": [TIMES, "x"]})
    monkeypatch.setitem(sys.modules, "matio", None)
    found = read_matlab(path)
    got = signals(found)
    assert set(got) == {"t", "run/log/q"}
    assert_array_equal(got["run/log/q"].values, WAVES)
    assert found.texts["run/title"] == "payload 0.2 kg"
    assert "mat-io" in skipped(found)[""]
    assert "c" in skipped(found)


def test_struct_arrays_count_from_one(tmp_path: Path) -> None:
    runs = ({"q": k * WAVES, "load": 0.2 * k, "name": f"run {k}"} for k in (1.0, 2.0))
    found = written(tmp_path, "5", data=made.records(*runs))
    got = signals(found)
    assert set(got) == {"data[1]/q", "data[2]/q", "data/load"}
    assert_array_equal(got["data[2]/q"].values, 2.0 * WAVES)
    assert_array_equal(got["data/load"].values, [0.2, 0.4])
    assert got["data[1]/q"].group == "data[1]"
    assert found.texts == {"data[1]/name": "run 1.0", "data[2]/name": "run 2.0"}


def test_structures_with_and_without_time(tmp_path: Path) -> None:
    """The vector of two of a second signal is logged as 1x2 matrices."""
    stacked = np.moveaxis(WAVES[:, None, :], 0, -1)
    q = {"values": WAVES, "dimensions": 2.0, "label": "q", "blockName": "m/Controller 1"}
    qd = {"values": stacked, "dimensions": np.array([[1.0, 2.0]]), "label": "qd", "blockName": "m/Reference"}
    own = {"time": TIMES[:, None], "blockName": "m/To Workspace"}
    one, two = (made.record(signals=made.records(*logged), **own) for logged in ([q], [q, qd]))
    timeless = made.record(time=made.EMPTY, signals=made.records(q))
    found = written(tmp_path, "5", one=one, two=two, timeless=timeless)
    got = signals(found)
    assert got["timeless/signals/values"].time is None
    for place, logged in (("one/signals", q), ("two/signals[1]", q), ("two/signals[2]", qd)):
        signal = got[f"{place}/values"]
        assert (signal.label, signal.group) == (logged["label"], place[:3])
        assert_array_equal(signal.time, TIMES)
        assert_array_equal(signal.values, WAVES)
        assert found.texts[f"{place}/blockName"] == logged["blockName"]
    assert found.texts["one/blockName"] == "m/To Workspace"
    assert not any("times for" in reason for reason in skipped(found).values())


def element(kind: int, body: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}II", kind, len(body)) + body + bytes(-len(body) % 8)


def matrix(name: str, rows: int, body: bytes, kind: int = 1, order: str = "<") -> bytes:
    """A matrix of MATLAB 5, byte by byte; a cell array unless told otherwise."""
    flags = element(6, struct.pack(f"{order}II", kind, 0), order)
    dims = element(5, struct.pack(f"{order}ii", rows, 1), order)
    return element(14, flags + dims + element(1, name.encode(), order) + body, order)


NUMBERS = element(9, TIMES.tobytes())


def test_files_of_big_endian_machines(tmp_path: Path) -> None:
    """Byte by byte; nothing at hand writes them."""
    big = TIMES.astype(">f8").tobytes()
    path = tmp_path / "SYNTHETIC.mat"
    path.write_bytes(HEAD[:124] + b"\x01\x00MI" + matrix("t", 10, element(9, big, ">"), 6, ">"))
    assert_array_equal(signals(read_matlab(path))["t"].values, TIMES)


SQUARE = np.arange(9.0).reshape(3, 3)
MATRICES = np.moveaxis(WAVES.reshape(10, 2, 1) * np.ones(3), 0, -1)


@OBJECTS
@pytest.mark.parametrize(
    ("stored", "times", "values"),
    [
        ({"data": WAVES, "time": TIMES}, TIMES, WAVES),
        ({"data": WAVES, "uniform": (2.0, 0.5, 10)}, 2.0 + 0.5 * np.arange(10), WAVES),
        ({"data": WAVES, "time": TIMES, "time_unit": "milliseconds"}, 1e-3 * TIMES, WAVES),
        ({"data": WAVES.T, "time": TIMES, "time_first": False}, TIMES, WAVES),
        ({"data": MATRICES, "time": TIMES, "time_first": False}, TIMES, np.tile(WAVES, 3)),
        # Square ones follow their own word.
        ({"data": SQUARE, "time": TIMES[:3], "time_first": True}, TIMES[:3], SQUARE),
        ({"data": SQUARE, "time": TIMES[:3], "time_first": False}, TIMES[:3], SQUARE.T),
        # Streaming storage is turned.
        ({"storage": WAVES.T.copy(), "time": TIMES}, TIMES, WAVES),
        ({"storage": SQUARE, "time": TIMES[:3]}, TIMES[:3], SQUARE.T),
        ({"storage": TIMES[None, :], "time": TIMES}, TIMES, TIMES),
    ],
)
def test_timeseries(tmp_path: Path, version: str, stored: dict[str, Any], times: Any, values: Any) -> None:
    series = made.timeseries(**stored, name="q2", unit="deg")
    found = written(tmp_path, version, ts=series)
    got = signals(found)["ts"]
    assert (got.label, got.unit) == ("q2", "deg")
    assert_array_equal(got.values, values)
    assert_array_equal(got.time, times)
    assert ("column by column" in got.note) == (stored.get("data") is MATRICES)
    assert not found.skipped


@OBJECTS
def test_dataset(tmp_path: Path, version: str) -> None:
    series = [made.timeseries(k * WAVES, TIMES, unit="rad") for k in (1.0, 2.0, 3.0)]
    block = made.record(Path="m/Controller 1/arm")
    elements = [
        made.thing("Simulink.SimulationData.Signal", Name=name, PropagatedName="", Values=values, **own)
        for name, values, own in zip(["q2", "q2", ""], series, [{"BlockPath": block}, {}, {}], strict=True)
    ]
    log, empty = (
        made.thing("Simulink.SimulationData.Dataset", Name="logsout", Elements=stored)
        for stored in (made.cells(*elements), made.EMPTY)
    )
    found = written(tmp_path, version, logsout=log, empty=empty)
    got = signals(found)
    assert set(got) == {"logsout/q2", "logsout/q2 (2)", "logsout/element 3"}
    assert (got["logsout/q2"].label, got["logsout/q2"].unit) == ("q2", "rad")
    assert_array_equal(got["logsout/q2 (2)"].values, 2.0 * WAVES)
    assert found.texts == {"logsout/q2/block": "m/Controller 1/arm"}
    assert "without signals" in skipped(found)["empty"]


@OBJECTS
def test_outputs_of_simulations_structs_and_user_classes(tmp_path: Path, version: str) -> None:
    logged = made.record(values=WAVES, dimensions=2.0, label="tau")
    structure = made.record(time=TIMES[:, None], signals=logged)
    data = made.record(tout=TIMES[:, None], ts=made.timeseries(WAVES, TIMES), simout=structure)
    out = made.thing("Simulink.SimulationOutput", Data=data, Metadata=made.record(stop=TIMES))
    log = made.record(q=made.timeseries(WAVES, TIMES), e=made.timeseries(0.1 * WAVES, TIMES))
    rig = made.thing("lab.Rig", angle=WAVES, gains=made.record(kp=np.array([[1.0, 2.0]])))
    got = signals(written(tmp_path, version, out=out, log=log, rig=rig))
    places = ["out/ts", "out/simout/signals/values", "log/q", "log/e", "rig/angle", "rig/gains/kp"]
    assert {path for path in got if path not in {"out/tout", "out/simout/time"}} == set(places)
    assert "out/tout" in got
    assert got["log/q"].group == got["log/e"].group == "log"
    assert_array_equal(got["out/simout/signals/values"].time, TIMES)


@OBJECTS
def test_tables(tmp_path: Path, version: str) -> None:
    rows = pd.to_timedelta(TIMES, unit="s").rename("Time")
    plain = pd.DataFrame({"q": TIMES, "count": np.arange(10, dtype=np.int32), "who": ["a"] * 10})
    found = written(tmp_path, version, plain=plain, timed=pd.DataFrame({"q": TIMES}, index=rows))
    got = signals(found)
    assert set(got) == {"plain/q", "plain/count", "timed/q"}
    assert (got["plain/q"].label, got["plain/q"].group, got["plain/q"].values.ndim) == ("q", "plain", 1)
    assert_allclose(got["timed/q"].time, TIMES, atol=1e-9)
    assert "plain/who" in skipped(found)


@OBJECTS
def test_dates_are_counted_from_the_first(tmp_path: Path, version: str) -> None:
    since = (TIMES * 1e9).astype("timedelta64[ns]")[:, None]
    got = signals(
        written(tmp_path, version, when=np.datetime64("2026-03-01T10:00", "ns") + since, since=since)
    )
    for name, note in (("when", "2026-03-01"), ("since", "durations")):
        assert_allclose(got[name].values, TIMES, atol=1e-6)
        assert got[name].unit == "s"
        assert note in got[name].note


@OBJECTS
def test_objects_need_the_package(tmp_path: Path, version: str, monkeypatch: pytest.MonkeyPatch) -> None:
    log = made.record(ts=made.timeseries(WAVES, TIMES), raw=WAVES)
    path = WRITERS[version](tmp_path / "SYNTHETIC.mat", {"log": log, "q": WAVES, "ts": log["ts"][0, 0]})
    monkeypatch.setitem(sys.modules, "matio", None)
    found = read_matlab(path)
    assert set(signals(found)) == {"log/raw", "q"}
    assert {"log/ts", "ts"} <= set(skipped(found))
    assert any("mat-io" in reason and "-struct" in reason for reason in skipped(found).values())


def test_one_broken_object_does_not_stop_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    matio = pytest.importorskip("matio")
    whole = matio.load_from_mat

    def failing(path: str, *, variable_names: list[str], **options: Any) -> Any:
        if "a" in variable_names:
            message = "broken"
            raise NotImplementedError(message)
        return whole(path, variable_names=variable_names, **options)

    monkeypatch.setattr(matio, "load_from_mat", failing)
    found = written(tmp_path, "objects 7.3", a=made.timeseries(WAVES, TIMES), b=WAVES)
    assert list(signals(found)) == ["b"]
    assert "broken" in skipped(found)["a"]


def test_streams_with_their_times_and_no_names(tmp_path: Path) -> None:
    streams = [TIMES, WAVES, TIMES, np.arange(10.0), WAVES[::-1, 0]]
    got = signals(read_matlab(made.hdf(tmp_path / "SYNTHETIC.mat", {"x": TIMES}, streams)))
    assert set(got) == {"x", "#sigstream#/1", "#sigstream#/3", "#sigstream#/4"}
    assert got["#sigstream#/4"].time is None
    assert_array_equal(got["#sigstream#/1"].values, WAVES)
    assert_array_equal(got["#sigstream#/1"].time, TIMES)
    assert "without its name" in got["#sigstream#/1"].note


def test_what_stands_for_streamed_samples_names_their_record() -> None:
    found = walked("log", {"q2": {"Name": "q2", "Values": {"DataR2": np.array([[3.0]])}}})
    assert skipped(found)["log/q2/Values"] == "its samples are #sigstream#/3; "


def test_a_broken_stream_is_skipped_alone(tmp_path: Path) -> None:
    path = made.hdf(tmp_path / "SYNTHETIC.mat", {}, [TIMES, WAVES, TIMES])
    with h5py.File(path, "r+") as file:
        file["#sigstream#/0/#length#"][0] = 10**15
    found = read_matlab(path)
    assert set(signals(found)) == {"#sigstream#/1", "#sigstream#/2"}
    assert "stored" in skipped(found)["#sigstream#/0"]


TREES = [("hgS_070000", "v7"), ("hgS_050000", "v7"), ("hgS_070000", "v7.3")]


@pytest.mark.parametrize(("tree", "version"), TREES)
def test_figure(tmp_path: Path, tree: str, version: str) -> None:
    words = {"title": "Joint 2", "xlabel": "Time (s)", "ylabel": "q (deg)"}
    first = made.axes(made.line(TIMES, WAVES[:, 0], "Controller 1"), made.line(TIMES, WAVES[:, 1]), **words)
    second = made.axes(made.line(WAVES[:, 0], WAVES[:, 1], "orbit"), xlabel="x [mm]", ylabel="sin(x)")
    legend = made.axes(made.line([0.0, 1.0], [1.0, 1.0]), Tag="legend")
    path = made.figure(tmp_path / "SYNTHETIC.fig", first, second, legend, tree=tree, version=version)
    found = read_matlab(path)
    assert found.kind == f"MATLAB figure (MATLAB {version[1:]})"
    assert not found.skipped
    got = signals(found)
    named, orbit = 'axes 1/curve 1 "Controller 1"/y', 'axes 2/curve 1 "orbit"'
    assert set(got) == {named, "axes 1/curve 2/y", f"{orbit}/x", f"{orbit}/y"}
    curve = got[named]
    assert (curve.label, curve.unit, curve.group) == ("Controller 1", "deg", "axes 1")
    assert_array_equal(curve.values, WAVES[:, 0])
    assert_array_equal(curve.time, TIMES)
    assert (got[f"{orbit}/x"].unit, got[f"{orbit}/y"].unit) == ("mm", None)
    assert found.texts["axes 1/title"] == "Joint 2"


def test_curves_that_turn_back_keep_their_x(tmp_path: Path) -> None:
    axes = made.axes(made.line(WAVES[:, 1], WAVES[:, 0]), made.line(np.zeros(10), TIMES))
    got = signals(read_matlab(made.figure(tmp_path / "SYNTHETIC.fig", axes)))
    assert set(got) == {f"axes 1/curve {k}/{name}" for k in (1, 2) for name in "xy"}
    assert_array_equal(got["axes 1/curve 1/x"].values, WAVES[:, 1])
    assert got["axes 1/curve 1/x"].group == got["axes 1/curve 1/y"].group == "axes 1/curve 1"


def test_figure_in_any_unit_of_time(tmp_path: Path) -> None:
    factors = {"[ms]": 1e3, "[msec]": 1e3, "(us)": 1e6, "(秒)": 1.0, "(min)": 1 / 60, "": 1.0}
    axes = [made.axes(made.line(k * TIMES, TIMES), xlabel=f"Time {unit}") for unit, k in factors.items()]
    curves = read_matlab(made.figure(tmp_path / "SYNTHETIC.fig", *axes)).signals
    assert len(curves) == len(factors)
    for curve in curves:
        assert_allclose(curve.time, TIMES)


# --- damage and hostility -------------------------------------------------------------------------


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


def test_truncated_and_flipped_files(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.mat"
    plain = {"t": TIMES, "s": {"q": WAVES, "who": "me"}, "c": made.cells(TIMES, "text")}
    logs = {"ts": made.timeseries(WAVES, TIMES), "q": WAVES}
    stored = {"5": plain, "7": plain, "objects 7": logs}
    whole = [WRITERS[version](path, variables).read_bytes() for version, variables in stored.items()]
    whole.append(made.figure(path, made.axes(made.line(TIMES, TIMES), title="x")).read_bytes())
    whole.append(made.hdf(path, plain | {"c": [TIMES, "text"]}, [TIMES, WAVES]).read_bytes())
    broken = []
    draw = np.random.default_rng(20260515)
    for data in whole:
        broken += [data[:stop] for stop in range(1, len(data), len(data) // 40)]
        for _ in range(60):
            mutant = bytearray(data)
            for at in draw.integers(0, len(data), 1 + int(draw.integers(3))):
                mutant[at] = draw.integers(256)
            broken.append(bytes(mutant))
    sources = guarded(tmp_path, broken)
    assert sum(bool(source.signals) for source in sources) > 100


def test_damage_inside_a_variable_is_skipped_alone(tmp_path: Path) -> None:
    good, short = (matrix(name, rows, NUMBERS, 6) for name, rows in (("a", 10), ("b", 11)))
    packed = bytearray(made.classic(tmp_path / "SYNTHETIC.mat", {"a": TIMES}, packed=True).read_bytes())
    packed[170:180] = bytes(10)
    wrong, cut, whole = guarded(tmp_path, [HEAD + short + good, HEAD + good + short[:-50], bytes(packed)])
    for source in (wrong, cut):
        assert [signal.path for signal in source.signals] == ["a"]
        assert "cannot be read" in skipped(source)["b"]
    assert "broken MATLAB file" in skipped(whole)[""]


@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is limited on Linux only")
def test_lies_about_sizes_end_in_a_reason(tmp_path: Path) -> None:
    """Sizes that nothing checks before the library does: the process that reads is limited."""
    deep = b""
    while len(deep) < 2**20:
        deep = matrix("", 1, deep)
    longest = bytearray(matrix("a", 10, NUMBERS, 6))
    longest[-84:-80] = (2**32 - 8).to_bytes(4, "little")
    rest = matrix("b", 10, NUMBERS, 6)
    zeros = matrix("", 2**30, element(2, bytes(2**26)), 9)
    lies = {
        "cells": matrix("a", 2**31 - 1, b"") + rest,
        "cells inside": matrix("a", 1, matrix("", 2**31 - 1, b"")) + rest,
        "nested": matrix("a", 1, deep),
        "numbers": bytes(longest),
        "packed": element(15, zlib.compress(matrix("a", 1, zeros), 1)),
    }
    found = dict(zip(lies, guarded(tmp_path, [HEAD + lie for lie in lies.values()]), strict=True))
    assert not any(signal.path == "a" for source in found.values() for signal in source.signals)
    for name, reason in (("cells", "too many"), ("cells inside", "allocate")):
        assert [signal.path for signal in found[name].signals] == ["b"]
        assert reason in skipped(found[name])["a"]
    assert "crashed" in skipped(found["nested"])[""]


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
    found = written(tmp_path, version, ts=place, q=WAVES)
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
    found = written(tmp_path, "5", s=many)
    assert len(found.signals) == 5000
    assert "1000 more" in skipped(found)[""]


def walked(path: str, value: Any) -> Found:
    found = Found("MATLAB")
    walk = Walk(found, vars)
    walk.visit(path, value)
    walk.finish()
    return found


def test_objects_that_hold_each_other_are_visited_once() -> None:
    first = SimpleNamespace(q=WAVES)
    first.other = SimpleNamespace(back=first)
    found = walked("h", first)
    assert list(signals(found)) == ["h/q"]
    assert skipped(found) == {"h/other/back": "the same object as h; "}


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


@pytest.mark.parametrize("data", [b"", b"this is no MATLAB file" * 10, b"\x89HDF\r\n\x1a\n", HEAD[:100]])
def test_other_files_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "SYNTHETIC.mat"
    path.write_bytes(data)
    with pytest.raises(Unreadable, match="a broken MATLAB file"):
        read_matlab(path)


# --- files written by MATLAB ----------------------------------------------------------------------


def test_real_values_tables_and_texts() -> None:
    plain = signals(sample("test_basic_v7.mat"))
    assert plain["int16_array"].dtype == "int16"
    assert plain["double_array"].values.shape == (2, 3)
    assert plain["struct_array/id"].values.tolist() == [1.0, 2.0]
    tables = signals(sample("test_tables_v7.mat"))
    assert tables["table_numeric/Var1"].values.tolist() == [1.1, 2.2, 3.3]
    assert tables["timetable_with_attrs/data1"].unit == "m/s"
    assert_allclose(tables["timetable_duration/data1"].time, [10.0, 20.0, 30.0])
    assert set(skipped(sample("test_function_handles_v7.mat")).values()) == {"a function handle; "}
    assert sample("test_string_v7.mat").texts["string_scalar"] == "Hello"
    assert sample("test_maps_v7.mat").texts["dict_val_scalar/data/Value"] == "a | a | a"


@pytest.mark.parametrize("version", ["v7", "v73"])
def test_real_dates_and_user_classes(version: str) -> None:
    dates = signals(sample(f"test_time_{version}.mat"))
    assert_allclose(dates["dt_vector"].values, 86400.0 * np.arange(6))
    assert_allclose(dates["dur_array"].values, [[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]])
    own = sample(f"test_user_defined_{version}.mat")
    assert own.texts["obj_with_nested_props/a/b"] == "Obj1"
    assert "same object" in skipped(own)["obj_handle_2"]


@pytest.mark.parametrize("name", ["test_corrupted_mcos_object_metadata.mat", "test_corrupted_subsystem.mat"])
def test_real_corrupted_files(name: str) -> None:
    found = sample(name)
    assert not found.signals
    assert "-struct" in skipped(found)["var"]


def test_real_streams() -> None:
    got = signals(sample("simulink_out_sigstream.mat"))
    assert list(got) == [f"#sigstream#/{k}" for k in range(1, 14, 2)]
    for signal in got.values():
        assert signal.time is not None
        assert (signal.time[0], signal.time[-1], len(signal.values)) == (0.0, 10.0, 304)
    assert set(got["#sigstream#/1"].values) == {12.0}
    assert_array_equal(got["#sigstream#/3"].values, got["#sigstream#/7"].values)


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
        assert_allclose(curve.values, np.sin(curve.time))
