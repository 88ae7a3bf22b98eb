"""Files are told by content, go to their reader, and no file takes the program down."""

from __future__ import annotations

import datetime
import hashlib
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import h5py
import numpy as np
import pandas  # noqa: F401 (what a reader imports is no part of a file's time)
import psutil
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from support import ROOT, matlab_bytes, seed_files
from support.seed_files import read_file

from tendonrepro.console import Talk
from tendonrepro.dataset.readers import arrays as hdf5_file
from tendonrepro.dataset.readers import guard, signals
from tendonrepro.dataset.readers.filetype import FileType, kind_of
from tendonrepro.dataset.readers.guard import Limits, read_guarded
from tendonrepro.dataset.readers.read import files_below, read_bit_by_bit
from tendonrepro.dataset.readers.signals import Allowance, Found, Source, seconds
from tendonrepro.errors import DataMissingError, TendonreproError

QUIET = Talk(quiet=True)
SEEDS = seed_files.readable()
READABLE = {name: content for name, (_, content) in SEEDS.items()}


UNREAD = {
    "a.opj": (b"CPYA 4.2673 552#\n", FileType.ORIGIN),
    "a.opju": (b"CPYUA 4.3380 160\n", FileType.ORIGIN),
    "a.tdms": (b"TDSm\x0e\x00\x00\x00", FileType.TDMS),
    "a.pdf": (b"%PDF-1.7\n", FileType.PDF),
    "a.png": (b"\x89PNG\r\n\x1a\n", FileType.IMAGE),
    "a.jpg": (b"\xff\xd8\xff\xe0", FileType.IMAGE),
    "a.rar": (b"Rar!\x1a\x07\x01\x00", FileType.RAR),
    "a.7z": (b"7z\xbc\xaf\x27\x1c\x00\x04", FileType.SEVEN_ZIP),
    "a.zip": (seed_files.encrypted_zip({"a.csv": b"x"}), FileType.ENCRYPTED_ZIP),
    "a.xlsx": (seed_files.ole2("EncryptedPackage"), FileType.ENCRYPTED_OFFICE),
    "a.doc": (seed_files.ole2("WordDocument"), FileType.OFFICE),
    "a.docx": (seed_files.zipped({"word/document.xml": b"<w/>"}), FileType.OFFICE),
    "a.slx": (seed_files.zipped({"simulink/blockdiagram.xml": b"<m/>"}), FileType.SIMULINK),
    "a.mdl": (b"Model {\n  Name \"a\"\n}\n", FileType.SIMULINK),
    "b.mdl": (b"# MathWorks OPC Text Package\n", FileType.SIMULINK),
    "a.m": (b"function y = f(x)\ny = 2*x;\n", FileType.MATLAB_CODE),
    "a.py": (b"import numpy as np\nx = 1\n", FileType.PYTHON_CODE),
    "a.csv": (b"<!DOCTYPE html>\n<html></html>", FileType.HTML),
    "a.xml": (b"<?xml version='1.0'?><a/>", FileType.XML),
    "a.mat": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", FileType.LFS_POINTER),
    "empty.csv": (b"", FileType.EMPTY),
    "a.bin": (bytes(range(256)), FileType.BINARY),
    "b.bin": (struct.pack("<5i", 7, 1, 1, 0, 2) + b"q\0", FileType.BINARY),
}  # fmt: skip


@pytest.mark.parametrize("name", SEEDS)
def test_a_file_is_told_by_content_and_read(name: str, tmp_path: Path) -> None:
    kind, content = SEEDS[name]
    path = tmp_path / "misleading.pdf"
    path.write_bytes(content)
    assert kind_of(path) is kind
    sources = read_file(path, name)
    assert any(source.signals for source in sources)
    assert sources[0].md5 == hashlib.md5(content, usedforsecurity=False).hexdigest()
    assert sources[0].size == len(content)


@pytest.mark.parametrize("name", UNREAD)
def test_what_is_not_read_is_named_with_advice(name: str, tmp_path: Path) -> None:
    content, kind = UNREAD[name]
    path = tmp_path / name
    path.write_bytes(content)
    assert kind_of(path) is kind
    (source,) = read_file(path, name)
    assert source.kind == str(kind)
    assert source.skipped[0].reason
    assert source.skipped[0].advice == kind.advice


def test_every_type_is_tested() -> None:
    tested = {kind for kind, _ in SEEDS.values()} | {kind for _, kind in UNREAD.values()}
    assert set(FileType) - tested == {FileType.XLSB, FileType.ZSTD, FileType.LIVE_SCRIPT}
    assert not any(kind.advice for kind, _ in SEEDS.values())
    assert all(kind.advice for _, kind in UNREAD.values())


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    (source,) = read_file(tmp_path / "missing", "missing")
    assert source.skipped[0].reason.startswith("cannot be opened")


