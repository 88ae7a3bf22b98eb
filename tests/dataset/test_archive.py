"""Archives: what is in them is read, and nothing they contain can do harm."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import stat
import sys
import tarfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
from support.seed_files import encrypted_zip, read_file, tar_entry, tarred, zipped

from tendonrepro.dataset.readers import archive
from tendonrepro.dataset.readers import signals as bounds
from tendonrepro.dataset.readers.archive import Member, members
from tendonrepro.dataset.readers.signals import Allowance, Unreadable

TABLE = b"t,q\n0,1\n1,2\n2,4\n"
INSIDE = {"run/a.csv": TABLE}
PACKERS = {"gz": gzip.compress, "bz2": bz2.compress, "xz": lzma.compress}
ARCHIVES = {"zip": zipped(INSIDE), "tar": tarred(INSIDE)} | {
    f"tar.{kind}": tarred(INSIDE, f"w:{kind}") for kind in PACKERS
}
SINGLE = {f"csv.{kind}": pack(TABLE) for kind, pack in PACKERS.items()}
EVERY_ARCHIVE = pytest.mark.parametrize("content", ARCHIVES.values(), ids=ARCHIVES)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "SYNTHETIC.pack"


def unpacked(
    path: Path, content: bytes | bytearray, allowance: Allowance | None = None
) -> list[tuple[Member, bytes]]:
    """Members of an archive with such a content, unpacked into a folder beside it."""
    path.write_bytes(content)
    own = path.with_name("own")
    own.mkdir(exist_ok=True)
    return [
        (member, member.path.read_bytes() if member.path else b"")
        for member in members(path, own, allowance=allowance)
    ]


@pytest.mark.parametrize("suffix", ARCHIVES | SINGLE)
def test_members_are_read_whatever_the_packing(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"SYNTHETIC.{suffix}"
    path.write_bytes((ARCHIVES | SINGLE)[suffix])
    whole, inside = read_file(path, path.name)
    assert (whole.skipped, whole.signals) == ((), ())
    assert inside.name == f"{path.name}/{'run/a.csv' if suffix in ARCHIVES else 'SYNTHETIC.csv'}"
    assert [signal.values.tolist() for signal in inside.signals] == [[0, 1, 2], [1, 2, 4]]


OUTSIDE = ["../a.csv", "run/../../a.csv", "/a.csv", "C:/a.csv", "C:\\a.csv", "..\\a.csv", "\\\\host\\a.csv"]


@pytest.mark.parametrize("name", OUTSIDE)
@pytest.mark.parametrize("pack", [zipped, tarred])
def test_nothing_lands_outside(name: str, pack: Callable[..., bytes], tmp_path: Path) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    found = unpacked(inner / "SYNTHETIC.pack", pack({name: TABLE, "good.csv": TABLE}))
    assert [member.reason for member, _ in found] == ["would land outside the folder", ""]
    assert found[1][1] == TABLE
    assert sorted(file.name for file in tmp_path.rglob("*") if file.is_file()) == ["SYNTHETIC.pack", "member"]


ZIP_LINK = zipfile.ZipInfo("a.csv")
ZIP_LINK.external_attr = (stat.S_IFLNK | 0o777) << 16
TAR_KINDS = [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE]
LINKS = [zipped({ZIP_LINK: b"/etc/passwd"})]
LINKS += [tarred({}, "w", tar_entry("a.csv", kind, "/etc/passwd")) for kind in TAR_KINDS]


@pytest.mark.parametrize("content", LINKS, ids=["zip", "symbolic", "hard", "device", "pipe"])
def test_links_and_devices_are_left_out(content: bytes, path: Path) -> None:
    ((member, _),) = unpacked(path, content)
    assert (member.name, member.reason) == ("a.csv", "a link or device, not a file")
    assert not list(path.with_name("own").iterdir())


BROKEN = zipped({"a.csv": b"A", "b.csv": TABLE}).replace(zlib.crc32(b"A").to_bytes(4, "little"), bytes(4))
ENCRYPTED = encrypted_zip({"a.csv": b"A", "b.csv": TABLE})
BAD = [(ENCRYPTED, "encrypted", "password"), (BROKEN, "broken (Bad CRC-32", "download it again")]


@pytest.mark.parametrize(("content", "reason", "advice"), BAD)
def test_a_bad_member_does_not_stop_the_rest(content: bytes, reason: str, advice: str, path: Path) -> None:
    (first, _), (second, data) = unpacked(path, content)
    assert first.reason.startswith(reason)
    assert advice in first.advice
    assert (second.reason, data) == ("", TABLE)


ZEROS = bytes(2**23)
ENTRY = tarfile.TarInfo("bomb")
OF_SPARSE = {"major": "0", "minor": "1", "name": "bomb", "size": str(2**40), "numblocks": "1", "map": "0,4"}
ENTRY.pax_headers = {f"GNU.sparse.{name}": value for name, value in OF_SPARSE.items()}
ENTRY.size = 4
SPARSE = io.BytesIO()
with tarfile.open(fileobj=SPARSE, mode="w", format=tarfile.PAX_FORMAT) as packed:
    packed.addfile(ENTRY, io.BytesIO(b"abcd"))
BOMBS = {
    "zip": zipped({"bomb": ZEROS}),
    "tar.gz": tarred({"bomb": ZEROS}, "w:gz"),
    "sparse tar": SPARSE.getvalue(),
    "gz.gz": gzip.compress(gzip.compress(ZEROS)),
} | {suffix: pack(ZEROS) for suffix, pack in PACKERS.items()}


@pytest.mark.parametrize("content", BOMBS.values(), ids=BOMBS)
def test_a_bomb_stops_by_its_ratio(content: bytes, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However often it is packed, and whatever a sparse file says of its own size."""
    monkeypatch.setattr(bounds, "RATIO_FROM", 2**20)
    path.write_bytes(content)
    left = Allowance()
    reasons = {skip.reason for source in read_file(path, "x", left) for skip in source.skipped}
    most = max(2**20, 300 * len(content))
    reason = f"unpacks into more than {most / 2**20:.0f} MB, too much for {len(content)} packed bytes"
    assert reasons == {reason}
    assert bounds.MOST_UNPACKED - left.unpacked <= most + 2**20


