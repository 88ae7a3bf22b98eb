"""The generated part of the findings is what the stored results say, and they agree with the theory."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from support import ROOT
import pytest

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


def test_page_is_what_the_stored_results_say(generate: Any) -> None:
    text = (DOCS / "findings.md").read_text(encoding="utf-8")
    between = text.split(generate.BEGIN)[1].split(generate.END)[0]
    assert between.strip() == generate.generated().strip()


def test_table_of_the_closest_plants(generate: Any) -> None:
    """From what `identify` reports; the best reading first, printed numbers below."""

    def reading(name: str, misfits: list[float], order: str) -> dict[str, Any]:
        shape: dict[str, Any] = {"printed_order_mae": "1 < 2 < 3"}
        shape |= {f"ours_order_{metric}": order for metric in ("mae", "rmse")}
        for whose, ratio in (("ours", 1.25), ("printed", 1.3)):
            shape |= {f"{whose}_rmse_over_mae_controller_{k}": ratio for k in (1, 2, 3)}
        agree = max(misfits) <= 1.05 * min(misfits)
        held = {"name": name, "misfit_log": min(misfits), "misfit_by_seed": misfits, "seeds_agree": agree}
        return held | {"rows_searched": ["motion"], "best_shape": [shape, shape], "history": []}

    readings = [reading("printed", [0.2, 0.3], "3 < 2 < 1"), reading("phi_branch=power", [0.07, 0.071], "1 < 2 < 3")]
    data = {"fit": "all", "window": "whole", "evaluations": 5904, "readings": readings, "joints": [2, 3]}
    thinned = generate.thinned_closest(data)
    assert "history" not in thinned["readings"][0]
    lines = generate.closest(thinned).splitlines()
    assert lines[2].startswith("| `phi_branch=power` | 0.070 | yes | 1 < 2 < 3 / 1 < 2 < 3 |")
    assert lines[3].startswith("| `printed` | 0.200 | no, up to 0.300 | 3 < 2 < 1 / 3 < 2 < 1 |")
    assert "1.25 1.25 1.25 / 1.25 1.25 1.25" in lines[2]
    assert "5,904 plants" in lines[-1]
    assert lines[-1].endswith("1.30 1.30 1.30 / 1.30 1.30 1.30.")


def test_medians_are_those_of_the_theory_where_the_load_changes_slowly(readings: dict[str, Any]) -> None:
    """1 + alpha, and 1 - alpha where the weights extrapolate; beta over eta gamma_1, see docs/theory.md."""
    ideal = readings["encoder=ideal"]
    for joint, alpha in (("joint_2", 0.1), ("joint_3", 0.2)):
        assert ideal["c1_c2"][joint]["median"] == pytest.approx(1.0 + alpha, rel=0.02)
        assert ideal["c1_c2"][joint]["q05"] > 1.0
        weights = readings["weights=extrapolating"]["c1_c2"][joint]["median"]
        assert weights == pytest.approx(1.0 - alpha, rel=0.02)
    assert readings["printed"]["c2_c3"]["joint_2"]["median"] == pytest.approx(1.032, rel=0.005)


def test_what_the_page_concludes(readings: dict[str, Any]) -> None:
    printed = readings["printed"]
    assert printed["in_order"]["share"] < 0.01
    assert max(printed["diverged"].values()) > min(printed["diverged"].values()) > 0.5
    assert readings["encoder=ideal"]["first_is_best"]["share"] < 0.01
    assert printed["ok"]["controller_1"] > printed["ok"]["controller_2"] > printed["ok"]["controller_3"]
    delayed = readings["output_delay=1"]["ok"]
    assert delayed["controller_1"] > 3.0 * max(delayed["controller_2"], delayed["controller_3"])
    both = readings["phi_branch=power+weights=extrapolating"]
    assert both["in_order"]["low"] > 0.5
    assert max(held["in_order"]["share"] or 0.0 for held in readings.values() if held is not both) < 0.55
    for name in ("gain_unit=law_in_degrees", "torque_coordinates=motor_shaft"):
        assert readings[name]["in_order"]["plants"] == 0
    assert readings["weights=extrapolating"]["c1_c2"]["joint_2"]["median"] < 1.0
    assert readings["phi_branch=power"]["c2_c3"]["joint_2"]["median"] < 1.0


def test_verdicts_that_the_page_explains(generate: Any) -> None:
    entries = {entry["id"]: entry for entry in generate.stored("claims.json")["claims"]}
    assert {name: entries[name]["verdict"] for name in ("C1", "C2", "C4", "C5", "C6", "E1", "E2")} == {
        "C1": "depends_on_plant",
        "C2": "contradicted",
        "C4": "depends_on_plant",
        "C5": "contradicted",
        "C6": "contradicted",
        "E1": "depends_on_plant",
        "E2": "contradicted",
    }
    sizes = [entry for name, entry in entries.items() if name.startswith("table2.")]
    assert {entry["verdict"] for entry in sizes} == {"compatible"}
    smoother = [held for held in entries["C6"]["evidence"]["statements"] if "step" in held["statement"]]
    assert smoother
    assert min(held["share"] for held in smoother) > 0.9


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
    ratios = [readings["printed"]["c1_c2"][joint]["median"] for joint in ("joint_2", "joint_3")]
    for phrase in (
        f"{populations['box']['plants']} plants and motions from a box of sourced ranges",
        f"under {len(readings)} readings",
        f"stable on {readings['printed']['in_order']['plants']} of the plants",
        f"holds on {100.0 * readings['printed']['in_order']['share']:.2g} % of those",
        f"error over Controller 2's is {ratios[0]:.2f} on joint 2 and {ratios[1]:.2f} on joint 3",
        f"on {100.0 * both['share']:.0f} % of the {both['plants']} plants",
        f"{counts['exact']} are exact, {counts['reproduced']} reproduced, {counts['compatible']} compatible",
        f"{counts['depends_on_plant']} claims depend on the plant, {counts['contradicted']}",
    ):
        assert phrase in " ".join(text.split()), phrase
