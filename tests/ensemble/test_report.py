"""The table of readings: shares against brute force, intervals against the textbook, words by numbers."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tendonrepro.ensemble.conclusions import conclusions
from tendonrepro.ensemble.data import EnsembleData
from tendonrepro.ensemble.figures import draw_ensemble_figures, draw_ratios, draw_shares, draw_statuses
from tendonrepro.ensemble.report import (
    ensemble_text,
    flat_rows,
    population_summary,
    reader_row,
    status_rows,
    write_ensemble_tables,
)
from tendonrepro.ensemble.shares import QUANTILES, printed_ratios, quantiles_of, reading_summary, share_of
from tendonrepro.physics.metrics import STATUSES

RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload")
READINGS = ("printed", "weights=extrapolating", "start=cold")
JOINTS = (2, 3)
OK, RINGING, DIVERGED, UNRESOLVED = range(4)
SCRAMBLINGS, EACH = 8, 32
PLANTS = SCRAMBLINGS * EACH

Errors = Callable[[str, str, str], np.ndarray]


def ensemble(errors: Errors, statuses: Callable[[str, str], np.ndarray]) -> EnsembleData:
    """An ensemble in memory."""

    class Held(SimpleNamespace):
        def __len__(self) -> int:
            return PLANTS

    return cast(
        EnsembleData,
        Held(
            population="box",
            joints=JOINTS,
            alpha=(0.1, 0.2),
            runs=RUNS,
            readings=READINGS,
            replicate=np.repeat(np.arange(SCRAMBLINGS), EACH),
            status=statuses,
            statistic=errors,
        ),
    )


def seeded(*words: str) -> np.random.Generator:
    return np.random.default_rng([ord(letter) for word in words for letter in word])


def random_errors(run: str, reading: str, metric: str) -> np.ndarray:
    """Ranked as printed more often than not; missing where the plant could not be resolved."""
    sizes = seeded(run, reading, metric).uniform(0.5, 1.5, (PLANTS, 2)) + 0.3 * RUNS[:3].index(run)
    sizes[random_statuses(run, reading) == UNRESOLVED] = np.nan
    return sizes


def random_statuses(run: str, reading: str) -> np.ndarray:
    return seeded(run, reading).choice(4, PLANTS, p=[0.7, 0.1, 0.1, 0.1]).astype(np.int8)


def always_ok(run: str, reading: str) -> np.ndarray:
    del run, reading
    return np.zeros(PLANTS, np.int8)


@pytest.fixture(scope="module")
def mixed() -> EnsembleData:
    return ensemble(random_errors, random_statuses)


# ---- Shares ------------------------------------------------------------------------------------------------


def brute_force(
    data: EnsembleData, reading: str, metric: str, joints: list[int], last: bool
) -> tuple[int, int]:
    """Count plants one by one."""
    hits = plants = 0
    status = [data.status(run, reading) for run in RUNS[:3]]
    errors = [data.statistic(run, reading, metric) for run in RUNS[:3]]
    for k in range(PLANTS):
        codes = [int(codes[k]) for codes in status]
        if UNRESOLVED in codes or (not last and codes != [OK, OK, OK]):
            continue
        plants += 1
        sizes = [
            [np.inf if code == DIVERGED else error[k, j] for j in joints]
            for code, error in zip(codes, errors, strict=True)
        ]
        hits += all(a < b < c for a, b, c in zip(*sizes, strict=True))
    return hits, plants


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("metric", ["mae", "rmse"])
def test_shares_equal_brute_force(mixed: EnsembleData, reading: str, metric: str) -> None:
    found = reading_summary(mixed, reading)["share_c1_lt_c2_lt_c3"]
    for joint, places in (("both", [0, 1]), ("joint_2", [0]), ("joint_3", [1])):
        for plants, last in (("all_ok", False), ("diverged_last", True)):
            share = found[plants][metric][joint]
            hits, total = brute_force(mixed, reading, metric, places, last)
            assert 0 < hits < total
            assert share["plants"] == total
            assert share["share"] == pytest.approx(hits / total, abs=1e-15)
            assert share["low"] < share["share"] < share["high"]


def test_both_metrics_together_is_the_intersection(mixed: EnsembleData) -> None:
    found = reading_summary(mixed, "printed")["share_c1_best"]["all_ok"]
    ok = np.all([mixed.status(run, "printed") == OK for run in RUNS[:3]], axis=0)
    hits = np.ones(PLANTS, bool)
    for metric in ("mae", "rmse"):
        first, *others = (mixed.statistic(run, "printed", metric) for run in RUNS[:3])
        hits &= np.all([first < other for other in others], axis=(0, 2))
    assert found["mae_and_rmse"]["both"]["share"] == hits[ok].mean()


def test_a_diverged_law_comes_last_and_two_of_them_are_not_in_order() -> None:
    """Errors rank C1 < C2 < C3 everywhere; what diverged changes that, plant by plant."""
    sizes = dict(zip(RUNS, (1.0, 2.0, 3.0, 1.0), strict=True))
    cases = [(OK, OK, OK), (OK, OK, DIVERGED), (OK, DIVERGED, DIVERGED), (DIVERGED, OK, OK)]
    cases += [(OK, RINGING, OK), (OK, OK, UNRESOLVED)]
    codes = np.array([cases[k % len(cases)] for k in range(PLANTS)], np.int8)

    def statuses(run: str, reading: str) -> np.ndarray:
        del reading
        return codes[:, RUNS[:3].index(run)] if run in RUNS[:3] else np.zeros(PLANTS, np.int8)

    data = ensemble(lambda run, *_: np.full((PLANTS, 2), sizes[run]), statuses)
    found = reading_summary(data, "printed")
    count = [(codes == case).all(axis=1).sum() for case in cases]
    in_order = found["share_c1_lt_c2_lt_c3"]["diverged_last"]["mae"]["both"]
    assert in_order["plants"] == PLANTS - count[5]
    assert in_order["share"] == (count[0] + count[1] + count[4]) / in_order["plants"]
    best = found["share_c1_best"]["diverged_last"]["mae"]["both"]
    assert best["share"] == (count[0] + count[1] + count[2] + count[4]) / best["plants"]
    alone = found["share_c1_lt_c2_lt_c3"]["all_ok"]["mae"]["both"]
    assert (alone["share"], alone["plants"]) == (1.0, count[0])
    # C1/C2 is 1/2, infinite where C1 alone diverged, 0 where C2 alone did; C2/C3 needs one that did not.
    ratio = found["ratio_c1_c2"]["diverged_last"]["mae"]["joint_2"]
    assert (ratio["median"]["value"], ratio["lowest"], ratio["highest"]) == (0.5, 0.0, np.inf)
    assert found["ratio_c2_c3"]["diverged_last"]["mae"]["joint_2"]["plants"] == PLANTS - count[5] - count[2]


def test_statuses_add_up(mixed: EnsembleData) -> None:
    for run, shares in reading_summary(mixed, "printed")["status"].items():
        assert sum(share["count"] for share in shares.values()) == PLANTS
        codes = mixed.status(run, "printed")
        assert [shares[name]["count"] for name in STATUSES] == [int((codes == c).sum()) for c in range(4)]


# ---- Intervals ---------------------------------------------------------------------------------------------


def test_equal_scramblings_give_the_t_interval_of_their_means() -> None:
    rng = np.random.default_rng(5)
    replicate = np.repeat(np.arange(8), 50)
    hits = rng.random(400) < np.repeat(rng.uniform(0.3, 0.5, 8), 50)
    means = hits.reshape(8, 50).mean(axis=1)
    # Student's t for 7 degrees of freedom, two-sided 95 %, from a printed table.
    reach = 2.364624 * means.std(ddof=1) / np.sqrt(8)
    found = share_of(hits, replicate).as_row()
    assert found["share"] == pytest.approx(means.mean())
    assert (found["low"], found["high"]) == pytest.approx((means.mean() - reach, means.mean() + reach), 1e-6)


def test_an_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(6)
    truth, covered = 0.3, 0
    replicate = np.repeat(np.arange(8), 64)
    for _ in range(400):
        hits, counted = rng.random(512) < truth, rng.random(512) < 0.5
        found = share_of(hits, replicate, counted).as_row()
        covered += found["low"] <= truth <= found["high"]
    assert 0.92 <= covered / 400 <= 0.98


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_share_without_exception_still_has_an_interval(share: float) -> None:
    """The rule of three: nothing seen among 256 leaves up to about 3/256."""
    found = share_of(np.full(PLANTS, share == 1.0), np.repeat(np.arange(8), EACH)).as_row()
    assert found["share"] == share
    assert found["high"] - found["low"] == pytest.approx(3.0 / PLANTS, rel=0.02)
    assert 0.0 <= found["low"] <= found["high"] <= 1.0


def test_few_scramblings_with_plants_give_no_interval() -> None:
    """Seven of eight hold plants: scatter of so few says little, and of one nothing."""
    replicate = np.repeat(np.arange(8), EACH)
    rng = np.random.default_rng(9)
    hits = rng.random(PLANTS) < 0.5
    for held in (7, 1):
        found = share_of(hits, replicate, replicate < held).as_row()
        assert (found["low"], found["high"]) == (None, None)
        assert found["share"] == pytest.approx(hits[replicate < held].mean())
        kept = replicate < held
        assert quantiles_of(rng.random(PLANTS)[kept], replicate[kept])["median"]["low"] is None


def test_no_plants_give_no_share() -> None:
    nothing = np.zeros(PLANTS, bool)
    found = share_of(nothing, np.repeat(np.arange(8), EACH), nothing).as_row()
    assert found == {"share": None, "low": None, "high": None, "plants": 0}
    assert quantiles_of(np.zeros(0), np.zeros(0, int))["median"]["value"] is None


def test_quantiles_are_values_of_plants() -> None:
    rng = np.random.default_rng(7)
    values = rng.lognormal(size=PLANTS)
    found = quantiles_of(values, np.repeat(np.arange(8), EACH))
    for name, level in QUANTILES.items():
        value = found[name]["value"]
        assert value in values
        assert (values <= value).mean() >= level > (values < value).mean()
        assert found[name]["low"] < value < found[name]["high"]
    assert (found["lowest"], found["highest"]) == (values.min(), values.max())


# ---- Agreement with the print ------------------------------------------------------------------------------


def printed_like(factor: float) -> EnsembleData:
    """Plants whose ratios scatter by 5 % around the printed ones times a factor for Controller 1."""

    def errors(run: str, reading: str, metric: str) -> np.ndarray:
        first = np.array(printed_ratios((0, 1), metric, JOINTS))
        third = 1.0 / np.array(printed_ratios((1, 2), metric, JOINTS))
        size = {"controller_1": factor * first, "controller_3": third}.get(run, np.ones(2))
        return size * np.exp(0.05 * seeded(run, reading, metric).standard_normal((PLANTS, 2)))

    return ensemble(errors, always_ok)


def test_printed_ratios() -> None:
    """Section 5.3: 90.3 % and 91.2 % in MAE, and Table 2's Controller 2 over 3."""
    assert printed_ratios((0, 1), "mae", JOINTS) == pytest.approx([0.903, 0.912], abs=6e-4)
    assert printed_ratios((1, 2), "rmse", JOINTS) == pytest.approx([0.375 / 0.436, 0.292 / 0.349])


