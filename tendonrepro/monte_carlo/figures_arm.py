"""Picture of an ensemble around an arm of one's own: ratios of errors of every two runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from matplotlib.axes import Axes

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.monte_carlo.figures import ratio_axis, ratio_bar, rows_figure
from tendonrepro.monte_carlo.summary import PopulationSummary, Summary
from tendonrepro.results.figures.style import Drawing
from tendonrepro.results.summary import CONTROLLERS


def arm_figures(summary: Summary) -> dict[str, Callable[[], Drawing]]:
    """The picture of all pairs."""
    (population,) = summary["populations"].values()
    return {"pairs": partial(draw_pairs, population, str(summary["around"]["told"]))}


def draw_pairs(population: PopulationSummary, told: str) -> Drawing:
    """Ratios of errors, a panel for each pair of runs, a row for each joint and reading."""
    pairs = list(dict.fromkeys((row["run"], row["over"]) for row in population["pairs"]))
    rows = list(dict.fromkeys((row["reading"], row["joint"]) for row in population["pairs"]))
    theory = {reading["name"]: reading["theory"] for reading in population["readings"]}

    def draw(axes: Sequence[Axes]) -> None:
        for panel, pair in zip(axes, pairs, strict=True):
            for row in population["pairs"]:
                if (row["run"], row["over"]) == pair and row["arms"]:
                    place = rows.index((row["reading"], row["joint"]))
                    ends = row["ratio_low"], row["ratio_high"]
                    slow = theory[row["reading"]][f"joint_{row['joint']}"]
                    marked = slow if pair == CONTROLLERS[:2] else None
                    ratio_bar(panel, place, row["ratio"], {"central 90 % of the arms": ends}, marked)
            ratio_axis(panel)

    caption = (
        f"Ratio of the mean absolute errors of two runs on arms {told}, where both are stable. "
        "Cross: what errors that change slowly would give."
    )
    alone = len({reading for reading, _ in rows}) == 1
    words = {PRINTED: "as in your comparison"}
    names = [
        f"joint {joint}" if alone else f"joint {joint},\n{words.get(reading, reading)}"
        for reading, joint in rows
    ]
    titles = [f"{_short(first)}/{_short(over)}" for first, over in pairs]
    origin = f"Simulated, {population['plants']} arms {told}"
    return rows_figure("pairs", titles, names, draw, caption, origin)


def _short(run: str) -> str:
    return f"C{CONTROLLERS.index(run) + 1}" if run in CONTROLLERS else run
