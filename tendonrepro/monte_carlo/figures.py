"""Figures of an ensemble: ratios of errors under each reading."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.files import Json
from tendonrepro.monte_carlo.shares import QUANTILES, RATIOS
from tendonrepro.results.figures.style import (
    PAGE_MM,
    SERIES,
    Drawing,
    journal_style,
    open_figure,
)
from tendonrepro.results.summary import CONTROLLERS

_RATIO_NAMES: Mapping[str, str] = {"ratio_c1_c2": "C1/C2", "ratio_c2_c3": "C2/C3"}
_ROW_MM = 4.2
_FRAME_MM = 26.0


def ensemble_figures(summary: Json) -> dict[str, Callable[[], Drawing]]:
    """Every population's ratios, by name of the figure; around an arm those of all pairs of runs."""
    if "around" in summary:
        (arms,) = summary["populations"].values()
        return {"pairs": partial(draw_pairs, arms, str(summary["around"]["told"]))}
    populations = summary["populations"].items()
    return {f"ratios_{name}": partial(draw_ratios, name, population) for name, population in populations}


def draw_ratios(population: str, summary: Json) -> Drawing:
    """Ratios of MAE under each reading, the printed ones, and those of slowly changing errors."""
    panels = list(product(RATIOS, summary["joints"]))

    def draw(axes: Sequence[Axes]) -> None:
        for panel, (key, joint) in zip(axes, panels, strict=True):
            _draw_ratio(panel, summary["readings"], key, f"joint_{joint}")

    caption = (
        f"Ratio of the mean absolute errors on plants of the population {population} on which all three laws "
        "are ok, under each reading: median, central 50 % (thick) and 90 % (thin). Dashed: as printed. "
        "Cross: what errors that change slowly would give."
    )
    titles = [f"{_RATIO_NAMES[key]}, joint {joint}" for key, joint in panels]
    names = [reading["name"] for reading in summary["readings"]]
    origin = f"Simulated, {summary['plants']} plants of the population {population}"
    return rows_figure(f"ratios_{population}", titles, names, draw, caption, origin)


def _draw_ratio(panel: Axes, readings: Sequence[Json], key: str, joint: str) -> None:
    printed = SERIES[1]
    ratios = [reading[key]["all_ok"]["mae"][joint] for reading in readings]
    for row, ratio in enumerate(ratios):
        if not ratio["plants"]:
            continue
        q05, q25, median, q75, q95 = (ratio[name]["value"] for name in QUANTILES)
        slow = readings[row]["theory"][joint] if key == "ratio_c1_c2" else None
        ratio_bar(panel, row, median, {"central 90 %": (q05, q95), "central 50 %": (q25, q75)}, slow)
    panel.axvline(ratios[0]["printed"], color=printed.colour, linestyle=printed.linestyle, label="printed")
    ratio_axis(panel)


def ratio_bar(
    panel: Axes,
    row: int,
    median: float,
    ranges: Mapping[str, tuple[float, float]],
    slow: float | None = None,
) -> None:
    """Draw a median on its ranges by what they are called, the wider ones thinner and first.

    A cross marks what errors that change slowly would give.
    """
    colour = SERIES[0].colour
    for width, (label, ends) in zip((0.7, 2.6), ranges.items(), strict=False):
        panel.plot(ends, [row, row], color=colour, linewidth=width, label=label)
    panel.plot(median, row, "o", color="white", markeredgecolor=colour, markersize=3.2, label="median")
    if slow is not None:
        panel.plot(slow, row, "x", color="black", markersize=3.5, label="slow errors")


def ratio_axis(panel: Axes) -> None:
    """Scale, ticks and label of ratios of errors."""
    panel.margins(x=0.05)
    panel.axvline(1.0, color="#999999", linewidth=0.4, zorder=0.4)
    panel.set_xscale("log")
    # Ratios are near 1, where ticks of a logarithmic axis are rare.
    panel.xaxis.set_major_locator(MaxNLocator(3))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlabel("ratio of MAE")


def rows_figure(
    stem: str,
    titles: Sequence[str],
    rows: Sequence[str],
    draw: Callable[[Sequence[Axes]], None],
    caption: str,
    origin: str = "",
) -> Drawing:
    """Draw titled panels side by side over named rows, the first on top; the legend has each label once."""
    with journal_style():
        figure = open_figure(PAGE_MM, _FRAME_MM + _ROW_MM * len(rows))
        axes = figure.subplots(1, len(titles), sharey=True, squeeze=False)[0]
        for panel, title in zip(axes, titles, strict=True):
            panel.set_title(title)
            panel.tick_params(axis="y", length=0.0)
            panel.grid(axis="y", color="#EEEEEE", linewidth=0.4)
            panel.set_axisbelow(True)
        draw(axes)
        marks = {
            label: mark
            for panel in axes
            for mark, label in zip(*panel.get_legend_handles_labels(), strict=True)
        }
        figure.legend(marks.values(), marks.keys(), loc="outside upper center", ncols=len(marks))
        axes[0].set_ylim(len(rows) - 0.4, -0.6)
        axes[0].set_yticks(range(len(rows)), rows, fontsize=6)
        return Drawing(stem, figure, tuple(axes), caption, origin=origin)


def draw_pairs(population: Json, told: str) -> Drawing:
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
