from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from tendonrepro.errors import DataMissingError, TendonreproError
from tendonrepro.files import atomic_path, sha256_of, to_json, write_atomically


def test_content_is_written_as_it_is_and_the_folder_is_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "text.md"
    write_atomically(path, "τ_m\r\nend\n")
    assert path.read_bytes() == "τ_m\r\nend\n".encode()
    write_atomically(path, b"\x00\xff")
    assert path.read_bytes() == b"\x00\xff"
    assert list(path.parent.iterdir()) == [path]


def test_a_block_that_fails_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "kept.txt"
    path.write_text("old")

    def fail_half_way() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half of the n")
            assert temporary.suffix == ".txt"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_half_way()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no permission bits")
def test_the_file_is_as_readable_as_any_other(tmp_path: Path) -> None:
    # tempfile.mkstemp would make it private, and colleagues could not read the results.
    ordinary, ours = tmp_path / "ordinary", tmp_path / "ours"
    ordinary.write_text("x")
    write_atomically(ours, "x")
    assert ours.stat().st_mode == ordinary.stat().st_mode


def test_a_file_where_the_folder_should_be_and_the_other_way_round(tmp_path: Path) -> None:
    blocker = tmp_path / "reports"
    blocker.write_text("I am a file")
    with pytest.raises(TendonreproError, match=r"^cannot write .*table\.csv: \w") as caught:
        write_atomically(blocker / "table.csv", "x")
    assert "\n" not in str(caught.value)
    assert blocker.read_text() == "I am a file"
    (tmp_path / "traces.h5").mkdir()
    with pytest.raises(TendonreproError, match=r"cannot write .*traces\.h5"):
        write_atomically(tmp_path / "traces.h5", "x")
    assert {path.name for path in tmp_path.iterdir()} == {"reports", "traces.h5"}


def test_sha256_of_a_known_text_and_of_a_missing_file(tmp_path: Path) -> None:
    path = tmp_path / "abc"
    path.write_bytes(b"abc")
    assert sha256_of(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    with pytest.raises(DataMissingError, match=r"cannot read .*nowhere") as caught:
        sha256_of(tmp_path / "nowhere")
    assert caught.value.exit_code == 4


def test_what_is_not_finite_is_null_in_json() -> None:
    found = json.loads(to_json({"τ": (1.5, float("nan"), {"x": [float("inf"), -float("inf")]})}))
    assert found == {"τ": [1.5, None, {"x": [None, None]}]}


@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege there")
def test_a_link_to_a_file_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    kept, link = tmp_path / "kept" / "real.txt", tmp_path / "link.txt"
    write_atomically(kept, "old")
    link.symlink_to(kept)
    write_atomically(link, "new")
    assert link.is_symlink()
    assert kept.read_text() == "new"
    assert [*kept.parent.iterdir()] == [kept]
