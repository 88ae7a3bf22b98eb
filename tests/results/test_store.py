"""A results folder holds the old result or the new one, and nothing of a user's is lost."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tendonrepro import __version__
from tendonrepro.console import QUIET
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.results.store import MANIFEST, PARTIAL, read_manifest, refuse_others, replaced

posix = pytest.mark.skipif(os.name != "posix", reason="Windows has others")

SLOW_WRITER = """
import sys, time
from pathlib import Path
from tendonrepro.results.store import replaced
with replaced(Path(sys.argv[1]), "b", command="compare", force=True) as result:
    result.write("numbers.json", "new")
    print("half", flush=True)
    time.sleep(60)
"""
HALTING_WRITER = """
import sys
from pathlib import Path
from tendonrepro.results.store import replaced

def halting(move):
    def halted(self, to):
        print("moves", flush=True)
        sys.stdin.readline()
        return move(self, to)
    return halted

Path.rename, Path.replace = halting(Path.rename), halting(Path.replace)
with replaced(Path(sys.argv[1]), "b", command="compare", force=True) as result:
    result.write("numbers.json", "new")
"""
"""Waits for a line before every file that it moves."""


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


def test_a_result_is_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    make(tmp_path / "above" / "mine", "new")
    assert files(tmp_path / "above") == {f"mine/{name}": text for name, text in NEW.items()}
    assert read_manifest(tmp_path / "above" / "mine")["outputs"].keys() == NEW.keys()


def test_the_same_again_replaces_and_another_is_refused(folder: Path) -> None:
    make(folder, "new")
    assert files(folder) == NEW
    with pytest.raises(UsageError, match="configuration"):
        make(folder, digest="b")
    make(folder, digest="b", force=True)
    assert read_manifest(folder)["config"]["sha256"] == "b"


def test_results_of_another_command_or_version_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path)
    with pytest.raises(UsageError):
        refuse_others(tmp_path, "a", command="decouple")
    refuse_others(tmp_path, "a", command="compare")
    monkeypatch.setattr("tendonrepro.results.store.__version__", "9.9")
    with pytest.raises(UsageError):
        refuse_others(tmp_path, "a", command="compare")


def test_an_output_that_is_gone_hinders_neither_an_update_nor_a_replacement(folder: Path) -> None:
    (folder / "tables" / "table2.csv").unlink()
    with replaced(folder, "a", command="compare", update=True) as result:
        result.manifest = read_manifest(folder)
    assert files(folder).keys() == {"numbers.json", "figures/fig13.svg"}
    (folder / "numbers.json").unlink()
    make(folder, "new")
    assert files(folder) == NEW


@pytest.mark.parametrize("name", ["notes.txt", "tables/mine.csv", "traces.csv", ".DS_Store"])
def test_own_files_stay_and_hinder_nothing(folder: Path, name: str) -> None:
    (folder / name).write_text("mine")
    make(folder, "new")
    assert files(folder) == {**NEW, name: "mine"}
    assert read_manifest(folder)["outputs"].keys() == NEW.keys()


def test_a_folder_without_a_manifest_is_somebody_elses(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    with pytest.raises(UsageError, match="thesis"):
        make(tmp_path / "mine")


def test_a_changed_file_is_refused(folder: Path) -> None:
    (folder / "numbers.json").write_text("edited")
    with pytest.raises(UsageError, match="numbers"):
        make(folder)
    make(folder, "new", force=True)
    assert files(folder) == NEW


def test_no_other_process_comes_between_any_two_steps(folder: Path) -> None:
    (folder / "notes.txt").write_text("my notes")
    words = [sys.executable, "-c", HALTING_WRITER, str(folder)]
    tries = 0
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdin is not None
        assert writer.stdout is not None
        for _ in writer.stdout:
            with pytest.raises(UsageError, match="another"):
                make(folder, "mine", force=True)
            tries += 1
            writer.stdin.write("\n")
            writer.stdin.flush()
    assert writer.returncode == 0
    assert tries >= 2
    assert files(folder.parent) == {"mine/numbers.json": "new", "mine/notes.txt": "my notes"}


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
        with pytest.raises(ZeroDivisionError), replaced(path, "b", command="compare", force=True):
            raise ZeroDivisionError
        new = {**NEW, "notes.txt": "mine"}
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


def test_where_no_lock_can_be_had_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("filelock.FileLock.acquire", refused)
    with pytest.raises(TendonreproError, match="No locks") as caught:
        make(tmp_path / "mine")
    assert caught.value.where == str(tmp_path / "mine")
    assert not [*tmp_path.iterdir()]


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


def test_an_empty_folder_of_the_user_stays(folder: Path) -> None:
    (folder / "for later" / "below").mkdir(parents=True)
    (folder / "figures" / "mine").mkdir()
    make(folder, "new", force=True)
    assert (folder / "for later" / "below").is_dir()
    assert (folder / "figures" / "mine").is_dir()


def test_a_name_that_no_manifest_lists_is_kept_too(tmp_path: Path) -> None:
    """In a folder that was the user's own before the first result."""
    path = tmp_path / "mine"
    path.mkdir()
    (path / "numbers.json").write_text("mine")
    make(path, "new", force=True, talk=QUIET)
    assert files(path) == {"numbers.json": "new", "tables/table2.csv": "new", "numbers.json.own": "mine"}


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "mine"
    path.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(path)]
    try:
        subprocess.run(words, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("only root can mount, and not everywhere")
    yield path
    subprocess.run(["umount", str(path)], check=True)


def test_a_real_mount_point_is_written_in_place(mounted: Path) -> None:
    make(mounted)
    (mounted / "notes.txt").write_text("mine")
    make(mounted, "new", force=True)
    assert files(mounted) == {"numbers.json": "new", "tables/table2.csv": "new", "notes.txt": "mine"}
    assert {path.name for path in mounted.iterdir()} == {"numbers.json", "tables", "notes.txt", MANIFEST}
    before = files(mounted)
    with pytest.raises(TendonreproError) as caught:
        make(mounted, "x" * 2**21, force=True)
    assert caught.value.exit_code == 1
    assert files(mounted) == before
    assert [path.name for path in mounted.parent.iterdir()] == ["mine"]


def test_a_damaged_manifest_does_not_stop_a_forced_replacement(folder: Path) -> None:
    (folder / MANIFEST).write_text("{")
    make(folder, "new", force=True)
    assert files(folder) == {"numbers.json": "new", "tables/table2.csv": "new", "figures/fig13.svg": "old"}


def test_a_result_that_lists_no_file_makes_none_of_a_users_its_own(tmp_path: Path) -> None:
    path = tmp_path / "mine"
    with replaced(path, "a", command="compare") as result:
        result.manifest = {
            "tendonrepro_version": __version__,
            "command": "compare",
            "config": {"sha256": "a"},
        }
    (path / "numbers.json").write_text("mine")
    make(path, "new")
    assert files(path) == {**NEW, "numbers.json.own": "mine"}


@posix
def test_links_stay_links(folder: Path) -> None:
    """Of the folder, and of a user's own in it: to a file, to a folder, to nothing."""
    above = folder.parent
    (above / "elsewhere").mkdir()
    (above / "elsewhere" / "data.csv").write_text("mine")
    targets = {"file": above / "elsewhere" / "data.csv", "folder": above / "elsewhere"}
    targets["nothing"] = above / "gone"
    for name, target in targets.items():
        (folder / name).symlink_to(target)
    (above / "latest").symlink_to(folder)
    make(above / "latest", "new")
    assert (above / "latest").readlink() == folder
    assert files(folder)["numbers.json"] == "new"
    assert {name: (folder / name).readlink() for name in targets} == targets
    assert files(above / "elsewhere") == {"data.csv": "mine"}


@posix
def test_group_and_permissions_of_a_folder_stay(folder: Path) -> None:
    modes = {folder: 0o2775, folder / "tables": 0o2770}
    group = next((one for one in os.getgroups() if one != folder.stat().st_gid), folder.stat().st_gid)
    if os.geteuid() == 0:
        group = 12345
    for path, mode in modes.items():
        os.chown(path, -1, group)
        path.chmod(mode)
    make(folder, "new", force=True, extra="figures/fig13.svg")
    assert {path: path.stat().st_mode & 0o7777 for path in modes} == modes
    everything = [folder, *folder.rglob("*")]
    written = [path for path in everything if path.parent != folder / "figures"]
    assert {path.stat().st_gid for path in written if path.name != "figures"} == {group}


@posix
def test_a_folder_that_is_not_writable_is_an_error_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine"
    make(path)
    mkdir = Path.mkdir

    def refusing(self: Path, *given: int, **options: bool) -> None:
        if self == path / PARTIAL:
            raise PermissionError(13, "Permission denied", str(self))
        mkdir(self, *given, **options)

    monkeypatch.setattr(Path, "mkdir", refusing)
    with pytest.raises(TendonreproError, match="mine"), replaced(path, "a", command="compare"):
        pytest.fail("the run began")
    assert [one.name for one in tmp_path.iterdir()] == ["mine"]


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


def test_an_update_leaves_what_it_does_not_make(folder: Path) -> None:
    with replaced(folder, "a", command="compare", update=True) as result:
        result.write("numbers.json", "redrawn")
        result.manifest = read_manifest(folder)
    old = {"tables/table2.csv": "old", "figures/fig13.svg": "old"}
    assert files(folder) == {"numbers.json": "redrawn", **old}
    assert json.loads((folder / MANIFEST).read_text())["outputs"].keys() == files(folder).keys()
    make(folder)


def test_the_folder_one_is_in_takes_a_result(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    make(Path(), "new")
    assert files(folder) == NEW


def test_what_cannot_be_read_elsewhere_is_named_and_not_the_folder(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(TendonreproError) as caught, replaced(folder, "a", command="compare"):
        (tmp_path / "gone.csv").read_bytes()
    assert caught.value.where == str(tmp_path / "gone.csv")
    assert caught.value.hint is None


def test_a_damaged_manifest_is_missing_data(tmp_path: Path) -> None:
    make(tmp_path)
    (tmp_path / MANIFEST).write_text("{")
    with pytest.raises(DataMissingError, match=MANIFEST):
        read_manifest(tmp_path)
