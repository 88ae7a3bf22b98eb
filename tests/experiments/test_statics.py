"""Tensions over the half-plane: against single postures worked by hand, and as files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.oracles import ROPE, TENDON_4
from support.overrides import on_plain_arm

import tendonrepro as tr
from tendonrepro.configuration.load import load_config
from tendonrepro.experiments.report import statics_result
from tendonrepro.experiments.statics import half_plane, survey

LENGTH, MASS, COM = np.array([0.30, 0.28]), np.array([0.77, 0.47, 0.22]), np.array([0.144, 0.1344, 0.096])
FORCE = 17.0
PULLS = f"manipulator.tensioner.force={FORCE}"


@pytest.fixture(scope="module")
def found():
    return survey(on_plain_arm("decouple", PULLS))


def row_of(rows, **keys):
    """The row with these values."""
    (row,) = (row for row in rows if all(row[key] == value for key, value in keys.items()))
    return row


def tension_by_hand(course, deg, payload=0.0, force=FORCE):
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
def test_maps_are_tensions_of_single_postures(found, course):
    """The spring pulls as hard as the motor in the start posture, and is stretched by 0.1 m there."""
    start, radius = np.rad2deg(np.cumsum(found.loaded.config.posture.si)), TENDON_4[course]
    for last, before in ((0, 0), (45, 45), (90, 10), (31, 77)):
        deg = [45.0, 2.0 * before, 2.0 * last]
        drawn = -radius @ np.diff(np.deg2rad(np.subtract(deg, start)), prepend=0.0)
        by_hand = {
            "motor": tension_by_hand(course, deg),
            "payload": tension_by_hand(course, deg, payload=0.2),
            "spring": tension_by_hand(course, deg, force=max(FORCE + 10.0 * FORCE * drawn, 0.0)),
        }
        for case, tension in by_hand.items():
            assert found.maps[course, case][last, before] == pytest.approx(tension.min(), abs=1e-6)
    # By the links' own angles; each turns from 0 to pi.
    travel = 1e3 * np.pi * np.abs(np.diff(radius, append=0.0)).sum()
    assert row_of(found.courses, course=course)["change_of_length_mm"] == pytest.approx(travel)


def test_one_moving_joint_has_tensions_but_no_map():
    loaded = load_config("plain", "compare")
    found = survey(replace(loaded, config=loaded.config.model_copy(update={"joints": (3,)})))
    # Of the cells' centres, 2.5 deg from hanging or upright has the least weight.
    smallest = [9.81 * 0.22 * 0.096 * np.sin(np.radians(2.5)) / 0.0185]
    assert found.weight_alone == pytest.approx(smallest)
    assert not found.maps
    assert not statics_result(found).figures


def test_whole_half_plane(found):
    grid = half_plane(3)
    assert (grid.min(), grid.max()) == pytest.approx((np.deg2rad(2.5), np.deg2rad(177.5)))
    for course in TENDON_4:
        over = row_of(found.tensions, course=course, case="motor")
        by_hand = tension_by_hand(course, over["link_angles_deg"])
        assert by_hand.min() == pytest.approx(over["least_tension_N"], abs=1e-6)
        assert by_hand.argmin() + 1 == over["tendon"]
        assert over["share_tense"] == 1.0
    # Where tendon 4 slackens another one, the largest force leaves that one just tense.
    low, high = row_of(found.tensions, course="distal_only", case="motor")["force_window_N"]
    assert low <= FORCE <= high
    at_most = survey(on_plain_arm("decouple", f"manipulator.tensioner.force={high}"))
    least = row_of(at_most.tensions, course="distal_only", case="motor")["least_tension_N"]
    assert least == pytest.approx(0.0, abs=1e-9)


def test_friction_of_the_pulleys_is_a_band(found):
    bands = {}
    for loss in (0.0, 0.05):
        courses = survey(on_plain_arm("decouple", PULLS, f"manipulator.friction.per_pulley={loss}")).courses
        bands[loss] = np.array([row["least_tension_with_friction_N"] for row in courses])
    least = [row_of(found.tensions, course=course, case="motor")["least_tension_N"] for course in TENDON_4]
    np.testing.assert_allclose(bands[0.0].T, [least, least], rtol=1e-12)
    assert (bands[0.05][:, 0] < least).all()
    assert (bands[0.05][:, 1] > least).all()


def test_files(tmp_path):
    heavy = {"runs.controller_1_payload.payload": 0.5}
    text = str(tr.statics("plain", set=heavy, out=tmp_path))
    stored = json.loads((tmp_path / "statics.json").read_text())
    assert row_of(stored["tensions"], course="alternating", case="motor")["force_window_N"] == [0.0, None]
    assert row_of(stored["inputs"], input="payload_kg")["value"] == 0.5
    assert all(course in text for course in TENDON_4)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    names = {f"figures/statics_margin.{suffix}" for suffix in ("pdf", "png", "txt")}
    names |= {f"tables/{name}.{suffix}" for name in ("statics", "courses") for suffix in ("csv", "md")}
    assert names | {"statics.json"} == set(manifest["outputs"])
