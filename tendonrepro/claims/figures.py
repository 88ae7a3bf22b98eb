"""Which unknowns decide a verdict, and the ratio of two laws' errors against each unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from tendonrepro.arrays import Array
from tendonrepro.claims.sensitivity import Ranking
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, SERIES, journal_style, open_figure

_BARS = 12
_COLUMNS = 4
_GROUPS = 20
_LEAST_IN_GROUP = 10
_MOST_POINTS = 2000
_SHOWN = (0.005, 0.995)


def draw_tornado(title: str, found: Ranking) -> Figure:
    """Bars of the unknowns that decide a verdict, the strongest on top, with the floor of chance.

    Parameters
    ----------
    title : str
        What is decided.
    found : Ranking
        From `sensitivity.ranked`.
    """
    rows = found["rows"][:_BARS]
    index = np.array([row["index"] for row in rows])
    with journal_style():
        figure = open_figure(COLUMN_MM, 18.0 + 5.0 * len(rows))
        axes = figure.subplots()
        above = index > found["noise_floor"]
        colours = [SERIES[0].colour if strong else "#BEBEBE" for strong in above]
        half = [row["half_width"] for row in rows]
        axes.barh(np.arange(len(rows)), index, xerr=half, color=colours, error_kw={"elinewidth": 0.7})
        stroke = SERIES[1]
        axes.axvline(
            found["noise_floor"], color=stroke.colour, linestyle=stroke.linestyle, label="floor of chance"
        )
        axes.legend(loc="lower right")
        axes.set_yticks(np.arange(len(rows)), [row["name"] for row in rows])
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlim(min(0.0, float(index.min())), 1.05 * float((index + half).max()))
        axes.set_xlabel("share of the variance explained alone")
        axes.set_title(title)
    return figure


def draw_ratio_against_unknowns(
    names: Sequence[str], draws: Array, ratio: Array, line: float, label: str, *, log: Sequence[bool] = ()
) -> Figure:
    """Ratio of two laws' errors against every unknown, plant by plant, with its running median.

    Parameters
    ----------
    names : sequence of str
        Of the P unknowns.
    draws : array (N, P)
        Plants on which all laws are ok.
    ratio : array (N,)
        Positive; the outermost 1 % are left out of the panels.
    line : float
        What slowly changing errors would give, 1 + alpha.
    label : str
        Of the ratio.
    log : sequence of bool
        Which unknowns stand on a logarithmic axis; none when empty.
    """
    rows = -(-len(names) // _COLUMNS)
    kept = ratio > 0.0
    with journal_style():
        figure = open_figure(PAGE_MM, 14.0 + 30.0 * rows)
        grid = figure.subplots(rows, _COLUMNS, sharey=True, squeeze=False)
        for place, axes in enumerate(grid.flat):
            if place >= len(names):
                axes.set_visible(False)
                continue
            _draw_cloud(axes, draws[kept, place], ratio[kept], line)
            axes.set_xlabel(names[place], fontsize=6)
            if log and log[place]:
                axes.set_xscale("log")
                axes.xaxis.set_minor_formatter(NullFormatter())
        low, high = np.quantile(ratio[kept], _SHOWN)
        grid[0, 0].set_ylim(min(low, 0.98 * line, 0.98), max(high, 1.02 * line, 1.02))
        figure.supylabel(label, fontsize=8)
    return figure


def _draw_cloud(axes: Axes, x: Array, ratio: Array, line: float) -> None:
    step = max(len(x) // _MOST_POINTS, 1)
    axes.plot(
        x[::step], ratio[::step], ".", color=SERIES[0].colour, markersize=0.8, alpha=0.25, rasterized=True
    )
    axes.axhline(line, color=SERIES[1].colour, linestyle=SERIES[1].linestyle)
    axes.axhline(1.0, color="#999999", linewidth=0.4)
    middle, median = running_median(x, ratio)
    axes.plot(middle, median, color="#000000")


def running_median(x: Array, y: Array) -> tuple[Array, Array]:
    """Medians of groups of equal size along x.

    Parameters
    ----------
    x, y : array (N,)
        Points.

    Returns
    -------
    middle, median : array (G,)
        Median of x and of y in each of at most 20 groups of at least 10 points; empty with fewer points.
    """
    count = min(_GROUPS, len(x) // _LEAST_IN_GROUP)
    if count == 0:
        return np.empty(0), np.empty(0)
    groups = np.array_split(np.argsort(x, kind="stable"), count)
    medians = np.array([[np.median(x[group]), np.median(y[group])] for group in groups])
    return medians[:, 0], medians[:, 1]
