"""Figures of an ensemble: ratios of errors under each reading."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator

from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.files import Json
from tendonrepro.monte_carlo.shares import QUANTILES, RATIOS
from tendonrepro.results.figures import style
from tendonrepro.results.summary import CONTROLLERS

_RATIO_NAMES: Mapping[str, str] = {"ratio_c1_c2": "C1/C2", "ratio_c2_c3": "C2/C3"}
_ROW_MM, _LINE_MM = 4.2, 2.5
"""Least height of a row, and of each line of its name."""
_FRAME_MM, _LEAST_MM = 26.0, 30.0
"""Height of what is around the panels, and least height of these."""
_FEW = 20
"""Rows up to which their names are as large as other ticks."""
_TICK_ROOM = 0.24
"""Least distance of two ticks of a ratio, as a share of the panel's width."""
_FAR_TICKS = 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0
"""Ticks of ratios far from 1."""
_NAME = 48
"""Letters of a row's name on one line."""


def ensemble_figures(summary: Json) -> dict[str, Callable[[], style.Drawing]]:
    """Ratios under each reading, by name of the figure; around an arm those of all pairs of runs."""
    ((name, population),) = summary["populations"].items()
    if "around" in summary:
        return {"pairs": partial(draw_pairs, population, str(summary["around"]["told"]))}
    return {f"ratios_{name}": partial(draw_ratios, name, population)}


def draw_ratios(population: str, summary: Json) -> style.Drawing:
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
    printed = style.SERIES[1]
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
    colour = style.SERIES[0].colour
    for width, (label, ends) in zip((0.7, 2.6), ranges.items(), strict=False):
        panel.plot(ends, [row, row], color=colour, linewidth=width, label=label)
    panel.plot(median, row, "o", color="white", markeredgecolor=colour, markersize=3.2, label="median")
    if slow is not None:
        panel.plot(slow, row, "x", color="black", markersize=3.5, label="slow errors")


class _RatioTicks(MaxNLocator):
    """Round numbers that lie apart on a logarithmic axis near 1, where its own ticks are rare."""

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Ticks in order, from 1 outwards those with room for their text."""
        ticks: list[float] = []
        room = _TICK_ROOM * np.log(vmax / vmin)
        candidates = {*_FAR_TICKS, *(tick for tick in super().tick_values(vmin, vmax) if tick > 0.0)}
        inside = (tick for tick in candidates if vmin <= tick <= vmax)
        for tick in sorted(inside, key=lambda tick: abs(np.log(tick))):
            if all(abs(np.log(tick / other)) >= room for other in ticks):
                ticks.append(tick)
        return sorted(ticks)


def ratio_axis(panel: Axes) -> None:
    """Scale, ticks and label of ratios of errors."""
    panel.margins(x=0.05)
    panel.axvline(1.0, color="#999999", linewidth=0.4, zorder=0.4)
    panel.set_xscale("log")
    panel.xaxis.set_major_locator(_RatioTicks(8, steps=[1, 2, 2.5, 5, 10]))
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
    *,
    sharex: bool = False,
) -> style.Drawing:
    """Draw titled panels side by side over named rows, the first on top; the legend has each label once."""
    with style.journal_style():
        names = [_broken(row) for row in rows]
        row_mm = max(_ROW_MM, _LINE_MM * max(1 + name.count("\n") for name in names))
        figure = style.open_figure(style.PAGE_MM, _FRAME_MM + max(row_mm * len(rows), _LEAST_MM))
        axes = figure.subplots(1, len(titles), sharex=sharex, sharey=True, squeeze=False)[0]
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
        axes[0].set_yticks(range(len(rows)), names, fontsize=6 if len(rows) > _FEW else 7)
        return style.Drawing(stem, figure, tuple(axes), caption, origin=origin)


def _broken(name: str) -> str:
    """A row's name in lines, of readings between two of them."""
    lines = [line for part in name.split("\n") for line in wrap(part.replace("+", "+ "), _NAME)]
    return "\n".join(lines).replace("+ ", "+")


def draw_pairs(population: Json, told: str) -> style.Drawing:
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
    return rows_figure("pairs", titles, names, draw, caption, origin, sharex=True)


def _short(run: str) -> str:
    return f"C{CONTROLLERS.index(run) + 1}" if run in CONTROLLERS else run
