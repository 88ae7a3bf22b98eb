"""The commands beyond the paper's own runs, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.command import answer, run

from tendonrepro.cli.app import RETIRED


def test_check_with_a_baseline_fails_where_a_verdict_changed(tmp_path: Path) -> None:
    ledger, kept = tmp_path / "reports" / "claims" / "claims.json", tmp_path / "before.json"
    answer("claims", cwd=tmp_path)
    kept.write_bytes(ledger.read_bytes())
    words = ["claims", "--check", "--baseline", "before.json"]
    assert run(*words, cwd=tmp_path).returncode == 0
    before: Any = json.loads(ledger.read_text())
    first, before["claims"][0]["verdict"] = dict(before["claims"][0]), "not_reproduced"
    kept.write_text(json.dumps(before))
    changed = answer(*words, cwd=tmp_path, code=3)["changed"]
    assert changed == {first["id"]: ["not_reproduced", first["verdict"]]}


@pytest.mark.parametrize("name", RETIRED)
def test_an_option_that_is_gone_is_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    error = answer("identify", f"--{name}", "8", cwd=tmp_path, code=2)["error"]
    assert error["hint"] == RETIRED[name]


@pytest.mark.parametrize(
    ("words", "code"), [(["XX"], 2), (["C2", "--baseline", "x.json"], 2), (["--baseline", "nowhere.json"], 4)]
)
def test_mistakes_with_claims(tmp_path: Path, words: list[str], code: int) -> None:
    done = run("claims", *words, cwd=tmp_path)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_what_is_unusual_is_told_once_with_its_line(tmp_path: Path) -> None:
    run("config", "init", "--joints", "2", "--out", "mine", cwd=tmp_path)
    arm = tmp_path / "mine" / "my_arm.yaml"
    arm.write_text(arm.read_text().replace("winch_diameter: 37", "winch_diameter: 0.04"))
    (line,) = (k for k, text in enumerate(arm.read_text().splitlines(), 1) if "winch_diameter" in text)
    for words in (["compare"], ["reproduce"], ["config", "check"]):
        given = ["mine/compare.yaml"] if "check" in words else ["--config", "mine/compare.yaml", "--dry-run"]
        assert run(*words, *given, cwd=tmp_path).stderr.count(f"my_arm.yaml:{line}: ") == 1
