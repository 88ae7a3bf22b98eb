from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import qmc

from tendonrepro.claims.figures import draw_ratio_against_unknowns, draw_tornado, running_median
from tendonrepro.claims.sensitivity import Ranking, ranked
from tendonrepro.results.figures.style import save_figure

NAMES = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    return qmc.Sobol(4, rng=1).random(1024)


def found(draws: np.ndarray, outcome: np.ndarray) -> Ranking:
    ranking = ranked(NAMES, draws, outcome)
    assert ranking is not None
    return ranking


def index(ranking: Ranking, name: str) -> float:
    (value,) = [row["index"] for row in ranking["rows"] if row["name"] == name]
    return value


class TestKnownIndices:
    def test_a_sum(self, draws: np.ndarray) -> None:
        ranking = found(draws, 3.0 * draws[:, 0] + draws[:, 2])
        assert [row["name"] for row in ranking["rows"][:2]] == ["a", "c"]
        assert index(ranking, "a") == pytest.approx(0.9, abs=0.03)
        assert index(ranking, "c") == pytest.approx(0.1, abs=0.03)
        assert max(index(ranking, "b"), index(ranking, "d")) < ranking["noise_floor"] < 0.06
        assert ranking["unexplained"] < 0.05

    def test_a_verdict_that_one_unknown_decides(self, draws: np.ndarray) -> None:
        ranking = found(draws, draws[:, 1] > 0.3)
        assert ranking["rows"][0]["name"] == "b"
        # Six harmonics of a step leave out the sharpness of its edge.
        assert 0.85 < index(ranking, "b") <= 1.0

    def test_only_the_order_of_an_unknown_counts(self, draws: np.ndarray) -> None:
        outcome = draws[:, 0] + draws[:, 3]
        stretched = draws.copy()
        stretched[:, 0] = 10.0 ** (3.0 * stretched[:, 0])
        assert index(found(stretched, outcome), "a") == pytest.approx(index(found(draws, outcome), "a"))

    def test_together_is_not_alone(self, draws: np.ndarray) -> None:
        ranking = found(draws, (draws[:, 0] > 0.5) ^ (draws[:, 1] > 0.5))
        assert ranking["unexplained"] > 0.9
        assert ranking["rows"][0]["index"] < 0.1

    def test_a_discrete_unknown(self, draws: np.ndarray) -> None:
        coarse = draws.copy()
        coarse[:, 2] = np.floor(3.0 * coarse[:, 2])
        assert index(found(coarse, coarse[:, 2] == 1.0), "c") > 0.8
        assert index(found(coarse, coarse[:, 0]), "c") < 0.05


def test_chance_stays_below_the_floor(draws: np.ndarray) -> None:
    rng = np.random.default_rng(8)
    above = 0
    for _ in range(20):
        ranking = found(draws[:128], rng.random(128))
        above += ranking["rows"][0]["index"] > ranking["noise_floor"]
    # One in 20 is expected.
    assert above <= 4


def test_bootstrap_intervals_narrow_with_more_draws(draws: np.ndarray) -> None:
    noise = np.random.default_rng(2).normal(size=1024)
    outcome = draws[:, 0] + 0.3 * noise
    few, many = (found(draws[:n], outcome[:n])["rows"][0]["half_width"] for n in (128, 1024))
    assert 0.0 < many < few


def test_the_same_every_time(draws: np.ndarray) -> None:
    outcome = draws[:, 0] * draws[:, 1]
    assert ranked(NAMES, draws, outcome) == ranked(NAMES, draws, outcome)


def test_nothing_to_rank(draws: np.ndarray) -> None:
    assert ranked(NAMES, draws, np.ones(1024)) is None
    assert ranked(NAMES, draws[:99], draws[:99, 0]) is None
    holes = draws[:150, 0].copy()
    holes[:60] = np.nan
    assert ranked(NAMES, draws[:150], holes) is None


class TestFigures:
    def test_bars_below_the_floor_are_grey(self, draws: np.ndarray) -> None:
        ranking = found(draws, 3.0 * draws[:, 0] + draws[:, 2])
        axes = draw_tornado("C2", ranking).axes[0]
        bars = axes.patches
        assert [round(bar.get_width(), 6) for bar in bars] == [
            round(row["index"], 6) for row in ranking["rows"]
        ]
        colours = [bar.get_facecolor() for bar in bars]
        assert colours[0] == colours[1] != colours[2] == colours[3]
        assert [label.get_text() for label in axes.get_yticklabels()][:2] == ["a", "c"]

    def test_ratio_and_its_line(self, draws: np.ndarray) -> None:
        ratio = 1.0 + 0.2 * draws[:, 0]
        figure = draw_ratio_against_unknowns(NAMES, draws, ratio, 1.1, "C1/C2", log=(True,) * 4)
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert [axes.get_xlabel() for axes in shown] == list(NAMES)
        assert all(axes.get_xscale() == "log" for axes in shown)
        for axes in shown:
            levels = [line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) == 2]
            assert levels == [1.1, 1.0]

    def test_running_median(self) -> None:
        x = np.random.default_rng(1).permutation(np.arange(400.0))
        middle, median = running_median(x, 2.0 * x)
        assert len(middle) == 20
        assert (np.diff(middle) > 0.0).all()
        assert median == pytest.approx(2.0 * middle)
        assert len(running_median(x[:9], x[:9])[0]) == 0
        assert len(running_median(x[:35], x[:35])[0]) == 3

    def test_files(self, draws: np.ndarray, tmp_path: Path) -> None:
        figure = draw_tornado("C2", found(draws, draws[:, 0]))
        paths = save_figure(figure, tmp_path, "claims_C2", "C2", "Unknowns that decide C2")
        assert [path.name for path in paths] == [f"claims_C2.{suffix}" for suffix in ("pdf", "svg", "png")]
        first = [path.read_bytes() for path in paths]
        save_figure(figure, tmp_path, "claims_C2", "C2", "Unknowns that decide C2")
        assert [path.read_bytes() for path in paths] == first
