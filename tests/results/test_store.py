"""A results folder holds the old result or the new one, and nothing of a user's is lost."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tendonrepro import __version__
from tendonrepro.console import QUIET
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.results.store import MANIFEST, PARTIAL, read_manifest, refuse_others, replaced

SLOW_WRITER = """
import sys, time
from pathlib import Path
from tendonrepro.results.store import replaced
with replaced(Path(sys.argv[1]), "b", command="compare", force=True) as result:
    result.write("numbers.json", "new")
    print("half", flush=True)
    time.sleep(60)
"""


def make(folder: Path, text: str = "old", digest: str = "a", extra: str = "", **options: object) -> None:
    with replaced(folder, digest, command="compare", **options) as result:  # type: ignore[arg-type]
        for name in ("numbers.json", "tables/table2.csv", *filter(None, [extra])):
            result.write(name, text)
        head = {"tendonrepro_version": __version__, "command": "compare", "config": {"sha256": digest}}
        result.manifest = head


def begin(folder: Path, error: BaseException, name: str = "numbers.json", keep: str = "") -> None:
    with replaced(folder, "a", command="compare", keep=keep) as result:
        result.write("half.json", "half")
        result.write(name, "begun")
        raise error


def files(folder: Path) -> dict[str, str]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in found if path.name != MANIFEST}


NEW = {"numbers.json": "new", "tables/table2.csv": "new"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "mine"
    make(path, extra="figures/fig13.svg")
    return path


def test_the_same_again_replaces_and_another_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    make(Path(), "new")
    assert files(folder) == NEW
    with pytest.raises(UsageError, match="configuration"):
        make(folder, digest="b")
    make(folder, digest="b", force=True)
    assert read_manifest(folder)["config"]["sha256"] == "b"
    with pytest.raises(UsageError):
        refuse_others(folder, "b", command="decouple")
    refuse_others(folder, "b", command="compare")
    monkeypatch.setattr("tendonrepro.results.store.__version__", "9.9")
    with pytest.raises(UsageError):
        refuse_others(folder, "b", command="compare")


def test_an_output_that_is_gone_hinders_neither_an_update_nor_a_replacement(folder: Path) -> None:
    (folder / "tables" / "table2.csv").unlink()
    with replaced(folder, "a", command="compare", update=True) as result:
        result.write("numbers.json", "redrawn")
        result.manifest = read_manifest(folder)
    assert files(folder) == {"numbers.json": "redrawn", "figures/fig13.svg": "old"}
    assert json.loads((folder / MANIFEST).read_text())["outputs"].keys() == files(folder).keys()
    (folder / "numbers.json").unlink()
    make(folder, "new")
    assert files(folder) == NEW


def test_own_files_and_folders_stay_and_hinder_nothing(folder: Path) -> None:
    own = dict.fromkeys(("notes.txt", "tables/mine.csv", "traces.csv", ".DS_Store"), "mine")
    for name, text in own.items():
        (folder / name).write_text(text)
    (folder / "for later" / "below").mkdir(parents=True)
    make(folder, "new")
    assert files(folder) == {**NEW, **own}
    assert read_manifest(folder)["outputs"].keys() == NEW.keys()
    assert (folder / "for later" / "below").is_dir()


def test_a_folder_without_a_manifest_is_somebody_elses(tmp_path: Path) -> None:
    path = tmp_path / "mine"
    path.mkdir()
    (path / "numbers.json").write_text("mine")
    with pytest.raises(UsageError, match="numbers"):
        make(path)
    make(path, "new", force=True, talk=QUIET)
    assert files(path) == {**NEW, "numbers.json.own": "mine"}


def test_a_changed_file_is_refused(folder: Path) -> None:
    (folder / "numbers.json").write_text("edited")
    with pytest.raises(UsageError, match="numbers"):
        make(folder)
    make(folder, "new", force=True)
    assert files(folder) == NEW


def test_a_killed_writer_keeps_others_out_and_then_leaves_the_old_result(folder: Path) -> None:
    before = files(folder)
    words = [sys.executable, "-c", SLOW_WRITER, str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"half\n"
        with pytest.raises(UsageError, match="mine"):
            make(folder)
        writer.kill()
    assert before.items() <= files(folder).items()
    assert read_manifest(folder)["config"]["sha256"] == "a"
    make(folder, "new")
    assert files(folder.parent) == {f"mine/{name}": text for name, text in NEW.items()}


class Killed(BaseException):
    pass


@pytest.mark.parametrize("kind", ["first", "another"])
def test_a_kill_at_any_step_leaves_the_old_result_or_the_next_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    steps = {
        (Path, "replace"): Path.replace,
        (Path, "unlink"): Path.unlink,
        (shutil, "rmtree"): shutil.rmtree,
    }
    for step in range(100):
        path, left = tmp_path / str(step) / "mine", step
        path.mkdir(parents=True)
        if kind == "another":
            make(path, extra="figures/fig13.svg")
        (path / "notes.txt").write_text("mine")
        before = files(path)

        def dying(whole, *given, **options):
            nonlocal left
            if whole is steps[Path, "unlink"] and given[0].name == ".lock":
                return whole(*given, **options)
            left -= 1
            if left < 0:
                raise Killed
            return whole(*given, **options)

        finished = True
        with monkeypatch.context() as patch:
            for (owner, name), whole in steps.items():
                patch.setattr(owner, name, lambda *a, _w=whole, **k: dying(_w, *a, **k))
            try:
                make(path, "new", digest="b", force=True)
            except Killed:
                finished = False
        new = {**NEW, "notes.txt": "mine"}
        if (path / MANIFEST).exists():
            there = {name: text for name, text in files(path).items() if not name.startswith(PARTIAL)}
            assert there == new or there.items() <= before.items(), "a manifest of what is not there"
        with pytest.raises(ZeroDivisionError), replaced(path, "b", command="compare", force=True):
            raise ZeroDivisionError
        assert files(path) in ([new] if finished else [before, new]), step
        if files(path) == new:
            assert read_manifest(path)["outputs"].keys() == NEW.keys()
        if finished:
            break
    assert step > 4


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder in which nobody can make a file")
def test_a_place_that_cannot_be_written_is_not_another_process() -> None:
    with pytest.raises(TendonreproError) as caught:
        make(Path("/proc/mine"))
    assert caught.value.exit_code == 1
    assert caught.value.where == "/proc/mine"


def test_what_cannot_be_read_elsewhere_is_named_and_not_the_folder(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(TendonreproError) as caught, replaced(folder, "a", command="compare"):
        (tmp_path / "gone.csv").read_bytes()
    assert caught.value.where == str(tmp_path / "gone.csv")
    assert caught.value.hint is None


def test_own_files_give_their_names_and_stay(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One of the name of a new file, twice, and one of the name of a new folder."""
    for text in ("mine", "mine too"):
        (folder / "samples.json").write_text(text)
        make(folder, "new", force=True, extra="samples.json")
        assert "samples.json.own" in capsys.readouterr().err
        make(folder, "new", force=True)
    (folder / "extra").write_text("a file")
    make(folder, "new", force=True, extra="extra/samples.json")
    held = files(folder)
    kept = {name: text for name, text in held.items() if ".own" in name}
    assert kept == {"samples.json.own": "mine", "samples.json.own1": "mine too", "extra.own": "a file"}
    assert held["extra/samples.json"] == "new"


