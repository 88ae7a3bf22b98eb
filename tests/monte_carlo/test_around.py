"""Plants around a user's arm: how far its values move, and what follows what."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tendonrepro.configuration.ensemble import load_around
from tendonrepro.configuration.own_arm import init_arm
from tendonrepro.errors import UsageError
from tendonrepro.monte_carlo.around import AroundArm


@pytest.fixture(scope="module")
def compare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mine")
    init_arm(4, folder)
    path = folder / "compare.yaml"
    path.write_text(path.read_text().replace("[1, 2, 3, 4]", "[2, 3, 4]"), encoding="utf-8")
    return path


def around(path: Path, spread: float | None) -> AroundArm:
    loaded = load_around(path, spread)
    assert loaded.around is not None
    return AroundArm(loaded, loaded.around)


def test_values_stay_within_the_spread_and_inertias_follow(compare: Path) -> None:
    arm = around(compare, 0.2)
    own = arm.loaded.compare.manipulator
    drawn = [arm.draw(number).manipulator for number in range(8)]
    for name in ("length", "mass"):
        ratio = np.array([getattr(one.links, name).si for one in drawn]) / getattr(own.links, name).si
        assert (ratio[:, 0] == 1.0).all()  # joint 1 is held
        assert ratio[:, 1:].min() >= 1.0 / 1.2
        assert ratio[:, 1:].max() <= 1.2
        assert np.ptp(ratio[:, 1:], axis=0).min() > 0.1
        assert np.ptp(ratio[:, 1:], axis=1).min() > 0.0
    for one in drawn:
        share = one.links.inertia.si / (one.links.mass.si * one.links.length.si**2) / 0.098
        assert share.min() >= 1.0 / 1.2 - 1e-9
        assert share.max() <= 1.2 + 1e-9
        # Bearings and motors are alike at all joints, and what is off stays off.
        assert np.ptp(one.winches.viscous.si / own.winches.viscous.si) < 1e-12
        assert one.tensioner.force.si == 0.0
    assert {one.links.mass.source for one in drawn} == {
        "assumed: draw around my arm, each value within a factor of 1.2"
    }


def test_without_a_spread_the_shipped_ranges_are_relative(compare: Path) -> None:
    arm = around(compare, None)
    ends = {(one.key, one.joint): (one.low, one.high) for one in arm.factors}
    assert ends["mass", 2] == pytest.approx((0.25 / 0.47, 0.9 / 0.47))
    assert ends["mass", 4] == pytest.approx((0.10 / 0.22, 0.5 / 0.22))
    assert ends["winches.viscous", None] == pytest.approx((0.2, 5.0))
    assert ("mass", 1) not in ends


def test_the_same_number_is_the_same_plant(compare: Path) -> None:
    arm = around(compare, 0.5)
    assert arm.draw(3) == arm.draw(3)
    assert arm.draw(3) != arm.draw(4)
    assert load_around(compare, 0.5).sha256 != load_around(compare, 0.4).sha256


@pytest.mark.parametrize("spread", [0.0, -0.1, 10.0, float("nan")])
def test_a_spread_that_is_none(compare: Path, spread: float) -> None:
    with pytest.raises(UsageError):
        load_around(compare, spread)