def test_a_reading_that_makes_the_print_agrees_and_another_cannot() -> None:
    agrees, cannot = (reading_summary(printed_like(factor), "printed") for factor in (1.0, 2.0))
    assert agrees["agreement"]["verdict"] == "agrees"
    assert len(agrees["agreement"]["inside"]) == 8
    assert cannot["agreement"]["verdict"] == "cannot"
    assert set(cannot["agreement"]["beyond"]) == {
        f"ratio_c1_c2 {metric} joint {joint}" for metric in ("mae", "rmse") for joint in JOINTS
    }
    part = reading_summary(printed_like(1.17), "printed")["agreement"]
    assert part["verdict"] == "in part"


def test_no_stable_plant_is_no_disagreement() -> None:
    data = ensemble(random_errors, lambda *_: np.full(PLANTS, RINGING, np.int8))
    assert reading_summary(data, "printed")["agreement"]["verdict"] == "no plant"


# ---- Rows, words, files ------------------------------------------------------------------------------------


def whole(data: EnsembleData) -> dict[str, Any]:
    populations = {"box": population_summary(data)}
    return {
        **populations["box"],
        "draws": PLANTS,
        "scramblings": SCRAMBLINGS,
        "experiments_per_second": 321.0,
        "out": "reports/ensemble",
        "populations": populations,
        "conclusions": conclusions(populations),
    }


