"""The ledger: what changes a verdict, what is missing, what the command reads, and the shipped verdicts."""

import json
import re
from dataclasses import replace

import pytest
from support.made_claims import ESTIMATES, MadeEnsemble, paper_of, spoil, verdict_on
from support.synthetic import FEW, make_compare_file

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.console import QUIET, Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import to_json
from tendonrepro.monte_carlo.data import PLAN
from tendonrepro.results.records import PlantRecord
from tendonrepro.results.traces import write_traces
from tendonrepro.studies.lifecycle import AGAINST, carry_out
from tendonrepro.verdicts.judge import claims_study, judge_all
from tendonrepro.verdicts.ledger import as_data, shipped_ledger, with_shipped
from tendonrepro.verdicts.rules import EDITION
from tendonrepro.verdicts.words import claims_table, details_text, table_text


class TestReadings:
    def test_those_that_change_a_verdict_are_named(self):
        data = MadeEnsemble(readings=("a=b", PRINTED, "c=d", "a=b+c=d"))
        paper = paper_of(data)
        spoil(data, "controller_1", ESTIMATES, 2.0, "a=b+c=d")
        del data.codes["controller_1", "c=d"]
        found = verdict_on(data, paper, "E1")
        assert (found.verdict, found.readings_that_change_it) == ("compatible", ("a=b+c=d",))
        assert verdict_on(data, paper, "C4").evidence["not_testable_under"] == ["c=d"]

    def test_a_verdict_says_on_which_motions_and_starts_it_depends(self):
        """Of choices that change it, those that need no more; and nothing of changed equations."""
        apart, absent = "starts=apart", "reference_acceleration=absent"
        both = f"{absent}+{apart}"
        data = MadeEnsemble(readings=(PRINTED, apart, absent, both, "weights=extrapolating"))
        paper = paper_of(data)
        for reading in (apart, both, "weights=extrapolating"):
            spoil(data, "controller_1", ["mae", "rmse"], 9.0, reading)
        found = verdict_on(data, paper, "C2")
        assert {held.reading: held.opposite for held in found.by_choice} == {
            apart: 0.0,
            absent: 0.0,
            both: 0.0,
        }
        ((changed, verdict, ours),) = [(held.reading, held.verdict, held.ours) for held in found.unless]
        assert (changed, verdict, ours) == (apart, "not_met", 0.0)
        assert found.verdict != verdict
        assert "starts=apart" in table_text([found])
        assert claims_table([found]).rows[0]["by_choice"] == "starts=apart: not_met"

    def test_variations_are_compared_under_the_printed_reading_alone(self):
        data = MadeEnsemble(readings=(PRINTED, "a=b"))
        spoil(data, "controller_2", ["mae", *ESTIMATES], 9.0, "a=b")
        found = verdict_on(data, paper_of(data), "E2")
        assert (found.verdict, found.readings_that_change_it) == ("compatible", ())
        assert found.evidence["not_testable_under"] == ["a=b"]

    def test_the_turn_of_joint_2(self, paper):
        turns = [verdict_on(None, paper, name) for name in ("K2", "K2a", "K2b")]
        assert [found.verdict for found in turns] == ["reproduced", "not_reproduced", "not_reproduced"]
        assert [found.ours for found in turns] == pytest.approx([35.0 / 77.0] * 3)
        # 35 mm against 77 mm is no translation.
        changed_by = [found.readings_that_change_it for found in turns]
        assert changed_by == [(), ("signs=c12=-1,c13=+1",), ()]


def test_an_id_is_judged_in_letters_of_either_case_and_an_input_is_not():
    verdicts = judge_all(only=["k3", "TABLE2.controller_1.mae.joint_2"])
    assert [verdict.id for verdict in verdicts] == ["K3", "table2.controller_1.mae.joint_2"]
    for name in ("C7", "gain.eta.joint_2"):
        with pytest.raises(UsageError, match=name):
            judge_all(only=["K1", name])


def claimed(out, ids=(), *, talk=None, **asked):
    """What the command answers."""
    study = claims_study(out, ids, folder={}, **asked)
    return carry_out(replace(study, command="claims"), talk or QUIET)


def entries(data):
    return {entry["id"]: entry for entry in data["claims"]}


def test_a_baseline_tells_what_changed(tmp_path):
    verdicts = with_shipped(judge_all(), shipped_ledger())
    path = tmp_path / "claims.json"
    earlier = [replace(one, verdict="exact") if one.id == "C2" else one for one in verdicts]
    earlier.append(replace(earlier[0], id="C99", verdict="exact"))
    # What a baseline does not hold has not changed; what is not judged now has.
    for held in (earlier, [one for one in earlier if one.id in ("C2", "C3", "C99")]):
        path.write_text(to_json(as_data(held)), encoding="utf-8")
        found = claimed(tmp_path / "none", baseline=path, check=True)
        assert found.data["changed"] == {"C2": ("exact", "not_met"), "C99": ("exact", None)}
        assert found.exit_code == AGAINST
    for content in (path.read_bytes()[:-100], b"[]", b'{"claims": [1]}', None):
        path.write_bytes(content) if content else path.unlink()
        with pytest.raises(DataMissingError) as caught:
            claimed(tmp_path / "none", baseline=path)
        assert caught.value.where == str(path)


