"""What the command refuses, and what it says of damage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from report.conftest import STATICS
from support import ROOT
from support.made_claims import MadeEnsemble

from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.report import page, sources
from tendonrepro.report.command import report_text, run_report
from tendonrepro.report.sources import Found, found_under
from tendonrepro.results.paper import OTHER_BASE

QUIET = Talk(quiet=True)


def shipped_summary() -> dict[str, Any]:
    return dict(json.loads((ROOT / "docs" / "results" / "ensemble.json").read_text()))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page that takes no time."""
    monkeypatch.setattr(page, "page", lambda found: f"<p>{found.origins}</p>\n")
    origins = {"compare": "run", "ensemble": "shipped", "statics": "missing"}
    monkeypatch.setattr(sources, "found_under", lambda *_: Found(origins=origins, inputs={"a": "b"}))


@pytest.mark.usefixtures("quick")
def test_a_page_is_replaced_and_nothing_else_is(tmp_path: Path) -> None:
    first = run_report(tmp_path, None, QUIET, measured=None, force=False)
    path = Path(first["path"])
    assert path == tmp_path / "report.html"
    assert first["bytes"] == path.stat().st_size
    assert first["parts"] == {"compare": "run", "ensemble": "shipped", "statics": "missing"}
    assert run_report(tmp_path, None, QUIET, measured=None, force=False) == first
    assert report_text(first).splitlines()[1:] == [
        "as shipped with the package: ensemble",
        "not run, the page says how: statics",
    ]
    for edited in (path.read_bytes().replace(b"run", b"ran"), b"", b"mine", path.read_bytes() + b"\n"):
        path.write_bytes(edited)
        with pytest.raises(UsageError, match="no report of tendonrepro, or was edited"):
            run_report(tmp_path, None, QUIET, measured=None, force=False)
        assert path.read_bytes() == edited
    assert run_report(tmp_path, None, QUIET, measured=None, force=True) == first


@pytest.mark.usefixtures("quick")
def test_folders_in_the_way_and_missing_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="is a folder"):
        run_report(tmp_path, tmp_path, QUIET, measured=None, force=True)
    with pytest.raises(DataMissingError, match="no such folder"):
        run_report(tmp_path / "none", None, QUIET, measured=None, force=False)


@pytest.mark.parametrize("content", ["", "[]", "{", '{"courses": 3}', '{"courses": {"a": {}}}', "\ud800"])
def test_damage_is_named(tmp_path: Path, content: str) -> None:
    path = tmp_path / "statics" / "statics.json"
    path.parent.mkdir()
    path.write_bytes(content.encode("utf-8", "surrogatepass"))
    with pytest.raises(DataMissingError, match="is damaged or of another version") as caught:
        found_under(tmp_path, None, QUIET)
    assert caught.value.where == str(path)
    assert caught.value.exit_code == 4


def test_a_summary_of_another_ensemble_than_its_blocks_is_told(tmp_path: Path) -> None:
    """As where one was extended and stopped, or is being written anew."""
    path = tmp_path / "ensemble" / "summary.json"
    path.parent.mkdir()
    for held in ({"identity": "other", "draws": 400}, {"identity": "made", "draws": 200}):
        path.write_text(json.dumps(shipped_summary() | held))
        with pytest.raises(DataMissingError, match="is of another ensemble than the blocks beside it"):
            sources._add_results(Found(), tmp_path, MadeEnsemble())


def test_an_ensemble_killed_among_its_tables_is_no_damage(tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="is missing: what should have written it was interrupted"):
        sources._add_results(Found(), tmp_path, MadeEnsemble())


def test_what_decides_is_of_the_ensemble_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not of one that stood there when `claims` was run."""
    monkeypatch.setattr(sources, "findings", lambda _: ())
    monkeypatch.setattr(sources.rows, "thinned", dict)
    shown = {}
    for name, of in (("its own", ["made", 400]), ("another", ["other", 400]), ("none", None)):
        folder = tmp_path / name
        for inner, file, held in (
            ("ensemble", "summary.json", shipped_summary() | {"identity": "made", "draws": 400}),
            ("claims", "decides.json", json.loads((ROOT / "docs" / "results" / "decides.json").read_text())),
            ("claims", "manifest.json", {"ensemble": of}),
        ):
            (folder / inner).mkdir(parents=True, exist_ok=True)
            (folder / inner / file).write_text(json.dumps(held))
        found = Found()
        sources._add_results(found, folder, MadeEnsemble())
        shown[name] = found.origins["decides"], found.decides is None
    assert shown == {"its own": ("run", False), "another": ("missing", True), "none": ("missing", True)}


def test_parts_that_are_not_of_the_paper_are_left_out_and_told_of(tmp_path, capsys) -> None:
    said = "not the paper's arm"
    for name, file, held in (
        ("statics", "statics.json", STATICS | {"of_paper": False}),
        ("identify_all", "identify.json", {"fit": "all", "conclusions": [OTHER_BASE]}),
        ("identify_all", "identify.json", {"fit": "controller_2", "conclusions": []}),
    ):
        path = tmp_path / name / file
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(held))
        found = found_under(tmp_path, None, Talk())
        assert found.origins["statics"] == "missing"
        assert found.origins["closest"] == "shipped"
        assert f"{path}: {said}" in capsys.readouterr().err


def test_what_a_manifest_does_not_vouch_for_is_damaged(tmp_path: Path) -> None:
    folder = tmp_path / "statics"
    folder.mkdir()
    (folder / "summary.json").write_text("{}", encoding="utf-8")
    manifest = {"config": {}, "outputs": {"summary.json": "0" * 64}}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(DataMissingError, match="not what its manifest lists"):
        found_under(tmp_path, None, QUIET)


def test_a_measured_file_that_is_asked_for_has_to_be_there(tmp_path: Path) -> None:
    with pytest.raises(DataMissingError, match="no measured trace file"):
        found_under(tmp_path, tmp_path / "measured.h5", QUIET)