def test_theory_follows_the_weights(mixed: EnsembleData) -> None:
    readings = {entry["name"]: entry["theory"] for entry in population_summary(mixed)["readings"]}
    assert readings["printed"] == pytest.approx({"joint_2": 1.1, "joint_3": 1.2})
    assert readings["weights=extrapolating"] == pytest.approx({"joint_2": 0.9, "joint_3": 0.8})


def test_files_hold_every_number(mixed: EnsembleData, tmp_path: Path) -> None:
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


def test_a_table_without_plants_has_dashes() -> None:
    data = ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8))
    summary = whole(data)
    assert list(reader_row(summary["readings"][0], JOINTS).values())[3] == "--"
    assert "no plant on which all three laws are ok" in " ".join(summary["conclusions"])
    assert "no plant" in ensemble_text(summary)


def test_words_follow_the_numbers() -> None:
    agrees = " ".join(whole(printed_like(1.0))["conclusions"])
    assert "All printed ratios lie inside the central 90 % under printed" in agrees
    cannot = " ".join(whole(printed_like(2.0))["conclusions"])
    assert "beyond every plant drawn under printed, weights=extrapolating, start=cold" in cannot
    assert "imply another ranking on nearly every plant" in cannot
    sizes = dict(zip(RUNS, (1.0, 2.0, 3.0, 1.0), strict=True))
    ranked = ensemble(lambda run, *_: np.full((PLANTS, 2), sizes[run]), always_ok)
    assert "follows from the printed equations on nearly every plant" in " ".join(
        whole(ranked)["conclusions"]
    )
    random = ensemble(random_errors, always_ok)
    assert "probab" not in " ".join(whole(random)["conclusions"])


