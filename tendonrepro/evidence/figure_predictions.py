"""The picture of the predictions."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from textwrap import fill

from matplotlib.lines import Line2D

from tendonrepro.configuration.models.readings import PRINTED, in_words
from tendonrepro.files import Json
from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    Look,
    journal_style,
    letter_panels,
    mark_cut,
    open_figure,
)

COLOURS = ["#004488", "#CC3311", "#DDAA00", "#228833", "#888888", "#55BBEE", "#8844BB", "#000000", "#AA7744"]
STYLES = tuple(zip(COLOURS, "os^Dos^Dv", strict=True))
"""Colour and marker of each interpretation; from the tenth on they come again, hollow."""
_LOWEST, _HIGHEST = 0.25, 4.0
_TALLEST_MM, _AROUND_MM, _ENTRY_MM = 240.0, 22.0, 3.3
"""Height of the picture, so that an A4 page has room for its caption; of the axis, and of a legend's line."""
_ROW_MM, _LINE_MM = 1.7, 3.2
"""Distance of two bars where there is room; and of two lines that say what an experiment is."""
_ABOUT = 30
"""Letters of a line that says what an experiment is."""
_ROOMY = 3
"""So many panels side by side have room for every tick."""


@journal_style()
def draw_predictions(
    experiments: Sequence[Json],
    readings: Sequence[str],
    joints: Sequence[int],
    told: str = "",
) -> Drawing:
    """Draw ``experiments`` of ``predict.json``: ratios, median and central 90 %; a panel for each joint.

    `told` says around which arm of a user's own plants lie.
    """
    step = len(readings) + 1.5
    around = _AROUND_MM + _ENTRY_MM * ceil(len(readings) / 2)
    labels = ["\n".join(fill(part, _ABOUT) for part in _parts(shown["about"])) for shown in experiments]
    of_labels = _LINE_MM * max(label.count("\n") + 1 for label in labels) / step
    row_mm = min(max(_ROW_MM, of_labels), (_TALLEST_MM - around) / (step * len(experiments)))
    figure = open_figure(PAGE_MM, around + row_mm * step * len(experiments))
    size = min(row_mm / _ROW_MM, 1.0)
    panels = figure.subplots(1, len(joints), squeeze=False, sharex=True, sharey=True)[0]
    for panel, joint in zip(panels, joints, strict=True):
        panel.axvline(1.0, color="#999999", linewidth=0.6)
        for group, experiment in enumerate(experiments):
            if group % 2:
                panel.axhspan(group * step - 1.25, (group + 1) * step - 1.25, color="#F2F2F2", linewidth=0.0)
            ratios = {row["reading"]: row for row in experiment["ratios"] if row["joint"] == joint}
            for place, reading in enumerate(readings):
                y, row = group * step + place, ratios[reading]
                low, median, high = (row[name] for name in ("low", "median", "high"))
                look = _look(place, max(size, 0.6))
                colour = look["color"]
                panel.plot([low, high], [y, y], color=colour, linewidth=1.2 * size, solid_capstyle="butt")
                panel.plot([median], [y], linestyle="", **look)
                mark_cut(panel, (low, high), y, (_LOWEST, _HIGHEST), colour)
        panel.set_xscale("log")
        panel.set_xlim(_LOWEST, _HIGHEST)
        ticks = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 4.0) if len(joints) <= _ROOMY else (0.25, 1.0, 4.0)
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlabel("ratio of MAE")
    middle = 0.5 * (len(readings) - 1)
    panels[0].set_yticks([group * step + middle for group in range(len(experiments))], labels)
    panels[0].set_ylim(step * len(experiments) - 1.0, -1.5)
    letter_panels(panels, [f"Joint {joint}" for joint in joints])
    handles = [
        Line2D([], [], label=_in_words(reading, experiments, told), **_look(place))
        for place, reading in enumerate(readings)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    caption = (
        "What experiments on a bench would give under several ways to understand the paper. Ratio of mean "
        "absolute errors (MAE), median and central 90 % of the plants on which both runs are stable. "
        "An arrow at the edge means that the range goes on."
    )
    origin = f"Simulated, plants {told}" if told else "Simulated, tendonrepro predict"
    return Drawing("predictions", figure, list(panels), caption, origin=origin)


def _in_words(reading: str, experiments: Sequence[Json], told: str) -> str:
    """What the legend calls an interpretation, and whether its errors are of motors."""
    words = "as in your comparison" if told and reading == PRINTED else in_words(reading)
    # Results from before the end of November 2026 do not say it, but for the interpretation's name.
    of_motors = any(
        row.get("errors_of") == "motors"
        for experiment in experiments
        for row in experiment["ratios"]
        if row["reading"] == reading
    )
    return f"{words}, errors of motors" if of_motors and "motors" not in words else words


def _parts(about: str) -> list[str]:
    """What is divided, and what it is divided by."""
    return about.replace(" over ", "\nover ").split("\n")


def _look(place: int, size: float = 1.0) -> Look:
    """How the interpretation at a place is drawn."""
    turn, which = divmod(place, len(STYLES))
    colour, marker = STYLES[which]
    hollow = {"markerfacecolor": "white", "markeredgewidth": 0.7} if turn % 2 else {"markeredgewidth": 0.0}
    return {"color": colour, "marker": marker, "markersize": 2.8 * size, **hollow}
