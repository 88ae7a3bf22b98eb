"""The generated parts of the pages are what the stored results say, and they agree with the theory."""

from __future__ import annotations

import importlib.util
from typing import Any

import pytest
from support import ROOT

from tendonrepro.report import rows

DOCS = ROOT / "docs"
pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="no docs folder beside the package")


@pytest.fixture(scope="module")
def generate() -> Any:
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def readings(generate: Any) -> dict[str, Any]:
    found = generate.stored("ensemble.json")["populations"]["box"]["readings"]
    return {reading["name"]: reading for reading in found}


def test_pages_are_what_the_stored_results_say(generate: Any) -> None:
    texts = [page.read_text(encoding="utf-8") for page in generate.PAGES]
    assert [generate.fresh(text) for text in texts] == texts
    assert [len(generate.PART.findall(text)) for text in texts] == [2, 1]


def test_table_of_the_closest_plants(generate: Any) -> None:
    """From what `identify` reports; the best reading first, printed numbers below."""

    def reading(name: str, misfits: list[float], order: str) -> dict[str, Any]:
        shape: dict[str, Any] = {f"printed_order_{metric}": "1 < 2 < 3" for metric in ("mae", "rmse")}
        shape |= {f"ours_order_{metric}": order for metric in ("mae", "rmse")}
        for whose, ratio in (("ours", 1.25), ("printed", 1.3)):
            shape |= {f"{whose}_rmse_over_mae_controller_{k}": ratio for k in (1, 2, 3)}
        agree = max(misfits) <= 1.05 * min(misfits)
        held = {"name": name, "misfit_log": min(misfits), "misfit_by_seed": misfits, "seeds_agree": agree}
        number = {"run": "controller_3", "metric": "mae", "joint": 3}
        held["numbers"] = [number | {"ratio": ratio} for ratio in (1.05, 0.94)]
        held["parameters"] = [{"name": "amplitude", "at_bound": "high"}, {"name": "rise", "at_bound": None}]
        return held | {"rows_searched": ["motion"], "best_shape": [shape, shape], "history": []}

    readings = [
        reading("printed", [0.2, 0.3], "3 < 2 < 1"),
        reading("phi_branch=power", [0.07, 0.071], "1 < 2 < 3"),
    ]
    data = {"fit": "all", "window": "whole", "evaluations": 5904, "readings": readings, "joints": [2, 3]}
    thinned = rows.thinned_closest(data)
    thinned["readings"][1]["evaluations"] = 48
    assert "history" not in thinned["readings"][0]
    lines = [*generate.table(rows.closest(thinned)).splitlines(), "", generate.together(thinned)]
    assert lines[2].startswith("| `phi_branch=power` | 0.070 | yes | 1 < 2 < 3 / 1 < 2 < 3 |")
    assert lines[3].startswith("| `printed` | 0.200 | no, up to 0.300 | 3 < 2 < 1 / 3 < 2 < 1 |")
    assert "1.25 1.25 1.25 / 1.25 1.25 1.25" in lines[2]
    assert "after 5,904 plants, 48 under `phi_branch=power`; seeds" in lines[-3]
    assert lines[-3].endswith("1.30 1.30 1.30 / 1.30 1.30 1.30.")
    assert "on both joints, under `phi_branch=power`; RMSE/MAE rises" in lines[-1]
    assert "on both joints under none of them; so both under none of them" in lines[-1]
    assert "agree under 1 of the 2;" in lines[-1]
    assert "controller 3's MAE on joint 3 is farthest off, 6 % too small" in lines[-1]
    assert "At a bound of the box it has `amplitude` (high)." in lines[-1]


def test_medians_are_those_of_the_theory_where_the_load_changes_slowly(readings: dict[str, Any]) -> None:
    """1 + alpha, and 1 - alpha where the weights extrapolate; beta over eta gamma_1, see docs/theory.md."""
    for name in ("encoder=ideal", "feedback=motor", "delay_time=two_periods", "output_delay=2"):
        for joint, alpha in (("joint_2", 0.1), ("joint_3", 0.2)):
            assert readings[name]["c1_c2"][joint]["median"] == pytest.approx(1.0 + alpha, rel=0.02)
    for joint, alpha in (("joint_2", 0.1), ("joint_3", 0.2)):
        assert readings["encoder=ideal"]["c1_c2"][joint]["q05"] > 1.0
        weights = readings["weights=extrapolating"]["c1_c2"][joint]["median"]
        assert weights == pytest.approx(1.0 - alpha, rel=0.02)
    assert readings["printed"]["c2_c3"]["joint_2"]["median"] == pytest.approx(1.032, rel=0.005)