def test_a_damaged_manifest_is_missing_data_and_stops_no_forced_replacement(folder: Path) -> None:
    (folder / MANIFEST).write_text("{")
    with pytest.raises(DataMissingError, match=MANIFEST):
        read_manifest(folder)
    make(folder, "new", force=True)
    assert files(folder) == {**NEW, "figures/fig13.svg": "old"}


@pytest.mark.skipif(os.name != "posix", reason="Windows has others")
def test_links_stay_links(folder: Path) -> None:
    """Of the folder, and of a user's own in it, also to nothing."""
    above = folder.parent
    for name in ("elsewhere", "gone"):
        (folder / name).symlink_to(above / name)
    (above / "elsewhere").mkdir()
    (above / "latest").symlink_to(folder)
    make(above / "latest", "new")
    assert (above / "latest").readlink() == folder
    assert files(folder)["numbers.json"] == "new"
    assert {name: (folder / name).readlink() for name in ("elsewhere", "gone")} == {
        name: above / name for name in ("elsewhere", "gone")
    }


def test_an_interrupted_study_goes_on_and_where_it_lies_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(KeyboardInterrupt):
        begin(folder, KeyboardInterrupt(), "blocks/0", keep="blocks")
    (kept,) = (path for path in folder.parent.rglob("blocks") if path.is_dir())
    assert str(kept) in capsys.readouterr().err
    assert files(kept) == {"0": "begun"}
    # What is refused would be refused again, and stays.
    with pytest.raises(UsageError):
        begin(folder, UsageError("of others"), keep="blocks")
    assert str(kept) not in capsys.readouterr().err
    assert files(kept) == {"0": "begun"}
    with replaced(folder, "a", command="compare", keep="blocks") as result:
        assert files(result.path) == {"blocks/0": "begun"}
        result.manifest = read_manifest(folder)
    assert files(folder) == {"blocks/0": "begun"}
    with pytest.raises(KeyboardInterrupt):
        begin(folder, KeyboardInterrupt(), keep="other")
    assert "kept" not in capsys.readouterr().err
    assert not (folder / PARTIAL).exists()
