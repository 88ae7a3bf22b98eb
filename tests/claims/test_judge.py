"""The ledger: what changes a verdict, what is missing, what decides, and how it is written."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from support.made_claims import MadeEnsemble, one, paper_of, verdicts
from support.synthetic import make_compare_file, make_decouple_file

from tendonrepro.claims.judge import Sources, changed, failing, judge_all
from tendonrepro.claims.report import as_data, details_text, table_text, write_claims
from tendonrepro.claims.statements import CLAIMS, IDEAL, LONGER
from tendonrepro.config.models.readings import PRINTED
from tendonrepro.errors import UsageError


class TestReadings:
    def test_those_that_change_a_verdict_are_named(self):
        data = MadeEnsemble(readings=(PRINTED, "a=b", "c=d", "a=b+c=d"))
        paper = paper_of(data)
        data.values["controller_1", "a=b+c=d", "epsilon_rms"] *= 2.0
        del data.codes["controller_1", "c=d"]
        assert one(data, paper, "E1").readings_that_change_it == ("a=b+c=d",)
        found = one(data, paper, "C4")
        assert found.readings_that_change_it == ()
        assert found.evidence["not_testable_under"] == ["c=d"]

    def test_variations_are_compared_under_the_printed_reading_alone(self):
        data = MadeEnsemble(readings=(PRINTED, "a=b"))
        data.values["controller_2", "a=b", "epsilon_rms"] *= 9.0
        found = one(data, paper_of(data), "E2")
        assert (found.verdict, found.readings_that_change_it) == ("compatible", ())
        assert found.evidence["not_testable_under"] == ["a=b"]

    def test_course_of_tendon_4(self, paper):
        found = one(None, paper, "T1")
        assert found.verdict == "reproduced"
        sides = {"distal_only", "alternating", "absent"}
        assert set(found.readings_that_change_it) == {f"tensioner={side}" for side in sides}


class TestWhatIsMissing:
    def test_the_print_alone(self):
        found = judge_all(Sources())
        assert {v.verdict for v in found} == {"exact", "reproduced", "not_testable"}
        for verdict in found:
            if verdict.kind == "ensemble":
                assert verdict.verdict == "not_testable"
                assert verdict.evidence["run"] == "tendonrepro ensemble"

    def test_a_variation_or_reading(self, data, paper):
        del data.codes["controller_2", LONGER]
        assert LONGER in one(data, paper, "E2").evidence["missing"]
        del data.codes["controller_1", IDEAL]
        assert IDEAL in one(data, paper, "L1").evidence["missing"]
        assert one(data, paper, "C2").verdict == "compatible"

    def test_one_plant_is_no_box(self):
        (without,) = judge_all(Sources(), only=["K3"])
        assert without.evidence["run"].startswith("tendonrepro fetch")
        (found,) = judge_all(Sources(decouple=make_decouple_file()), only=["K3"])
        assert found.verdict == "not_testable"
        assert set(found.evidence["mae_deg"]) == {"joint_1", "joint_2", "joint_3"}
        assert found.evidence["run"] == without.evidence["run"]

    def test_an_id_that_is_not_judged(self):
        for name in ("C7", "gain.eta.joint_2"):
            with pytest.raises(UsageError, match="no claim or number"):
                judge_all(Sources(), only=[name])

    def test_every_rule_named_in_the_ledger_exists(self, data, paper):
        assert len(verdicts(data, paper)) == sum(j.kind != "input" for j in paper.judgements.values())
        assert {j.rule for j in paper.judgements.values()} >= set(CLAIMS)


class TestShippedRun:
    def test_its_numbers_stand_beside_the_printed_ones(self, data, paper):
        file = make_compare_file()
        name = "table2.controller_2.mae.joint_3"
        without = one(data, paper, name)
        assert without.ours == without.evidence["box"]["median"]
        found = {v.id: v for v in judge_all(Sources(compare=file, ensemble=data), paper)}
        first, second, loaded = (
            np.rad2deg(np.abs(file.runs[run]["e"]).mean(axis=0))[1]
            for run in ("controller_1", "controller_2", "controller_1_payload")
        )
        assert found[name].ours == pytest.approx(second)
        assert found["table3.with_load.mae.joint_3"].ours == pytest.approx(loaded)
        assert found["share.controller_1_of_2.mae.joint_3"].ours == pytest.approx(100.0 * first / second)
        assert found["increase.with_load.mae.joint_3"].ours == pytest.approx(100.0 * (loaded / first - 1.0))


class TestLedger:
    @pytest.fixture
    def found(self, data, paper):
        data.values["controller_1", PRINTED, "epsilon_rms"] *= 2.0
        return judge_all(Sources(ensemble=data), paper)

    def test_keys_are_those_promised(self, found):
        content = as_data(found)
        promised = {
            *("id", "where", "kind", "printed", "ours", "unit", "rule", "verdict", "evidence"),
            *("depends_on", "readings_that_change_it"),
        }
        for claim in content["claims"]:
            assert promised <= claim.keys()
            assert claim["kind"] in {"arithmetic", "model", "ensemble", "measured"}
        assert sum(content["summary"].values()) == len(found)
        assert content["summary"]["contradicted"] == 1

    def test_check_names_what_fails(self, found):
        assert failing(found) == ["E1"]

    def test_baseline(self, found):
        baseline = {verdict.id: verdict.verdict for verdict in found}
        assert changed(baseline, found) == {}
        now = [replace(v, verdict="compatible") if v.id == "E1" else v for v in found if v.id != "K1"]
        assert changed(baseline, now) == {"K1": ("exact", None), "E1": ("contradicted", "compatible")}
        assert changed({}, now[:1]) == {now[0].id: (None, "exact")}

    def test_files(self, found, tmp_path):
        paths = write_claims(found, tmp_path)
        assert [path.name for path in paths] == ["claims.json", "claims.csv", "claims.md"]
        content = json.loads(paths[0].read_text(encoding="utf-8"))
        assert [claim["id"] for claim in content["claims"]] == [v.id for v in found]
        with paths[1].open(encoding="utf-8", newline="") as file:
            rows = {row["id"]: row for row in csv.DictReader(file)}
        assert rows["E1"]["verdict"] == "contradicted"
        assert "| E1 | section 4.2 |" in paths[2].read_text(encoding="utf-8")

    def test_table_for_a_terminal(self, found):
        text = table_text(found)
        lines = {line.split()[0]: line for line in text.splitlines() if line}
        assert lines["E1"].endswith("contradicted")
        assert "0.261" not in lines["E1"]
        assert "1 contradicted" in text
        assert "for more verdicts run tendonrepro ensemble" in table_text(judge_all(Sources()))

    def test_one_claim_with_its_evidence(self, found):
        (claim,) = [v for v in found if v.id == "E1"]
        text = details_text(claim)
        assert "verdict: contradicted" in text
        assert "RMS of epsilon of controller_1 below that of controller_2" in text
        assert "measured hardware" in text
        (percentages,) = [v for v in found if v.id == "A1"]
        assert details_text(percentages).count("printed_is") == 12


def test_which_unknown_decides(data, paper):
    half = data.draws[:, 0] > 0.5
    data.values["controller_1", PRINTED, "epsilon_rms"][half] *= 2.0
    (found,) = judge_all(Sources(ensemble=data), paper, ["E1"], decided_by=True)
    assert found.verdict == "depends_on_plant"
    first, second = found.evidence["decided_by"]["rows"]
    assert (first["name"], second["name"]) == ("size", "nothing")
    assert first["index"] > found.evidence["decided_by"]["noise_floor"] > second["index"]


def test_a_number_is_decided_too(data, paper):
    name = "table2.controller_1.mae.joint_2"
    (found,) = judge_all(Sources(ensemble=data), paper, [name], decided_by=True)
    assert found.evidence["decided_by"]["rows"][0]["name"] == "size"
    del data.codes["controller_1", PRINTED]
    (found,) = judge_all(Sources(ensemble=data), paper, [name], decided_by=True)
    assert found.evidence["decided_by"] is None
