"""Indices of functions whose answer is known, and the floor of chance."""

import numpy as np
import pytest
from support.made_claims import NAMES, MadeEnsemble, ranking_of

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts import sensitivity
from tendonrepro.verdicts.figures import draw_influences
from tendonrepro.verdicts.sensitivity import ranked


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

    def test_together_is_not_alone(self, draws):
        ranking = ranking_of(draws, (draws[:, 0] > 0.5) ^ (draws[:, 1] > 0.5))
        assert ranking["unexplained"] > 0.9
        assert ranking["rows"][0]["index"] < 0.1

    def test_what_two_explain_together_is_in_the_totals(self, draws):
        """(a - 1/2)(b - 1/2) has no share of either alone; c alone has the rest of the variance."""
        product = 12.0 * (draws[:, 0] - 0.5) * (draws[:, 1] - 0.5)
        ranking = ranking_of(draws, product + np.sqrt(12.0) * (draws[:, 2] - 0.5))
        total = {row["name"]: row["total"] for row in ranking["rows"]}
        assert [total[name] for name in "abcd"] == pytest.approx([0.5, 0.5, 0.5, 0.0], abs=0.06)
        assert index(ranking, "a") < 0.05

    def test_a_discrete_unknown(self, draws):
        coarse = draws.copy()
        coarse[:, 2] = np.floor(3.0 * coarse[:, 2])
        assert index(ranking_of(coarse, coarse[:, 2] == 1.0), "c") > 0.8
        assert index(ranking_of(coarse, coarse[:, 0]), "c") < 0.05


def test_chance_stays_below_the_floor(draws):
    rng = np.random.default_rng(8)
    above = 0
    for _ in range(20):
        ranking = ranking_of(draws[:128], rng.random(128))
        above += ranking["rows"][0]["index"] > ranking["noise_floor"]
    # One in 20 is expected.
    assert above <= 4


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
    (axes,) = draw_influences(found).axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names[:2] == ["a", "c"]
    for column, held in enumerate(found.values()):
        totals = {row["name"]: 100.0 * row["total"] for row in held["rows"]}
        assert axes.images[0].get_array()[:, column].tolist() == pytest.approx(
            [totals[name] for name in names]
        )


def test_what_is_ranked_are_ratio_numbers_and_joint_3_over_joint_2(monkeypatch):
    data, seen = MadeEnsemble(), []

    def spied(_names, _draws, values, floor=None):
        seen.append((values, floor))
        return {"noise_floor": 0.25}

    monkeypatch.setattr(sensitivity, "ranked", spied)
    found = dict(zip(sensitivity.rankings(data), seen, strict=True))
    error = {run: data.values[run, PRINTED, "mae"] for run in CONTROLLERS}
    for i, joint in enumerate(data.joints):
        values, floor = found[f"ratio_joint_{joint}"]
        assert values == pytest.approx(np.log(error[CONTROLLERS[0]] / error[CONTROLLERS[1]])[:, i])
        assert floor is None
        values, floor = found[f"table2.controller_3.mae.joint_{joint}"]
        assert values == pytest.approx(np.log(error[CONTROLLERS[2]])[:, i])
        assert floor == 0.25
    values, floor = found["joint_3_over_2"]
    assert values == pytest.approx(np.log(error[CONTROLLERS[0]][:, 1] / error[CONTROLLERS[0]][:, 0]))
    assert floor == 0.25
    assert sum(name.startswith("table") for name in found) == 16