def touch(folder: Path, names: Sequence[str]) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("1\n")


def names_below(*paths: Path) -> list[str]:
    return [name for _, name in files_below(paths)]


def test_files_below(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    names = ["a.csv", "motor.lock", "other.lock.json", "b/z.csv", "results/r.csv"]
    touch(folder, [*reversed(names), ".hidden", ".git/x", ".lock", "results.lock.json"])
    touch(folder, ["c.mat.part", "c.mat.part.json", "C.MAT.PART"])
    touch(tmp_path, ["secret"])
    if sys.platform != "win32":  # where links need a right of their own
        (folder / "link").symlink_to(tmp_path / "secret")
        (folder / "circle").symlink_to(folder)
    assert names_below(folder) == names
    both = files_below([folder / "a.csv", folder])
    assert [name for _, name in both] == ["a.csv", *(f"data/{name}" for name in names)]
    assert all(path.is_file() for path, _ in both)


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="names are text there")
def test_names_that_are_no_text(tmp_path: Path) -> None:
    for name in (b"c1_\xff.csv", b"c1_\xfe.csv", b"\xff/a.csv"):
        path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(READABLE["SYNTHETIC_comma.csv"])
    files = files_below([tmp_path])
    names = [name for _, name in files]
    assert names == ["c1_\ufffd.csv", "c1_\ufffd.csv (2)", "\ufffd/a.csv"]
    assert [source.name for source in read_guarded(files, QUIET) if source.signals] == names
    # A file that is named twice stays one file.
    assert names_below(files[0][0], files[0][0]) == [names[0], names[0]]


def test_no_files_below(tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="does not exist"):
        files_below([tmp_path / "missing"])
    with pytest.raises(DataMissingError, match="no files in"):
        files_below([tmp_path])


def narrow(folder: Path, suffix: str, arrays: dict[str, np.ndarray]) -> Path:
    """Arrays of one byte a number in a file that packs them well."""
    path = folder / f"SYNTHETIC.{suffix}"
    if suffix == "h5":
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file.create_dataset(name, data=values, compression="gzip")
    elif suffix == "npz":
        np.savez_compressed(path, **arrays)
    else:
        matlab_bytes.classic(path, arrays, packed=True)
    return path


NO_ROOM = "no room is left for its numbers"
LESS = "one command keeps 1 GB at most: name fewer files at once, or split this one"


@pytest.mark.parametrize("suffix", ["h5", "npz", "mat"])
def test_signals_together_end_at_a_bound(suffix: str, tmp_path: Path) -> None:
    """They are counted as what they become in memory, and what is small enough still has room."""
    arrays = {f"d{number}": np.arange(3000).astype(np.int8) for number in range(5)}
    arrays |= {"large": np.zeros(10_000, np.int8), "small": np.arange(10, dtype=np.int8)}
    left = Allowance(numbers=2**16)
    (source,) = read_file(narrow(tmp_path, suffix, arrays), "x", left)
    assert [signal.path for signal in source.signals] == ["d0", "d1", "small"]
    assert left.numbers == 2**16 - 8 * 6010
    assert {(left.path, left.reason, left.advice) for left in source.skipped} == {
        (name, NO_ROOM, LESS) for name in ("d2", "d3", "d4", "large")
    }


def test_no_more_is_read_than_may_be_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    add = hdf5_file._add

    def noted(found: Found, path: str, dataset: h5py.Dataset) -> None:
        read.append(path)
        add(found, path, dataset)

    monkeypatch.setattr(hdf5_file, "_add", noted)
    arrays = {f"d{number}": np.arange(6000).astype(np.int8) for number in range(5)}
    path = narrow(tmp_path, "h5", arrays | {"large": np.zeros(10_000, np.int8)})
    hdf5_file.read_hdf5(path, Allowance(numbers=2**16))
    assert read == ["d0"]


def test_files_of_one_command_share_their_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST_NUMBERS", 2**16)
    path = narrow(tmp_path, "h5", {"q": np.arange(3000).astype(np.int8)})
    sources = read_guarded([(path, name) for name in "abcd"], QUIET)
    assert [len(source.signals) for source in sources] == [1, 1, 0, 0]
    assert [skip.reason for source in sources for skip in source.skipped] == [NO_ROOM, NO_ROOM]