def test_a_measured_file_judges_and_one_of_another_arm_is_told(tmp_path, capsys):
    file = make_compare_file(**FEW, source="measured")
    runs = {name: replace(trace, joint=(5, 6)) for name, trace in file.runs.items()}
    path = tmp_path / "SYNTHETIC.h5"
    write_traces(path, file)
    assert "verdict" in entries(claimed(tmp_path, ["C2"], measured=path).data)["C2"]["evidence"]["measured"]
    write_traces(path, replace(file, runs=runs, plant=PlantRecord({}, {"arm": "one with 6 joints"})))
    found = claimed(tmp_path, ["C2"], measured=path, talk=Talk())
    assert "measured" not in entries(found.data)["C2"]["evidence"]
    assert str(path) in capsys.readouterr().err


def test_a_ledger_takes_the_place_of_its_own_earlier_one_and_claims_by_id_write_nothing(tmp_path):
    for ids in ((), (), ("C1",)):
        claimed(tmp_path, ids)
    assert len(json.loads((tmp_path / "claims" / "claims.json").read_text())["claims"]) > 1


@pytest.fixture(scope="module")
def ledger(tmp_path_factory):
    return claimed(tmp_path_factory.mktemp("empty"))


class TestFreshClone:
    """The shipped verdicts stand in for an ensemble."""

    def test_every_claim_has_the_stored_verdict(self, ledger):
        stored, found = shipped_ledger().verdicts, entries(ledger.data)
        assert ledger.data["ensemble"] == shipped_ledger().ensemble
        shipped = {name for name, entry in found.items() if entry["shipped"]}
        # A new claim has no verdict until the ensemble is judged again; check-release asks for that.
        assert shipped == stored.keys() & {
            name for name, entry in found.items() if entry["kind"] == "ensemble"
        }
        for name in shipped:
            for key in ("verdict", "ours", "borderline", "rule", "printed", "unit"):
                assert found[name][key] == getattr(stored[name], key), name

    def test_its_headline_counts_what_is_neither_repeated_nor_without_power(self, ledger):
        counted = [
            name
            for name, entry in entries(ledger.data).items()
            if entry["repeats"] is None and entry["verdict"] != "no_power"
        ]
        (line,) = re.findall(r"^\d+ claims judged.*?\.", ledger.text, re.M)
        total, *parts = map(int, re.findall(r"\d+", line))
        assert total == sum(parts) == len(counted)

    def test_a_claim_is_shown_with_each_other_choice_of_starts(self):
        order = shipped_ledger().verdicts["C2"]
        reverse = {choice.reading: choice.opposite for choice in order.by_choice}
        text = details_text(order)
        for share in (*reverse.values(), order.evidence["opposite"]["share"]):
            assert f"{share:.4g}" in text
        assert reverse["starts=apart"] < 0.2 < order.evidence["opposite"]["share"]


def test_an_ensemble_of_ones_own_replaces_them(tmp_path, monkeypatch):
    own = MadeEnsemble()
    (tmp_path / "ensemble").mkdir()
    (tmp_path / "ensemble" / PLAN).touch()
    (tmp_path / "ensemble" / "manifest.json").write_text('{"created": "2026-01-02"}')
    monkeypatch.setattr("tendonrepro.verdicts.judge.read_ensemble", lambda _: own)
    monkeypatch.setattr("tendonrepro.verdicts.sensitivity.rankings", lambda _: {})
    ledger = claimed(tmp_path)
    assert not any(entry["shipped"] for entry in entries(ledger.data).values())
    assert any(entry["false_contradicted"] for entry in entries(ledger.data).values())
    known = {"draws": len(own.draws), "created": "2026-01-02", "rules_edition": EDITION}
    assert ledger.data["ensemble"] == {"source": "local", "tendonrepro_version": None} | known
    assert json.loads((tmp_path / "claims" / "claims.json").read_text())["ensemble"]["source"] == "local"
    own.of_paper = False
    assert claimed(tmp_path, ["C2"]).data["claims"][0]["shipped"]


@pytest.mark.parametrize("key", ["rule", "printed", "kind"])
def test_a_verdict_by_another_rule_does_not_count(key):
    shipped = shipped_ledger()
    other = replace(shipped.verdicts["C2"], **{key: "another"})
    stored = replace(shipped, verdicts={**shipped.verdicts, "C2": other})
    left, taken = with_shipped(judge_all(only=["C2", "E1"]), stored)
    assert (left.verdict, left.shipped) == ("not_testable", False)
    assert taken.shipped


def test_what_was_measured_elsewhere_is_not_told_here():
    stored = shipped_ledger()
    stored.verdicts["C2"].evidence["measured"] = {"verdict": "reproduced", "ours": 1.0}
    (found,) = with_shipped(judge_all(only=["C2"]), stored)
    assert "measured" not in found.evidence
