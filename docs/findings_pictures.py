"""The map of the orders, a picture of findings.md."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.configuration.published import COMPARED, published
from tendonrepro.configuration.models.readings import BOTH, STEPS
from tendonrepro.monte_carlo.shares import RATIOS, printed_ratios
from tendonrepro.reporting.figures import of_plants
from tendonrepro.reporting.contents import Shown
from tendonrepro.results.figures.style import PAGE_MM, Drawing, Look, journal_style, letter_panels, open_figure
from tendonrepro.results.summary import CONTROLLERS

_BLUE, _PALE, _RED, _GREY = "#004488", "#8FA3B8", "#B5405A", "#999999"

IN_MAP = {
    "printed": "as published",
    "Delta_unit=deg": "Δ in degrees",
    "gain_unit=phi_in_degrees": "φ in degrees",
    "weights=extrapolating": "(1 + α, −α)",
    BOTH: "Δ in degrees and (1 + α, −α)",
    "stored_torque=applied+output_delay=1": "applied torque, late",
    STEPS: "torque in steps",
}
"""Readings that have their name in the map; the others are small dots."""


_REGIONS = {
    (0.45, 0.82): "1, 2, 3",
    (0.45, 1.26): "1, 3, 2",
    (0.9, 1.26): "3, 1, 2",
    (1.5, 1.26): "3, 2, 1",
    (1.6, 0.82): "2, 3, 1",
    (1.08, 0.82): "2, 1, 3",
}
"""Orders of the controllers by their errors, the smallest first, and where their region has room."""

_MARKS = ("o", "s", "^", "v", "P", "X", "h")
"""Of the readings that have a name in the map."""


@journal_style()
def draw_map(shown: Shown, closest: Sequence[Mapping[str, Any]]) -> Drawing:
    """Draw the six orders over the two ratios that decide them, a panel a joint.

    ``closest`` are rows of Table 2 for the arm closest to it. Under a slow load no plant enters: the ratios
    are of the ages of the estimates, and of the softness of the surfaces.
    """
    figure = open_figure(PAGE_MM, 108.0)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for panel, joint in zip(panels, COMPARED, strict=True):
        _draw_regions(panel)
        alpha = published().number(f"gain.alpha.joint_{joint}")
        for age, label in ((1.0 - alpha, "1 ± α, by theory"), (1.0 + alpha, None)):
            panel.axvline(age, color=_BLUE, linewidth=0.7, linestyle="--", zorder=1.5, label=label)
        _draw_readings(panel, shown, joint)
        for metric, inside in (("mae", {}), ("rmse", {"markerfacecolor": "white"})):
            errors = {row["run"]: row[f"{metric}_deg"] for row in closest if row["joint"] == joint}
            sizes = [errors[name] for name in CONTROLLERS]
            simulated = [sizes[above] / sizes[below] for above, below in RATIOS.values()]
            look: Look = {"color": "black", "markersize": 3.6, "label": f"closest arm, {metric.upper()}"}
            panel.plot(*simulated, "D", **look | inside)
            printed = [printed_ratios(pair, metric, [joint])[0] for pair in RATIOS.values()]
            look = {"color": _RED, "markersize": 7.0, "label": f"Table 2, {metric.upper()}"}
            panel.plot(*printed, "*", **look | inside)
        panel.set_xlabel("error of Controller 1 over 2")
    letter_panels(panels, [f"Joint {joint}" for joint in COMPARED])
    panels[0].set_ylabel("error of Controller 2 over 3")
    named = dict(zip(*panels[0].get_legend_handles_labels()[::-1], strict=True))
    figure.legend(named.values(), named.keys(), loc="outside upper center", ncols=4)
    caption = (
        "The six orders of the controllers, the smallest error first, over the two ratios that decide them. "
        "A dot is an interpretation of the paper: median of the plants on which the controllers are stable. "
        "Stars are the mean absolute errors (MAE) and root mean square errors (RMSE) of Table 2, diamonds "
        "those of the simulated arm that comes closest. The tinted region has the published order. Where a "
        "load changes slowly, theory puts Controller 1 on the dashed lines."
    )
    return Drawing("map", figure, panels, caption, origin=of_plants(shown))


def _draw_regions(panel: Axes) -> None:
    across, upwards = (0.25, 2.0), (0.8, 1.3)
    _logarithmic(panel, "x", across, (0.3, 0.4, 0.6, 0.8, 1.0, 1.2, 1.6))
    _logarithmic(panel, "y", upwards, (0.8, 0.9, 1.0, 1.1, 1.2, 1.3))
    panel.fill_between((across[0], 1.0), upwards[0], 1.0, color="#E4EAF1", linewidth=0.0)
    even, diagonal = (1.0, 1.0), (1.0 / across[0], 1.0 / across[1])
    # The diagonal is straight, since both axes are logarithmic.
    for line in ((across, even), (even, upwards), (across, diagonal)):
        panel.plot(*line, color=_GREY, linewidth=0.6, zorder=1.0)
    for (x, y), order in _REGIONS.items():
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 1.0} if order != "1, 2, 3" else None
        panel.text(x, y, order, ha="center", va="center", color="#555555", fontsize=7, bbox=ground)


def _draw_readings(panel: Axes, shown: Shown, joint: int) -> None:
    """Draw a dot at the medians of each reading, and a mark of its own where one has a name."""
    medians = {
        name: (reading[f"c1_c2_joint_{joint}_median"], reading[f"c2_c3_joint_{joint}_median"])
        for name, reading in shown.box.items()
        if reading["plants"]
    }
    look: Look = {"linestyle": "", "marker": "o", "markeredgewidth": 0.0, "label": "interpretation, median"}
    panel.plot(*zip(*medians.values(), strict=True), color=_PALE, markersize=2.2, **look)
    for mark, (name, label) in zip(_MARKS, IN_MAP.items(), strict=True):
        if name in medians:
            panel.plot(*medians[name], mark, color=_BLUE, markersize=4.5, label=label, zorder=4.0)


def _logarithmic(panel: Axes, axis: str, limits: tuple[float, float], ticks: tuple[float, ...]) -> None:
    """Make an axis, ``x`` or ``y``, logarithmic, with these ticks alone."""
    panel.set(**{f"{axis}scale": "log", f"{axis}lim": limits})
    panel.set(**{f"{axis}ticks": ticks, f"{axis}ticklabels": [f"{tick:g}" for tick in ticks]})
    panel.minorticks_off()
