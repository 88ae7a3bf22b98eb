"""Archives: what is in them is read, and nothing they contain can do harm."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sys
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tendonrepro.dataset.readers import archive
from tendonrepro.dataset.readers.archive import Allowance, Member, members
from tendonrepro.dataset.readers.read import read_file
from tendonrepro.dataset.readers.signals import Unreadable

TABLE = b"t,q\n0,1\n1,2\n2,4\n"


def zip_of(path: Path, content: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in content.items():
            packed.writestr(name, data)
    return path


def tar_of(path: Path, content: dict[str, bytes], mode: str = "w") -> Path:
    with tarfile.open(path, mode) as packed:  # type: ignore[call-overload]
        for name, data in content.items():
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            packed.addfile(entry, io.BytesIO(data))
    return path


def unpacked(path: Path, folder: Path, allowance: Allowance | None = None) -> list[tuple[Member, bytes]]:
    folder.mkdir(exist_ok=True)
    return [
        (member, member.path.read_bytes() if member.path else b"")
        for member in members(path, folder, allowance=allowance)
    ]


PACKERS: dict[str, Callable[[Path], Path]] = {
    "zip": lambda path: zip_of(path, {"run/a.csv": TABLE}),
    "tar": lambda path: tar_of(path, {"run/a.csv": TABLE}),
    "tar.gz": lambda path: tar_of(path, {"run/a.csv": TABLE}, "w:gz"),
    "tar.bz2": lambda path: tar_of(path, {"run/a.csv": TABLE}, "w:bz2"),
    "tar.xz": lambda path: tar_of(path, {"run/a.csv": TABLE}, "w:xz"),
}


@pytest.mark.parametrize("suffix", PACKERS)
def test_members_are_read_whatever_the_packing(suffix: str, tmp_path: Path) -> None:
    path = PACKERS[suffix](tmp_path / f"SYNTHETIC.{suffix}")
    whole, inside = read_file(path, path.name)
    assert (whole.skipped, whole.signals) == ((), ())
    assert inside.name == f"SYNTHETIC.{suffix}/run/a.csv"
    assert [signal.values.tolist() for signal in inside.signals] == [[0, 1, 2], [1, 2, 4]]


@pytest.mark.parametrize(
    ("suffix", "pack"), [("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress)]
)
def test_a_single_packed_file(suffix: str, pack: Callable[[bytes], bytes], tmp_path: Path) -> None:
    path = tmp_path / f"SYNTHETIC.csv.{suffix}"
    path.write_bytes(pack(TABLE))
    _, inside = read_file(path, path.name)
    assert inside.name == f"SYNTHETIC.csv.{suffix}/SYNTHETIC.csv"
    assert len(inside.signals) == 2


OUTSIDE = ["../a.csv", "run/../../a.csv", "/a.csv", "C:/a.csv", "C:\\a.csv", "..\\a.csv", "\\\\host\\a.csv"]


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("pack", [zip_of, tar_of])
def test_nothing_lands_outside(name: str, pack: Callable[..., Path], tmp_path: Path) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    path = pack(tmp_path / "SYNTHETIC.pack", {name: TABLE, "good.csv": TABLE})
    found = unpacked(path, inner)
    assert [member.reason for member, _ in found] == ["would land outside the folder", ""]
    assert found[1][1] == TABLE
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == ["SYNTHETIC.pack", "member"]


@pytest.mark.parametrize(
    "kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE, b"zip"]
)
def test_links_and_devices_are_left_out(kind: bytes, tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC"
    if kind == b"zip":
        with zipfile.ZipFile(path, "w") as zipped:
            link = zipfile.ZipInfo("a.csv")
            link.external_attr = 0o120777 << 16
            zipped.writestr(link, "/etc/passwd")
    else:
        with tarfile.open(path, "w") as packed:
            entry = tarfile.TarInfo("a.csv")
            entry.type, entry.linkname = kind, "/etc/passwd"
            packed.addfile(entry)
    ((member, _),) = unpacked(path, tmp_path / "own")
    assert (member.name, member.reason) == ("a.csv", "a link or device, not a file")
    assert not list((tmp_path / "own").iterdir())


def test_an_encrypted_member_does_not_stop_the_rest(tmp_path: Path) -> None:
    path = zip_of(tmp_path / "SYNTHETIC.zip", {"a": TABLE, "b": TABLE})
    raw = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        raw[raw.index(signature) + offset] |= 1
    path.write_bytes(raw)
    first, second = unpacked(path, tmp_path / "own")
    assert first[0].reason == "encrypted"
    assert "password" in first[0].advice
    assert second[1] == TABLE


def test_a_broken_member_does_not_stop_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.zip"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("a", b"AAAA" * 20)
        packed.writestr("b", TABLE)
    path.write_bytes(path.read_bytes().replace(b"AAAA", b"BBBB", 1))
    first, second = unpacked(path, tmp_path / "own")
    assert first[0].reason.startswith("broken (Bad CRC-32")
    assert second[1] == TABLE


@pytest.mark.parametrize("suffix", ["zip", "tar.gz", "gz", "bz2", "xz"])
def test_a_bomb_stops_by_its_ratio(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "RATIO_FROM", 2**20)
    zeros = bytes(2**23)
    path = tmp_path / f"SYNTHETIC.{suffix}"
    if suffix == "zip":
        zip_of(path, {"bomb": zeros})
    elif suffix == "tar.gz":
        tar_of(path, {"bomb": zeros}, "w:gz")
    else:
        path.write_bytes({"gz": gzip, "bz2": bz2, "xz": lzma}[suffix].compress(zeros))
    found = unpacked(path, tmp_path / "own")
    assert [member.reason for member, _ in found] == ["unpacks into more than 300 times its size"]
    assert sum(file.stat().st_size for file in (tmp_path / "own").iterdir()) <= 2**22


def test_a_bomb_of_many_members_stops_by_bytes_and_by_number(tmp_path: Path) -> None:
    path = zip_of(tmp_path / "SYNTHETIC.zip", {f"{number}.csv": TABLE for number in range(20)})
    by_bytes = unpacked(path, tmp_path / "own", Allowance(bytes_left=10 * len(TABLE)))
    assert len(by_bytes) == 11
    assert "more than 4 GB" in by_bytes[-1][0].reason
    by_number = unpacked(path, tmp_path / "own", Allowance(members_left=5))
    assert len(by_number) == 6
    assert "more than 10000 files" in by_number[-1][0].reason


def test_a_sparse_file_counts_what_it_unpacks_to(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.tar"
    entry = tarfile.TarInfo("bomb")
    entry.pax_headers = {
        "GNU.sparse.major": "0",
        "GNU.sparse.minor": "1",
        "GNU.sparse.name": "bomb",
        "GNU.sparse.size": str(2**40),
        "GNU.sparse.numblocks": "1",
        "GNU.sparse.map": "0,4",
    }
    entry.size = 4
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as packed:
        packed.addfile(entry, io.BytesIO(b"abcd"))
    found = unpacked(path, tmp_path / "own", Allowance(bytes_left=2**21))
    assert "more than 4 GB" in found[-1][0].reason
    assert sum(file.stat().st_size for file in (tmp_path / "own").iterdir()) <= 2**21


def test_archives_inside_each_other_end_at_a_depth(tmp_path: Path) -> None:
    path = zip_of(tmp_path / "SYNTHETIC.zip", {"a.csv": TABLE})
    for _ in range(4):
        zip_of(path, {"inner.zip": path.read_bytes(), "a.csv": TABLE})
    sources = read_file(path, "x.zip")
    assert sum(bool(source.signals) for source in sources) == 3
    assert sources[-1].name == "x.zip/a.csv"
    deep = next(source for source in sources if source.name == "x.zip" + 3 * "/inner.zip")
    assert deep.skipped[0].reason == "more than 3 archives inside each other"


def test_names_of_members(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.zip"
    zip_of(path, {"__MACOSX/a.csv": TABLE, ".DS_Store": TABLE, "run/": b"", "XXXX.csv": TABLE})
    path.write_bytes(path.read_bytes().replace(b"XXXX", "数据".encode("gbk")))
    assert [member.name for member, _ in unpacked(path, tmp_path / "own")] == ["数据.csv"]
    zip_of(path, {"a.csv": TABLE, "b.csv": TABLE})
    path.write_bytes(path.read_bytes().replace(b"b.csv", b"a.csv"))
    assert [source.name for source in read_file(path, "x")] == ["x", "x/a.csv", "x/a.csv (2)"]


@pytest.mark.parametrize("suffix", PACKERS)
def test_a_truncated_archive_is_named(suffix: str, tmp_path: Path) -> None:
    path = PACKERS[suffix](tmp_path / f"SYNTHETIC.{suffix}")
    content = path.read_bytes()[:520] if suffix == "tar" else path.read_bytes()[:-30]
    path.write_bytes(content[: len(content) // 2] if suffix != "tar" else content)
    sources = read_file(path, "x")
    assert sources[0].skipped[0].reason
    assert all(source.signals or source.skipped for source in sources)


@pytest.mark.parametrize("suffix", PACKERS)
def test_want_of_memory_is_no_fault_of_the_archive(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def greedy(*_: object) -> Member:
        raise MemoryError

    path = PACKERS[suffix](tmp_path / f"SYNTHETIC.{suffix}")
    monkeypatch.setattr(archive, "_unpacked", greedy)
    with pytest.raises(MemoryError):
        unpacked(path, tmp_path / "own")
    (source,) = read_file(path, "x")
    assert [left.reason for left in source.skipped] == ["needs too much memory"]
    assert source.md5


@pytest.mark.skipif(sys.platform != "linux", reason="has no disk that is always full")
@pytest.mark.parametrize("suffix", PACKERS)
def test_a_full_disk_is_no_fault_of_the_archive(suffix: str, tmp_path: Path) -> None:
    path = PACKERS[suffix](tmp_path / f"SYNTHETIC.{suffix}")
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "member").symlink_to("/dev/full")
    with pytest.raises(Unreadable) as caught:
        unpacked(path, tmp_path / "own")
    assert caught.value.reason == "no room to unpack it"
    assert "TMPDIR" in caught.value.advice


def test_an_empty_archive_says_so(tmp_path: Path) -> None:
    (source,) = read_file(zip_of(tmp_path / "SYNTHETIC.zip", {}), "x")
    assert source.skipped[0].reason == "no files in it"


def test_what_is_no_archive_cannot_be_opened(tmp_path: Path) -> None:
    path = tmp_path / "SYNTHETIC.zip"
    path.write_bytes(b"PK\x03\x04 and nothing more")
    with pytest.raises(Unreadable, match="broken archive"):
        unpacked(path, tmp_path / "own")
