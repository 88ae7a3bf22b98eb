"""Tensions over the half-plane: against single postures worked by hand, and as text, pictures and files."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support.oracles import ROPE, TENDON_4
from support.overrides import on_plain_arm

import tendonrepro as tr
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.statics import RESERVE, half_plane, survey
from tendonrepro.experiments.statics_report import statics_result

LENGTH, MASS, COM = np.array([0.30, 0.28]), np.array([0.77, 0.47, 0.22]), np.array([0.144, 0.1344, 0.096])


@pytest.fixture(scope="module")
def found():
    return survey(on_plain_arm("decouple"))


def row_of(rows, **keys):
    """The row with these values."""
    (row,) = (row for row in rows if all(row[key] == value for key, value in keys.items()))
    return row


def tension_by_hand(course, deg, payload=0.0, force=17.0):
    """Centres of mass in the plane, their potential's slope by differences, and a lever for each rope."""
    phi = np.deg2rad(deg)

    def potential(turn):
        angle = phi + np.cumsum(turn)
        height = -np.cos(angle)
        joint = np.concatenate([[0.0], np.cumsum(LENGTH * height[:2])])
        tip = joint[2] + 0.20 * height[2]
        return 9.81 * (MASS @ (joint + COM * height) + payload * tip)

    step = 1e-5 * np.eye(3)
    weight = np.array([(potential(turn) - potential(-turn)) / 2e-5 for turn in step])
    return np.linalg.solve(ROPE.T, weight - TENDON_4[course] * force)


@pytest.mark.parametrize("course", TENDON_4)
def test_the_spring_pulls_as_its_rope_is_drawn(found, course):
    """17 N in the start posture, stretched by 0.1 m there."""
    start, radius = np.rad2deg(np.cumsum(found.loaded.config.posture.si)), TENDON_4[course]
    for last, before in ((0, 0), (45, 45), (90, 10), (31, 77)):
        deg = [45.0, 2.0 * before, 2.0 * last]
        drawn = -radius @ np.diff(np.deg2rad(np.subtract(deg, start)), prepend=0.0)
        smallest = tension_by_hand(course, deg, force=max(17.0 + 170.0 * drawn, 0.0)).min()
        assert found.maps[course].least["spring"][last, before] == pytest.approx(smallest, abs=1e-6)
    # By the links' own angles; each turns from 0 to pi.
    travel = 1e3 * np.pi * np.abs(np.diff(radius, append=0.0)).sum()
    assert row_of(found.courses, course=course)["change_of_length_mm"] == pytest.approx(travel)


def test_one_moving_joint_has_tensions_but_no_map():
    loaded = load_config("plain", "compare")
    config = loaded.config.model_copy(update={"joints": (3,)})
    found = survey(replace(loaded, config=config))
    assert not found.maps
    # At level, its weight has the lever of its centre of mass, and its tendon that of the pulley.
    # The smallest tension is nearest to hanging or upright, half a cell of 5 deg away.
    smallest = [9.81 * 0.22 * 0.096 * np.sin(np.radians(2.5)) / 0.0185]
    assert found.weight_alone == pytest.approx(smallest)
    cases = [row["case"] for row in found.tensions if row["course"] == "negative"]
    assert cases == ["motor", "payload", "spring"]
    shown = statics_result(found)
    assert shown.data["map"] is None
    assert not shown.figures


@pytest.mark.parametrize("course", TENDON_4)
@pytest.mark.parametrize(("case", "payload"), [("motor", 0.0), ("payload", 0.2)])
def test_maps_are_tensions_of_single_postures(found, course, case, payload):
    for last, before in ((0, 0), (45, 45), (90, 10), (31, 77)):
        deg = [45.0, 2.0 * before, 2.0 * last]
        smallest = tension_by_hand(course, deg, payload).min()
        assert found.maps[course].least[case][last, before] == pytest.approx(smallest, abs=1e-6)


def test_force_for_the_reserve_leaves_it(found):
    for course in TENDON_4:
        needed, room = found.maps[course].needed, found.maps[course].room
        for last, before in ((2, 1), (0, 45), (90, 90)):
            deg = [45.0, 2.0 * before, 2.0 * last]
            left = tension_by_hand(course, deg, force=needed[last, before]).min()
            if room[last, before] >= 0.0:
                assert left == pytest.approx(RESERVE, abs=1e-6) or needed[last, before] == 0.0
            else:
                assert left < RESERVE
    assert (found.maps["alternating"].room < 0.0).any()


def test_whole_half_plane(found):
    grid = half_plane(3)
    assert grid.min() > 0.0
    assert grid.max() < np.pi
    for name in TENDON_4:
        over = row_of(found.tensions, course=name, case="motor")
        by_hand = tension_by_hand(name, over["link_angles_deg"])
        assert by_hand.min() == pytest.approx(over["least_tension_N"], abs=1e-6)
        assert by_hand.argmin() + 1 == over["tendon"]
        low, high = over["force_window_N"]
        assert low <= found.force[0] <= high
        assert over["share_tense"] == 1.0


def test_friction_band_holds_the_frictionless_tension(found):
    for maps in found.maps.values():
        assert (maps.band[0] <= maps.least["motor"] + 1e-9).all()
        assert (maps.least["motor"] <= maps.band[1] + 1e-9).all()
    without = survey(on_plain_arm("decouple", "manipulator.friction.per_pulley=1e-9"))
    maps = without.maps["negative"]
    assert maps.band[0] == pytest.approx(maps.least["motor"])


def test_files(tmp_path):
    text = str(tr.statics(out=tmp_path))
    stored = json.loads((tmp_path / "statics.json").read_text())
    assert stored["courses"]["alternating"]["half_plane"]["motor"]["force_window_N"] == [0.0, None]
    assert all(course in text for course in TENDON_4)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    names = {f"figures/statics_margin.{suffix}" for suffix in ("pdf", "png", "txt")}
    names |= {f"tables/{name}.{suffix}" for name in ("statics", "courses") for suffix in ("csv", "md")}
    assert names | {"statics.json"} == set(manifest["outputs"])
    assert len(pd.read_csv(tmp_path / "tables" / "statics.csv")) == 9


def test_what_an_own_arm_takes_from_others_is_marked(tmp_path):
    init_arm(4, tmp_path)
    text = (tmp_path / "my_arm.yaml").read_text() + "tensioner: {force: 20}\n"
    (tmp_path / "my_arm.yaml").write_text(text)
    found = tr.statics(tmp_path / "compare.yaml").data
    assert found["tensioner_diameter_mm"] == pytest.approx([35.0, 35.0, 37.0, 37.0])
    assert found["sources"]["diameter"] == "assumed: from plain_arm"
    assert found["tensioner_force_N"] == 20.0
    assert found["sources"]["force"].startswith("user")
    assert "paper's arm" in found["sources"]["loss"]
