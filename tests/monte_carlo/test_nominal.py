"""The nominal plant follows its two rules: middles of ranges, and off what stands in no equation.

docs/assumptions.md states them. A number that is neither has a source that says why not.
"""

import math
import re
from decimal import ROUND_HALF_UP, Decimal

import numpy as np
import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import BoxRange
from tendonrepro.monte_carlo.box import configured, make_box

NUMBER = r"\d[\d.]*(?:e-?\d+)?"
MIDDLES = re.compile(
    rf"(geometric )?middles? of (?:the usual )?({NUMBER} to {NUMBER}(?:, {NUMBER} to {NUMBER})*)"
)
NUMERICS = ("solver", "status", "seed")  # no unknowns of the bench
OFF = {"manipulator.friction.reducer_efficiency": 1.0}  # of the others 0


def two_digits(value):
    """Round to two significant digits, halves upwards; the 12th digit and beyond do not count."""
    exact = Decimal(f"{value:.12g}")
    return float(exact.quantize(Decimal((0, (1,), exact.adjusted() - 1)), rounding=ROUND_HALF_UP))


def middle(low, high, geometric):
    return two_digits(math.sqrt(low * high) if geometric else 0.5 * (low + high))


def stated_middles(source):
    """Middle of every range that a source gives."""
    found = []
    for geometric, ranges in MIDDLES.findall(source):
        for pair in ranges.split(", "):
            low, high = map(float, pair.split(" to "))
            found.append(middle(low, high, bool(geometric)))
    return found


def quantities(tree, path=()):
    if isinstance(tree, dict) and "source" in tree:
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


ROWS = dict(load_ensemble(None).config.box.items())
SHIPPED = {
    f"{name}: {key}": held
    for name in ("compare", "compare_cosine", "decouple")
    for key, held in quantities(load_config(name, None).tree)
    if key.split(".")[0] not in NUMERICS
}


@pytest.mark.parametrize(
    ("value", "rounded"), [(0.275, 0.28), (2.25, 2.3), (32.5, 33.0), (0.0982, 0.098), (282.8, 280.0)]
)
def test_rounding_is_to_two_digits_and_halves_go_up(value, rounded):
    assert two_digits(value) == rounded


@pytest.mark.parametrize("name", ROWS)
def test_nominal_of_a_row_is_its_middle_or_its_source_says_why_not(name):
    row = ROWS[name]
    by_rule = isinstance(row, BoxRange) and row.nominal == middle(row.low, row.high, row.scale == "log")
    text = row.nominal if isinstance(row.nominal, str) else f"{row.nominal:g}"
    assert (f"nominal {text}: " in row.source) != by_rule


def test_what_acts_in_no_equation_is_off_in_the_nominal_draw():
    switches = [row for name, row in ROWS.items() if name.endswith("_acts")]
    assert len(switches) == 5
    assert {row.nominal for row in switches} == {"off"}
    assert all("nominal off: in no equation" in row.source for row in switches)


@pytest.mark.parametrize("key", SHIPPED)
def test_shipped_number_is_printed_or_follows_from_a_rule(key):
    held = SHIPPED[key]
    origin, _, why = held["source"].partition(": ")
    values, middles = np.ravel(held["value"]), stated_middles(held["source"])
    if origin in ("printed", "datasheet"):
        return
    if "off, " in why:
        assert set(values) == {OFF.get(key.split(": ")[1], 0.0)}
        # What it would be if it were on follows the rule too.
        assert [float(value) for value in re.findall(rf"if on ({NUMBER})", why)] == middles
    elif origin == "derived":
        numbers = {float(number) for number in re.findall(rf"(?<![\w.]){NUMBER}", why)}
        assert set(middles) <= numbers
    elif "no range" in why and not middles:
        return
    else:
        assert middles
        moved = [value for value in values if value or "no range" not in why]
        np.testing.assert_array_equal(moved, middles if len(middles) == len(moved) else middles * len(moved))


def arms():
    """Manipulator of the nominal draw, and the shipped one, by key."""
    loaded = load_ensemble(None)
    box = make_box(loaded.config)
    drawn = configured(loaded.base, box, box.nominal)
    return drawn, loaded.compare


def test_shipped_manipulator_is_the_nominal_draw():
    drawn, shipped = arms()
    ours, theirs = (dict(quantities(config.manipulator.model_dump())) for config in (drawn, shipped))
    assert ours.keys() == theirs.keys()
    for key, held in theirs.items():
        alone = [np.ravel(values)[-2:] for values in (ours[key]["value"], held["value"])]  # joint 1 is held
        if held["unit"] != ours[key]["unit"]:
            assert not any(map(np.any, alone)), key
            continue
        same = np.allclose(*alone, rtol=1e-6, atol=0.0)
        assert same != ("unlike the box" in held["source"]), key


def test_shipped_comparison_is_the_nominal_draw():
    drawn, shipped = arms()
    assert drawn.reference.kind == shipped.reference.kind
    for name in ("amplitude", "rise", "hold"):
        ours, theirs = (getattr(config.reference, name).si for config in (drawn, shipped))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    np.testing.assert_allclose(drawn.posture.si, shipped.posture.si, rtol=1e-12)
    assert drawn.control.filter_cutoff.si == shipped.control.filter_cutoff.si
    assert drawn.control.readings == shipped.control.readings
    assert drawn.disturbance.kind == shipped.disturbance.kind


def test_what_is_derived_of_the_arm_follows_from_its_middles():
    arm = load_config("compare", None).config.manipulator
    links, friction, winch = arm.links, arm.friction, arm.winches
    np.testing.assert_allclose(links.com.si, 0.48 * links.length.si)
    np.testing.assert_allclose(links.inertia.si, 0.098 * links.mass.si * links.length.si**2)
    radius = np.diag(arm.routing.pulley_diameter.si) / 2.0
    np.testing.assert_allclose(arm.tendons.axial_stiffness.si * radius**2, [420.0, 280.0, 100.0], rtol=1e-6)
    np.testing.assert_allclose(arm.tendons.axial_damping.si * radius**2, [0.71, 0.71, 0.39], rtol=1e-6)
    np.testing.assert_allclose(winch.reflected_inertia.si, winch.reduction.si**2 * (5.7e-6 + 5.1e-6))
    for part in (friction.link, friction.winch):
        np.testing.assert_allclose(part.smoothing_velocity.si, 0.5 * part.stribeck_velocity.si)


def test_position_loop_is_20_hz_and_damped_by_07():
    config = load_config("decouple", None).config
    loop, inertia = config.position_loop, config.manipulator.winches.reflected_inertia.si[0]
    stiffness = two_digits(inertia * (2.0 * math.pi * 20.0) ** 2)
    np.testing.assert_array_equal(loop.stiffness.si, stiffness)
    np.testing.assert_array_equal(loop.damping.si, two_digits(1.4 * math.sqrt(stiffness * inertia)))
