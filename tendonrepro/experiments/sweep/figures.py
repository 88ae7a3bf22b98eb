"""Figures of a sweep: errors of every run and their ratios over the values of a key."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.experiments.sweep.figure_map import (
    GONE,
    PAIRS,
    SweepFigure,
    caption_of,
    draw_maps,
    grid_of,
    name_of,
    title_of,
)
from tendonrepro.results.figures.style import SERIES, Stroke, journal_style, save_drawing, stroke_of
from tendonrepro.results.summary import CONTROLLERS, LOADS

_PANEL_MM = 48.0
# From this ratio of the largest to the smallest value on, an axis is logarithmic.
_SPREAD = 7.5
_MOST_TICKS = 8
# Between two labels, as a share of the panel.
_LEAST_GAP = 0.09
# Values are written side by side while they fit a panel, else aslant.
_LETTERS_ACROSS = 34


@dataclass(frozen=True)
class _Look:
    """Stroke and marker of a series; the first series lies on top and is the smallest, so that all show."""

    stroke: Stroke
    place: int

    @property
    def marker(self) -> str:
        return "osD^v"[self.place % 5]

    @property
    def size(self) -> float:
        return 2.8 + 0.5 * min(self.place, 4)

    @property
    def zorder(self) -> float:
        return 3.0 - 0.1 * self.place


def draw_sweep_figures(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw and save the figures of a sweep.

    Parameters
    ----------
    data : mapping
        From `tendonrepro.experiments.sweep.command.simulate_sweep`.
    folder : Path
        Made when missing.

    Returns
    -------
    list of Path
        ``sweep``, and of two keys ``sweep_ratio`` too where ratios are, each as pdf, svg and png.
    """
    drawn = [draw_curves(data)] if len(data["keys"]) == 1 else draw_maps(data)
    return [path for one in drawn for path in save_drawing(one, folder)]


def draw_curves(data: Mapping[str, Any]) -> SweepFigure:
    """MAE of every run and ratios of the controllers over one key, a column of panels per joint.

    Parameters
    ----------
    data : mapping
        Of a sweep over one key.
    """
    axis, joints = data["keys"][0], data["joints"]
    pairs = [pair for pair in PAIRS if pair in data["points"][0]["ratio"]]
    log = any(_spread(_lasting(data, k)) for k in range(len(joints)))
    with journal_style():
        height = _PANEL_MM * (2 if pairs else 1) + 12.0
        figure, grid = grid_of(1 + bool(pairs), len(joints), height)
        for k, joint in enumerate(joints):
            x, ticks = _places(axis, k)
            _draw_errors(grid[0][k], data, x, k, log=log)
            if pairs:
                _draw_ratios(grid[1][k], data, pairs, x, k)
            for row, title in enumerate(("MAE", "Ratio of MAE")[: 1 + bool(pairs)]):
                panel = grid[row][k]
                panel.set_title(f"({ascii_lowercase[row * len(joints) + k]}) Joint {joint}")
                panel.set_ylabel(f"{title} (deg)" if row == 0 else title)
                _set_x(panel, axis, x, ticks, labelled=row == bool(pairs))
        figure.align_ylabels()
        _draw_legend(figure, data, pairs)
        axes = {("mae", joint): grid[0][k] for k, joint in enumerate(joints)}
        axes |= {(pair, joint): grid[1][k] for pair in pairs for k, joint in enumerate(joints)}
        return SweepFigure("sweep", figure, axes, caption_of(data, pairs))


def _places(axis: Mapping[str, Any], k: int) -> tuple[Array, list[str] | None]:
    """Where the values stand for a joint, and how they are written where they are no numbers."""
    if axis["numbers"] is None:
        return np.arange(float(len(axis["texts"]))), list(axis["texts"])
    return np.array([row[k] for row in axis["numbers"]], dtype=np.float64), None


def _lasting(data: Mapping[str, Any], k: int) -> Array:
    """Errors of a joint in all runs that can be compared."""
    every = (found for point in data["points"] for found in point["runs"].values())
    return np.array([found["mae_deg"][k] for found in every if found["status"] not in GONE])


def _spread(values: Array) -> bool:
    """Whether values ask for a logarithmic axis."""
    return bool(values.size and values.min() > 0.0 and values.max() / values.min() > _SPREAD)


