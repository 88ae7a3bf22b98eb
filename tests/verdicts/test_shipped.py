"""The verdicts that come with the package: where they stand in, what they say, what replaces them."""

import json

import pytest
from support.made_claims import MadeEnsemble
from support.synthetic import make_compare_file

from tendonrepro.console import Talk
from tendonrepro.monte_carlo.data import PLAN
from tendonrepro.results.store import TRACES
from tendonrepro.results.traces import write_traces
from tendonrepro.verdicts.command import ShippedLedger, run_claims, shipped_ledger, with_shipped
from tendonrepro.verdicts.judge import Sources, judge_all
from tendonrepro.verdicts.rules import EDITION, FAILURES

QUIET = Talk(quiet=True)


def entries(ledger):
    return {entry["id"]: entry for entry in ledger.data["claims"]}


@pytest.fixture(scope="module")
def ledger(tmp_path_factory):
    return run_claims(tmp_path_factory.mktemp("empty"), (), None, QUIET)


class TestFreshClone:
    def test_every_claim_has_the_stored_verdict(self, ledger):
        stored = shipped_ledger().entries
        judged = {name: entry for name, entry in entries(ledger).items() if entry["kind"] == "ensemble"}
        assert sum(entry["shipped"] for entry in judged.values()) > 20
        for name, entry in judged.items():
            same = all(stored.get(name, {}).get(key) == entry[key] for key in ("kind", "rule", "printed"))
            assert entry["shipped"] == same, name
            for key in ("verdict", "ours", "borderline") if same else ():
                assert entry[key] == stored[name][key], name
        assert not any(entry["shipped"] for name, entry in entries(ledger).items() if name not in judged)

    def test_it_says_of_which_ensemble_they_are(self, ledger):
        origin = shipped_ledger().ensemble
        assert ledger.data["ensemble"] == origin
        assert origin["source"] == "shipped"
        assert origin["draws"] >= 256
        for key in ("draws", "tendonrepro_version", "created"):
            assert str(origin[key]).partition("T")[0] in ledger.text
        assert "(shipped)" in ledger.text
        assert "one of your own replaces it: tendonrepro ensemble" in ledger.text

    def test_they_count_for_a_check_as_any_verdict_does(self, ledger):
        bad = FAILURES
        assert set(ledger.failed) == {name for name, one in entries(ledger).items() if one["verdict"] in bad}
        assert ledger.failed


def test_numbers_of_a_run_here_go_before_the_stored_ones(tmp_path):
    write_traces(tmp_path / "compare" / TRACES, make_compare_file(step=0.05))
    name = "table2.controller_2.mae.joint_3"
    (without,) = judge_all(Sources(compare=make_compare_file(step=0.05)), only=[name])
    entry = entries(run_claims(tmp_path, [name], None, QUIET))[name]
    assert entry["ours"] == pytest.approx(without.ours)
    assert entry["evidence"]["box"] == shipped_ledger().entries[name]["evidence"]["box"]


def test_an_ensemble_of_ones_own_replaces_them(tmp_path, monkeypatch):
    own = MadeEnsemble()
    (tmp_path / "ensemble").mkdir()
    (tmp_path / "ensemble" / PLAN).touch()
    (tmp_path / "ensemble" / "manifest.json").write_text('{"created": "2026-01-02"}')
    monkeypatch.setattr("tendonrepro.verdicts.command.read_ensemble", lambda _: own)
    monkeypatch.setattr("tendonrepro.verdicts.command.rankings", lambda _: {})
    ledger = run_claims(tmp_path, (), None, QUIET)
    assert not any(entry["shipped"] for entry in entries(ledger).values())
    assert ledger.data["ensemble"] == {
        "source": "local",
        "draws": len(own.draws),
        "tendonrepro_version": None,
        "created": "2026-01-02",
        "rules_edition": EDITION,
    }
    assert json.loads((tmp_path / "claims" / "claims.json").read_text())["ensemble"]["source"] == "local"
    assert "shipped" not in ledger.text


@pytest.mark.parametrize("key", ["rule", "printed", "kind"])
def test_a_verdict_by_another_rule_does_not_count(key):
    waiting = [one for one in judge_all(Sources()) if one.id in {"C2", "E1"}]
    stored = {name: dict(entry) for name, entry in shipped_ledger().entries.items()}
    stored["C2"][key] = "another"
    left, taken = with_shipped(waiting, ShippedLedger(stored, {"draws": 1}))
    assert (left.id, left.verdict, left.shipped) == ("C2", "not_testable", False)
    assert taken.shipped


def test_the_run_of_the_shipped_plant_is_not_called_one_of_here():
    name = "table2.controller_1.mae.joint_2"
    stored = shipped_ledger()
    stored.entries[name]["evidence"]["shipped_run"] = 1.0
    (found,) = with_shipped(judge_all(Sources(), only=[name]), stored)
    assert "shipped_run" not in found.evidence
    assert found.ours == stored.entries[name]["ours"]


def test_what_was_measured_elsewhere_is_not_told_here():
    waiting = [one for one in judge_all(Sources()) if one.id == "C2"]
    entry = dict(shipped_ledger().entries["C2"])
    entry["evidence"] = {**entry["evidence"], "measured": {"verdict": "reproduced", "ours": 1.0}}
    (found,) = with_shipped(waiting, ShippedLedger({"C2": entry}, {}))
    assert "measured" not in found.evidence
