"""What a manifest on disk may make a command do: it is data, and may come from anywhere."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tendonrepro import __version__
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.files import write_atomically
from tendonrepro.results.folder import MANIFEST, claimed, foretell_refusal, read_manifest, refuse_others

CONTENT = b"somebody else's"
DIGEST = hashlib.sha256(CONTENT).hexdigest()


def result(folder: Path, *names: str) -> Path:
    """A results folder whose manifest lists these names."""
    folder.mkdir()
    config = {"config": {"sha256": "a"}, "tendonrepro_version": __version__}
    (folder / MANIFEST).write_text(json.dumps(config | {"outputs": dict.fromkeys(names, DIGEST)}))
    return folder


def cleared(folder: Path, *, force: bool = False) -> None:
    with claimed(folder, "a", force=force) as held:
        held.clear()


def test_files_of_the_earlier_result_are_removed(tmp_path: Path) -> None:
    folder = result(tmp_path / "out", "figures/fig14.svg", "changed.csv", "gone.csv")
    (folder / "figures").mkdir()
    (folder / "figures/fig14.svg").write_bytes(CONTENT)
    (folder / "changed.csv").write_bytes(b"edited")
    with pytest.raises(UsageError, match="was changed since") as caught:
        cleared(folder)
    assert caught.value.where == str(folder / "changed.csv")
    assert (folder / "figures/fig14.svg").exists()
    cleared(folder, force=True)
    assert {path.name for path in folder.rglob("*") if path.is_file()} == {"changed.csv", ".lock"}


def test_what_no_file_can_replace_is_told_before_the_earlier_result_is_gone(tmp_path: Path) -> None:
    """A folder, a link that leads nowhere or a pipe in the place of a file that the manifest lists."""
    folder = result(tmp_path / "out", "traces.h5", "figures/fig14.svg")
    (folder / "figures").mkdir()
    (folder / "figures/fig14.svg").write_bytes(CONTENT)
    for put in (Path.mkdir, os.mkfifo, lambda path: path.symlink_to(tmp_path / "nowhere")):
        put(folder / "traces.h5")
        with pytest.raises(UsageError, match="was changed since") as caught:
            cleared(folder)
        assert caught.value.where == str(folder / "traces.h5")
        assert (folder / "figures/fig14.svg").exists()
        (folder / "traces.h5").rename(tmp_path / f"moved {len(list(tmp_path.iterdir()))}")
    cleared(folder)
    assert not (folder / "figures/fig14.svg").exists()


def test_a_folder_that_takes_no_file_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(TendonreproError, match="cannot write into the results folder: Permission denied"):
        cleared(tmp_path)


@pytest.mark.parametrize("beside", [True, False], ids=["manifest", "none"])
@pytest.mark.parametrize(
    "name", ["traces.h5", "identified.yaml", "summary.json", "figures/mine.png", "tables/best/table2.csv"]
)
def test_files_that_no_manifest_lists_are_not_overwritten(tmp_path: Path, name: str, beside: bool) -> None:
    folder = result(tmp_path / "out", "gone.csv") if beside else tmp_path / "out"
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(CONTENT)
    with pytest.raises(UsageError, match=f"no {MANIFEST} lists it") as caught:
        cleared(folder)
    assert caught.value.where == str(path)
    cleared(folder, force=True)
    assert path.read_bytes() == CONTENT


def test_what_tells_of_an_interrupted_run_is_no_foreign_file(tmp_path: Path) -> None:
    (tmp_path / "plan.json").touch()
    with claimed(tmp_path, "a", force=False, begun="plan.json"), pytest.raises(UsageError):
        refuse_others(tmp_path, "a")


def test_a_folder_in_a_result_is_no_file_of_it(tmp_path: Path) -> None:
    folder = result(tmp_path / "out", "tables/best/table2.md")
    (folder / "tables" / "best").mkdir(parents=True)
    (folder / "tables/best/table2.md").write_bytes(CONTENT)
    (folder / "figures" / "mine").mkdir(parents=True)
    cleared(folder)
    assert not (folder / "tables/best/table2.md").exists()


def test_results_of_another_command_are_not_overwritten(tmp_path: Path) -> None:
    """`explain` and `compare` are of one configuration, and so of one digest."""
    folder = result(tmp_path / "out")
    for name, mine, other in (("explain", "explain", None), (None, None, "explain")):
        manifest = read_manifest(folder) | {"experiment": "compare", "command": name}
        (folder / MANIFEST).write_text(json.dumps(manifest))
        refuse_others(folder, "a", command=mine)
        with pytest.raises(
            UsageError, match=f"another command: {mine or 'compare'}, not {other or 'compare'}"
        ):
            refuse_others(folder, "a", command=other)


def test_a_result_that_cannot_be_removed_stays_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = result(tmp_path / "out", "tables/table2.md", "figures/fig14.svg")
    for name in ("tables", "figures"):
        (folder / name).mkdir()
        (folder / name / {"tables": "table2.md", "figures": "fig14.svg"}[name]).write_bytes(CONTENT)
    monkeypatch.setattr(os, "access", lambda path, _: path != folder / "tables")
    with pytest.raises(TendonreproError, match="cannot remove the earlier result: no permission") as caught:
        cleared(folder)
    assert caught.value.where == str(folder / "tables")
    assert len(list(folder.glob("*/*"))) == 2
    assert (folder / MANIFEST).exists()


def test_half_a_result_is_none(tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    for name in ("notes.txt", "figures/mine.png"):
        (tmp_path / name).write_bytes(CONTENT)

    def interrupted() -> None:
        with claimed(tmp_path, "a", force=True) as held:
            held.clear()
            held.write("traces.h5", "x")
            write_atomically(tmp_path / "tables" / "table2.md", "x")  # before its writer has returned
            (tmp_path / "figures" / "fig13.svg").touch()
            # Somebody's own, put there in the meantime.
            (tmp_path / "figures" / "later.png").touch()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {"notes.txt", "mine.png", "later.png", ".lock"}


@pytest.mark.parametrize(
    "name",
    ["../victim.txt", "figures/../../victim.txt", "{victim}", "n" * 5000, "d/" * 500 + "n", "", ".", "a\0b"],
    ids=["above", "through", "absolute", "long", "deep", "empty", "dot", "zero"],
)
def test_a_manifest_with_names_that_are_not_its_own_is_none(tmp_path: Path, name: str) -> None:
    victim = tmp_path / "victim.txt"
    victim.write_bytes(CONTENT)
    folder = result(tmp_path / "out", name.format(victim=victim))
    for look in (read_manifest, lambda folder: refuse_others(folder, "a"), cleared):
        with pytest.raises(DataMissingError, match="is not a manifest") as caught:
            look(folder)
        assert "--force" in str(caught.value.hint)
    cleared(folder, force=True)
    assert victim.read_bytes() == CONTENT
    assert not (folder / MANIFEST).exists()


def test_a_failed_run_leaves_no_folder_that_it_made(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    for out, left in ((tmp_path / "new" / "out", tmp_path), (tmp_path / "mine", tmp_path / "mine")):
        with pytest.raises(ZeroDivisionError), claimed(out, "a", force=False):
            raise ZeroDivisionError
        assert left.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize("through", ["file", "folder"])
def test_links_lead_nowhere(tmp_path: Path, through: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    victim = tmp_path / "elsewhere" / "victim.txt"
    victim.write_bytes(CONTENT)
    folder = result(tmp_path / "out", "link/victim.txt", "link.txt")
    if through == "file":
        (folder / "link.txt").symlink_to(victim)
    else:
        (folder / "link").symlink_to(victim.parent, target_is_directory=True)
    with pytest.raises(UsageError, match="was changed since"):
        cleared(folder)  # whatever the manifest says, it is somebody's own
    cleared(folder, force=True)
    assert victim.read_bytes() == CONTENT


def replaced(out: Path, own: dict[str, str]) -> None:
    """A run whose folder is moved away among its writing, and files of somebody else put in its place."""
    with claimed(out, "a", force=False) as held:
        held.clear()
        held.write("traces.h5", "x")
        held.write("tables/table2.csv", "x")
        out.rename(out.with_name("moved"))
        for name, content in own.items():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            (out / name).write_text(content)
        for late in (
            held.clear,
            lambda: held.finish({}, Talk()),
            lambda: held.write("traces.h5", "x"),
            lambda: write_atomically(out / "tables" / "table2.md", "x"),
        ):
            with pytest.raises(TendonreproError, match="was removed while results were written"):
                late()
        held.finish({}, Talk())


def test_a_folder_that_another_command_made_anew_is_its_own(tmp_path: Path) -> None:
    """Nothing is written there, and nothing taken away, whatever it is called."""
    out = tmp_path / "out"
    own = {".lock": "", "traces.h5": "y", "figures/fig14.png": "y", "tables/table2.csv": "y"}
    with pytest.raises(TendonreproError, match="was removed"):
        replaced(out, own)
    left = {path.relative_to(out).as_posix(): path.read_text() for path in out.rglob("*") if path.is_file()}
    assert left == own
    write_atomically(tmp_path / "later.txt", "x")


def test_a_folder_that_is_removed_is_not_made_again(tmp_path: Path) -> None:
    with claimed(tmp_path / "out", "a", force=False) as held:
        shutil.rmtree(held.path)
        with pytest.raises(TendonreproError, match="was removed"):
            held.write("tables/table2.csv", "x")
    assert not held.path.exists()


def test_an_interrupted_run_leaves_figures_of_other_names(tmp_path: Path) -> None:
    with claimed(tmp_path, "a", force=False) as held:
        held.clear()
        (tmp_path / "figures").mkdir()
        for name in ("fig14.svg", "fig14.paper.png", "fig01.jpg"):
            (tmp_path / "figures" / name).touch()
        held.discard()
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {"fig14.paper.png", "fig01.jpg"}


@pytest.mark.parametrize("gone", ["folder", "file"])
def test_what_is_removed_while_results_are_written_is_not_made_again(tmp_path: Path, gone: str) -> None:
    out = tmp_path / "out"
    with claimed(out, "a", force=False) as held:
        held.write("traces.h5", "x")
        if gone == "folder":
            shutil.rmtree(out)
        else:
            (out / "traces.h5").unlink()
        with pytest.raises(TendonreproError, match="was removed") as caught:
            held.finish({}, Talk())
    assert caught.value.exit_code == 1
    assert not (out / MANIFEST).exists()
    assert not list(out.glob("*"))


def test_a_dry_run_says_what_would_be_refused_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = result(tmp_path / "out")
    for digest, words in (("a", ""), ("b", "a run would be refused")):
        foretell_refusal(folder, digest, Talk(), force=False)
        assert words in capsys.readouterr().err
    foretell_refusal(folder, "b", Talk(), force=True)
    assert capsys.readouterr().err == ""


def test_a_claimed_folder_is_swept_before_and_after(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    left = tmp_path / f".fig13.{dead.pid}-0123abcd.pdf"
    left.touch()
    with claimed(tmp_path, "a", force=False):
        assert not left.exists()
        left.touch()
    assert not left.exists()
