"""Indices of functions whose answer is known, and the floor of chance."""

import numpy as np
import pytest
from SALib.analyze import rbd_fast
from support.made_claims import ESTIMATES, NAMES, MadeEnsemble, ranking_of

from tendonrepro.configuration.models.readings import PRINTED, UNDER_READINGS
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts import sensitivity
from tendonrepro.verdicts.sensitivity import HARMONICS, draw_influences, first_order_index, half_width, ranked


def index(ranking, name):
    (value,) = [row["index"] for row in ranking["rows"] if row["name"] == name]
    return value


class TestKnownIndices:
    def test_a_sum(self, draws):
        ranking = ranking_of(draws, 3.0 * draws[:, 0] + draws[:, 2])
        assert [row["name"] for row in ranking["rows"][:2]] == ["a", "c"]
        assert index(ranking, "a") == pytest.approx(0.9, abs=0.03)
        assert index(ranking, "c") == pytest.approx(0.1, abs=0.03)
        assert max(index(ranking, "b"), index(ranking, "d")) < ranking["noise_floor"] < 0.06
        assert ranking["unexplained"] < 0.05


@pytest.mark.parametrize("plants", [101, 400])
def test_indices_and_intervals_are_those_of_salib(draws, plants):
    X = np.column_stack([draws[:plants, :2], np.floor(3.0 * draws[:plants, 2])])
    Y = 3.0 * X[:, 0] + X[:, 2] + draws[:plants, 1] * draws[:plants, 3]
    problem = {"num_vars": 3, "names": ["a", "b", "c"]}
    theirs = rbd_fast.analyze(problem, X, Y, M=HARMONICS, num_resamples=400, seed=1)
    rng = np.random.default_rng(2)
    for i, unknown in enumerate(X.T):
        assert first_order_index(unknown, Y) == pytest.approx(theirs["S1"][i], abs=1e-12)
        # Two bootstraps of 400 differ by a twentieth.
        assert half_width(unknown, Y, 400, rng) == pytest.approx(theirs["S1_conf"][i], rel=0.2)


def test_chance_stays_below_the_floor(draws):
    rng = np.random.default_rng(8)
    above = 0
    for _ in range(20):
        ranking = ranking_of(draws[:128], rng.random(128))
        above += ranking["rows"][0]["index"] > ranking["noise_floor"]
    # One in 20 is expected.
    assert above <= 4


def test_an_unknown_that_cannot_act_raises_the_floor_to_what_it_seems_to_explain(draws):
    alike = draws.copy()
    alike[:, 3] = 0.7 * draws[:, 0] + 0.3 * draws[:, 3]
    outcome = draws[:, 0] + 0.2 * draws[:, 1]
    ranking = ranked(NAMES, alike, outcome, inert=("d",))
    assert [row["name"] for row in ranking["rows"]][:1] == ["a"]
    assert "d" not in [row["name"] for row in ranking["rows"]]
    # A linear sum: corr(a, d)^2 times the share of a.
    assert ranking["noise_floor"] == pytest.approx(0.49 / 0.58 / 1.04, abs=0.03)
    assert index(ranking, "b") < ranking["noise_floor"]
    assert ranking_of(draws, outcome)["noise_floor"] < 0.06


def test_nothing_to_rank(draws):
    assert ranked(NAMES, draws, np.ones(1024)) is None
    assert ranked(NAMES, draws[:99], draws[:99, 0]) is None
    holes = draws[:150, 0].copy()
    holes[:60] = np.nan
    assert ranked(NAMES, draws[:150], holes) is None


def test_the_picture_has_a_column_an_outcome_and_the_strongest_unknowns_on_top(draws):
    found = {
        "C2": ranking_of(draws, 3.0 * draws[:, 0] + draws[:, 2]),
        "ratio_joint_2": ranking_of(draws, draws[:, 0]),
    }
    (axes,) = draw_influences(found, 1024).axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names[:2] == ["a", "c"]
    for column, held in enumerate(found.values()):
        shares = {row["name"]: 100.0 * row["index"] for row in held["rows"]}
        assert axes.images[0].get_array()[:, column].tolist() == pytest.approx(
            [shares[name] for name in names]
        )


def test_what_is_ranked_are_claims_ratio_and_errors(monkeypatch):
    data, seen = MadeEnsemble(), []

    def spied(_names, _draws, values, inert):
        seen.append(values)
        assert set(inert) == set(UNDER_READINGS)
        return {}

    monkeypatch.setattr(sensitivity, "ranked", spied)
    found = dict(zip(sensitivity.rankings(data), seen, strict=True))
    first, second, third = (np.log(data.values[run, PRINTED, "mae"]) for run in CONTROLLERS)
    for i, joint in enumerate(data.joints):
        assert found[f"ratio_joint_{joint}"] == pytest.approx((first - second)[:, i])
        assert found[f"table2.controller_3.mae.joint_{joint}"] == pytest.approx(third[:, i])
    assert found["joint_3_over_2"] == pytest.approx(first[:, 1] - first[:, 0])
    assert sum(name.startswith("table") for name in found) == 16


def test_which_unknown_decides_a_claim(data):
    half = data.draws[:, 0] > 0.5
    for name in ESTIMATES:
        data.values["controller_1", PRINTED, name][half] *= 2.0
    found = sensitivity.rankings(data)["E1"]
    first, second = found["rows"]
    assert (first["name"], second["name"]) == ("size", "nothing")
    assert first["index"] > found["noise_floor"] > second["index"]
