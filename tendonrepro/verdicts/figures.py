"""What decides a verdict, a ratio of errors against each unknown, and what tells the laws apart from near."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import periodogram
from tendonrepro.results.figures.style import COLUMN_MM, PAGE_MM, SERIES, journal_style, open_figure
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.sensitivity import Ranking

Curve = Callable[[Trace, int], tuple[Array, Array]]

NEAR = 0.6
"""Time shown around a reversal, s to both sides."""
BANDS = 120
"""Points of a spectrum, evenly spaced on a logarithmic axis."""

_BARS = 12
_COLUMNS = 4
_GROUPS = 20
_LEAST_IN_GROUP = 10
_MOST_POINTS = 2000
_SHOWN = (0.005, 0.995)


def draw_tornado(title: str, found: Ranking) -> Figure:
    """Bars of the unknowns that decide a verdict, the strongest on top, with the floor of chance."""
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


def draw_influences(found: Mapping[str, Ranking]) -> Figure:
    """Shares of the variance of every number that the unknowns explain, in percent, the strongest on top."""
    shares = {
        name: {row["name"]: row["index"] if row["total"] is None else row["total"] for row in held["rows"]}
        for name, held in found.items()
    }
    unknowns = [*next(iter(shares.values()))]
    unknowns.sort(key=lambda name: -sum(held[name] for held in shares.values()))
    unknowns = unknowns[:_BARS]
    cells = np.array([[100.0 * held[name] for held in shares.values()] for name in unknowns])
    with journal_style():
        figure = open_figure(PAGE_MM, 48.0 + 5.0 * len(unknowns))
        axes = figure.subplots()
        axes.imshow(cells, cmap="Blues", vmin=0.0, vmax=60.0, aspect="auto")
        for (row, column), value in np.ndenumerate(cells):
            if value >= 1.0:
                ink = "white" if value > 35.0 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=ink)
        axes.set_yticks(np.arange(len(unknowns)), unknowns)
        names = [name.replace(".", " ").replace("_", " ") for name in shares]
        axes.set_xticks(np.arange(len(shares)), names, rotation=60.0, ha="right")
        axes.set_title("What decides each number of Tables 2 and 3: share of the variance, %")
    return figure


def draw_ratio_against_unknowns(
    names: Sequence[str], draws: Array, ratio: Array, line: float, label: str, *, log: Sequence[bool] = ()
) -> Figure:
    """Ratio of two laws' errors (N,) against every unknown (N, P), plant by plant, with its running median.

    The outermost 1 % are left out of the panels. `line` is what slowly changing errors would give, 1 + alpha;
    `log` says which unknowns stand on a logarithmic axis, none when empty.
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
    """Medians of x and y in at most 20 groups of at least 10 points, along x; empty with fewer points."""
    count = min(_GROUPS, len(x) // _LEAST_IN_GROUP)
    if count == 0:
        return np.empty(0), np.empty(0)
    groups = np.array_split(np.argsort(x, kind="stable"), count)
    medians = np.array([[np.median(x[group]), np.median(y[group])] for group in groups])
    return medians[:, 0], medians[:, 1]


def draw_laws(file: TraceFile) -> Figure:
    """Torque and estimation error over frequency, the error's distribution, and the error at a reversal.

    A row for each of the four, a column for each joint; at least one of Controllers 1 to 3 was run.
    """
    runs = {name: file.runs[name] for name in CONTROLLERS if name in file.runs}
    joints = next(iter(runs.values())).joint
    with journal_style():
        figure = open_figure(PAGE_MM, 185.0)
        grid = figure.subplots(4, len(joints), squeeze=False)
        for i, joint in enumerate(joints):
            grid[0, i].set_title(f"Joint {joint}")
            for axes, row in zip(grid[:, i], _ROWS, strict=True):
                _draw(axes, runs, i, *row)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw(
    axes: Axes, runs: Mapping[str, Trace], joint: int, curve: Curve, x: str, y: str, scale: str
) -> None:
    for (name, trace), series in zip(runs.items(), SERIES, strict=False):
        label = name.replace("_", " ").capitalize()
        axes.plot(*curve(trace, joint), color=series.colour, linestyle=series.linestyle, label=label)
    axes.set(xlabel=x, ylabel=y, xscale=scale, yscale=scale)


def _spectrum_of(variable: str) -> Curve:
    """Root mean square in bands of equal ratio, the constant part left out."""

    def curve(trace: Trace, joint: int) -> tuple[Array, Array]:
        signal = trace[variable][:, [joint]]
        # An unfinished last sample of ε has no successor to be compared with.
        frequency, power = periodogram(
            signal[np.isfinite(signal[:, 0])], float(trace.time[1] - trace.time[0])
        )
        edges = np.geomspace(frequency[1], frequency[-1], BANDS + 1)
        sums = np.histogram(frequency[1:], edges, weights=power[1:, 0])[0]
        held = sums > 0.0
        return np.sqrt(edges[:-1] * edges[1:])[held], np.sqrt(sums[held])

    return curve


def _distribution(trace: Trace, joint: int) -> tuple[Array, Array]:
    size = np.sort(np.abs(np.rad2deg(trace["e"][:, joint])))
    return size, np.arange(1, size.size + 1) / size.size


def _reversal(trace: Trace, joint: int) -> tuple[Array, Array]:
    """Error around the last reversal of the first period: the arm begins to move down."""
    down = np.flatnonzero((trace["dq_d"][1:, joint] < 0.0) & (trace["dq_d"][:-1, joint] >= 0.0))
    at = trace.time[down[0]] if down.size else trace.time[0]
    near = np.abs(trace.time - at) <= NEAR
    return trace.time[near] - at, np.rad2deg(trace["e"][near, joint])


_ROWS = (
    (_spectrum_of("tau_m"), "frequency (Hz)", "torque (N m)", "log"),
    (_spectrum_of("epsilon"), "frequency (Hz)", "ε (rad s⁻²)", "log"),
    (_distribution, "|error| (deg)", "share of samples below", "linear"),
    (_reversal, "time from the reversal (s)", "error (deg)", "linear"),
)
"""Rows of `draw_laws`: what is drawn, labels of the axes, and their scale."""
