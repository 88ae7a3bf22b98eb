"""Whatever a command leaves is a result: `tr.open`, `diff` and `report` take it. Over the registry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command import SMALL, answer, run, with_out

import tendonrepro as tr
from tendonrepro.results.store import MANIFEST
from tendonrepro.results.traces import read_traces, write_traces

NO_RESULT = {
    "config init",
    "data fetch",
    "live",
    "report",
    "result animate",
    "result export",
    "result redraw",
}
"""They leave a film, a page, files for other programs, a configuration, or data of others."""

QUICK = {"claims", "compare", "data ingest", "statics"}
"""The others take longer, some of them minutes."""

COMMANDS = [
    pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow)
    for name in with_out()
    if name not in NO_RESULT
]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run as if it had been measured, and that as a table of numbers."""
    folder = tmp_path_factory.mktemp("results")
    assert run("compare", *SMALL["compare"], "--out", "compare", cwd=folder).returncode == 0
    file = read_traces(folder / "compare")
    write_traces(folder / "measured.h5", replace(file, source="measured"))
    trace = file.runs["controller_1"]
    columns = {"time": trace.time}
    for name in ("q", "q_d"):
        columns |= {f"{name}_{joint}": np.rad2deg(trace[name][:, k]) for k, joint in enumerate(trace.joint)}
    table, head = np.column_stack([*columns.values()]), ",".join(columns)
    np.savetxt(folder / "controller_1.csv", table, delimiter=",", header=head, comments="")
    answer("data", "inspect", "controller_1.csv", "--suggest", "--mapping", "mapping.yaml", cwd=folder)
    return folder


def results_of(name: str, folder: Path) -> list[Path]:
    """Carry out a command, if that was not done, and find what it left."""
    out = folder / ("ingested.h5" if name == "data ingest" else name.replace(" ", "_"))
    if not out.exists():
        done = run(*name.split(), *SMALL.get(name, []), "--out", str(out), cwd=folder)
        assert done.returncode in {0, 5}, done.stderr
    return [out] if out.is_file() else sorted(path.parent for path in out.rglob(MANIFEST))


@pytest.mark.parametrize("name", COMMANDS)
def test_what_a_command_leaves_is_opened_compared_and_reported(place: Path, name: str) -> None:
    results = results_of(name, place)
    assert results
    for path in results:
        found = tr.open(path)
        assert found.data
        assert found.tables
        assert str(found)
        assert tr.diff(path, path)["same"]
        if path.is_dir():
            assert found.save(place / "saved", force=True)
            assert tr.diff(path, place / "saved")["same"]
            told = answer("report", str(path), "--out", "page.html", "--force", cwd=place)
            assert {"run", "here"} & {*told["parts"].values()}


def test_tables_of_a_result_are_those_that_the_command_wrote(place: Path) -> None:
    (statics,) = results_of("statics", place)
    before = tr.open(statics).tables.keys()
    (statics / "mine.csv").write_text("a,b\n1,2\n", "utf-8")
    assert tr.open(statics).tables.keys() == before
    (statics / "mine.csv").unlink()


def test_a_report_names_what_it_shows_and_what_it_leaves_out(place: Path) -> None:
    for name in ("statics", "compare"):
        results_of(name, place)
    (place / "no_result").mkdir(exist_ok=True)
    told = answer("report", ".", cwd=place)
    folders = {path.name for path in place.iterdir() if path.is_dir()}
    shown = {name for name, origin in told["parts"].items() if origin == "run"}
    assert {"compare", "statics"} <= shown
    assert {"no_result"} <= told["left_out"].keys()
    assert folders == (shown & folders) | told["left_out"].keys()
    text = run("report", ".", cwd=place).stdout
    page = (place / "report.html").read_text(encoding="utf-8")
    assert all(name in text and name in page for name in folders)
