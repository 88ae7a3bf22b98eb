"""A results folder is replaced whole: the old result or the new one, and nothing of a user's is lost."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tendonrepro import __version__
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.store import MANIFEST, read_manifest, refuse_others, replaced

SLOW_WRITER = """
import sys, time
from pathlib import Path
from tendonrepro.results.store import replaced
with replaced(Path(sys.argv[1]), "b", command="compare", force=True) as result:
    result.write("numbers.json", "new")
    print("half", flush=True)
    time.sleep(60)
"""


def make(folder: Path, digest: str = "a", text: str = "old", **options: object) -> None:
    with replaced(folder, digest, command="compare", **options) as result:  # type: ignore[arg-type]
        result.write("numbers.json", text)
        result.write("tables/table2.csv", text)
        head = {"tendonrepro_version": __version__, "command": "compare", "config": {"sha256": digest}}
        result.manifest = head


def begin(folder: Path, error: BaseException, keep: str = "") -> None:
    with replaced(folder, "a", command="compare", keep=keep) as result:
        result.write("shards/0", "done")
        result.write("numbers.json", "half")
        raise error


def names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_a_result_is_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    make(tmp_path / "above" / "mine")
    assert names(tmp_path / "above") == {"mine/manifest.json", "mine/numbers.json", "mine/tables/table2.csv"}
    assert set(read_manifest(tmp_path / "above" / "mine")["outputs"]) == {"numbers.json", "tables/table2.csv"}


def test_the_same_again_replaces_and_another_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    make(folder)
    make(folder, text="again")
    assert (folder / "numbers.json").read_text() == "again"
    with pytest.raises(UsageError, match="configuration"):
        make(folder, "b")
    make(folder, "b", force=True)
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


def test_an_output_that_is_gone_hinders_neither_an_update_nor_a_replacement(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    make(folder)
    (folder / "tables" / "table2.csv").unlink()
    with replaced(folder, "a", command="compare", update=True) as result:
        result.manifest = read_manifest(folder)
    assert names(folder) == {MANIFEST, "numbers.json"}
    (folder / "numbers.json").unlink()
    make(folder)
    assert names(folder) == {MANIFEST, "numbers.json", "tables/table2.csv"}


@pytest.mark.parametrize("name", ["notes.txt", "tables/mine.csv"])
def test_own_files_are_refused_and_kept_under_force(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "mine"
    make(folder)
    (folder / name).write_text("mine")
    with pytest.raises(UsageError, match=name):
        make(folder)
    make(folder, text="new", force=True)
    assert (folder / name).read_text() == "mine"
    assert (folder / "numbers.json").read_text() == "new"
    assert name not in read_manifest(folder)["outputs"]


DERIVED = ("traces.csv", "traces.mat", "controller_1.gif")


def make_with_traces(folder: Path, digest: str = "a", **options: object) -> None:
    with replaced(folder, digest, command="compare", **options) as result:  # type: ignore[arg-type]
        result.write("traces.h5", digest)
        head = {"tendonrepro_version": __version__, "command": "compare", "config": {"sha256": digest}}
        result.manifest = head


def test_exports_and_films_of_the_same_result_hinder_nothing_and_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    make_with_traces(folder)
    for name in DERIVED:
        (folder / name).write_text("of a")
    make_with_traces(folder)
    assert capsys.readouterr().err == ""
    with pytest.raises(UsageError):
        make_with_traces(folder, "b")
    make_with_traces(folder, "b", force=True)
    told = capsys.readouterr().err.splitlines()
    assert {line.split()[0] for line in told} == {str(folder / name) for name in DERIVED}
    assert {(folder / name).read_text() for name in DERIVED} == {"of a"}


@pytest.mark.parametrize("name", ["traces.csv", "film.gif"])
def test_such_names_beside_no_traces_are_a_users(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "mine"
    make(folder)
    (folder / name).write_text("mine")
    with pytest.raises(UsageError, match=name):
        make(folder)


def test_a_folder_without_a_manifest_is_somebody_elses(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("mine")
    with pytest.raises(UsageError, match="thesis"):
        make(tmp_path / "mine")


def test_a_changed_file_is_refused(tmp_path: Path) -> None:
    make(tmp_path)
    (tmp_path / "numbers.json").write_text("edited")
    with pytest.raises(UsageError, match="numbers"):
        make(tmp_path)


def test_hidden_files_neither_refuse_nor_get_lost(tmp_path: Path) -> None:
    make(tmp_path / "mine")
    (tmp_path / "mine" / ".DS_Store").write_text("x")
    make(tmp_path / "mine")
    assert (tmp_path / "mine" / ".DS_Store").exists()


def test_a_killed_writer_keeps_others_out_and_then_leaves_the_old_result(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    make(folder)
    with subprocess.Popen([sys.executable, "-c", SLOW_WRITER, str(folder)], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"half\n"
        with pytest.raises(UsageError, match="mine"):
            make(folder)
        writer.kill()
    assert (folder / "numbers.json").read_text() == "old"
    assert {path.name for path in tmp_path.iterdir()} == {"mine", ".mine.partial", ".mine.lock"}
    make(folder, text="new")
    assert (folder / "numbers.json").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_kill_between_the_two_renames_is_undone_and_a_failure_leaves_the_old_result(tmp_path: Path) -> None:
    make(tmp_path / "mine")
    (tmp_path / "mine" / ".own").touch()
    (tmp_path / "mine").rename(tmp_path / ".mine.old")
    with pytest.raises(ZeroDivisionError):
        begin(tmp_path / "mine", ZeroDivisionError())
    assert names(tmp_path / "mine") == {MANIFEST, "numbers.json", "tables/table2.csv", ".own"}
    assert (tmp_path / "mine" / "numbers.json").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_an_old_result_that_a_kill_left_beside_the_new_one_goes(tmp_path: Path) -> None:
    for name in ("mine", ".mine.old"):
        make(tmp_path / name)
    make(tmp_path / "mine")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_what_is_kept_outlives_a_failure(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    with pytest.raises(KeyboardInterrupt):
        begin(folder, KeyboardInterrupt(), keep="shards")
    with replaced(folder, "a", command="compare", keep="shards") as result:
        assert names(result.path) == {"shards/0"}
        result.manifest = {"config": {"sha256": "a"}}
    assert names(folder) == {"shards/0", MANIFEST}


def test_an_update_begins_with_the_earlier_result(tmp_path: Path) -> None:
    make(tmp_path / "mine")
    with replaced(tmp_path / "mine", "a", command="compare", update=True) as result:
        result.write("numbers.json", "redrawn")
        result.manifest = read_manifest(tmp_path / "mine")
    assert (tmp_path / "mine" / "tables" / "table2.csv").read_text() == "old"
    outputs = json.loads((tmp_path / "mine" / MANIFEST).read_text())["outputs"]
    assert set(outputs) == {"numbers.json", "tables/table2.csv"}
    make(tmp_path / "mine")


def test_the_folder_one_is_in_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="--out"):
        make(Path())


def test_a_damaged_manifest_is_missing_data(tmp_path: Path) -> None:
    make(tmp_path)
    (tmp_path / MANIFEST).write_text("{")
    with pytest.raises(DataMissingError, match=MANIFEST):
        read_manifest(tmp_path)
