"""Files are told by content, go to their reader, and no file takes the program down."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import seed_files

from tendonrepro.dataset.filetype import ADVICE, FileType, kind_of
from tendonrepro.dataset.guard import Limits, read_guarded
from tendonrepro.dataset.readers import files_below, read_file
from tendonrepro.dataset.signals import Source
from tendonrepro.errors import DataMissingError, TendonreproError
from tendonrepro.talk import Talk

QUIET = Talk(quiet=True)
READABLE = seed_files.readable()
KINDS = {
    "SYNTHETIC_comma.csv": FileType.TEXT,
    "SYNTHETIC_semicolon.csv": FileType.TEXT,
    "SYNTHETIC_utf16.txt": FileType.TEXT,
    "SYNTHETIC.xlsx": FileType.XLSX,
    "SYNTHETIC.xls": FileType.XLS,
    "SYNTHETIC.ods": FileType.ODS,
    "SYNTHETIC.npy": FileType.NPY,
    "SYNTHETIC.npz": FileType.NPZ,
    "SYNTHETIC.h5": FileType.HDF5,
    "SYNTHETIC_4.mat": FileType.MATLAB_4,
    "SYNTHETIC_5.mat": FileType.MATLAB_5,
    "SYNTHETIC_7.mat": FileType.MATLAB_5,
    "SYNTHETIC_73.mat": FileType.MATLAB_73,
    "SYNTHETIC.zip": FileType.ZIP,
    "SYNTHETIC.tar": FileType.TAR,
    "SYNTHETIC.tar.gz": FileType.GZIP,
    "SYNTHETIC.csv.gz": FileType.GZIP,
    "SYNTHETIC.csv.bz2": FileType.BZIP2,
    "SYNTHETIC.csv.xz": FileType.XZ,
}


def encrypted_zip() -> bytes:
    raw = bytearray(seed_files.zipped({"a.csv": b"x"}))
    raw[raw.index(b"PK\x01\x02") + 8] |= 1
    return bytes(raw)


UNREAD = {
    "a.opj": (b"CPYA 4.2673 552#\n", FileType.ORIGIN),
    "a.opju": (b"CPYUA 4.3380 160\n", FileType.ORIGIN),
    "a.tdms": (b"TDSm\x0e\x00\x00\x00", FileType.TDMS),
    "a.pdf": (b"%PDF-1.7\n", FileType.PDF),
    "a.png": (b"\x89PNG\r\n\x1a\n", FileType.IMAGE),
    "a.jpg": (b"\xff\xd8\xff\xe0", FileType.IMAGE),
    "a.rar": (b"Rar!\x1a\x07\x01\x00", FileType.RAR),
    "a.7z": (b"7z\xbc\xaf\x27\x1c\x00\x04", FileType.SEVEN_ZIP),
    "a.zip": (encrypted_zip(), FileType.ENCRYPTED_ZIP),
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
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_a_file_is_told_by_content_and_read(name: str, tmp_path: Path) -> None:
    path = tmp_path / "misleading.pdf"
    path.write_bytes(READABLE[name])
    assert kind_of(path) is KINDS[name]
    sources = read_file(path, name)
    assert any(source.signals for source in sources)
    assert sources[0].md5 == hashlib.md5(READABLE[name], usedforsecurity=False).hexdigest()
    assert sources[0].size == len(READABLE[name])


def test_every_readable_type_has_a_seed() -> None:
    assert set(FileType) - set(ADVICE) - {FileType.XLSB} == set(KINDS.values())


@pytest.mark.parametrize("name", UNREAD)
def test_what_is_not_read_is_named_with_advice(name: str, tmp_path: Path) -> None:
    content, kind = UNREAD[name]
    path = tmp_path / name
    path.write_bytes(content)
    assert kind_of(path) is kind
    (source,) = read_file(path, name)
    assert source.kind == str(kind)
    assert source.skipped[0].reason
    assert source.skipped[0].advice == ADVICE[kind]


def test_every_unread_type_is_tested() -> None:
    assert set(ADVICE) - {FileType.ZSTD, FileType.LIVE_SCRIPT} == {kind for _, kind in UNREAD.values()}


def test_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    (source,) = read_file(tmp_path / "missing", "missing")
    assert source.skipped[0].reason.startswith("cannot be opened")


def test_files_below(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    for name in [
        "b/z.csv",
        "a.csv",
        ".hidden",
        ".git/x",
        "c.mat.part",
        "c.mat.part.json",
        "d.lock",
        "e.json",
    ]:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1\n")
    (tmp_path / "secret").write_text("1\n")
    if sys.platform != "win32":  # where links need a right of their own
        (folder / "link").symlink_to(tmp_path / "secret")
        (folder / "circle").symlink_to(folder)
    assert [name for _, name in files_below([folder])] == ["a.csv", "e.json", "b/z.csv"]
    both = files_below([folder / "a.csv", folder])
    assert [name for _, name in both] == ["a.csv", "data/a.csv", "data/e.json", "data/b/z.csv"]
    assert all(path.is_file() for path, _ in both)


def test_no_files_below(tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="does not exist"):
        files_below([tmp_path / "missing"])
    with pytest.raises(DataMissingError, match="no files in"):
        files_below([tmp_path])


def misbehave(path: Path, name: str) -> list[Source]:
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
    return read_file(path, name)


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
    assert [(one.name, one.kind, one.md5, one.skipped) for one in there] == [
        (one.name, one.kind, one.md5, one.skipped) for one in here
    ]
    for one, other in zip(there, here, strict=True):
        for signal_there, signal_here in zip(one.signals, other.signals, strict=True):
            assert signal_there.values.tobytes() == signal_here.values.tobytes()


WITHOUT_GUARD = """
from pathlib import Path
from tendonrepro.dataset.guard import read_guarded
from tendonrepro.talk import Talk
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
from tendonrepro.dataset.guard import read_guarded
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
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    parent = subprocess.Popen(
        [sys.executable, script], env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
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
