"""The ledger: what changes a verdict, what is missing, what decides, and how it is written."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from support.made_claims import ESTIMATES, MadeEnsemble, paper_of, spoil, verdict_on
from support.synthetic import make_compare_file

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import UsageError
from tendonrepro.verdicts.judge import Sources, judge_all
from tendonrepro.verdicts.ledger import as_data, changed
from tendonrepro.verdicts.report import claims_table, table_text
from tendonrepro.verdicts.rules import FAILURES
from tendonrepro.verdicts.statements import IDEAL_LONGER, LONGER


class TestReadings:
    def test_those_that_change_a_verdict_are_named(self):
        data = MadeEnsemble(readings=(PRINTED, "a=b", "c=d", "a=b+c=d"))
        paper = paper_of(data)
        spoil(data, "controller_1", ESTIMATES, 2.0, "a=b+c=d")
        del data.codes["controller_1", "c=d"]
        assert verdict_on(data, paper, "E1").readings_that_change_it == ("a=b+c=d",)
        found = verdict_on(data, paper, "C4")
        assert found.readings_that_change_it == ()
        assert found.evidence["not_testable_under"] == ["c=d"]

    def test_the_printed_one_decides_wherever_it_stands(self):
        data = MadeEnsemble(readings=("a=b", PRINTED))
        spoil(data, "controller_1", ESTIMATES, 2.0, "a=b")
        found = verdict_on(data, paper_of(data), "E1")
        assert (found.verdict, found.readings_that_change_it) == ("compatible", ("a=b",))

    def test_a_verdict_says_on_which_motions_and_starts_it_depends(self):
        """Of choices that change it, those that need no more; and nothing of changed equations."""
        apart, absent = "starts=apart", "reference_acceleration=absent"
        both = f"{absent}+{apart}"
        data = MadeEnsemble(readings=(PRINTED, apart, absent, both, "weights=extrapolating"))
        paper = paper_of(data)
        for reading in (apart, both, "weights=extrapolating"):
            spoil(data, "controller_1", ["mae", "rmse"], 9.0, reading)
        found = verdict_on(data, paper, "C2")
        assert {held.reading for held in found.by_choice} == {apart, absent, both}
        ((changed, verdict, ours),) = [(held.reading, held.verdict, held.ours) for held in found.unless]
        assert (changed, verdict, ours) == (apart, "not_met", 0.0)
        assert found.verdict != verdict
        assert "starts=apart" in table_text([found])
        entry = as_data([found])["claims"][0]
        assert {held["reading"] for held in entry["by_choice"]} == {apart, absent, both}

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


class TestWhatIsMissing:
    def test_the_print_alone(self):
        found = judge_all(Sources())
        assert {v.verdict for v in found if v.kind == "arithmetic"} == {"exact"}
        judged = {v.verdict for v in found if v.kind == "model"}
        assert judged == {"reproduced", "not_reproduced", "depends_on_plant"}
        assert [v.id for v in found if v.verdict in FAILURES] == ["K2a", "K2b"]
        waiting = [v for v in found if v.kind == "ensemble"]
        assert {(v.verdict, v.evidence["run"]) for v in waiting} == {("not_testable", "tendonrepro ensemble")}

    def test_a_variation_or_reading(self, data, paper):
        del data.codes["controller_2", LONGER.name]
        assert LONGER.name in verdict_on(data, paper, "E2").evidence["missing"]
        assert verdict_on(data, paper, "E2a").verdict == "compatible"
        data.codes["controller_2", LONGER.name] = data.codes["controller_2", PRINTED]
        del data.codes["controller_2", IDEAL_LONGER.name]
        assert IDEAL_LONGER.name in verdict_on(data, paper, "E2").evidence["missing"]
        assert verdict_on(data, paper, "C2").verdict == "compatible"

    def test_what_only_a_measurement_can_tell(self):
        for found in judge_all(Sources(), only=["K3", "K5"]):
            assert found.verdict == "not_testable"
            assert found.evidence["run"].startswith("tendonrepro data fetch")

    def test_an_id_that_is_not_judged(self):
        for name in ("C7", "gain.eta.joint_2"):
            with pytest.raises(UsageError, match="no claim or number"):
                judge_all(Sources(), only=[name])

    def test_an_id_in_letters_of_either_case(self):
        verdicts = judge_all(Sources(), only=["k3", "TABLE2.controller_1.mae.joint_2"])
        assert [verdict.id for verdict in verdicts] == ["K3", "table2.controller_1.mae.joint_2"]


def test_numbers_of_the_nominal_run_stand_beside_the_printed_ones(data, paper):
    file = make_compare_file()
    name = "table2.controller_2.mae.joint_3"
    without = verdict_on(data, paper, name)
    assert without.ours == without.evidence["box"]["median"]
    found = {v.id: v.ours for v in judge_all(Sources(compare=file, ensemble=data), paper)}
    first, second, loaded = (
        np.rad2deg(np.abs(file.runs[run]["e"]).mean(axis=0))[1]
        for run in ("controller_1", "controller_2", "controller_1_payload")
    )
    assert found[name] == pytest.approx(second)
    assert found["table3.with_load.mae.joint_3"] == pytest.approx(loaded)
    assert found["share.controller_1_of_2.mae.joint_3"] == pytest.approx(100.0 * first / second)
    assert found["increase.with_load.mae.joint_3"] == pytest.approx(100.0 * (loaded / first - 1.0))


class TestLedger:
    @pytest.fixture
    def found(self, data, paper):
        spoil(data, "controller_1", ESTIMATES, 2.0)
        return judge_all(Sources(ensemble=data), paper)

    def test_keys_are_those_promised(self, found):
        content = as_data(found)
        promised = {
            *("id", "where", "kind", "printed", "ours", "unit", "rule", "verdict", "evidence"),
            *("depends_on", "readings_that_change_it"),
        }
        assert all(promised <= claim.keys() for claim in content["claims"])
        repeats = {v.id.partition(".")[0]: v.repeats for v in found if v.repeats}
        assert repeats == {
            **{"S_inv": "Table 1", "S": "K1", "table3": "Table 2", "rmse_over_mae": "F1"},
            **{"joints": "F2", "share": "C2", "increase": "P1"},
        }
        once = [claim for claim in content["claims"] if claim["repeats"] is None]
        assert sum(content["summary"].values()) == len(once) < len(found)
        assert content["summary"]["exact"] == 6 + len(["K1", "A1", "encoder"])
        assert content["summary"]["contradicted"] == 1

    def test_baseline(self, found):
        baseline = {verdict.id: verdict.verdict for verdict in found}
        assert changed(baseline, found) == {}
        now = [replace(v, verdict="compatible") if v.id == "E1" else v for v in found if v.id != "K1"]
        assert changed(baseline, now) == {"K1": ("exact", None), "E1": ("contradicted", "compatible")}
        # What a baseline does not hold has not changed.
        assert changed({"E1": "contradicted"}, now) == {"E1": ("contradicted", "compatible")}

    def test_files(self, found, tmp_path):
        paths = claims_table(found).write(tmp_path)
        assert [path.name for path in paths] == ["claims.csv", "claims.md"]
        with paths[0].open(encoding="utf-8", newline="") as file:
            rows = {row["id"]: row for row in csv.DictReader(file)}
        assert rows["E1"]["verdict"] == "contradicted"
        assert float(rows["table2.controller_1.mae.joint_2"]["also_passing"]) > 0.0
        assert (rows["S.21"]["repeats"], rows["K1"]["repeats"]) == ("K1", "")
        assert "| E1 | section 4.2 |" in paths[1].read_text(encoding="utf-8")


def test_which_unknown_decides(data, paper):
    half = data.draws[:, 0] > 0.5
    for name in ESTIMATES:
        data.values["controller_1", PRINTED, name][half] *= 2.0
    (found,) = judge_all(Sources(ensemble=data), paper, ["E1"], decided_by=True)
    assert found.verdict == "depends_on_plant"
    first, second = found.evidence["decided_by"]["rows"]
    assert (first["name"], second["name"]) == ("size", "nothing")
    assert first["index"] > found.evidence["decided_by"]["noise_floor"] > second["index"]