def test_an_array_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signals, "MOST_SAMPLES", 2**10)
    monkeypatch.setattr(signals, "MOST_NUMBERS", 2**14)
    long, wide = np.zeros(1025, np.int8), np.zeros((3, 1000), np.int8)
    for values, reason in (long, "1025 samples are more than 1024"), (wide, "24000 bytes are too many"):
        np.save(tmp_path / "SYNTHETIC.npy", values)
        (source,) = read_file(tmp_path / "SYNTHETIC.npy", "x")
        assert source.skipped[0].reason == reason
    # However deep in a variable, by what it announces before it is unpacked.
    monkeypatch.setattr(scipy.io, "loadmat", None)
    scipy.io.savemat(tmp_path / "SYNTHETIC.mat", {"s": {"q": np.zeros(3000)}}, do_compression=True)
    (source,) = read_file(tmp_path / "SYNTHETIC.mat", "x")
    assert "bytes are too many" in source.skipped[0].reason


def test_a_chunk_counts_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred samples in a chunk of 32 MiB take 32 MiB to read."""
    monkeypatch.setattr(signals, "MOST_NUMBERS", 2**25 - 1)
    with h5py.File(tmp_path / "SYNTHETIC.h5", "w") as file:
        packed = {"chunks": (2**22,), "maxshape": (None,), "compression": "gzip"}
        file.create_dataset("few", data=np.arange(100.0), **packed)
        file["plain"] = np.arange(100.0)
    (source,) = read_file(tmp_path / "SYNTHETIC.h5", "x")
    assert [signal.path for signal in source.signals] == ["plain"]
    assert source.skipped[0].reason == f"{2**25} bytes are too many"


def test_what_was_read_of_an_archive_is_kept(tmp_path: Path) -> None:
    names = ["first", "second", "hang", "last"]
    path = tmp_path / "SYNTHETIC.zip"
    path.write_bytes(seed_files.zipped(dict.fromkeys(names, READABLE["SYNTHETIC_comma.csv"])))
    whole, *inside = read_guarded([(path, "x.zip")], QUIET, Limits(seconds=3.0), slowly)
    assert [(source.name, len(source.signals)) for source in inside] == [
        ("x.zip/first", 3),
        ("x.zip/second", 3),
    ]
    assert [skip.reason for skip in whole.skipped] == [
        "reading it took longer than 3 s, after 2 of its files; the others were not read"
    ]


def test_thousands_of_one_name_are_quick() -> None:
    found = Found("SYNTHETIC")
    start = time.monotonic()
    for _ in range(20_000):
        found.add("q", np.arange(2.0))
    assert time.monotonic() - start < 5.0
    assert [signal.path for signal in found.signals] == ["q", *(f"q ({k})" for k in range(2, 20_001))]


@given(st.lists(st.sampled_from(["q", "q (2)", "q (3)", "q (2) (2)"]), max_size=12))
def test_no_two_signals_have_one_name(names: list[str]) -> None:
    found = Found("SYNTHETIC")
    for name in names:
        found.add(name, np.arange(2.0))
        found.add(name, np.zeros(1))
    paths = [signal.path for signal in found.signals]
    assert len(set(paths)) == len(names)
    assert all(path.startswith(name) for path, name in zip(paths, names, strict=True))
    # What is no signal takes no number away.
    assert {left.path for left in found.skipped}.isdisjoint(paths) or set(paths) >= set(names)


DAYS = st.integers(-400_000, 400_000)


@given(days=st.lists(DAYS, min_size=1, max_size=4), unit=st.sampled_from(["h", "s", "ms", "us"]))
def test_dates_and_durations_in_seconds(days: list[int], unit: str) -> None:
    """A thousand years before 1970 and after it, exactly."""
    dates = np.array(days, "M8[D]").astype(f"M8[{unit}]")
    expected = 86400.0 * (np.array(days, float) - days[0])
    values, note = seconds(dates)
    assert_array_equal(values, expected)
    assert note.startswith(f"dates, in s from {dates[0].astype('M8[ms]')}")
    assert_array_equal(seconds(dates - dates[0])[0], expected)


@given(counts=st.lists(st.integers(2000 - 2**63, 2**63 - 1), min_size=2, max_size=4))
def test_dates_in_nanoseconds(counts: list[int]) -> None:
    """Their differences do not always fit into 64 bits."""
    values, _ = seconds(np.array(counts, "M8[ns]"))
    expected = [(count - counts[0]) / 10**9 for count in counts]
    np.testing.assert_allclose(values, expected, rtol=1e-15, atol=0.0)


def test_gaps_among_dates() -> None:
    dates = [["NaT", "2024-01-01"], ["2500-01-02", "2024-01-01T00:00:00.001"]]
    values, note = seconds(np.array(dates, "M8[ms]"))
    days = (datetime.date(2500, 1, 2) - datetime.date(2024, 1, 1)).days
    assert_array_equal(values, [[np.nan, 0.0], [86400.0 * days, 0.001]])
    assert note == "dates, in s from 2024-01-01T00:00:00.000"
    assert_array_equal(seconds(np.array(["NaT"], "M8[ns]"))[0], [np.nan])
    assert_array_equal(seconds(np.array([1, "NaT"], "m8[ns]"))[0], [1e-9, np.nan])


def slowly(path: Path, name: str, left: Allowance) -> Iterator[Source]:
    """Reader that hangs at a member of an archive."""
    for source in read_bit_by_bit(path, name, left):
        misbehave(path, source.name.rpartition("/")[2], left)
        yield source


def misbehave(path: Path, name: str, left: Allowance) -> list[Source]:
    """Reader that does what a name says."""
    if name == "crash":
        os.abort()
    if name == "hang":
        time.sleep(600)
    if name == "grow":
        bytearray(2**34)
    if name == "raise":
        message = "unforeseen"
        raise RuntimeError(message)
    print("noise")  # noqa: T201
    sys.stderr.write("more noise")
    return read_file(path, name, left)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory of a process is limited on Linux only")
def test_one_bad_file_does_not_stop_the_rest(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "SYNTHETIC.csv"
    path.write_bytes(READABLE["SYNTHETIC_comma.csv"])
    names = ["first", "crash", "second", "hang", "grow", "raise", "last"]
    sources = read_guarded([(path, name) for name in names], QUIET, Limits(seconds=3.0), misbehave)
    assert [source.name for source in sources] == names
    reasons = {source.name: source.skipped[0].reason for source in sources if source.skipped}
    assert reasons == {
        "crash": "its reader crashed, perhaps for want of memory",
        "hang": "reading it took longer than 3 s",
        "grow": "reading it needed too much memory",
        "raise": "its reader crashed, perhaps for want of memory",
    }
    assert all(len(source.signals) == 3 for source in sources if source.name not in reasons)
    assert all(source.md5 and source.kind.startswith("text") for source in sources)
    assert capfd.readouterr() == ("", "")
    assert not multiprocessing.active_children()


def test_the_order_and_the_numbers_are_those_of_reading_here(tmp_path: Path) -> None:
    for name, content in READABLE.items():
        (tmp_path / name).write_bytes(content)
    files = files_below([tmp_path])
    there = read_guarded(files, QUIET)
    here = [source for path, name in files for source in read_file(path, name)]
    for one, other in zip(there, here, strict=True):
        for part in ("name", "kind", "md5", "skipped"):
            assert getattr(one, part) == getattr(other, part)
        for signal_there, signal_here in zip(one.signals, other.signals, strict=True):
            assert signal_there.values.tobytes() == signal_here.values.tobytes()


WITHOUT_GUARD = """
from pathlib import Path
from tendonrepro.dataset.readers.guard import read_guarded
from tendonrepro.console import Talk
read_guarded([(Path(__file__), "x")], Talk())
"""


def test_a_script_without_a_main_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "SYNTHETIC_script.py"
    script.write_text(WITHOUT_GUARD)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    assert f"{TendonreproError.__name__}: the process that reads files did not start" in done.stderr


HANGING = """
import signal
from pathlib import Path
import test_readers
from tendonrepro.dataset.readers.guard import read_guarded
if __name__ == "__main__":
    # Tests that run in the background of a shell inherit that interrupts are ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    print("ready", flush=True)
    files = [(Path(__file__), "first"), (Path(__file__), "hang")]
    read_guarded(files, test_readers.QUIET, read=test_readers.misbehave)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no signals there")
@pytest.mark.parametrize("how", ["SIGKILL", pytest.param("SIGINT", marks=pytest.mark.slow)])
def test_nobody_is_left_behind(how: str, tmp_path: Path) -> None:
    script = tmp_path / "SYNTHETIC_script.py"
    script.write_text(HANGING)
    own = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, (ROOT, ROOT / "tests", Path(__file__).parent)))
    }
    to = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    parent = subprocess.Popen([sys.executable, script], env=own, **to)
    process = psutil.Process(parent.pid)
    try:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"ready\n"
        deadline = time.monotonic() + 60
        # The children are the reader and Python's own tracker of resources; the reader sleeps once it hangs.
        while not (children := process.children()) and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(1.0)
        children = process.children()
        assert children
        parent.send_signal(getattr(signal, how))
        parent.wait(30)
    finally:
        parent.kill()
        parent.communicate()
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
