"""Shares against brute force, intervals against the textbook, agreement with the printed ratios."""

import numpy as np
import pytest
from support.made_ensemble import (
    DIVERGED,
    EACH,
    JOINTS,
    OK,
    PLANTS,
    READINGS,
    RINGING,
    RUNS,
    SCRAMBLINGS,
    UNRESOLVED,
    always_ok,
    ensemble,
    printed_like,
    random_errors,
)

from tendonrepro.configuration.published import METRICS, published
from tendonrepro.monte_carlo.shares import (
    QUANTILES,
    RATIOS,
    agreement,
    quantiles_of,
    reading_summary,
    share_of,
)

EIGHT = np.repeat(np.arange(8), 50)
REPLICATE = np.repeat(np.arange(SCRAMBLINGS), EACH)


def brute_force(data, reading, metric, joints, last):
    """Plants on which C1 < C2 < C3 on all these joints, and plants counted."""
    codes = np.stack([data.status(run, reading) for run in RUNS[:3]])
    sizes = np.stack([data.statistic(run, reading, metric)[:, joints] for run in RUNS[:3]])
    sizes[codes == DIVERGED] = np.inf
    rankable = (codes != UNRESOLVED).all(axis=0) & (codes != DIVERGED).any(axis=0)
    counted = rankable if last else (codes == OK).all(axis=0)
    hits = ((sizes[0] < sizes[1]) & (sizes[1] < sizes[2])).all(axis=1)
    return (hits & counted).sum(), counted.sum()


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("metric", ["mae", "rmse"])
def test_shares_equal_brute_force(mixed, reading, metric):
    found = reading_summary(mixed, reading)["share_c1_lt_c2_lt_c3"]
    for joint, places in (("both", [0, 1]), ("joint_2", [0]), ("joint_3", [1])):
        for plants, last in (("all_ok", False), ("diverged_last", True)):
            share = found[plants][metric][joint]
            hits, total = brute_force(mixed, reading, metric, places, last)
            assert 0 < hits < total
            assert share["plants"] == total
            assert share["share"] == pytest.approx(hits / total, abs=1e-15)
            assert share["low"] < share["share"] < share["high"]


def test_shape_needs_no_scale():
    """The print itself is at no distance and rises; errors with one shape do not."""
    printed = {
        run: {m: np.array(published().per_joint(f"table2.{run}.{m}", JOINTS)) for m in ("mae", "rmse")}
        for run in RUNS[:3]
    } | {RUNS[3]: {"mae": np.ones(2), "rmse": np.ones(2)}}
    scale = np.random.default_rng(2).uniform(0.1, 10.0, (PLANTS, 2))
    as_printed = ensemble(lambda run, _, name: scale * printed[run].get(name, 1.0), always_ok)
    found = reading_summary(as_printed, "printed")
    assert found["distance"]["highest"] == pytest.approx(0.0, abs=1e-12)
    assert found["share_rmse_over_mae_rises"]["both"]["share"] == 1.0
    assert found["rmse_over_mae_growth"]["joint_2"]["median"]["value"] == pytest.approx(
        (0.436 / 0.305) / (0.311 / 0.261)
    )
    flat = ensemble(
        lambda run, _, name: scale * printed[run]["mae"] * (1.2 if name == "rmse" else 1.0), always_ok
    )
    found = reading_summary(flat, "printed")
    assert found["share_rmse_over_mae_rises"]["both"]["share"] == 0.0
    shapes = [1.2 * printed[run]["mae"] / printed[run]["rmse"] for run in RUNS[:3]]
    wanted = np.sqrt((np.log(shapes) ** 2).sum() / 10.0)
    assert found["distance"]["median"]["value"] == pytest.approx(wanted)


def test_a_diverged_law_comes_last_and_two_of_them_are_not_in_order():
    """Errors rank C1 < C2 < C3 everywhere; what diverged changes that, plant by plant."""
    sizes = dict(zip(RUNS, (1.0, 2.0, 3.0, 1.0), strict=True))
    cases = [(OK, OK, OK), (OK, OK, DIVERGED), (OK, DIVERGED, DIVERGED), (DIVERGED, OK, OK)]
    cases += [(OK, RINGING, OK), (OK, OK, UNRESOLVED)]
    codes = np.array([cases[k % len(cases)] for k in range(PLANTS)], np.int8)

    def statuses(run, reading):
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
    assert found["status"]["controller_1"]["diverged"]["count"] == count[3]
    alone = found["share_c1_lt_c2_lt_c3"]["all_ok"]["mae"]["both"]
    assert (alone["share"], alone["plants"]) == (1.0, count[0])
    # C1/C2 is 1/2, infinite where C1 alone diverged, 0 where C2 alone did; C2/C3 needs one that did not.
    ratio = found["ratio_c1_c2"]["diverged_last"]["mae"]["joint_2"]
    assert (ratio["median"]["value"], ratio["lowest"], ratio["highest"]) == (0.5, 0.0, np.inf)
    assert found["ratio_c2_c3"]["diverged_last"]["mae"]["joint_2"]["plants"] == PLANTS - count[5] - count[2]


