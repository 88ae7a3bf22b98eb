"""The map of the answer: where each interpretation lies between the six orders, by theory and by the runs.

Under a load that changes slowly two numbers decide the order, and no plant enters: how much older Controller
1's estimate is than Controller 2's, and how much softer Controller 2's surface is than Controller 3's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import COMPARED, published
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
