"""The figure of a sweep: lines over the values of one key, a map over the values of two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import CenteredNorm, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from tendonrepro.arrays import Array
from tendonrepro.experiments.sweep.report import PAIRS, pair_name
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure, stroke_of
from tendonrepro.results.summary import CONTROLLERS, LOADS

GONE = ("diverged", "unresolved")
"""Statuses of runs whose errors cannot be compared."""

_PANEL_MM, _CELL_MM, _FRAME_MM = 48.0, 7.5, 12.0
# From this ratio of the largest to the smallest value on, an axis is logarithmic.
_SPREAD = 7.5
# Each value gets a tick where all are at least this share of the axis apart.
_LEAST_GAP = 0.09
# Words are written side by side while they fit a panel, else aslant.
_LETTERS_ACROSS = 34
# Height of a cross at the top of a panel, as a share of it.
_CROSS, _MOST_CROSSES = 0.08, 6
_MOST_IN_LINE = 6
_RATIO_COLOURS = LinearSegmentedColormap.from_list("ratio", ["#4477AA", "#F6F6F6", "#CC6677"])
_SIZE_COLOURS = LinearSegmentedColormap.from_list("size", ["#F6F6F6", "#6699CC"])
_NO_VALUE = "#E4E4E4"
_EXPONENTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@journal_style()
def draw_sweep(data: Mapping[str, Any]) -> Drawing:
    """Draw the figure of a sweep."""
    figure = draw_lines(data) if len(data["keys"]) == 1 else draw_map(data)
    origin = f"Simulated, configuration {Path(data['config']).name} ({data['config_sha256'][:8]})"
    return Drawing("sweep", figure, figure.axes, _caption(data), origin=origin)


def draw_lines(data: Mapping[str, Any]) -> Figure:
    """MAE of every run above, ratios of the controllers below where they ran, a column per joint."""
    axis, joints = data["keys"][0], data["joints"]
    rows = ("MAE (deg)", "Ratio of MAE")[: 1 + bool(data["points"][0]["ratio"])]
    figure = open_figure(PAGE_MM, len(rows) * _PANEL_MM + _FRAME_MM)
    grid = figure.subplots(len(rows), len(joints), sharex="col", squeeze=False)
    log = any(_is_wide(_lasting(data, k)) for k in range(len(joints)))
    for k, joint in enumerate(joints):
        numbers = axis["numbers"] or [[i] * len(joints) for i in range(len(axis["texts"]))]
        x = np.array([row[k] for row in numbers], dtype=np.float64)
        order = np.argsort(x)
        points, x = [data["points"][i] for i in order], x[order]
        _draw_errors(grid[0, k], points, x, k, log=log)
        for panel in grid[1:, k]:
            _draw_ratios(panel, points, x, k)
        for row, panel in enumerate(grid[:, k]):
            panel.set(title=f"({ascii_lowercase[row * len(joints) + k]}) Joint {joint}", ylabel=rows[row])
        _set_values(list(grid[:, k]), axis, x)
    figure.align_ylabels()
    handles = [line for panel in grid[:, 0] for line in panel.get_legend_handles_labels()[0]]
    statuses = set(data["status"].values())
    black: dict[str, Any] = {"color": "black", "linestyle": "none", "markersize": 4.0}
    if "ringing" in statuses:
        handles.append(Line2D([], [], marker="o", markerfacecolor="white", label="ringing", **black))
    if statuses & {*GONE}:
        handles.append(Line2D([], [], marker="x", label="did not last", **black))
    lines = 1 + (len(handles) > _MOST_IN_LINE)
    figure.legend(handles=handles, loc="outside upper center", ncols=-(-len(handles) // lines))
    return figure


def _lasting(data: Mapping[str, Any], k: int) -> Array:
    """Errors of a joint in all runs that can be compared."""
    every = (run for point in data["points"] for run in point["runs"].values())
    return np.array([run["mae_deg"][k] for run in every if run["status"] not in GONE])


def _is_wide(values: Array) -> bool:
    """Whether values ask for a logarithmic axis."""
    return bool(values.size and values.min() > 0.0 and values.max() / values.min() > _SPREAD)


def _draw_errors(panel: Axes, points: Sequence[Mapping[str, Any]], x: Array, k: int, *, log: bool) -> None:
    """Lines of the runs: open markers where they ring, crosses above where they did not last."""
    runs, room = list(points[0]["runs"]), 0.0
    # The paper's runs always look the same; the first lies on top and is smallest, so that all show.
    numbers = {run: i for i, run in enumerate(dict.fromkeys((*CONTROLLERS, LOADS["with_load"], *runs)))}
    for place, run in enumerate(runs):
        status = np.array([point["runs"][run]["status"] for point in points])
        gone, ringing = np.isin(status, GONE), status == "ringing"
        y = np.where(gone, np.nan, [point["runs"][run]["mae_deg"][k] for point in points])
        stroke, size = stroke_of(numbers[run] + 1), 2.8 + 0.5 * min(numbers[run], 4)
        look: dict[str, Any] = {
            "color": stroke.colour,
            "marker": "osD^v"[numbers[run] % 5],
            "markersize": size,
        }
        look["zorder"] = 3.0 - 0.1 * numbers[run]
        line = {"linestyle": stroke.linestyle, "linewidth": stroke.width, "label": _title(run)}
        panel.plot(x, y, **look | line)
        panel.plot(x[ringing], y[ringing], linestyle="none", markerfacecolor="white", **look)
        level = min(place, _MOST_CROSSES - 1)
        height = np.full(gone.sum(), 1.0 - _CROSS * (level + 0.5))
        across = panel.get_xaxis_transform()
        panel.plot(x[gone], height, "x", color=stroke.colour, markersize=4.5, transform=across)
        room = max(room, _CROSS * (level + 1) * gone.any())
    panel.margins(y=0.08)
    if log:
        _set_logarithmic(panel, "y")
    low, high = panel.get_ylim() if log else (0.0, 1.05 * panel.get_ylim()[1])
    top = high * (high / low) ** (room / (1.0 - room)) if log else high / (1.0 - room)
    panel.set_ylim(low, top)


def _draw_ratios(panel: Axes, points: Sequence[Mapping[str, Any]], x: Array, k: int) -> None:
    """Lines of the ratios, and paler those of a slowly changing load."""
    for place, pair in enumerate(points[0]["ratio"]):
        stroke = stroke_of(5 + place)
        ratio, slow = ([point[name][pair][k] for point in points] for name in ("ratio", "predicted_ratio"))
        look: dict[str, Any] = {"color": stroke.colour, "linestyle": stroke.linestyle, "zorder": 2.5}
        panel.plot(x, ratio, marker="os"[place], markersize=3.3, label=pair_name(pair), **look)
        label = f"{pair_name(pair)}, slow load"
        panel.plot(x, slow, ":", markersize=9.0, color=stroke.colour, alpha=0.5, label=label)
    panel.margins(y=0.1)


def _set_values(panels: Sequence[Axes], axis: Mapping[str, Any], x: Array) -> None:
    """Put the values below a column: numbers where there is room for them, words apart and not joined."""
    panels[-1].set_xlabel(_axis_label(axis))
    words = axis["numbers"] is None
    along = np.log(x) if _is_wide(x) and not words else x
    if along is not x:
        _set_logarithmic(panels[-1], "x")
    if words:
        panels[-1].set_xticks(x, axis["texts"], **_turned(axis["texts"]))
    elif np.diff(along).min() > _LEAST_GAP * np.ptp(along):
        panels[-1].set_xticks(x, [f"{value:g}" for value in x])
    for panel in panels:
        panel.margins(x=0.2 if words else 0.04)
        for line in panel.lines if words else ():
            line.set(marker="_" if line.get_linestyle() == ":" else line.get_marker(), linestyle="none")
    for panel in panels[1:]:
        panel.axhline(1.0, color="#999999", linewidth=0.4, zorder=0.5)


def _set_logarithmic(panel: Axes, which: str) -> None:
    panel.set(**{f"{which}scale": "log"})
    axis = panel.xaxis if which == "x" else panel.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.minorticks_off()


def _turned(texts: Sequence[str]) -> dict[str, Any]:
    """How labels are written below a panel."""
    return {"rotation": 25.0, "ha": "right"} if sum(map(len, texts)) > _LETTERS_ACROSS else {}


def draw_map(data: Mapping[str, Any]) -> Figure:
    """Ratios of the controllers, or MAE of every run where there are none; a column of panels per joint."""
    upright, across = data["keys"]
    shape, joints, pairs = (
        (len(upright["texts"]), len(across["texts"])),
        data["joints"],
        data["points"][0]["ratio"],
    )
    shown: dict[str, Sequence[str]] = {pair: PAIRS[pair] for pair in pairs} or {x: [x] for x in data["runs"]}
    figure = open_figure(PAGE_MM, len(shown) * (shape[0] * _CELL_MM + 9.0) + _FRAME_MM)
    grid = figure.subplots(len(shown), len(joints), sharex=True, sharey=True, squeeze=False)
    for place, (name, k) in enumerate(product(shown, range(len(joints)))):
        panel, values = grid.flat[place], np.full(shape, np.nan)
        for point in data["points"]:
            i, j = point["places"]
            values[i, j], text = _cell(point, name, shown[name], k)
            panel.text(j, i, text, ha="center", va="center", fontsize=min(7.0, 45.0 / shape[1]))
        seen = np.ma.masked_invalid(np.log(values) if pairs else values)
        # Colours of ratios end at a factor of two everywhere, so that figures can be compared.
        norm = (
            CenteredNorm(0.0, np.log(2.0)) if pairs else Normalize(0.0, seen.max() if seen.count() else 1.0)
        )
        colours = (_RATIO_COLOURS if pairs else _SIZE_COLOURS).with_extremes(bad=_NO_VALUE)
        columns, rows = np.arange(shape[1]), np.arange(shape[0])
        panel.pcolormesh(columns, rows, seen, cmap=colours, norm=norm, edgecolors="white", linewidth=0.8)
        what = f"Ratio of MAE {pair_name(name)}" if pairs else f"{_title(name)}, MAE (deg)"
        panel.set_title(f"({ascii_lowercase[place % 26]}) {what}, joint {joints[k]}")
        panel.set_xticks(columns, across["texts"], **_turned(across["texts"]))
        panel.set_yticks(rows, upright["texts"])
        panel.tick_params(length=0.0)
        panel.spines[:].set_visible(False)
    figure.supxlabel(_axis_label(across), fontsize=8)
    figure.supylabel(_axis_label(upright), fontsize=8)
    return figure


def _cell(point: Mapping[str, Any], name: str, runs: Sequence[str], k: int) -> tuple[float, str]:
    """Value of a cell, NaN where a run did not last, and what is written there."""
    statuses = {point["runs"][run]["status"] for run in runs}
    if statuses & {*GONE}:
        return np.nan, "×"
    ratio = len(runs) > 1
    value = point["ratio"][name][k] if ratio else point["runs"][name]["mae_deg"][k]
    return value, format(value, ".2f" if ratio else "#.3g") + "~" * ("ringing" in statuses)


def _title(run: str) -> str:
    return run.replace("_", " ").capitalize()


def _axis_label(axis: Mapping[str, Any]) -> str:
    """Key and unit."""
    unit = "" if axis["unit"] in (None, "1") else f" ({axis['unit'].translate(_EXPONENTS)})"
    return f"{axis['key']}{unit}"


def _caption(data: Mapping[str, Any]) -> str:
    """What the figure shows, and which runs did not last."""
    keys = " and ".join(axis["key"] for axis in data["keys"])
    parts = [f"Mean absolute tracking error over the whole run under values of {keys}."]
    if data["points"][0]["ratio"]:
        parts.append("Ratios where both runs lasted.")
    if len(data["keys"]) > 1:
        parts.append("Grey: a run did not last; tilde: it rings.")
    elif data["points"][0]["ratio"]:
        parts.append("Slow load: what the laws alone give for a load that changes slowly.")
    if data["diverged"]:
        parts.append(f"Diverged: {', '.join(data['diverged'])}.")
    return " ".join([*parts, f"Configuration {data['config']}, sweep {data['config_sha256'][:12]}."])