def test_a_bomb_of_many_members_stops_by_bytes_and_by_number(path: Path) -> None:
    content = zipped({f"{number}.csv": TABLE for number in range(20)})
    for allowance, most, reason in (
        (Allowance(unpacked=10 * len(TABLE)), 10, "after 4 GB unpacked"),
        (Allowance(members=5), 5, "after 10000 files"),
    ):
        found = unpacked(path, content, allowance)
        assert len(found) == most + 1
        assert reason in found[-1][0].reason


def test_archives_inside_each_other_end_at_a_depth(path: Path) -> None:
    content = zipped({"a.csv": TABLE})
    for _ in range(4):
        content = zipped({"inner.zip": content, "a.csv": TABLE})
    path.write_bytes(content)
    sources = read_file(path, "x.zip")
    assert sum(bool(source.signals) for source in sources) == 3
    assert sources[-1].name == "x.zip/a.csv"
    deep = next(source for source in sources if source.name == "x.zip" + 3 * "/inner.zip")
    assert deep.skipped[0].reason == "more than 3 archives inside each other"


def test_names_of_members(path: Path) -> None:
    content = zipped({"__MACOSX/a.csv": TABLE, ".DS_Store": TABLE, "run/": b"", "XXXX.csv": TABLE})
    found = unpacked(path, content.replace(b"XXXX", "数据".encode("gbk")))
    assert [member.name for member, _ in found] == ["数据.csv"]
    path.write_bytes(zipped({"a.csv": TABLE, "b.csv": TABLE}).replace(b"b.csv", b"a.csv"))
    assert [source.name for source in read_file(path, "x")] == ["x", "x/a.csv", "x/a.csv (2)"]


@pytest.mark.parametrize("suffix", ARCHIVES)
def test_a_truncated_archive_is_named(suffix: str, path: Path) -> None:
    content = ARCHIVES[suffix]
    path.write_bytes(content[: 520 if suffix == "tar" else len(content) // 2])
    sources = read_file(path, "x")
    assert sources[0].skipped[0].reason
    assert all(source.signals or source.skipped for source in sources)


@EVERY_ARCHIVE
def test_want_of_memory_is_no_fault_of_the_archive(
    content: bytes, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def greedy(*_: object) -> Member:
        raise MemoryError

    monkeypatch.setattr(archive, "_unpacked", greedy)
    with pytest.raises(MemoryError):
        unpacked(path, content)
    (source,) = read_file(path, "x")
    assert [left.reason for left in source.skipped] == ["needs too much memory"]
    assert source.md5


@pytest.mark.skipif(sys.platform != "linux", reason="has no disk that is always full")
@EVERY_ARCHIVE
def test_a_full_disk_is_no_fault_of_the_archive(content: bytes, path: Path) -> None:
    path.with_name("own").mkdir()
    path.with_name("own").joinpath("member").symlink_to("/dev/full")
    with pytest.raises(Unreadable) as caught:
        unpacked(path, content)
    assert caught.value.reason == "no room to unpack it"
    assert "TMPDIR" in caught.value.advice


def test_an_archive_without_files_and_what_is_none(path: Path) -> None:
    path.write_bytes(zipped({}))
    (source,) = read_file(path, "x")
    assert source.skipped[0].reason == "no files in it"
    with pytest.raises(Unreadable, match="broken archive"):
        unpacked(path, b"PK\x03\x04 and nothing more")