def test_median_omega_of_the_slips(generate: Any) -> None:
    (entry,) = [entry for entry in generate.stored("claims.json")["claims"] if entry["id"] == "L1"]
    found = entry["evidence"]["remarks"][1].removeprefix("the median Omega is ").replace(", ", " and ")
    assert f"is {found} (joints 2 and 3)" in (DOCS / "slips.md").read_text(encoding="utf-8")


def test_stored_verdicts_follow_from_the_rules_of_today(generate: Any) -> None:
    """What needs nothing but the print is judged again."""
    from tendonrepro.claims.judge import Sources, judge_all

    entries = {entry["id"]: entry for entry in generate.stored("claims.json")["claims"]}
    for verdict in judge_all(Sources()):
        if verdict.verdict != "not_testable":
            assert entries[verdict.id]["verdict"] == verdict.verdict, verdict.id


def test_readme_says_what_was_found(generate: Any, readings: dict[str, Any]) -> None:
    text = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    populations, counts = (
        generate.stored("ensemble.json")["populations"],
        generate.stored("claims.json")["summary"],
    )
    both = readings["phi_branch=power+weights=extrapolating"]["in_order"]
    printed, motors = readings["printed"], readings["feedback=motor"]
    ratios = [printed["c1_c2"][joint]["median"] for joint in ("joint_2", "joint_3")]
    entries = generate.stored("claims.json")["claims"]
    power = [
        entry["evidence"]["also_passing"]
        for entry in entries
        if entry["id"].startswith(("table2.", "table3.with"))
    ]
    plants, alone = populations["box"]["plants"], readings["weights=extrapolating"]["first_best"]["share"]
    last = [
        entry["evidence"]["direction"]["diverged_last"]["share"]
        for entry in entries
        if entry["verdict"] == "contradicted"
    ]
    assert printed["in_order"]["share"] == 0.0
    late = readings["stored_torque=applied+output_delay=1"]
    volt, later = (
        readings["torque_unit=volt"]["first_best"],
        readings["stored_torque=applied+output_delay=2"],
    )
    assert later["first_best"]["plants"] == 0

    def last_of(reading: dict[str, Any], key: str, digits: int = 0) -> str:
        held = reading["diverged_last"][key]
        return f"{100.0 * held['share']:.{digits}f} % of {held['plants']}"

    assert round(1e3 * printed["diverged_last"]["in_order"]["share"]) == 3
    reverse = printed["diverged_last"]["in_reverse"]
    assert all(
        "stored_torque=applied" in entry["readings_that_change_it"]
        for entry in entries
        if entry["verdict"] == "contradicted"
    )
    named = {entry["id"]: entry["ours"] for entry in entries}
    assert max(named[name] for name in ("C2", "C3", "E3")) < 0.02
    for phrase in (
        f"Controller 1 has the smallest errors on {100.0 * alone:.0f} % of the plants",
        f"of the {reverse['plants']} on which not all three diverge, a diverged law ranked last, it is "
        f"{100.0 * reverse['share']:.0f} % and 0.3 %",
        f"on {100.0 * late['first_best']['share']:.0f} % of the {late['first_best']['plants']} plants that",
        f"on {last_of(late, 'first_best')} with a diverged law ranked last, for the others mostly diverge",
        f"two samples late that is {last_of(later, 'first_best', 1)}, and none is left",
        f"torque in volts it is {100.0 * volt['share']:.0f} % of {volt['plants']}",
        f"({last_of(readings['weights=extrapolating'], 'first_best')} with a diverged law ranked last)",
        f"({last_of(readings['phi_branch=power+weights=extrapolating'], 'in_order')})",
        "none where the applied torque is stored, nor where a diverged law counts as the worst",
        f"there Controller 1 is ahead on {100.0 * min(last):.0f} % to {100.0 * max(last):.0f} %",
        f"{plants} plants and motions from a box of ranges, each with its reason",
        f"under {len(readings)} readings",
        f"all three controllers track on {printed['in_order']['plants']} of the plants",
        f"on {100.0 * printed['in_reverse']['share']:.0f} % of those the complete order is the reverse",
        f"error over Controller 2's is {ratios[0]:.2f} on joint 2 and {ratios[1]:.2f} on joint 3",
        f"on {100.0 * both['share']:.0f} % of the {both['plants']} plants",
        f"track on {100.0 * motors['in_order']['plants'] / plants:.0f} % of the plants drawn",
        f"{counts['exact']} are exact and {counts['reproduced']} reproduced; {counts['contradicted']} are",
        f"{counts['not_reproduced']} are not reproduced; {counts['depends_on_plant']} are called",
        f"Another {counts['compatible']} are compatible",
        f"{100.0 * min(power):.0f} % to {100.0 * max(power):.0f} % of a decade",
    ):
        assert phrase.lower() in " ".join(text.split()).lower(), phrase
