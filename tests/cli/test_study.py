"""The commands beyond the paper's own runs, as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.command import SHORT, answer, run


def test_sweep_prints_what_it_found(tmp_path: Path) -> None:
    words = ["sweep", "--over", "control.gains.alpha=[0,0],[0.1,0.2]", *SHORT]
    data = answer(*words, cwd=tmp_path)
    assert len(data["points"]) == 2
    assert (tmp_path / "reports" / "sweep" / "sweep.json").exists()
    missing = answer("sweep", cwd=tmp_path, code=2)
    assert "--over" in missing["error"]["message"]
    words[2] = "control.gains.b=[0.9,0.9],[1.5,0.9]"
    assert "1.5" in answer(*words, cwd=tmp_path, code=2)["error"]["message"]


def test_dry_runs_write_nothing_and_ensemble_says_what_it_would_cost(tmp_path: Path) -> None:
    for name in ("explain", "identify"):
        assert answer(name, "--dry-run", cwd=tmp_path)["dry_run"]
    found = answer("ensemble", "--draws", "4096", "--dry-run", cwd=tmp_path)
    assert found["cost"]["experiments"] % (4096 + 1024) == 0
    text = run("ensemble", "--draws", "4096", "--dry-run", cwd=tmp_path)
    assert text.returncode == 0
    assert f"{found['cost']['experiments']:,} experiments" in text.stdout
    assert not list(tmp_path.iterdir())


def test_claims_without_any_results(tmp_path: Path) -> None:
    data = answer("claims", cwd=tmp_path)
    verdicts = {entry["id"]: entry for entry in data["claims"]}
    keys = {"id", "where", "kind", "printed", "ours", "unit", "rule", "verdict", "evidence", "depends_on"}
    assert all(keys | {"readings_that_change_it"} <= entry.keys() for entry in data["claims"])
    assert verdicts["K1"]["verdict"] == "exact"
    assert verdicts["A1"]["verdict"] == "exact"
    assert data["ensemble"]["source"] == "shipped"
    assert any(entry["shipped"] for entry in data["claims"])
    assert sum(data["summary"].values()) == sum(entry["repeats"] is None for entry in data["claims"])
    for suffix in ("json", "csv", "md"):
        assert (tmp_path / "reports" / "claims" / f"claims.{suffix}").exists()
    # Eq. (1) with the printed signs turns joint 2 the other way than Fig. 6 is described.
    assert verdicts["K2a"]["verdict"] == "not_reproduced"
    assert run("claims", "--check", cwd=tmp_path).returncode == 3


def test_a_baseline_notices_a_changed_verdict(tmp_path: Path) -> None:
    answer("claims", cwd=tmp_path)
    ledger = tmp_path / "reports" / "claims" / "claims.json"
    before: Any = json.loads(ledger.read_text())
    kept = tmp_path / "before.json"
    kept.write_text(json.dumps(before))
    same = run("claims", "--check", "--baseline", "before.json", cwd=tmp_path)
    assert same.returncode == 0
    before["claims"][0]["verdict"] = "not_reproduced"
    kept.write_text(json.dumps(before))
    other = run("claims", "--check", "--baseline", "before.json", cwd=tmp_path)
    assert other.returncode == 3
    name, now = before["claims"][0]["id"], json.loads(ledger.read_text())["claims"][0]["verdict"]
    assert f"\n{name}: not_reproduced -> {now}\n" in other.stdout
    told = answer("claims", "--baseline", "before.json", cwd=tmp_path)["changed"]
    assert told == {name: ["not_reproduced", now]}


@pytest.mark.parametrize(
    ("words", "code"), [(["XX"], 2), (["C2", "--baseline", "x.json"], 2), (["--baseline", "nowhere.json"], 4)]
)
def test_mistakes_with_claims(tmp_path: Path, words: list[str], code: int) -> None:
    done = run("claims", *words, cwd=tmp_path)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_configuration_commands_know_the_ensemble(tmp_path: Path) -> None:
    checked = answer("config", "check", "ensemble", cwd=tmp_path)
    assert checked["kind"] == "ensemble"
    shown = answer("config", "show", "ensemble", "--set", "seed=5", cwd=tmp_path)
    assert shown["seed"]["value"] == 5
    wrong = answer("config", "check", "ensemble", "--set", "box.posture.low=-5", cwd=tmp_path, code=2)
    assert "posture" in wrong["error"]["message"]
    run("config", "init", "ensemble", "--out", "mine", cwd=tmp_path)
    copied = answer("config", "check", "mine/ensemble.yaml", cwd=tmp_path)
    assert copied["config_sha256"] == checked["config_sha256"]
