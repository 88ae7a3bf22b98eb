"""Claim T1: extremes against postures in between, the draws it uses, and when edges would decide."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.oracles import TABLE_1, coupling_by_columns

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.readings import AXES
from tendonrepro.monte_carlo.box import configured, make_box
from tendonrepro.verdicts import tension as rule

ROPE = coupling_by_columns(TABLE_1) * 0.0185
PULL = {
    "negative": np.array([-17.5, -17.5, -18.5]) / 1000.0,
    "distal_only": np.array([0.0, 0.0, -18.5]) / 1000.0,
    "alternating": np.array([-17.5, 17.5, -18.5]) / 1000.0,
}
BOX = make_box(load_ensemble(None).config)


def drawn(count, **rows):
    """An ensemble of nominal plants but for some rows, in eight scramblings."""
    draws = np.tile(BOX.nominal, (count, 1))
    for name, values in rows.items():
        draws[:, BOX.names.index(name)] = values
    return SimpleNamespace(names=BOX.names, draws=draws, replicate=np.arange(count) % 8)


def rows_of(data):
    return {row["course"]: row for row in rule.tension(data).evidence["courses"]}


def test_courses_are_the_readings_of_the_ensemble():
    axis = AXES["tensioner"]
    assert {*rule.COURSES, "absent"} == {axis.printed, *axis.alternatives}


@pytest.mark.parametrize("course", PULL)
def test_no_posture_in_between_is_lower_than_the_corners(course):
    """Every posture of a fine grid 10 deg inside, tension by the rope of every joint."""
    rng = np.random.default_rng(2)
    force, mass = rng.uniform(5.0, 60.0, 24), rng.uniform(0.1, 0.5, 24)
    data = drawn(24, tensioner_force=force, link_mass_3=mass, link_mass_2=2.0 * mass)
    machines = rule._machines(data)
    angles = np.stack(np.meshgrid(*[np.deg2rad(np.linspace(10.0, 170.0, 17))] * 3)).reshape(3, -1)
    torque = machines.moment[:, :, np.newaxis] * np.sin(angles)[:, np.newaxis]
    joint = np.cumsum(torque[::-1], axis=0)[::-1] - (np.outer(PULL[course], force))[:, :, np.newaxis]
    tension = np.einsum("nj,jkp->nkp", np.linalg.inv(ROPE.T), joint)
    by_hand = (tension.min(axis=(0, 2)) > 0.0).mean()
    assert rows_of(data)[course]["every_tendon_tense"]["at_10_deg"]["share"] == pytest.approx(by_hand)


def test_moments_are_those_of_the_plants_that_are_simulated():
    values = BOX.values(np.random.default_rng(1).random((3, len(BOX.names))))
    data = SimpleNamespace(names=BOX.names, draws=values, replicate=np.zeros(3, dtype=int))
    machines = rule._machines(data)
    base = load_ensemble(None).base
    for k in range(3):
        links = configured(base, BOX, values[k]).manipulator.links
        mass, length, com = (getattr(links, name).si for name in ("mass", "length", "com"))
        by_hand = 9.81 * np.array([mass[1] * com[1] + mass[2] * length[1], mass[2] * com[2]])
        assert machines.moment[1:, k] == pytest.approx(by_hand)
        first = 9.81 * (0.77 * 0.144 + (mass[1] + mass[2]) * 0.30)
        assert machines.moment[0, k] == pytest.approx(first), "link 1 is not in the box"


def test_a_heavy_pull_slackens_tendon_1_where_tendon_4_acts_on_joint_3_alone():
    """T1 there is the weight's share less 0.248 of the pull; link 1's alone is bounded by hand."""
    rows = rows_of(drawn(800, tensioner_force=np.linspace(5.0, 400.0, 800)))
    shares = rows["distal_only"]["every_tendon_tense"]
    assert shares["at_5_deg"]["share"] < shares["at_10_deg"]["share"] < shares["at_20_deg"]["share"] < 1.0
    b = np.array(
        [9.81 * (0.77 * 0.144 + 0.69 * 0.30), 9.81 * (0.47 * 0.1344 + 0.22 * 0.28), 9.81 * 0.22 * 0.096]
    )
    row = np.array([37 / 77, 37 / 77 + 35 * 37 / 77**2])
    last = row[1] - 35 / 77 + 35 * 35 / 77**2
    limit = np.sin(np.deg2rad(20.0)) * (b @ [*row, last]) / (35 / 77 - 35 * 35 / 77**2) / 0.0185
    assert shares["at_20_deg"]["share"] == pytest.approx((limit - 5.0) / 395.0, abs=0.03)
    assert rows["negative"]["every_tendon_tense"]["at_5_deg"]["share"] == 1.0


def test_where_the_distance_from_the_edges_decides_the_course_depends():
    found = rule.tension(None)
    rows = {row["course"]: row for row in found.evidence["courses"]}
    verdicts = {course: row["verdict"] for course, row in rows.items()}
    assert verdicts == {
        "negative": "compatible",
        "distal_only": "depends_on_plant",
        "alternating": "compatible",
    }
    by_margin = rows["distal_only"]["every_tendon_tense"]
    assert by_margin["at_5_deg"]["verdict"] != by_margin["at_20_deg"]["verdict"]
    assert found.decision.verdict == "depends_on_plant"
    assert found.other_readings["tensioner=absent"] == "not_testable"