def _draw_errors(panel: Axes, data: Mapping[str, Any], x: Array, k: int, *, log: bool) -> None:
    scattered = data["keys"][0]["numbers"] is None
    ends: list[tuple[float, str, str]] = []
    for place, run in enumerate(data["runs"]):
        look = _look(run, place)
        found = [point["runs"][run] for point in data["points"]]
        gone = np.array([f["status"] in GONE for f in found])
        y = np.where(gone, np.nan, [f["mae_deg"][k] for f in found])
        at = x + (0.16 * (place - (len(data["runs"]) - 1) / 2.0) if scattered else 0.0)
        ringing = np.array([f["status"] == "ringing" for f in found])
        _draw_series(panel, at, y, ringing, look, joined=not scattered)
        ends += [(float(a), f["status"], look.stroke.colour) for a, f in zip(at, found, strict=True)]
    shown = _lasting(data, k)
    if log and shown.size and shown.min() > 0.0:
        panel.set_yscale("log")
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.yaxis.set_minor_formatter(NullFormatter())
    elif shown.size:
        panel.set_ylim(0.0, 1.12 * float(shown.max()))
    _make_room(panel, max(Counter(at for at, status, _ in ends if status in GONE).values(), default=0))
    _mark_ends(panel, ends)


def _make_room(panel: Axes, levels: int) -> None:
    """Lift the top of the y axis, so that marks there stay clear of the data."""
    low, high = panel.get_ylim()
    share = 0.07 * levels
    if panel.get_yscale() == "log":
        panel.set_ylim(low, high * (high / low) ** (share / (1.0 - share)))
    else:
        panel.set_ylim(low, high + (high - low) * share / (1.0 - share))


def _draw_series(
    panel: Axes, x: Array, y: Array, ringing: NDArray[np.bool_], look: _Look, *, joined: bool
) -> None:
    order, stroke = np.argsort(x), look.stroke
    style = stroke.linestyle if joined else "none"
    panel.plot(
        *(x[order], y[order]),
        color=stroke.colour,
        linestyle=style,
        linewidth=stroke.width,
        zorder=look.zorder,
    )
    for is_open in (False, True):
        chosen = (ringing == is_open) & np.isfinite(y)
        (dots,) = panel.plot(
            *(x[chosen], y[chosen]),
            linestyle="none",
            marker=look.marker,
            markersize=look.size,
            color=stroke.colour,
            markerfacecolor="white" if is_open else stroke.colour,
            markeredgewidth=0.7,
            clip_on=False,
            zorder=look.zorder,
        )
        # Markers on an axis may leave the panel, but must not move it.
        dots.set_in_layout(False)


def _mark_ends(panel: Axes, ends: Sequence[tuple[float, str, str]]) -> None:
    """Mark runs that did not last at the top of the panel, one below the other."""
    stacked: dict[float, int] = {}
    for at, status, colour in ends:
        if status not in GONE:
            continue
        level = stacked[at] = stacked.get(at, -1) + 1
        (cross,) = panel.plot(
            *([at], [0.985 - 0.07 * level]),
            marker="x" if status == "diverged" else "+",
            markersize=4.5,
            markeredgewidth=1.1,
            color=colour,
            transform=panel.get_xaxis_transform(),
            clip_on=False,
        )
        cross.set_in_layout(False)