def test_ties_the_worst_law_and_the_ratio_of_the_joints():
    """Controllers 2 and 3 are 4.9 % apart on every eighth plant; Controller 1 is best on one of four."""
    place = np.arange(PLANTS)
    sizes = {
        "controller_1": np.where(place % 4 == 0, 0.5, 3.0),
        "controller_2": np.where(place % 8 == 0, 0.951, 0.949),
    }
    data = ensemble(lambda run, *_: np.outer(sizes.get(run, np.ones(PLANTS)), [1.0, 4.0]), always_ok)
    found = reading_summary(data, "printed")
    for name, share in {
        "share_c2_ties_c3": 0.125,
        "share_c1_worst": 0.75,
        "share_c1_best": 0.25,
        "share_c2_lt_c1": 0.75,
        "share_c2_lt_c3_lt_c1": 0.75,
        "share_c3_lt_c1_lt_c2": 0.0,
    }.items():
        assert found[name]["all_ok"]["mae"]["both"]["share"] == share, name
    assert found["joint_3_over_2"]["controller_1"]["rmse"]["median"]["value"] == 4.0


def test_rankings_without_the_start_are_of_errors_without_it():
    """Controller 1 is best over whole runs, and worst without their start on joint 3 alone."""

    def errors(run, _, metric):
        late = metric.endswith("_settled") and run == "controller_1"
        return np.tile([1.0, 3.0 if late else 1.0], (PLANTS, 1)) * {"controller_1": 0.5}.get(run, 1.0)

    found = reading_summary(ensemble(errors, always_ok), "printed")
    assert found["share_c1_best"]["all_ok"]["mae_and_rmse"]["both"]["share"] == 1.0
    late = found["without_start"]
    assert late["share_c1_best"]["all_ok"]["rmse"]["joint_2"]["share"] == 1.0
    assert late["share_c1_worst"]["all_ok"]["mae_and_rmse"]["joint_3"]["share"] == 1.0
    assert late["share_c1_worst"]["all_ok"]["mae_and_rmse"]["both"]["share"] == 0.0


def test_the_reverse_and_the_rise_equal_brute_force(mixed):
    found = reading_summary(mixed, "printed")
    ok = np.all([mixed.status(run, "printed") == OK for run in RUNS[:3]], axis=0)
    mae, rmse = ([mixed.statistic(run, "printed", name)[ok] for run in RUNS[:3]] for name in ("mae", "rmse"))
    held = [(sizes[2] < sizes[1]) & (sizes[1] < sizes[0]) for sizes in (mae, rmse)]
    reverse = found["share_c3_lt_c2_lt_c1"]["all_ok"]["mae_and_rmse"]
    assert reverse["joint_3"]["share"] == np.mean(held[0][:, 1] & held[1][:, 1])
    shape = np.divide(rmse, mae)
    rising = (shape[0] < shape[1]) & (shape[1] < shape[2])
    assert found["share_rmse_over_mae_rises"]["both"]["share"] == rising.all(axis=1).mean()
    steps = [mixed.statistic(run, "printed", "torque_step_rms")[ok] for run in RUNS[:3]]
    smoother = np.all([np.less(steps[0], other) for other in steps[1:]], axis=(0, 2))
    assert found["share_c1_smoother"]["share"] == smoother.mean()
    assert found["share_c1_smoother"]["plants"] == ok.sum()
    growth = found["rmse_over_mae_growth"]["joint_2"]
    assert growth["highest"] == (shape[2][:, 0] / shape[0][:, 0]).max()


def test_equal_scramblings_give_the_t_interval_of_their_means():
    rng = np.random.default_rng(5)
    hits = rng.random(400) < np.repeat(rng.uniform(0.3, 0.5, 8), 50)
    means = hits.reshape(8, 50).mean(axis=1)
    # Student's t for 7 degrees of freedom, two-sided 95 %, from a printed table.
    reach = 2.364624 * means.std(ddof=1) / np.sqrt(8)
    found = share_of(hits, EIGHT).as_row()
    assert found["share"] == pytest.approx(means.mean())
    assert (found["low"], found["high"]) == pytest.approx((means.mean() - reach, means.mean() + reach), 1e-6)


