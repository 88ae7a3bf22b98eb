"""Readings: every axis changes the runs it says and no other, and names lead back to readings."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.load import CompareConfig, shipped_folder
from tendonrepro.configuration.models.control import RUNS, Readings
from tendonrepro.configuration.models.readings import (
    AXES,
    SETTINGS,
    VARIATIONS,
    Reading,
    case_of,
    default_readings,
    in_words,
    parse_reading,
    reading,
    under,
)
from tendonrepro.errors import UsageError
from tendonrepro.evidence import hypotheses
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.physics.control import Law, Surface
from tendonrepro.simulation.loop import Loop

ALONE = [reading({axis.name: value}) for axis in AXES.values() for value in axis.alternatives]
UNREAD_BY_TSM = ("eta", "b", "Delta", "phi_is_odd", "power_inside", "power_floor", "angle_scale", "rate_gain")


@cache
def drawing() -> tuple[CompareConfig, dict[str, float]]:
    """A draw whose hardware differs from the printed one in everything."""
    ensemble = load_ensemble(None)
    box = population_of(ensemble)
    values = box.sample(1, 0, 0, 8)[3]
    for name, value in {"encoder_count": np.deg2rad(0.088), "output_delay": 2.0, "error_rate": 1.0}.items():
        values[box.names.index(name)] = value
    return box.configured(values), box.named(values)


@cache
def loops_under(choice: Reading) -> dict[str, Loop]:
    config, draw = drawing()
    return dict(build_loops(under(choice, config, draw), shipped_folder()))


def printed_loops() -> dict[str, Loop]:
    return loops_under(reading({}))


def content(value: Any) -> Any:
    """What a loop consists of as plain values; what its law does not read is left out."""
    if isinstance(value, np.ndarray):
        return value.shape, (value + 0.0).tobytes()  # -0.0 is 0.0
    if isinstance(value, Law):
        unread = UNREAD_BY_TSM if value.surface == Surface.TSM else ()
        return {name: content(getattr(value, name)) for name in value._fields if name not in unread}
    if hasattr(value, "_fields"):
        return {name: content(getattr(value, name)) for name in value._fields}
    if hasattr(value, "__dataclass_fields__"):
        return {name: content(getattr(value, name)) for name in value.__dataclass_fields__}
    return None if callable(value) else value


@pytest.mark.parametrize("choice", [*ALONE, *VARIATIONS], ids=lambda choice: choice.name)
def test_a_reading_changes_the_runs_it_says_and_no_other(choice: Reading) -> None:
    (name, value), loops = choice.settings[-1], loops_under(choice)
    changed = {run for run in RUNS if content(loops[run]) != content(printed_loops()[run])}
    if choice in VARIATIONS:
        assert "controller_2" in changed
        assert case_of(choice, "controller_2") == choice
        assert case_of(choice, "controller_1") in {reading({}), reading({"encoder": "ideal"})}
    else:
        assert changed == set(AXES[name].affects[value])


@pytest.mark.parametrize("choice", ALONE, ids=lambda choice: choice.name)
def test_the_case_of_a_run_is_the_same_loop(choice: Reading) -> None:
    loops = loops_under(choice)
    for run in RUNS:
        case = case_of(choice, run)
        alone = printed_loops() if case == reading({}) else loops_under(case)
        assert content(alone[run]) == content(loops[run])


@pytest.mark.parametrize(
    ("choice", "count_deg", "delay"),
    [("printed", 0.022, 0), ("hardware=drawn", 0.088, 2), ("hardware=drawn+encoder=ideal", 0.0, 2)],
)
def test_hardware_is_the_papers_or_that_of_the_draw(choice: str, count_deg: float, delay: int) -> None:
    loop = loops_under(parse_reading(choice))["controller_1"]
    assert loop.joint_encoder.resolution == pytest.approx(np.deg2rad(count_deg))
    assert loop.actuator.delay == delay
    rate_filter = loop.controller.law.rate_filter  # type: ignore[attr-defined]
    assert rate_filter == 1.0 if choice == "printed" else 0.0 < rate_filter < 1.0


def test_every_reading_of_the_law_has_words_and_no_other_setting_has() -> None:
    of_law = {f"{name}={value}" for name in Readings.model_fields for value in AXES[name].alternatives}
    assert of_law <= SETTINGS.keys()
    for setting in SETTINGS:
        assert parse_reading(setting).name == setting
        assert in_words(setting) != setting


UNTRIED = {
    "weights": "the regression finds them as numbers",
    "torque_unit": "a factor on the torque, which the regression finds with M_bar",
    "start": "over before a log's first complete sample",
}
"""Readings of the law that `recover` does not try on a log, and why."""


def test_recover_tries_every_reading_of_the_law_or_says_why_not() -> None:
    """A new one is tried in evidence/hypotheses.py, or says in `UNTRIED` why not."""
    log: Any = SimpleNamespace(q_motor=np.zeros((1, 2)), applied=None)
    tried = {axis for held in hypotheses.hypotheses(log) for axis, _ in held.settings}
    tried |= {axis for axis, _ in hypotheses.FILTERS}
    assert Readings.model_fields.keys() - tried == UNTRIED.keys()


def test_sides_of_the_tensioner() -> None:
    _, draw = drawing()
    torque = draw["tensioner_force"] * np.array([35.0, 37.0]) / 2000.0
    signs = {"negative": [-1, -1], "distal_only": [0, -1], "alternating": [1, -1], "absent": [0, 0]}
    for side, sign in signs.items():
        preload = loops_under(reading({"tensioner": side}))["controller_1"].plant.preload
        np.testing.assert_allclose(preload, torque * sign, atol=1e-15)


def test_variations_change_period_and_inertia() -> None:
    half = loops_under(parse_reading("sampling_period=0.5ms"))["controller_2"]
    assert half.L == half.solver.max_step == half.controller.law.L == 5e-4  # type: ignore[attr-defined]
    law = loops_under(parse_reading("M_bar=halved"))["controller_2"].controller.law  # type: ignore[attr-defined]
    np.testing.assert_allclose(law.M_bar, 0.005)


def test_under_shares_what_does_not_change_and_stays_valid() -> None:
    config, draw = drawing()
    changed = under(parse_reading("weights=extrapolating"), config, draw)
    assert changed.manipulator is config.manipulator
    assert config.control.readings.weights == "interpolating"
    assert under(reading({}), config, draw) is config
    for choice in default_readings(load_ensemble(None).config.pairs) + VARIATIONS:
        changed = under(choice, config, draw)
        assert CompareConfig.model_validate(changed.model_dump()) == changed


def test_default_readings_are_printed_alternatives_and_pairs() -> None:
    chosen = default_readings([["weights=extrapolating", "phi_branch=power"]])
    names = [choice.name for choice in chosen]
    assert names[0] == "printed"
    assert names[-1] == "phi_branch=power+weights=extrapolating"
    assert len(names) == len(set(names)) == 2 + len(ALONE)


def test_a_name_leads_back_to_its_reading() -> None:
    for choice in (*ALONE, *VARIATIONS):
        assert parse_reading(choice.name) == choice


@pytest.mark.parametrize(
    "text", ["weight=extrapolating", "weights=both", "extrapolating", "start=cold+start=cold"]
)
def test_what_is_no_reading(text: str) -> None:
    with pytest.raises(UsageError):
        parse_reading(text)
