"""Pictures of findings.md alone: the map of the six orders, and how far plausible plants spread.

On the map each interpretation lies between the orders, by theory and by the runs. Under a load that changes
slowly two numbers decide the order, and no plant enters: how much older Controller 1's estimate is than
Controller 2's, and how much softer Controller 2's surface is than Controller 3's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import COMPARED, published
from tendonrepro.reporting.orders import AS_PUBLISHED, CHANGED
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, letter_panels, open_figure

LABELS = {
    "printed": ("as published", 5.0),
    "Delta_unit=deg": ("Δ in degrees", 5.0),
    "gain_unit=phi_in_degrees": ("φ in degrees", 5.0),
    "weights=extrapolating": ("(1 + α, −α)", -5.0),
    "weights=extrapolating+Delta_unit=deg": ("both", -5.0),
    "stored_torque=applied+output_delay=1": ("applied\ntorque,\nlate", 5.0),
    "Delta_unit=deg+stored_torque=applied+torque_step=0.016": ("torque in steps", -5.0),
}
"""Readings that have their name in the picture, and on which side, pt; the others are small dots."""

_ACROSS, _UPWARDS = (0.35, 2.0), (0.8, 1.3)
_ORDERS = {
    (0.45, 0.82): "1, 2, 3",
    (0.45, 1.26): "1, 3, 2",
    (0.9, 1.26): "3, 1, 2",
    (1.5, 1.26): "3, 2, 1",
    (1.6, 0.82): "2, 3, 1",
    (1.08, 0.82): "2, 1, 3",
}
"""Orders of the controllers by their errors, the smallest first, and where their region has room."""

_BLUE, _PALE, _RED = "#004488", "#8FA3B8", "#B5405A"


@journal_style()
def draw_map(summary: Mapping[str, Any]) -> Drawing:
    """Draw the six orders over the two ratios, a panel for each joint.

    Parameters
    ----------
    summary : mapping
        Stored ensemble, as in ``docs/results/ensemble.json``.
    """
    figure = open_figure(PAGE_MM, 88.0)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, joint in zip(panels, COMPARED, strict=True):
        _draw_regions(panel)
        alpha = published().per_joint("gain.alpha", (joint,))[0]
        for age in (1.0 - alpha, 1.0 + alpha):
            panel.axvline(age, color=_BLUE, linewidth=0.7, linestyle="--", zorder=1.5)
        for reading, ratios in medians(summary, joint):
            _draw_reading(panel, reading, *ratios)
        look = {"color": _RED, "markersize": 7.0, "markeredgewidth": 0.0, "zorder": 5.0}
        panel.plot(*printed_ratios(joint), "*", **look)
        panel.set_xlabel("error of Controller 1 over 2")
    letter_panels(panels, [f"Joint {joint}" for joint in COMPARED])
    panels[0].set_ylabel("error of Controller 2 over 3")
    handles = [
        Line2D([], [], linestyle="", marker="o", color=_BLUE, markersize=3.5, label="interpretation, median"),
        Line2D([], [], color=_BLUE, linewidth=0.7, linestyle="--", label="1 ± α, by theory"),
        Line2D([], [], linestyle="", marker="*", color=_RED, markersize=7.0, label="Table 2 (MAE, RMSE)"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3)
    caption = (
        "Order of the three controllers over the two ratios that decide it; on a solid line two errors are "
        "equal. A dot is the median of an ensemble's runs under one interpretation. Dashed: the ratio of the "
        "ages of the estimates, 1 + α as Eq. (15) is published, 1 − α with its sign changed. The region of "
        "the published order is tinted."
    )
    return Drawing("map", figure, list(panels), caption)


def medians(summary: Mapping[str, Any], joint: int) -> Iterator[tuple[str, Array]]:
    """Median MAE of Controller 1 over 2 and of 2 over 3, (2,), by reading, where plants are stable."""
    for held in summary["populations"]["box"]["readings"]:
        found = [held[pair][f"joint_{joint}"]["median"] for pair in ("c1_c2", "c2_c3")]
        if None not in found:
            yield held["name"], np.array(found, dtype=np.float64)


def printed_ratios(joint: int) -> Array:
    """The same ratios from Table 2, first those of Controllers 1 and 2, in MAE and in RMSE, (2, 2)."""
    paper = published()
    errors = np.array(
        [
            [paper.number(f"table2.controller_{k}.{metric}.joint_{joint}") for metric in ("mae", "rmse")]
            for k in (1, 2, 3)
        ],
        dtype=np.float64,
    )
    return np.asarray(errors[:-1] / errors[1:])


def _draw_regions(panel: Axes) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlim(*_ACROSS)
    panel.set_ylim(*_UPWARDS)
    panel.set_xticks([0.4, 0.6, 0.8, 1.0, 1.2, 1.6], ["0.4", "0.6", "0.8", "1", "1.2", "1.6"])
    panel.set_yticks([0.8, 0.9, 1.0, 1.1, 1.2, 1.3], ["0.8", "0.9", "1", "1.1", "1.2", "1.3"])
    panel.minorticks_off()
    x = np.geomspace(*_ACROSS, 200)
    panel.fill_between(x, _UPWARDS[0], 1.0, where=(x <= 1.0).tolist(), color="#E4EAF1", linewidth=0.0)
    for line in ((x, np.ones_like(x)), (np.ones_like(x), np.geomspace(*_UPWARDS, 200)), (x, 1.0 / x)):
        panel.plot(*line, color="#999999", linewidth=0.6, zorder=1.0)
    for (across, upwards), order in _ORDERS.items():
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 1.0} if across > 0.5 else None
        panel.text(across, upwards, order, ha="center", va="center", color="#555555", fontsize=7, bbox=ground)


def _draw_reading(panel: Axes, reading: str, x: float, y: float) -> None:
    named = reading in LABELS
    size, colour, above = (3.8, _BLUE, 4.0) if named else (2.2, _PALE, 3.0)
    panel.plot([x], [y], "o", color=colour, markersize=size, markeredgewidth=0.0, zorder=above)
    if named:
        text, side = LABELS[reading]
        look: dict[str, Any] = {"ha": "left" if side > 0.0 else "right", "va": "center", "fontsize": 6.5}
        panel.annotate(text, (x, y), xytext=(side, 0.0), textcoords="offset points", zorder=6.0, **look)


@journal_style()
def draw_ranges(summary: Mapping[str, Any]) -> Drawing:
    """Draw two ratios that need no scale: Controller 1 over 2 on joint 2, and joint 3 over joint 2.

    Parameters
    ----------
    summary : mapping
        Stored ensemble, as in ``docs/results/ensemble.json``.
    """
    stored = {held["name"]: held for held in summary["populations"]["box"]["readings"]}
    labels = {name: label for name, label in (AS_PUBLISHED | CHANGED).items() if name in stored}
    figure = open_figure(PAGE_MM, 26.0 + 5.0 * len(labels))
    panels = figure.subplots(1, 2, sharey=True)
    paper = published().number
    names = [f"table2.controller_{k}.mae.joint_{joint}" for k, joint in ((1, 2), (2, 2), (1, 3), (1, 2))]
    printed = (paper(names[0]) / paper(names[1]), paper(names[2]) / paper(names[3]))
    for row, name in enumerate(labels):
        held = stored[name]
        _draw_range(panels[0], row, held["c1_c2"]["joint_2"])
        _draw_range(panels[1], row, held["joint_3_over_2"]["controller_1"])
    ticks = ((0.3, 0.4, 0.6, 0.8, 1.0, 1.4), (0.05, 0.1, 0.2, 0.4, 0.8))
    for panel, value, places in zip(panels, printed, ticks, strict=True):
        panel.axvline(value, color=_RED, linewidth=1.0, linestyle="--")
        panel.set_xscale("log")
        panel.set_xlim(0.8 * places[0], 1.3 * places[-1])
        panel.set_xticks(places, [f"{place:g}" for place in places])
        panel.minorticks_off()
    panels[0].axvline(1.0, color="#999999", linewidth=0.6)
    panels[0].set_yticks(range(len(labels)), [*labels.values()])
    panels[0].invert_yaxis()
    letter_panels(panels, ["Controller 1 over 2, joint 2", "Joint 3 over joint 2, Controller 1"])
    for panel in panels:
        panel.set_xlabel("ratio of mean absolute errors")
    handles = [
        Line2D([], [], color=_BLUE, marker="o", markersize=3.5, label="stable plants: median and 90 %"),
        Line2D([], [], color=_RED, linestyle="--", label="Table 2"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    caption = (
        "Two ratios of errors under several ways to understand the paper: median and central 90 % of the "
        "plants on which all three controllers are stable. Dashed: the same ratio from Table 2."
    )
    return Drawing("ranges", figure, list(panels), caption)


def _draw_range(panel: Axes, row: int, found: Mapping[str, float | None]) -> None:
    low, middle, high = (found[key] for key in ("q05", "median", "q95"))
    if low is None or middle is None or high is None:
        return
    panel.plot([low, high], [row, row], color=_BLUE, linewidth=1.4, solid_capstyle="butt")
    panel.plot([middle], [row], "o", color=_BLUE, markersize=3.5)
