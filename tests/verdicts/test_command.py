"""What the command reads: other experiments, damaged files, earlier ledgers."""

from dataclasses import replace

import pytest
from support.fake_batch import run_ensemble_of
from support.synthetic import FEW, make_compare_file

from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.monte_carlo.data import SHARDS, shard_files
from tendonrepro.results.traces import TRACES, write_traces
from tendonrepro.verdicts.command import run_claims, shipped_ledger, with_shipped
from tendonrepro.verdicts.judge import Sources, judge_all
from tendonrepro.verdicts.report import write_claims

QUIET = Talk(quiet=True)


def test_a_baseline_tells_what_changed(tmp_path):
    verdicts = with_shipped(judge_all(Sources()), shipped_ledger())
    write_claims([replace(one, verdict="exact") if one.id == "C2" else one for one in verdicts], tmp_path)
    path = tmp_path / "claims.json"
    assert run_claims(tmp_path / "none", (), path, QUIET).data["changed"] == {"C2": ("exact", "not_met")}
    for content in (path.read_bytes()[:-100], b"[]", b'{"claims": [1]}', None):
        path.write_bytes(content) if content else path.unlink()
        with pytest.raises(DataMissingError) as caught:
            run_claims(tmp_path / "none", (), path, QUIET)
        assert caught.value.where == str(path)


def test_no_claim_is_judged_by_another_experiment(tmp_path, capsys):
    file = make_compare_file(**FEW)
    gains = {"attributes": {**file.runs["controller_2"].attributes, "gains": {"lam": [8.0, 9.0]}}}
    runs = {**file.runs, "controller_2": replace(file.runs["controller_2"], **gains)}
    fitted = replace(file, config_yaml="source: 'identified: Tables 2 and 3, misfit 0.04'")
    for stored, told in ((file, ""), (replace(file, runs=runs), str(tmp_path)), (fitted, str(tmp_path))):
        write_traces(tmp_path / "compare" / TRACES, stored)
        (number,) = run_claims(tmp_path, ("table2.controller_1.mae.joint_2",), None, Talk()).verdicts
        assert told in capsys.readouterr().err
        assert ("shipped_run" in number.evidence) != bool(told)


def test_the_measured_file_is_read(tmp_path):
    path = tmp_path / "SYNTHETIC.h5"
    write_traces(path, make_compare_file(**FEW, source="measured"))
    (claim,) = run_claims(tmp_path, ["C2"], None, QUIET, path).verdicts
    assert "verdict" in claim.evidence["measured"]


def test_a_ledger_that_somebody_edited_is_not_written_over(tmp_path):
    for _ in range(2):
        run_claims(tmp_path, (), None, QUIET)
    path = tmp_path / "claims" / "claims.md"
    path.write_bytes(b"with my notes")
    with pytest.raises(UsageError):
        run_claims(tmp_path, (), None, QUIET)
    assert path.read_bytes() == b"with my notes"
    run_claims(tmp_path, ("C1",), None, QUIET)  # writes nothing
    run_claims(tmp_path, (), None, QUIET, force=True)


def test_a_damaged_ensemble_is_no_missing_one(tmp_path):
    assert run_claims(tmp_path, (), None, QUIET).data["summary"]["not_testable"] > 0
    run_ensemble_of(tmp_path / "ensemble")
    path = shard_files(tmp_path / "ensemble" / SHARDS)[0]
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DataMissingError) as caught:
        run_claims(tmp_path, ("C2",), None, QUIET)
    assert caught.value.where == str(path)
