"""Tables, text and conclusions say what the numbers are."""

import csv
import io
from types import SimpleNamespace

import numpy as np
import pytest
from support.made_ensemble import (
    DIVERGED,
    JOINTS,
    PLANTS,
    READINGS,
    RUNS,
    always_ok,
    ensemble,
    printed_like,
    random_errors,
    whole,
)

from tendonrepro.ensemble.report import (
    _slow_ratio,
    ensemble_text,
    flat_rows,
    population_summary,
    reader_row,
    status_rows,
    write_ensemble_tables,
)
from tendonrepro.physics.metrics import STATUSES


def test_theory_follows_the_weights(mixed):
    readings = {entry["name"]: entry["theory"] for entry in population_summary(mixed)["readings"]}
    assert readings["printed"] == pytest.approx({"joint_2": 1.1, "joint_3": 1.2})
    assert readings["weights=extrapolating"] == pytest.approx({"joint_2": 0.9, "joint_3": 0.8})


@pytest.mark.parametrize(
    ("reading", "joint_2"),
    [
        ("weights=swapped", 1.9),
        ("output_delay=1", 1.1),
        ("stored_torque=applied+output_delay=2", 3.1 / 3.0),
        ("stored_torque=applied+hardware=drawn", np.nan),
        ("estimate_filter=estimate", np.nan),
    ],
)
def test_theory_knows_what_makes_the_estimate_older(mixed, reading, joint_2):
    """Against the age that the law itself says, see tests/explain."""
    mixed = SimpleNamespace(joints=mixed.joints, alpha=mixed.alpha)
    assert _slow_ratio(mixed, reading)["joint_2"] == pytest.approx(joint_2, nan_ok=True)


def test_files_hold_every_number(mixed, tmp_path):
    summary = whole(mixed)
    paths = write_ensemble_tables(summary, tmp_path)
    assert {path.name for path in paths} == {"readings.csv", "statuses.csv", "readings.md"}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "readings.csv").read_text())))
    assert len(rows) == len(list(flat_rows("box", summary))) == len(READINGS) * 2 * 3 * 3
    first = summary["readings"][0]["share_c1_lt_c2_lt_c3"]["all_ok"]["mae"]["both"]
    assert float(rows[0]["share_c1_lt_c2_lt_c3"]) == first["share"]
    assert len(list(status_rows("box", summary))) == len(READINGS) * len(RUNS) * len(STATUSES)
    text = (tmp_path / "readings.md").read_text()
    assert "shares of the box" in text
    assert "probab" not in text
    assert all(f"| {name} |" in text for name in READINGS)
    terminal = ensemble_text(summary)
    assert all(name in terminal for name in READINGS)
    assert "321 experiments a second" in terminal


def test_a_table_without_plants_has_dashes():
    data = ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8))
    summary = whole(data)
    assert list(reader_row(summary["readings"][0], JOINTS).values())[3] == "--"
    assert "no plant on which all three laws are ok" in " ".join(summary["conclusions"])
    assert "no plant" in ensemble_text(summary)


def test_too_few_plants_conclude_nothing():
    # 32 of 256 are ok: enough to be counted, not enough to say anything.
    few = np.where(np.arange(PLANTS) % 8 == 0, 0, DIVERGED).astype(np.int8)
    data = printed_like(2.0)
    data.status = lambda *_: few
    text = " ".join(whole(data)["conclusions"])
    assert "Below 100 plants that concludes nothing." in text
    assert "32 plants are too few to judge the printed ranking by; 100 are needed" in text
    assert "Too few plants keep all three laws ok, to say anything, under printed" in text
    for word in ("beyond every plant", "nearly every plant", "Under no reading", "most frequent"):
        assert word not in text


def test_words_follow_the_numbers():
    agrees = " ".join(whole(printed_like(1.0))["conclusions"])
    assert "All printed ratios lie inside the central 90 % under printed" in agrees
    cannot = " ".join(whole(printed_like(2.0))["conclusions"])
    assert "beyond every plant on which all three laws are ok under printed, weights=extrapolating" in cannot
    assert "depends on the plant" in cannot
    for sizes, words in (
        ((1.0, 2.0, 3.0, 1.0), "ranking follows from the printed equations on nearly every plant"),
        ((3.0, 2.0, 1.0, 3.0), "imply the reverse ranking on nearly every plant"),
        # Another order than both is no opposite.
        ((2.0, 1.0, 3.0, 2.0), "depends on the plant"),
    ):
        size = dict(zip(RUNS, sizes, strict=True))
        ranked = ensemble(lambda run, *_, size=size: np.full((PLANTS, 2), size[run]), always_ok)
        assert words in " ".join(whole(ranked)["conclusions"])
    random = ensemble(random_errors, always_ok)
    assert "probab" not in " ".join(whole(random)["conclusions"])
