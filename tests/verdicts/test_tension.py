"""Claim T1: extremes against postures in between, the draws it uses, and when edges would decide."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.made_ensemble import box
from support.oracles import ROPE, TENDON_4

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import AXES, PRINTED
from tendonrepro.verdicts import tension as rule

BOX = box()
ARM = load_config(None, "decouple").config.manipulator


def drawn(count, **rows):
    """An ensemble of nominal plants but for some rows, in eight scramblings."""
    draws = np.tile(BOX.nominal, (count, 1))
    for name, values in rows.items():
        draws[:, BOX.names.index(name)] = values
    return SimpleNamespace(names=BOX.names, draws=draws, replicate=np.arange(count) % 8)


def test_courses_are_the_readings_of_the_ensemble():
    axis = AXES["tensioner"]
    assert {*rule.COURSES, "absent"} == {axis.printed, *axis.alternatives}


@pytest.mark.parametrize("margin", [5.0, 10.0, 20.0])
@pytest.mark.parametrize("course", TENDON_4)
def test_no_posture_in_between_is_lower_than_the_corners(course, margin):
    """Every posture of a grid inside, tension by the rope of every joint; some pulls are too heavy."""
    rng = np.random.default_rng(2)
    force, mass = np.linspace(5.0, 400.0, 100), rng.uniform(0.1, 0.5, 100)
    data = drawn(100, tensioner_force=force, link_mass_3=mass, link_mass_2=2.0 * mass)
    plants = rule.plants_at_rest(data, ARM)
    angles = np.stack(np.meshgrid(*[np.deg2rad(np.linspace(margin, 180.0 - margin, 7))] * 3)).reshape(3, -1)
    torque = plants.moment[:, :, np.newaxis] * np.sin(angles)[:, np.newaxis]
    joint = np.cumsum(torque[::-1], axis=0)[::-1] - (np.outer(TENDON_4[course], force))[:, :, np.newaxis]
    tension = np.einsum("nj,jkp->nkp", np.linalg.inv(ROPE.T), joint)
    by_hand = (tension.min(axis=(0, 2)) > 0.0).mean()
    (row,) = (row for row in rule.tension(data)[PRINTED].evidence["courses"] if row["course"] == course)
    assert row["every_tendon_tense"][f"at_{margin:g}_deg"]["share"] == pytest.approx(by_hand)
    assert (by_hand < 1.0) == (course == "distal_only")


def test_moments_are_those_of_the_plants_that_are_simulated():
    values = BOX.values(np.random.default_rng(1).random((3, len(BOX.names))))
    data = SimpleNamespace(names=BOX.names, draws=values, replicate=np.zeros(3, dtype=int))
    plants = rule.plants_at_rest(data, ARM)
    for k in range(3):
        links = BOX.configured(values[k]).manipulator.links
        mass, length, com = (getattr(links, name).si for name in ("mass", "length", "com"))
        by_hand = 9.81 * np.array([mass[1] * com[1] + mass[2] * length[1], mass[2] * com[2]])
        assert plants.moment[1:, k] == pytest.approx(by_hand)
        first = 9.81 * (0.74 * 0.132 + (mass[1] + mass[2]) * 0.33)
        assert plants.moment[0, k] == pytest.approx(first), "link 1 is not in the box"


def test_tendons_that_are_slack_while_tendon_4_moves_are_no_opposite():
    """A pull of 100 kN on the last link alone leaves no posture without a slack tendon."""
    courses = rule.tension(drawn(100, tensioner_force=1e5))[PRINTED].evidence["courses"]
    assert [row["verdict"] for row in courses if row["course"] == "distal_only"] == ["not_met"]
