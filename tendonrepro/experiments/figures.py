"""The figures of statics and of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from tendonrepro.arrays import Array
from tendonrepro.experiments.rig import start_angles
from tendonrepro.experiments.statics import COURSES, STRETCH, Survey
from tendonrepro.experiments.sweep import LASTED, Grid, Sweep, text_of
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures import style
from tendonrepro.results.summary import PAIRS

COURSE_NAMES = {"negative": "Negative", "distal_only": "Last joint alone", "alternating": "Alternating"}
"""Courses of tendon 4 as titles have them."""

_LEVELS = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
_BLUE, _PUSH = "#004488", "#B5405A"
_SHADES = [*(style.paler(_BLUE, white) for white in np.linspace(0.92, 0.12, len(_LEVELS) - 1)), _BLUE]


@style.journal_style()
def draw_statics(survey: Survey) -> style.Drawing:
    """Smallest tension of any tendon: a column per course, a row per case."""
    config, values = survey.loaded.config, {row["input"]: row["value"] for row in survey.inputs}
    cases = {"motor": "motor", "payload": f"{values['payload_kg']:g} kg", "spring": "spring"}
    figure = style.open_figure(style.PAGE_MM, 172.0)
    grid = figure.subplots(len(cases), len(COURSES), sharex=True, sharey=True)
    titles = [f"{COURSE_NAMES[course]}, {case}" for case in cases.values() for course in COURSES]
    panels = style.letter_panels(grid.flat, titles)
    ticks, colours = np.arange(0.0, 181.0, 45.0), [_PUSH, *_SHADES]
    for panel, (case, course) in zip(panels.values(), product(cases, COURSES), strict=True):
        tension = survey.maps[course, case]
        # Rounding below zero is no push.
        least = np.where(np.abs(tension) < SLACK, 0.0, tension)
        degrees = np.linspace(0.0, 180.0, len(least))
        drawn = panel.contourf(degrees, degrees, least, levels=_LEVELS, colors=colours, extend="both")
        panel.set(aspect="equal", xticks=ticks, yticks=ticks)
    before, last = config.joints[-2:]
    for panel in grid[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in grid[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")
    label = "Smallest tension of any tendon (N)"
    figure.colorbar(drawn, ax=grid, shrink=0.6, aspect=25, pad=0.01, format="{x:g}", label=label)
    figure.legend(
        handles=[Patch(color=_PUSH, label="a tendon would have to push")], loc="outside upper center"
    )
    caption = (
        f"Smallest tension of any tendon at rest, by course of tendon {config.manipulator.joints + 1}, which "
        f"a motor pulls with {values['force_N']:g} N; spring: as hard at the start, there stretched by "
        f"{1e3 * STRETCH:g} mm. {survey.loaded.origin} (sha256 {survey.loaded.sha256[:12]})."
    )
    angles = ", ".join(f"{angle:g}°" for angle in np.rad2deg(start_angles(config)[:-2]))
    posture = f"links before: {angles or 'held rigidly'}; link angles from hanging, at rest"
    return style.Drawing("statics_margin", figure, panels, caption, origin=posture)


@style.journal_style()
def draw_sweep(sweep: Sweep) -> style.Drawing:
    """MAE of every run above, ratios of the controllers below, a column per joint."""
    grid, joints, base = sweep.grid, sweep.grid.joints, sweep.grid.base
    pairs = [pair for pair in PAIRS if pair in sweep.points[0]]
    heights = ("MAE (deg)", "Ratio of MAE")[: 2 if pairs else 1]
    figure = style.open_figure(style.PAGE_MM, 48.0 * len(heights) + 16.0)
    panels = figure.subplots(len(heights), len(joints), sharex="col", squeeze=False)
    for k, joint in enumerate(joints):
        x = _set_values(panels[-1, k], grid, k)
        _draw_errors(panels[0, k], sweep, joint, x)
        for panel in panels[1:, k]:
            _draw_ratios(panel, sweep, joint, x, pairs)
    for panel, label in zip(panels[:, 0], heights, strict=True):
        panel.set_ylabel(label)
    letters = style.letter_panels(panels.flat, [f"Joint {joint}" for _ in heights for joint in joints])
    handles = [line for panel in panels[:, 0] for line in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper center", ncols=6, columnspacing=1.2)
    caption = (
        f"Mean absolute tracking error over the whole run under values of "
        f"{' and '.join(axis.key for axis in grid.axes)}. "
        "Open markers: ringing. Crosses: did not last. Ratios where both runs lasted. "
        f"Configuration {base.origin}, sweep {base.sha256[:12]}."
    )
    origin = f"Open: ringing; cross: did not last. Simulated, configuration {base.sha256[:8]}"
    return style.Drawing("sweep", figure, letters, caption, origin=origin)


def _set_values(panel: Axes, grid: Grid, k: int) -> Array:
    """Where the points stand along the axis of joint k, from 0: at their numbers, or side by side."""
    # Many joints leave no room for the keys below each panel.
    if len(grid.joints) < 3 or k == len(grid.joints) // 2:
        units = ("" if axis.unit in (None, "1") else f" ({axis.unit})" for axis in grid.axes)
        panel.set_xlabel(", ".join(axis.key + unit for axis, unit in zip(grid.axes, units, strict=True)))
    panel.margins(x=0.06)
    numbers = grid.axes[0].numbers
    if numbers is None:
        texts = [", ".join(map(text_of, point.values.values())) for point in grid.points]
        x = np.arange(len(texts), dtype=np.float64)
        panel.set_xticks(x, texts, rotation=45.0, ha="right")
        return x
    x = numbers[:, k]
    if x.min() > 0.0 and x.max() > 7.5 * x.min():
        panel.set_xscale("log")
        panel.xaxis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), major_formatter="{x:g}")
        panel.xaxis.minorticks_off()
    return x


def _draw_errors(panel: Axes, sweep: Sweep, joint: int, x: Array) -> None:
    """Lines of the runs: open markers where they ring, crosses where they did not last."""
    strokes, order = style.strokes_of(sweep.grid.runs), np.argsort(x)
    for i, run in enumerate(sweep.grid.runs):
        rows = [row for row in sweep.rows if (row["run"], row["joint"]) == (run, joint)]
        status = np.array([row["status"] for row in rows])
        mae = np.array([row["mae_deg"] for row in rows], dtype=np.float64)
        mae[~np.isin(status, LASTED)] = np.nan
        look = strokes[run].line | {"marker": "osD^v"[i % 5], "markersize": 3.3}
        label = run.replace("_", " ").capitalize()
        (line,) = panel.plot(x[order], mae[order], label=label, **look)
        if sweep.grid.axes[0].numbers is None:
            line.set_linestyle("none")
        ringing, gone = x[status == "ringing"], x[np.isnan(mae)]
        open_marker = {"linestyle": "none", "markerfacecolor": "white"}
        panel.plot(ringing, mae[status == "ringing"], **look | open_marker)
        height = np.full(gone.size, 0.97 - 0.07 * i)
        panel.plot(gone, height, "x", color=strokes[run].colour, transform=panel.get_xaxis_transform())


def _draw_ratios(panel: Axes, sweep: Sweep, joint: int, x: Array, pairs: Sequence[str]) -> None:
    """Lines of the ratios, in the strokes of their first runs."""
    strokes, order = style.strokes_of(()), np.argsort(x)
    for i, pair in enumerate(pairs):
        ratio = np.array([row[pair] for row in sweep.points if row["joint"] == joint], dtype=np.float64)
        look = strokes[PAIRS[pair][0]].line | {"marker": "PX"[i], "markersize": 4.0}
        (line,) = panel.plot(x[order], ratio[order], label=pair.upper().replace("_", "/"), **look)
        if sweep.grid.axes[0].numbers is None:
            line.set_linestyle("none")
    panel.axhline(1.0, color="#999999", linewidth=0.4, zorder=0.5)
