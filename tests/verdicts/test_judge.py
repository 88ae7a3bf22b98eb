"""The ledger: what changes a verdict, what is missing, what decides, and how it is written."""

from dataclasses import replace

import pytest
from support.made_claims import ESTIMATES, MadeEnsemble, paper_of, spoil, verdict_on

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.errors import UsageError
from tendonrepro.verdicts.judge import judge_all
from tendonrepro.verdicts.ledger import changed
from tendonrepro.verdicts.rules import FAILURES
from tendonrepro.verdicts.statements import IDEAL_LONGER, LONGER
from tendonrepro.verdicts.words import claims_table, table_text


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
        assert {held.reading for held in found.by_choice} == {apart, absent, both}
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


class TestWhatIsMissing:
    def test_the_print_alone(self):
        found = judge_all()
        assert {v.verdict for v in found if v.kind == "arithmetic"} == {"exact"}
        judged = {v.verdict for v in found if v.kind == "model"}
        assert judged == {"reproduced", "not_reproduced", "depends_on_plant"}
        assert [v.id for v in found if v.verdict in FAILURES] == ["K2a", "K2b"]
        waiting = [v for v in found if v.kind == "ensemble"]
        assert {(v.verdict, v.evidence["run"]) for v in waiting} == {("not_testable", "tendonrepro ensemble")}
        on_bench = [v for v in found if v.kind == "measured"]
        assert {(v.id, v.verdict) for v in on_bench} == {("K3", "not_testable"), ("K5", "not_testable")}

    def test_a_variation_or_reading(self, data, paper):
        for variation in (LONGER, IDEAL_LONGER):
            kept = data.codes.pop(("controller_2", variation.name))
            assert variation.name in verdict_on(data, paper, "E2").evidence["missing"]
            data.codes["controller_2", variation.name] = kept
        assert verdict_on(data, paper, "E2").verdict == "compatible"

    @pytest.mark.parametrize("name", ["C7", "gain.eta.joint_2"])
    def test_an_id_that_is_not_judged(self, name):
        with pytest.raises(UsageError, match=name):
            judge_all(only=["K1", name])

    def test_an_id_in_letters_of_either_case(self):
        verdicts = judge_all(only=["k3", "TABLE2.controller_1.mae.joint_2"])
        assert [verdict.id for verdict in verdicts] == ["K3", "table2.controller_1.mae.joint_2"]


class TestLedger:
    def test_baseline(self, data, paper):
        spoil(data, "controller_1", ESTIMATES, 2.0)
        found = judge_all(data, paper)
        baseline = {verdict.id: verdict.verdict for verdict in found}
        assert changed(baseline, found) == {}
        now = [replace(v, verdict="compatible") if v.id == "E1" else v for v in found if v.id != "K1"]
        assert changed(baseline, now) == {"K1": ("exact", None), "E1": ("contradicted", "compatible")}
        # What a baseline does not hold has not changed.
        assert changed({"E1": "contradicted"}, now) == {"E1": ("contradicted", "compatible")}
