"""The mapping file: what its lines mean, and which line is wrong."""

import numpy as np
import pytest

from tendonrepro.dataset.guess import guess_mapping
from tendonrepro.dataset.mapping import Use, parse_mapping
from tendonrepro.dataset.tables import Columns
from tendonrepro.errors import ConfigError

GOOD = """schema_version: 2
title: SYNTHETIC
columns:
  t: time ms
  q2: q_encoder 2 deg  # CHECK: measured?
  e2: e 2 deg * -1
  m1: q_motor_encoder 1 deg * 0.01 - 3.5
  tau2: tau_m 2 N m
runs:
  controller_1: "a.xlsx:C1"
  controller_1_payload: {sources: [b.csv, c.csv], from_s: 2, columns: {"b.csv:q2": q_d 2 rad}}
"""


def table_of(name, columns):
    """A table as a file of that name gives it."""
    table = Columns(columns)
    table.name = name
    return table


def test_what_lines_mean():
    found = parse_mapping(GOOD, "m.yaml")
    first, second = found.runs.values()
    assert first.columns == {
        "t": Use("time", 0, "ms"),
        "q2": Use("q_encoder", 2, "deg"),
        "e2": Use("e", 2, "deg", -1.0),
        "m1": Use("q_motor_encoder", 1, "deg", 0.01, -3.5),
        "tau2": Use("tau_m", 2, "N m"),
    }
    assert (first.sources, first.payload_mass_kg) == (["a.xlsx:C1"], 0.0)
    assert (second.sources, second.payload_mass_kg, second.from_s) == (["b.csv", "c.csv"], 0.2, 2.0)
    assert list(second.columns) == ["b.csv:q2"]
    # Factor and offset are in the unit of the file.
    assert first.columns["m1"].in_si(np.array([100.0])) == pytest.approx(np.deg2rad(-2.5))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("q_encoder 2 deg", "q_encoder 2 furlong", 5),
        ("q_encoder 2 deg", "q_measured 2 deg", 5),
        ("q_encoder 2 deg", "q_encoder deg", 5),
        ("q_encoder 2 deg", "q_encoder 7 deg", 5),
        ("time ms", "time", 4),
        ("e 2 deg * -1", "[e, 2]", 6),
        ("from_s: 2", "from_s: two", 11),
        ("from_s: 2", "reading_error_deg: {q_d: 0, q_encoder: -0.1}", 11),
        ("from_s: 2", "reading_error_deg: {q_measured: 0.1}", 11),
        ("from_s: 2", "step_s: 0", 11),
        ('"a.xlsx:C1"', "3", 10),
        ("controller_1:", "controller 1:", 10),
    ],
)
def test_the_line_of_a_mistake_is_named(old, new, line):
    with pytest.raises(ConfigError) as caught:
        parse_mapping(GOOD.replace(old, new, 1), "m.yaml")
    assert f"m.yaml:{line}" in str(caught.value)


def test_every_placeholder_left_is_asked_for_at_once():
    text = GOOD.replace("q_encoder 2 deg", "q_encoder JOINT UNIT", 1).replace("e 2 deg", "VARIABLE 2 deg", 1)
    with pytest.raises(ConfigError) as caught:
        parse_mapping(text, "m.yaml")
    assert caught.value.where == "m.yaml:5"
    assert all(name in caught.value.hint for name in ('"q2"', '"e2"'))


@pytest.mark.parametrize(
    ("step", "unit", "most", "checks"),
    [(0.01, "s", 3.1, 5), (0.2, "ms", 3.1, 6), (1e4, "us", 3.3, 6), (1e7, "ns", 3.3, 6)],
)
def test_units_that_no_name_says_are_guessed_by_size(step, unit, most, checks):
    """Beyond half a turn the angles of a table are degrees; but for seconds a guess has its mark."""
    sizes = {"q2": 3.0, "qd2": most, "e2": 0.4, "tau2": 1.0, "dq2": 1.0}
    columns = {"t": step * np.arange(20.0)} | {name: np.linspace(0.0, x, 20) for name, x in sizes.items()}
    text = guess_mapping([table_of("controller_1.csv", columns)], "SYNTHETIC").text
    found = parse_mapping(text, "m.yaml")
    units = {name: use.unit for name, use in found.runs["controller_1"].columns.items()}
    angle = "deg" if most > 3.2 else "rad"
    assert units == {"t": unit, "q2": angle, "qd2": angle, "e2": angle, "tau2": "N m", "dq2": f"{angle}/s"}
    assert len(found.guesses) == checks


def test_a_curve_of_uneven_times_is_taken_to_be_read_off_to_half_a_percent():
    time = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.1, 40))
    columns = {"t (s)": time, "q_d 2 (deg)": np.linspace(-10.0, 30.0, 40)}
    text = guess_mapping([table_of("controller_1.csv", columns)], "SYNTHETIC").text
    run = parse_mapping(text, "m.yaml").runs["controller_1"]
    assert run.reading_error("q_d") == pytest.approx(np.deg2rad(0.2))


@pytest.mark.parametrize(("mass", "payload"), [("0.2kg", 0.2), ("0.5kg", 0.5)])
def test_a_payload_in_a_name_is_that_of_the_run(mass, payload):
    columns = {"t (s)": np.arange(20.0), "q2 (deg)": np.arange(20.0)}
    text = guess_mapping([table_of(f"controller_1 {mass}.csv", columns)], "SYNTHETIC").text
    assert parse_mapping(text, "m.yaml").runs["controller_1_payload"].payload_mass_kg == payload