def test_text_names_every_reading(mixed: EnsembleData) -> None:
    text = ensemble_text(whole(mixed))
    assert all(name in text for name in READINGS)
    assert "321 experiments a second" in text


# ---- Figures -----------------------------------------------------------------------------------------------


def test_ratios_show_median_print_and_theory(mixed: EnsembleData) -> None:
    summary = population_summary(mixed)
    drawn = draw_ratios("box", summary)
    assert [panel.get_title(loc="left") for panel in drawn.axes] == [
        f"{ratio}, joint {joint}" for ratio in ("C1/C2", "C2/C3") for joint in JOINTS
    ]
    for i, panel in enumerate(drawn.axes[:2]):
        held = {
            (float(x), float(y))
            for line in panel.lines
            for x, y in zip(np.atleast_1d(line.get_xdata()), np.atleast_1d(line.get_ydata()), strict=True)
        }
        for row, reading in enumerate(summary["readings"]):
            joint = f"joint_{JOINTS[i]}"
            assert (reading["ratio_c1_c2"]["all_ok"]["mae"][joint]["median"]["value"], row) in held
            assert (reading["theory"][joint], row) in held
        assert printed_ratios((0, 1), "mae", JOINTS)[i] in {x for x, _ in held}
    # The first reading is on top.
    low, high = drawn.axes[0].get_ylim()
    assert low > high


def test_statuses_fill_the_bar(mixed: EnsembleData) -> None:
    drawn = draw_statuses("box", population_summary(mixed))
    for panel in drawn.axes:
        total = np.zeros(len(READINGS))
        for bars in panel.containers:
            total += [bar.get_width() for bar in bars]
        np.testing.assert_allclose(total, 100.0)


def test_shares_stand_at_their_values(mixed: EnsembleData) -> None:
    summary = population_summary(mixed)
    panel = draw_shares("box", summary).axes[0]
    marks = np.concatenate([container.lines[0].get_xdata() for container in panel.containers])
    wanted = [
        100.0 * reading["share_c1_lt_c2_lt_c3"][plants]["mae"]["both"]["share"]
        for plants in ("all_ok", "diverged_last")
        for reading in summary["readings"]
    ]
    np.testing.assert_allclose(marks, wanted)


def test_figures_are_drawn_without_plants_too(tmp_path: Path) -> None:
    data = ensemble(random_errors, lambda *_: np.full(PLANTS, DIVERGED, np.int8))
    paths = draw_ensemble_figures(whole(data), tmp_path)
    assert {path.name for path in paths} == {
        f"{stem}_box.{suffix}"
        for stem in ("ratios", "shares", "statuses")
        for suffix in ("pdf", "svg", "png")
    }
    assert all(path.stat().st_size > 1000 for path in paths)
