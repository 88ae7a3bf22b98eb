"""Sentences say what their numbers bear, and are left out where these do not."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from tendonrepro.files import shipped
from tendonrepro.report.content import Scale
from tendonrepro.report.findings import Results, findings, why


@pytest.fixture
def stored() -> Results:
    folder = shipped("docs/results")
    held = [
        json.loads((folder / name).read_text()) for name in ("ensemble.json", "claims.json", "decides.json")
    ]
    return copy.deepcopy(Results(*held))


def heads(found: Results) -> list[str]:
    return [line.split("**")[1].rstrip(".:") for line in findings(found)]


def share(value: float, plants: int = 500) -> dict[str, Any]:
    return {"share": value, "low": value - 0.05, "high": value + 0.05, "plants": plants}


@pytest.mark.parametrize(
    ("forth", "back", "head"),
    [
        (0.1, 0.9, "As printed, the equations mostly rank the laws the other way round"),
        (0.9, 0.05, "As printed, the equations mostly rank the laws as the paper does"),
        (0.4, 0.5, "As printed, the equations give no one order of the laws"),
        (0.1, 0.52, "As printed, the equations give no one order of the laws"),
    ],
)
def test_the_order_is_the_one_that_most_plants_give(
    stored: Results, forth: float, back: float, head: str
) -> None:
    printed = stored.readings["printed"]
    printed["in_order"], printed["in_reverse"] = share(forth), share(back)  # type: ignore[index]
    assert heads(stored)[0] == head
    assert f"{100 * back:.0f} %" in findings(stored)[0]


def test_too_few_plants_say_nothing(stored: Results) -> None:
    printed = stored.readings["printed"]
    printed["in_order"], printed["in_reverse"] = share(0.1, 99), share(0.9, 99)  # type: ignore[index]
    assert heads(stored)[0] == "About the order of the laws this ensemble says nothing"


def test_only_contradicted_ratios_are_called_so(stored: Results) -> None:
    ratios = stored.starting("share.")
    for entry in ratios[:3]:
        entry["verdict"] = "depends_on_plant"  # type: ignore[index]
    assert "5 of the 8 printed ratios are contradicted where all three laws track" in heads(stored)
    for entry in ratios:
        entry["readings_that_change_it"] = ["start=cold", "phi_branch=power"]  # type: ignore[index]
    ratios[-1]["readings_that_change_it"].append("torque_unit=volt")
    (line,) = [line for line in findings(stored) if "printed ratios are" in line]
    assert "of the 5, for none with `start=cold`, with a diverged law" in line
    for entry in ratios:
        entry["verdict"] = "compatible"  # type: ignore[index]
    assert not any("contradicted" in head for head in heads(stored))


def test_readings_that_do_not_mend_the_order_are_not_praised(stored: Results) -> None:
    for name, reading in stored.readings.items():
        reading["in_order"] = share(0.2 if name == "start=cold" else 0.1)  # type: ignore[index]
    assert "No reading that was run brings the printed order back on most plants" in heads(stored)
    (line,) = [line for line in findings(stored) if "No reading" in line]
    assert "`start=cold`, with 20 % [15 %, 25 %] of 500 plants" in line


def test_other_weights_alone_are_praised_only_where_they_put_controller_1_first(stored: Results) -> None:
    praise = "Extrapolating weights put Controller 1 first on {} that all three laws track; for the printed "
    praise += "order on most of them φ has to change too"
    assert praise.format("nearly every plant") in heads(stored)
    alone = stored.readings["weights=extrapolating"]
    alone["first_best"] = share(0.6)  # type: ignore[index]
    assert praise.format("most plants") in heads(stored)
    for key, value in (("first_best", 0.5), ("in_order", 0.6)):
        alone |= {"first_best": share(0.6), "in_order": share(0.1)} | {key: share(value)}  # type: ignore[operator]
        assert "Two other readings together bring the order back" in heads(stored)


def test_readings_with_the_printed_weights_that_put_controller_1_first_are_named(stored: Results) -> None:
    head = "With the weights of Eq. (15) Controller 1 comes first under"
    for reading in stored.readings.values():
        reading["first_best"] = reading["diverged_last"]["first_best"] = share(0.4)  # type: ignore[index]
        reading["order_rise_and_smoother"] = share(0.0)  # type: ignore[index]
    assert not any(head in line for line in heads(stored))
    cold = stored.readings["start=cold"]
    cold["first_best"], cold["order_rise_and_smoother"] = share(0.7), share(0.02)  # type: ignore[index]
    cold["diverged_last"]["first_best"] = share(0.8, 900)
    stored.readings["weights=swapped"]["first_best"] = share(0.9)  # type: ignore[index]
    late = stored.readings["stored_torque=applied+output_delay=2"]
    late["first_best"], late["diverged_last"]["first_best"] = share(0.9, 0), share(0.6, 800)  # type: ignore[index]
    (line,) = [line for line in findings(stored) if head in line]
    assert f"{head} 2 of the readings" in line
    last = "plants with a diverged law ranked last"
    assert f"under `start=cold` on 80 % of 900 {last} and on 70 % of the 500 that all three track" in line
    assert f"output_delay=2` on 60 % of 800 {last}, while all three laws track on none." in line
    assert f": 10 of {cold['in_order']['plants']} under `start=cold`." in line
    assert "swapped" not in line


def test_choices_where_the_print_is_silent_stand_beside_the_order(stored: Results) -> None:
    for name, reading in stored.readings.items():
        reading["in_reverse"] = share(0.3 if name == "start=cold" else 0.9)  # type: ignore[index]
    stored.readings["feedback=motor"]["in_reverse"] = share(0.0, 0)  # type: ignore[index]
    first = findings(stored)[0]
    assert "the reverse order holds on 90 % under" in first
    assert "but not under `start=cold` (30 %); on no plant all three track under `feedback=motor`." in first


def test_plants_of_the_size_of_the_bench_are_told_where_there_are_enough(stored: Results) -> None:
    sizes = "Where all six MAE of the three laws are within a factor of 2 of the print"
    printed = stored.readings["printed"]
    for plants, told in ((100, True), (99, False)):
        printed["reverse_near_print"] = share(0.7, plants)  # type: ignore[index]
        assert any(sizes in line for line in findings(stored)) is told


def test_what_no_longer_holds_is_left_out(stored: Results) -> None:
    before = heads(stored)
    stored.readings["feedback=motor"]["in_order"]["plants"] = 0
    stored.entries["F1"]["evidence"]["share"] = 0.8
    stored.entries["K2a"]["verdict"] = "reproduced"  # type: ignore[index]
    for entry in stored.starting("table2"):
        entry["evidence"]["also_passing"] = 0.1
    for held in stored.entries["C6"]["evidence"]["statements"]:
        held["share"] = 0.1
    stored.entries["E2a"]["evidence"]["share"] = 0.4
    gone = {*before} - {*heads(stored)}
    assert sorted(head.split()[0] for head in gone) == ["In", "One", "The", "What", "What", "With"]


def test_theory_and_run_stand_side_by_side() -> None:
    ours = {f"share.controller_1_of_{k}.mae.joint_{j}": 100.0 + 10 * k + j for k in (2, 3) for j in (2, 3)}
    first, second, _ = why(ours)
    assert "1.1 and 1.2 on joints 2 and 3" in first
    assert first.endswith("The run of this page gives 1.22 and 1.23.")
    # eta gamma_1 = 1.5 (2 - 0.9) 0.2^-0.1
    assert "η γ₁ = 1.94" in second
    assert "are 1.03." in second
    assert second.endswith("gives 1.08 and 1.08.")
    assert not any("run of this page" in line for line in why({}))


def test_places_on_a_scale() -> None:
    linear, logarithmic = Scale.over([-1.0, 3.0]), Scale.over([0.1, 10.0])
    assert not linear.logarithmic
    assert linear.place(1.0) == 50.0
    assert logarithmic.logarithmic
    assert logarithmic.place(1.0) == pytest.approx(50.0)
    assert logarithmic.place("0.9 to 1.1") == pytest.approx(50.0)
    assert linear.place(100.0) == 100.0
