"""The picture of the predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.lines import Line2D

from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    journal_style,
    letter_panels,
    mark_cut,
    open_figure,
)

COLOURS = ["#004488", "#CC3311", "#DDAA00", "#228833", "#888888", "#55BBEE", "#8844BB", "#000000", "#AA7744"]
STYLES = tuple(zip(COLOURS, "os^Dos^Dv", strict=True))
"""Colour and marker of each interpretation; from the tenth on they come again, hollow."""
_LOWEST, _HIGHEST = 0.25, 4.0


@journal_style()
def draw_predictions(
    experiments: Sequence[Mapping[str, Any]], readings: Sequence[str], joints: Sequence[int]
) -> Drawing:
    """Draw ``experiments`` of ``predict.json``: ratios, median and central 90 %; a panel for each joint."""
    step = len(readings) + 1.5
    figure = open_figure(PAGE_MM, 24.0 + 1.7 * step * len(experiments))
    panels = figure.subplots(1, len(joints), squeeze=False, sharex=True, sharey=True)[0]
    for panel, joint in zip(panels, joints, strict=True):
        panel.axvline(1.0, color="#999999", linewidth=0.6)
        for group, experiment in enumerate(experiments):
            ratios = {row["reading"]: row for row in experiment["ratios"] if row["joint"] == joint}
            for place, reading in enumerate(readings):
                y, row = group * step + place, ratios[reading]
                low, median, high = (row[name] for name in ("low", "median", "high"))
                look = _look(place)
                colour = look["color"]
                panel.plot([low, high], [y, y], color=colour, linewidth=1.2, solid_capstyle="butt")
                panel.plot([median], [y], linestyle="", **look)
                mark_cut(panel, (low, high), y, (_LOWEST, _HIGHEST), colour)
        panel.set_xscale("log")
        panel.set_xlim(_LOWEST, _HIGHEST)
        ticks = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0)
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlabel("ratio of mean absolute errors")
    middle = 0.5 * (len(readings) - 1)
    panels[0].set_yticks(
        [group * step + middle for group in range(len(experiments))],
        [one["about"].replace(" over ", "\nover ") for one in experiments],
    )
    panels[0].set_ylim(step * len(experiments) - 1.0, -1.5)
    letter_panels(panels, [f"Joint {joint}" for joint in joints])
    handles = [Line2D([], [], label=reading, **_look(place)) for place, reading in enumerate(readings)]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    caption = (
        "What experiments on a bench would give under several ways to understand the paper. Ratio of mean "
        "errors, median and central 90 % of the plants on which both runs are stable. "
        "An arrow at the edge means that the range goes on."
    )
    return Drawing("predictions", figure, list(panels), caption, origin="Simulated, tendonrepro predict")


def _look(place: int) -> dict[str, Any]:
    """How the interpretation at a place is drawn."""
    turn, which = divmod(place, len(STYLES))
    colour, marker = STYLES[which]
    hollow = {"markerfacecolor": "white", "markeredgewidth": 0.7} if turn % 2 else {"markeredgewidth": 0.0}
    return {"color": colour, "marker": marker, "markersize": 2.8, **hollow}
