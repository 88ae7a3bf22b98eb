"""What lies at ``--out`` is never lost: every command of the registry, as a user runs it."""

from __future__ import annotations

from pathlib import Path
from shutil import copy

import pytest
from support.command import answer, with_out
from support.synthetic import FEW, make_compare_file

from tendonrepro.files import shipped
from tendonrepro.results.traces import write_traces

ARGUMENTS = {
    "result animate": ["runs.h5"],
    "config init": ["compare"],
    "result export": ["runs.h5"],
    "data ingest": ["data.csv"],
    "live": [],
    "data recover": ["runs.h5"],
    "report": ["."],
    "sweep": ["--over", "control.gains.lam=4,5"],
    "data validate": ["measured.h5"],
}
"""What a command cannot do without."""

FILES = {
    "result animate": "mine.gif",
    "result export": "mine.csv",
    "data ingest": "mine.h5",
    "live": "mine.html",
    "report": "mine.html",
}
"""Commands that write one file, and a name that they accept."""


COMMANDS = with_out()


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    write_traces(folder / "runs.h5", make_compare_file(**FEW, runs=("controller_1",)))
    write_traces(folder / "measured.h5", make_compare_file(**FEW, runs=("controller_1",), source="measured"))
    (folder / "data.csv").write_text("time,q\n0,1\n")
    (folder / "my.yaml").write_text("SYNTHETIC: not read\n")
    (folder / "thesis.docx").write_text("my thesis")
    (folder / "below").mkdir()
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def forced(name: str) -> list[str]:
    """Not even `--force` loses another's file where a folder is to be."""
    return ["--force"] if any("--force" in option.opts for option in COMMANDS[name].params) else []


@pytest.mark.parametrize("name", sorted(COMMANDS.keys() - FILES.keys()))
@pytest.mark.parametrize("out", ["thesis.docx", "thesis.docx/below"])
def test_a_file_where_the_results_should_go_is_refused(place: Path, name: str, out: str) -> None:
    before = contents(place)
    words = [*name.split(), *ARGUMENTS.get(name, []), "--out", out, *forced(name)]
    found = answer(*words, cwd=place, code=2)
    assert found["error"]["where"] == out.split("/", maxsplit=1)[0]
    assert contents(place) == before


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_folder_where_a_file_should_go_is_refused(place: Path, name: str, force: list[str]) -> None:
    (place / FILES[name]).mkdir()
    before = contents(place)
    found = answer(*name.split(), *ARGUMENTS[name], "--out", FILES[name], *force, cwd=place, code=2)
    assert found["error"]["where"] == FILES[name]
    assert contents(place) == before
    (place / FILES[name]).rmdir()


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("below", ["", "thesis.docx/"])
def test_a_file_that_is_there_is_refused(place: Path, name: str, below: str) -> None:
    path = place / FILES[name]
    path.write_text("mine")
    before = contents(place)
    found = answer(*name.split(), *ARGUMENTS[name], "--out", below + FILES[name], cwd=place, code=2)
    assert found["error"]["where"] == (below.strip("/") or FILES[name])
    assert contents(place) == before
    path.unlink()


@pytest.mark.parametrize(
    ("words", "lost"),
    [
        ("data ingest data.csv --out data.csv", "data.csv"),
        ("data inspect data.csv --suggest --mapping data.csv", "data.csv"),
        ("result export runs.csv --format csv", "runs.csv"),
        ("statics --config decouple.yaml --out decouple.yaml", "decouple.yaml"),
    ],
)
def test_what_is_read_is_not_overwritten(place: Path, words: str, lost: str) -> None:
    (place / "runs.csv").write_bytes((place / "runs.h5").read_bytes())
    copy(shipped("configs") / "decouple.yaml", place)
    before = contents(place)
    assert answer(*words.split(), "--force", cwd=place, code=2)["error"]["where"] == lost
    assert contents(place) == before
