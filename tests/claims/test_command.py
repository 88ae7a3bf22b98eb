"""What the command reads again: a damaged file is named, never taken for something else."""

import pytest
from support.damage import by_chance, of_another_shape

from tendonrepro.claims.command import run_claims
from tendonrepro.claims.judge import Sources, judge_all
from tendonrepro.claims.report import write_claims
from tendonrepro.console import Talk
from tendonrepro.ensemble.data import PLAN
from tendonrepro.errors import DataMissingError

QUIET = Talk(quiet=True)


def test_a_damaged_baseline_is_named(tmp_path, monkeypatch):
    verdicts = judge_all(Sources())
    path = write_claims(verdicts, tmp_path)[0]
    content = path.read_bytes()
    monkeypatch.setattr("tendonrepro.claims.command.judge_all", lambda *_, **__: verdicts)
    assert run_claims(tmp_path / "none", (), path, QUIET).data["changed"] == {}
    for image in [*of_another_shape(content), *(by_chance(content, seed) for seed in range(60))]:
        path.write_bytes(image)
        try:
            # What is damaged but still a ledger has changed verdicts, or the same.
            run_claims(tmp_path / "none", (), path, QUIET)
        except DataMissingError as error:
            named = error.where
        else:
            named = str(path)
        assert named == str(path)


def test_a_damaged_ensemble_is_no_missing_one(tmp_path):
    (tmp_path / "ensemble").mkdir()
    assert run_claims(tmp_path, (), None, QUIET).data["summary"]["not_testable"] > 0
    (tmp_path / "ensemble" / PLAN).write_text("{}")
    with pytest.raises(DataMissingError, match="is damaged or not the plan"):
        run_claims(tmp_path, (), None, QUIET)