def _draw_ratios(panel: Axes, data: Mapping[str, Any], pairs: Sequence[str], x: Array, k: int) -> None:
    joined = data["keys"][0]["numbers"] is not None
    panel.axhline(1.0, color="#999999", linewidth=0.4, zorder=0.5)
    order = np.argsort(x)
    for place, pair in enumerate(pairs):
        shift = 0.0 if joined else 0.16 * (place - (len(pairs) - 1) / 2.0)
        look = _pair_look(pair)
        predicted = np.array([point["predicted_ratio"][pair][k] for point in data["points"]])
        style: dict[str, Any] = {"color": look.stroke.colour, "alpha": 0.45, "zorder": 0.8}
        if joined:
            panel.plot(x[order], predicted[order], linestyle=(0.0, (1.0, 1.0)), linewidth=1.0, **style)
        else:
            panel.plot(x + shift, predicted, linestyle="none", marker="_", markersize=9.0, **style)
        y = np.array([point["ratio"][pair][k] for point in data["points"]])
        _draw_series(panel, x + shift, y, np.zeros(len(x), np.bool_), look, joined=joined)
    low, high = panel.get_ylim()
    room = max(0.04, 0.06 * (high - low))
    panel.set_ylim(min(low, 1.0) - room, max(high, 1.0) + room)
    panel.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _set_x(
    panel: Axes, axis: Mapping[str, Any], x: Array, ticks: list[str] | None, *, labelled: bool
) -> None:
    if ticks is not None:
        panel.set_xlim(-0.5, len(x) - 0.5)
        crowded = sum(map(len, ticks)) > _LETTERS_ACROSS
        panel.set_xticks(x, ticks if labelled else [""] * len(x))
        if labelled and crowded:
            panel.tick_params(axis="x", rotation=25.0)
            for text in panel.get_xticklabels():
                text.set_horizontalalignment("right")
    else:
        _set_numbers(panel, x)
        if not labelled:
            panel.tick_params(axis="x", labelbottom=False)
    if labelled:
        panel.set_xlabel(name_of(axis))


def _set_numbers(panel: Axes, x: Array) -> None:
    if _spread(x):
        panel.set_xscale("log")
        room = (x.max() / x.min()) ** 0.04
        panel.set_xlim(x.min() / room, x.max() * room)
    else:
        room = 0.04 * (x.max() - x.min())
        panel.set_xlim(x.min() - room, x.max() + room)
    if len(x) <= _MOST_TICKS:
        panel.xaxis.set_major_locator(FixedLocator(_apart(panel, np.sort(x))))
        panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())


def _apart(panel: Axes, x: Array) -> list[float]:
    """Values whose labels do not touch, from the smallest on."""
    log = panel.get_xscale() == "log"
    low, high = np.log(panel.get_xlim()) if log else panel.get_xlim()
    kept: list[float] = []
    last = -np.inf
    for value, at in zip(x.tolist(), ((np.log(x) if log else x) - low) / (high - low), strict=True):
        if at - last >= _LEAST_GAP:
            kept.append(value)
            last = at
    return kept


def _draw_legend(figure: Figure, data: Mapping[str, Any], pairs: Sequence[str]) -> None:
    joined = data["keys"][0]["numbers"] is not None
    handles = [
        _handle(_look(run, place), title_of(run), joined=joined) for place, run in enumerate(data["runs"])
    ]
    handles += [_handle(_pair_look(pair), PAIRS[pair], joined=joined) for pair in pairs]
    if pairs:
        look: dict[str, Any] = (
            {"linestyle": (0.0, (1.0, 1.0))} if joined else {"linestyle": "none", "marker": "_"}
        )
        handles.append(Line2D([], [], color="#888888", label="slow load", **look))
    statuses = {found["status"] for point in data["points"] for found in point["runs"].values()}
    for status, marker, face in (
        ("ringing", "o", "white"),
        ("diverged", "x", "black"),
        ("unresolved", "+", "black"),
    ):
        if status in statuses:
            handles.append(
                Line2D(
                    *([], []),
                    color="black",
                    linestyle="none",
                    marker=marker,
                    markersize=4.0,
                    markerfacecolor=face,
                    label=status,
                )
            )
    figure.legend(
        handles=handles, loc="outside upper center", ncols=-(-len(handles) // (1 + (len(handles) > 6)))
    )


def _handle(look: _Look, label: str, *, joined: bool) -> Line2D:
    stroke = look.stroke
    return Line2D(
        *([], []),
        color=stroke.colour,
        linestyle=stroke.linestyle if joined else "none",
        linewidth=stroke.width,
        marker=look.marker,
        markersize=look.size,
        label=label,
    )


def _look(run: str, place: int) -> _Look:
    """Look of a run, the same in every sweep for the paper's."""
    known = (*CONTROLLERS, LOADS["with_load"])
    number = known.index(run) if run in known else len(known) + place
    return _Look(stroke_of(number + 1), number)


def _pair_look(pair: str) -> _Look:
    place = list(PAIRS).index(pair)
    return _Look(SERIES[4 + place], place)
