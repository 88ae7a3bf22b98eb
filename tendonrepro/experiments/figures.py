"""The figures of a sweep, and of the tensions over the angles of the last two links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from tendonrepro.arrays import Array
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures import style

Points: TypeAlias = Sequence[Mapping[str, Any]]

GONE = ("diverged", "unresolved")
"""Statuses of runs whose errors cannot be compared."""

_SPREAD = 7.5
"""From this ratio of the largest to the smallest value on, an axis is logarithmic."""


@style.journal_style()
def draw_sweep(data: Mapping[str, Any]) -> style.Drawing:
    """MAE of every run above, ratios of the controllers below, a column per joint."""
    keys, joints = [axis["key"] for axis in data["keys"]], data["joints"]
    rows = ("MAE (deg)", "Ratio of MAE")[: 1 + bool(data["points"][0]["ratio"])]
    figure = style.open_figure(style.PAGE_MM, 48.0 * len(rows) + 16.0)
    grid = figure.subplots(len(rows), len(joints), sharex="col", sharey="row", squeeze=False)
    for k in range(len(joints)):
        points, x = _set_values(grid[-1, k], data, k)
        _draw_errors(grid[0, k], points, x, k)
        for panel in grid[1:, k]:
            _draw_ratios(panel, points, x, k)
    if not _is_numeric(data):
        for line in (line for panel in grid.flat for line in panel.lines if line.get_marker() != "None"):
            line.set_linestyle("none")
    for panel, label in zip(grid[:, 0], rows, strict=True):
        panel.set_ylabel(label)
    named = style.letter_panels(grid.flat, [f"Joint {joint}" for _ in rows for joint in joints])
    handles = [line for panel in grid[:, 0] for line in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper center", ncols=5)
    caption = (
        f"Mean absolute tracking error over the whole run under values of {' and '.join(keys)}. "
        f"Open markers: ringing. Crosses: did not last. Ratios where both runs lasted. "
        f"Diverged: {', '.join(data['diverged']) or 'none'}. "
        f"Configuration {data['config']}, sweep {data['config_sha256'][:12]}."
    )
    made = f"Simulated, configuration {data['config_sha256'][:8]}"
    origin = f"Open: ringing; cross: did not last. {made}"
    return style.Drawing("sweep", figure, named, caption, origin=origin)


def _is_numeric(data: Mapping[str, Any]) -> bool:
    """Whether points lie on one axis of numbers; no line joins words or pairs."""
    return len(data["keys"]) == 1 and data["keys"][0]["numbers"] is not None


def _set_values(panel: Axes, data: Mapping[str, Any], k: int) -> tuple[Points, Array]:
    """Points as they lie along the axis: numbers in order, or words side by side."""
    keys, points = data["keys"], data["points"]
    labels = (axis["key"] + ("" if axis["unit"] in (None, "1") else f" ({axis['unit']})") for axis in keys)
    panel.set_xlabel(", ".join(labels))
    panel.margins(x=0.06)
    if _is_numeric(data):
        x = np.array([row[k] for row in keys[0]["numbers"]])
        _set_scale(panel, "x", x)
        order = np.argsort(x)
        return [points[i] for i in order], x[order]
    texts = [
        ", ".join(axis["texts"][place] for axis, place in zip(keys, point["places"], strict=True))
        for point in points
    ]
    x = np.arange(len(points), dtype=np.float64)
    panel.set_xticks(x, texts, rotation=25.0, ha="right")
    return points, x


def _draw_errors(panel: Axes, points: Points, x: Array, k: int) -> None:
    """Lines of the runs: open markers where they ring, crosses where they did not last."""
    errors = np.array([[run["mae_deg"][k] for run in point["runs"].values()] for point in points])
    status = np.array([[run["status"] for run in point["runs"].values()] for point in points])
    gone = np.isin(status, GONE)
    errors[gone] = np.nan
    for i, run in enumerate(points[0]["runs"]):
        stroke, y, ringing = style.stroke_of(i + 1), errors[:, i], status[:, i] == "ringing"
        look: dict[str, Any] = {"color": stroke.colour, "marker": "osD^v"[i % 5], "markersize": 3.3}
        label = run.replace("_", " ").capitalize()
        panel.plot(x, y, linestyle=stroke.linestyle, linewidth=stroke.width, label=label, **look)
        panel.plot(x[ringing], y[ringing], linestyle="none", markerfacecolor="white", **look)
        height = np.full(gone[:, i].sum(), 0.97 - 0.07 * i)
        across = panel.get_xaxis_transform()
        panel.plot(x[gone[:, i]], height, "x", color=stroke.colour, transform=across)
    _set_scale(panel, "y", errors)


def _draw_ratios(panel: Axes, points: Points, x: Array, k: int) -> None:
    """Lines of the ratios, paler under a slow load."""
    for i, pair in enumerate(points[0]["ratio"]):
        ratio, slow = ([point[name][pair][k] for point in points] for name in ("ratio", "predicted_ratio"))
        colour, label = style.stroke_of(5 + i).colour, pair.upper().replace("_", "/")
        panel.plot(x, ratio, marker="os"[i], markersize=3.3, color=colour, label=label)
        panel.plot(x, slow, ":", marker="_", color=colour, alpha=0.5, label=f"{label}, slow load")
    panel.axhline(1.0, color="#999999", linewidth=0.4, zorder=0.5)


def _set_scale(panel: Axes, which: str, values: Array) -> None:
    seen = values[np.isfinite(values)]
    if not seen.size or seen.min() <= 0.0 or seen.max() <= _SPREAD * seen.min():
        return
    panel.set(**{f"{which}scale": "log"})
    axis = panel.xaxis if which == "x" else panel.yaxis
    axis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), major_formatter="{x:g}")
    axis.minorticks_off()


COURSE_NAMES = {"negative": "Negative", "distal_only": "Last joint alone", "alternating": "Alternating"}
"""Courses of tendon 4 as titles have them."""

_LEVELS = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
_BLUE, _PUSH, _FRICTION = "#004488", "#B5405A", "#CC8800"
_SHADES = [*(style.paler(_BLUE, white) for white in np.linspace(0.92, 0.12, len(_LEVELS) - 1)), _BLUE]


@style.journal_style()
def draw_margin(data: Mapping[str, Any], courses: Mapping[str, Any], origin: str) -> style.Drawing:
    """Smallest tension of any tendon: a column per course, a row per case."""
    reserve, ticks = data["reserve_N"], np.arange(0.0, 181.0, 45.0)
    cases = {"motor": "motor", "payload": f"{data['payload_kg']:g} kg", "spring": "spring"}
    figure = style.open_figure(style.PAGE_MM, 172.0)
    grid = figure.subplots(len(cases), len(courses), sharex=True, sharey=True)
    titles = [f"{COURSE_NAMES[course]}, {case}" for case in cases.values() for course in courses]
    panels = style.letter_panels(grid.flat, titles)
    drawn: Any = None
    for panel, (case, maps) in zip(panels.values(), product(cases, courses.values()), strict=True):
        # Rounding below zero is no push.
        least = np.where(np.abs(maps.least[case]) < SLACK, 0.0, maps.least[case])
        degrees, colours = np.linspace(0.0, 180.0, len(least)), [_PUSH, *_SHADES]
        drawn = panel.contourf(degrees, degrees, least, levels=_LEVELS, colors=colours, extend="both")
        for edge in maps.band if case == "motor" else ():
            if edge.min() < reserve < edge.max():
                panel.contour(degrees, degrees, edge, levels=[reserve], colors=_FRICTION, linewidths=0.9)
        panel.set(aspect="equal", xticks=ticks, yticks=ticks)
    before, last = data["joints"][-2:]
    for panel in grid[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in grid[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")
    label = "Smallest tension of any tendon (N)"
    figure.colorbar(drawn, ax=grid, shrink=0.6, aspect=25, pad=0.01, format="{x:g}", label=label)
    line = Line2D([], [], color=_FRICTION, linewidth=0.9, label=f"{reserve:g} N, with pulley friction")
    push = Patch(color=_PUSH, label="a tendon would have to push")
    figure.legend(handles=[line, push], loc="outside upper center", ncols=2)
    tendon, force, source = data["tensioning_tendon"], data["tensioner_force_N"], data["sources"]["force"]
    caption = (
        f"Smallest tension of any tendon at rest, by course of tendon {tendon}, which a motor pulls with "
        f"{force:g} N ({source}); spring: as hard at the start, "
        f"there stretched by {data['spring_stretch_mm']:g} mm. Orange: between the lines friction of the "
        f"guide pulleys, {100 * data['pulley_loss']:g} % each, decides on {reserve:g} N. {origin}."
    )
    held = ", ".join(f"{angle:g}°" for angle in data["map"]["held_link_angles_deg"]) or "held rigidly"
    posture = f"links before: {held}; link angles from hanging, at rest"
    return style.Drawing("statics_margin", figure, panels, caption, origin=posture)
