"""How far plausible plants spread: two ratios of errors under each interpretation, beside Table 2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tendonrepro.configuration.published import published
from tendonrepro.reporting.orders import AS_PUBLISHED, CHANGED
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, letter_panels, open_figure

_BLUE, _RED = "#004488", "#B5405A"


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
