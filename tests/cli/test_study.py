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
    assert found["cost"]["experiments"] % 4096 == 0
    text = run("ensemble", "--draws", "4096", "--dry-run", cwd=tmp_path)
    assert text.returncode == 0
    assert f"{found['cost']['experiments']:,} experiments" in text.stdout
    assert not list(tmp_path.iterdir())


def test_claims_without_any_results(tmp_path: Path) -> None:
    data = answer("claims", cwd=tmp_path)
    verdicts = {entry["id"]: entry for entry in data["claims"]}
    keys = "id where kind printed ours unit rule verdict evidence depends_on readings_that_change_it"
    assert all({*keys.split()} <= entry.keys() for entry in data["claims"])
    assert verdicts["K1"]["verdict"] == verdicts["A1"]["verdict"] == "exact"
    assert data["ensemble"]["source"] == "shipped"
    assert any(entry["shipped"] for entry in data["claims"])
    assert sum(data["summary"].values()) == sum(entry["repeats"] is None for entry in data["claims"])
    for suffix in ("json", "csv", "md"):
        assert (tmp_path / "reports" / "claims" / f"claims.{suffix}").exists()
    # Eq. (1) with the printed signs turns joint 2 the other way than Fig. 6 is described.
    assert verdicts["K2a"]["verdict"] == "not_reproduced"
    assert run("claims", "--check", cwd=tmp_path).returncode == 3


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


@pytest.mark.parametrize("command", ["ensemble", "identify", "predict", "tune"])
def test_an_option_that_is_gone_is_refused_with_what_to_do(tmp_path: Path, command: str) -> None:
    refused = answer(command, "--device", "gpu", cwd=tmp_path, code=2)["error"]
    assert "--jobs" in refused["hint"]


def test_a_search_begins_at_no_draw(tmp_path: Path) -> None:
    refused = answer("identify", "--from-draws", "reports/ensemble", cwd=tmp_path, code=2)["error"]
    assert "--config" in refused["hint"]


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
    assert answer("config", "show", "ensemble", "--set", "seed=5", cwd=tmp_path)["seed"]["value"] == 5
    run("config", "init", "ensemble", "--out", "mine", cwd=tmp_path)
    copied = answer("config", "check", "mine/ensemble.yaml", cwd=tmp_path)
    assert copied["config_sha256"] == checked["config_sha256"]
