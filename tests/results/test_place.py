"""How a result takes its place: one process at a time, wherever the folder lies, and a user's files stay."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tendonrepro import __version__
from tendonrepro.console import QUIET, Talk
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.results.store import MANIFEST, read_manifest, replaced

posix = pytest.mark.skipif(os.name != "posix", reason="Windows has others")

HALTING_WRITER = """
import errno, os, sys
from pathlib import Path
from tendonrepro.results.store import replaced

folder, fixed = Path(sys.argv[1]), sys.argv[2] == "fixed"

def halting(move):
    def halted(self, to):
        if fixed and self == folder:
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        print("moves", flush=True)
        sys.stdin.readline()
        return move(self, to)
    return halted

Path.rename, Path.replace = halting(Path.rename), halting(Path.replace)
with replaced(folder, "b", command="compare", force=True) as result:
    result.write("numbers.json", "new")
"""
"""Waits for a line before every renaming; a fixed folder cannot be renamed."""
HEAD = {"tendonrepro_version": __version__, "command": "compare", "config": {"sha256": "a"}}


def make(
    folder: Path, text: str = "old", *, force: bool = False, extra: str = "", talk: Talk | None = None
) -> None:
    with replaced(folder, "a", command="compare", force=force, talk=talk) as result:
        result.write("numbers.json", text)
        result.write("tables/table2.csv", text)
        if extra:
            result.write(extra, text)
        result.manifest = HEAD


def begin(folder: Path, error: BaseException, name: str = "numbers.json", keep: str = "") -> None:
    with replaced(folder, "a", command="compare", keep=keep) as result:
        result.write(name, "begun")
        raise error


def files(folder: Path) -> dict[str, str]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in found if path.name != MANIFEST}


@pytest.fixture(params=["beside", "fixed"])
def folder(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A results folder, which in the second case cannot be renamed."""
    path = tmp_path / "mine"
    make(path, extra="figures/fig13.svg")
    if request.param == "fixed":
        fix(path, monkeypatch)
    return path


def fix(folder: Path, monkeypatch: pytest.MonkeyPatch, error: int = errno.EBUSY) -> None:
    """Let the system refuse to rename a folder, as it does with a mount point."""
    rename = Path.rename

    def refusing(self: Path, to: Path) -> Path:
        if self == folder:
            raise OSError(error, os.strerror(error))
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", refusing)