def test_an_interval_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(6)
    truth, covered = 0.3, 0
    replicate = np.repeat(np.arange(8), 64)
    for _ in range(400):
        hits, counted = rng.random(512) < truth, rng.random(512) < 0.5
        found = share_of(hits, replicate, counted).as_row()
        covered += found["low"] <= truth <= found["high"]
    assert 0.92 <= covered / 400 <= 0.98


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_share_without_exception_still_has_an_interval(share):
    """The rule of three: nothing seen among 256 leaves up to about 3/256."""
    found = share_of(np.full(PLANTS, share == 1.0), REPLICATE).as_row()
    assert found["share"] == share
    assert found["high"] - found["low"] == pytest.approx(3.0 / PLANTS, rel=0.02)
    assert 0.0 <= found["low"] <= found["high"] <= 1.0


def test_few_scramblings_with_plants_give_no_interval():
    """Seven of eight hold plants: scatter of so few says little, and of one nothing."""
    rng = np.random.default_rng(9)
    hits = rng.random(PLANTS) < 0.5
    for held in (7, 1):
        found = share_of(hits, REPLICATE, held > REPLICATE).as_row()
        assert np.isnan([found["low"], found["high"]]).all()
        assert found["share"] == pytest.approx(hits[held > REPLICATE].mean())
        kept = held > REPLICATE
        assert np.isnan(quantiles_of(rng.random(PLANTS)[kept], REPLICATE[kept])["median"]["low"])


def test_no_plants_give_no_share():
    nothing = np.zeros(PLANTS, bool)
    found = share_of(nothing, REPLICATE, nothing).as_row()
    assert found.pop("plants") == 0
    assert np.isnan([*found.values()]).all()
    assert np.isnan(quantiles_of(np.zeros(0), np.zeros(0, int))["median"]["value"])


def test_quantiles_are_values_of_plants():
    rng = np.random.default_rng(7)
    values = rng.lognormal(size=PLANTS)
    found = quantiles_of(values, REPLICATE)
    for name, level in QUANTILES.items():
        value = found[name]["value"]
        assert value in values
        assert (values <= value).mean() >= level > (values < value).mean()
        assert found[name]["low"] < value < found[name]["high"]
    assert (found["lowest"], found["highest"]) == (values.min(), values.max())


def test_a_reading_that_makes_the_print_agrees_and_another_cannot():
    agrees, cannot = (reading_summary(printed_like(factor), "printed") for factor in (1.0, 2.0))
    assert agrees["agreement"]["verdict"] == "agrees"
    assert len(agrees["agreement"]["inside"]) == 8
    assert cannot["agreement"]["verdict"] == "cannot"
    assert set(cannot["agreement"]["beyond"]) == {
        f"ratio_c1_c2 {metric} joint {joint}" for metric in ("mae", "rmse") for joint in JOINTS
    }
    nowhere_stable = ensemble(random_errors, lambda *_: np.full(PLANTS, RINGING, np.int8))
    for data, verdict in ((printed_like(1.17), "in part"), (nowhere_stable, "no plant")):
        assert reading_summary(data, "printed")["agreement"]["verdict"] == verdict


@pytest.mark.parametrize(
    ("printed", "verdict"),
    [(0.6, "agrees"), (1.4, "agrees"), (0.4, "in part"), (1.6, "in part"), (0.2, "cannot"), (2.1, "cannot")],
)
def test_a_print_agrees_inside_the_central_90_percent(printed, verdict):
    levels = {"q05": 0.5, "q25": 0.7, "q75": 1.3, "q95": 1.5}
    held = {name: {"value": value} for name, value in levels.items()}
    held |= {"plants": 400, "printed": printed, "lowest": 0.3, "highest": 2.0}
    joints = {f"joint_{joint}": held for joint in JOINTS}
    found = {key: {"all_ok": dict.fromkeys(METRICS, joints)} for key in RATIOS}
    found["share_c1_lt_c2_lt_c3"] = {"all_ok": {"mae": {"both": {"plants": 400}}}}
    assert agreement(found, JOINTS)["verdict"] == verdict


@pytest.mark.parametrize(("plants", "verdict"), [(99, "too few"), (100, "agrees")])
def test_few_plants_conclude_nothing(plants, verdict):
    codes = np.where(np.arange(PLANTS) < plants, OK, RINGING).astype(np.int8)
    found = reading_summary(ensemble(printed_like(1.0).statistic, lambda *_: codes), "printed")
    assert found["agreement"]["verdict"] == verdict
