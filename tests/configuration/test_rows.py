"""What a comparison has in the rows of the box: a draw comes back, and a base keeps its own."""

import numpy as np
from support.made_ensemble import box

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.box import WORDS
from tendonrepro.configuration.models.readings import UNDER_READINGS, parse_reading, under
from tendonrepro.configuration.quantity import to_si
from tendonrepro.configuration.rows import values_of
from tendonrepro.monte_carlo.population import holding_base

DRAWS = 48
APART = parse_reading("starts=apart+run_friction=drawn")


NOMINAL = box().named(box().nominal)


def numbers(tree, path=()):
    """Every quantity of a configuration in SI, and every word, by its key; not the noise's seed."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        return {path: np.ravel(to_si(np.array(tree["value"]), tree["unit"]))}
    if isinstance(tree, dict):
        held = [numbers(value, (*path, key)) for key, value in tree.items() if key != "seed"]
        return {key: value for part in held for key, value in part.items()}
    return {path: tree}


def assert_same(one, other):
    mine, theirs = (numbers(config.model_dump(mode="json")) for config in (one, other))
    assert mine.keys() == theirs.keys()
    for key, value in mine.items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(theirs[key], value, rtol=1e-12, atol=1e-15, err_msg=str(key))
        else:
            assert theirs[key] == value, key


def test_a_draw_comes_back():
    """Whatever kinds of motion, friction and disturbance it has: 48 draws have all of them."""
    draws = box().sample(1, 0, 0, DRAWS)
    for row in ("motion", "friction_sides", "disturbance", "clearance_at"):
        column = draws[:, box().names.index(row)]
        assert len(set(column)) == len(box().rows[box().names.index(row)].choices)
    for values in draws:
        config = under(APART, box().configured(values), box().named(values))
        found = values_of(config, NOMINAL)
        again = under(APART, box().configured(np.array([*found.values()])), found)
        assert_same(again, config)


def test_what_the_shipped_arm_has_is_held():
    """Its numbers of joints 2 and 3, which are those that move; its motion; and runs that start together."""
    base = box().loaded.compare
    held = box().configured(holding_base(box()).nominal)
    for part in ("links", "tensioner", "transmission_error"):
        arms = held.manipulator, base.manipulator
        ours, theirs = (numbers(getattr(arm, part).model_dump(mode="json")) for arm in arms)
        for key, value in theirs.items():
            if isinstance(value, np.ndarray):
                np.testing.assert_allclose(ours[key][-2:], value[-2:], rtol=1e-12)
    assert held.reference.kind == base.reference.kind
    np.testing.assert_allclose(held.reference.amplitude.si, base.reference.amplitude.si, rtol=1e-12)
    assert held.disturbance.kind == base.disturbance.kind
    named = values_of(base, NOMINAL)
    assert {named[row] for row in UNDER_READINGS if row.startswith("offset")} == {0.0}
    assert {named[row] for row in UNDER_READINGS if row.startswith("friction")} == {1.0}


def test_what_a_base_does_not_have_stays_nominal():
    """Size and frequency of no disturbance; times of another kind of motion."""
    loaded = load_config("compare_cosine", "compare", overrides=["disturbance={kind: none}"])
    found, nominal = values_of(loaded.config, NOMINAL), NOMINAL
    assert found["disturbance"] == WORDS["disturbance"].index("none")
    assert found["motion"] == WORDS["motion"].index("raised_cosine")
    for row in ("disturbance_torque", "disturbance_frequency", "rise", "hold", "velocity", "acceleration"):
        assert found[row] == nominal[row]


def test_a_box_that_is_held_gives_the_base_at_any_point():
    held = holding_base(box()).only(())
    np.testing.assert_array_equal(held.values(np.full((1, len(box().names)), 0.9))[0], held.nominal)