@pytest.mark.parametrize("kind", ["beside", "fixed"])
def test_no_other_process_comes_between_any_two_steps(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mine"
    make(path)
    (path / "notes.txt").write_text("my notes")
    words = [sys.executable, "-c", HALTING_WRITER, str(path), kind]
    tries = 0
    with (
        monkeypatch.context() as patch,
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as writer,
    ):
        if kind == "fixed":
            fix(path, patch)
        assert writer.stdin is not None
        assert writer.stdout is not None
        for _ in writer.stdout:
            with pytest.raises(UsageError, match="another"):
                make(path, "mine", force=True)
            tries += 1
            writer.stdin.write("\n")
            writer.stdin.flush()
    assert writer.returncode == 0
    assert tries >= 2
    assert files(tmp_path) == {"mine/numbers.json": "new", "mine/notes.txt": "my notes"}
    make(path, force=True)
    assert (path / "notes.txt").read_text() == "my notes"
    assert [one.name for one in tmp_path.iterdir()] == ["mine"]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder in which nobody can make a file")
def test_a_place_that_cannot_be_written_is_not_another_process() -> None:
    with pytest.raises(TendonreproError) as caught:
        make(Path("/proc/mine"))
    assert caught.value.exit_code == 1
    assert caught.value.where == "/proc/mine"


def test_what_is_new_comes_what_is_old_goes_and_what_is_the_users_stays(folder: Path) -> None:
    (folder / "notes.txt").write_text("mine")
    (folder / "figures" / "mine.svg").write_text("mine")
    make(folder, "new", force=True)
    own = {"notes.txt": "mine", "figures/mine.svg": "mine"}
    assert files(folder) == {"numbers.json": "new", "tables/table2.csv": "new"} | own
    assert read_manifest(folder)["outputs"].keys() == {"numbers.json", "tables/table2.csv"}
    assert [one.name for one in folder.parent.iterdir()] == ["mine"]


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


def test_it_is_said_only_where_the_result_is_written_in_place(
    folder: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    make(folder)
    said = capsys.readouterr().err
    assert (str(folder) in said) == ("fixed" in request.node.name)
    make(folder, talk=QUIET)
    assert not capsys.readouterr().err


def test_a_failed_run_leaves_the_old_result(folder: Path) -> None:
    before = files(folder)
    with pytest.raises(ZeroDivisionError):
        begin(folder, ZeroDivisionError())
    assert files(folder.parent) == {f"mine/{name}": text for name, text in before.items()}


@pytest.mark.parametrize("reason", ["layer of an image", "folder above not writable"])
def test_that_a_folder_cannot_be_renamed_is_found_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reason: str
) -> None:
    path, access = tmp_path / "mine", os.access
    make(path)
    if reason == "layer of an image":
        fix(path, monkeypatch, errno.EXDEV)
    else:
        monkeypatch.setattr(os, "access", lambda place, mode: place != tmp_path and access(place, mode))
    with replaced(path, "a", command="compare", talk=QUIET) as result:
        assert result.path.parent == path
        result.write("numbers.json", "new")
    assert files(tmp_path) == {"mine/numbers.json": "new"}


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


class Killed(BaseException):
    pass


@pytest.mark.parametrize("step", range(3))
def test_files_that_were_cut_off_while_they_took_their_places_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    """The three files of a result: none, one or two of them were moved."""
    path = tmp_path / "mine"
    make(path)
    (path / "notes.txt").write_text("mine")
    fix(path, monkeypatch)
    moved: list[Path] = []
    replace = Path.replace

    def dying(self: Path, to: Path) -> Path:
        if len(moved) == step:
            raise Killed
        moved.append(to)
        return replace(self, to)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", dying)
        with pytest.raises(Killed):
            make(path, "new", force=True, talk=QUIET)
    assert not (path / MANIFEST).exists(), "a result that is not complete has no manifest"
    with pytest.raises(UsageError, match=r"notes\.txt"):
        make(path, "newer", talk=QUIET)
    assert files(path) == {"numbers.json": "new", "tables/table2.csv": "new", "notes.txt": "mine"}
    assert read_manifest(path)["outputs"].keys() == {"numbers.json", "tables/table2.csv"}


def test_own_files_of_an_old_result_that_a_kill_left_beside_the_new_one_move_over(tmp_path: Path) -> None:
    for name in ("mine", ".mine.old"):
        make(tmp_path / name, extra="" if name == "mine" else "figures/fig13.svg")
    (tmp_path / ".mine.old" / "notes.txt").write_text("mine")
    make(tmp_path / "mine", "new", force=True)
    new = {"mine/numbers.json": "new", "mine/tables/table2.csv": "new", "mine/notes.txt": "mine"}
    assert files(tmp_path) == new


def test_a_damaged_manifest_does_not_stop_a_forced_replacement(folder: Path) -> None:
    (folder / MANIFEST).write_text("{")
    make(folder, "new", force=True)
    assert files(folder) == {"numbers.json": "new", "tables/table2.csv": "new", "figures/fig13.svg": "old"}


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
    with pytest.raises(UsageError):
        make(above / "latest", "new")
    make(above / "latest", "new", force=True)
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
    monkeypatch.setattr(os, "access", lambda place, _: place != path)
    with pytest.raises(TendonreproError, match="mine"), replaced(path, "a", command="compare"):
        pytest.fail("the run began")
    assert [one.name for one in tmp_path.iterdir()] == ["mine"]


def test_where_an_interrupted_study_lies_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(KeyboardInterrupt):
        begin(folder, KeyboardInterrupt(), "blocks/0", keep="blocks")
    (kept,) = (path for path in folder.parent.rglob("blocks") if path.is_dir())
    assert str(kept) in capsys.readouterr().err
    assert files(kept) == {"0": "begun"}
    with pytest.raises(KeyboardInterrupt):
        begin(folder, KeyboardInterrupt(), keep="other")
    assert "kept" not in capsys.readouterr().err
