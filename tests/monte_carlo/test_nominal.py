"""The plain arm is the nominal draw, by its two rules: middles of ranges, and off what is in no equation.

docs/assumptions.md states them. A number that is neither has a source that says why not.
"""

import math
from decimal import ROUND_HALF_UP, Decimal

import numpy as np
import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import BoxRange
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.reporting.contents import quantities


def two_digits(value):
    """Round to two significant digits, halves upwards; the 12th digit and beyond do not count."""
    exact = Decimal(f"{value:.12g}")
    return float(exact.quantize(Decimal((0, (1,), exact.adjusted() - 1)), rounding=ROUND_HALF_UP))


def middle(low, high, geometric):
    return two_digits(math.sqrt(low * high) if geometric else 0.5 * (low + high))


ROWS = dict(load_ensemble(None).config.box)


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if isinstance(row, BoxRange)])
def test_nominal_of_a_row_is_its_middle_or_its_source_says_why_not(name):
    row = ROWS[name]
    by_rule = row.nominal == middle(row.low, row.high, row.scale == "log")
    assert by_rule != (f"nominal {row.nominal:g}: " in row.source)


def test_what_acts_in_no_equation_is_off_in_the_nominal_draw():
    switches = [row for name, row in ROWS.items() if name.endswith("_acts")]
    assert len(switches) == 5
    assert {row.nominal for row in switches} == {"off"}
    assert all("nominal off: in no equation" in row.source for row in switches)


def arms():
    """Comparisons of the nominal draw, and of the plain arm."""
    loaded = load_ensemble(None)
    box = population_of(loaded)
    drawn = box.configured(box.nominal)
    return drawn, load_config("plain", "compare").config


def test_plain_manipulator_is_the_nominal_draw():
    drawn, plain = arms()
    ours, theirs = (dict(quantities(config.manipulator.model_dump())) for config in (drawn, plain))
    assert ours.keys() == theirs.keys()
    for key, held in theirs.items():
        alone = [np.ravel(values)[-2:] for values in (ours[key]["value"], held["value"])]  # joint 1 is held
        if held["unit"] != ours[key]["unit"]:
            assert not any(map(np.any, alone)), key
            continue
        same = np.allclose(*alone, rtol=1e-6, atol=0.0)
        assert same != ("unlike the box" in held["source"]), key


def test_plain_comparison_is_the_nominal_draw_but_for_the_amplitude():
    """The range of amplitudes has become wider since."""
    drawn, plain = arms()
    assert drawn.reference.kind == plain.reference.kind
    for name in ("rise", "hold"):
        ours, theirs = (getattr(config.reference, name).si for config in (drawn, plain))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)
    assert drawn.reference.duration == pytest.approx(plain.reference.duration)
    np.testing.assert_allclose(drawn.posture.si, plain.posture.si, rtol=1e-12)
    assert drawn.control.filter_cutoff.si == plain.control.filter_cutoff.si
    assert drawn.control.readings == plain.control.readings
    assert drawn.disturbance.kind == plain.disturbance.kind


def test_position_loop_is_20_hz_and_damped_by_07():
    config = load_config("decouple", None).config
    loop, inertia = config.position_loop, config.manipulator.winches.reflected_inertia.si[0]
    stiffness = two_digits(inertia * (2.0 * math.pi * 20.0) ** 2)
    np.testing.assert_array_equal(loop.stiffness.si, stiffness)
    np.testing.assert_array_equal(loop.damping.si, two_digits(1.4 * math.sqrt(stiffness * inertia)))
