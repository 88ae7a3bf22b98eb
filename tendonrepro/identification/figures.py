"""Figures of an identification, and of single edits: where they move the ratios of a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.configuration.models.control import run_in_words
from tendonrepro.files import Json
from tendonrepro.monte_carlo.figures import rows_figure
from tendonrepro.results.figures import style

NUMBERED = 5
"""Edits that have their rank beside their dots, the likeliest first."""

_EDGES = 0.6, 1.6
_TICKS = 0.6, 0.8, 1.0, 1.2, 1.6

_LOOKS: dict[bool, style.Look] = {
    True: {"color": style.SERIES[0].colour, "markersize": 3.6},
    False: {"color": "#888888", "markersize": 3.6, "markerfacecolor": "white"},
}
"""Of numbers that were fitted, and of others; in the colour of no controller."""


def draw_numbers(numbers: Sequence[Json], word: str, caption: str, origin: str) -> style.Drawing:
    """Every number over the printed or given one, of the best plant and of those that come near."""
    names = [
        f"{run_in_words(row['run'])}, {row['metric'].upper()} of joint {row['joint']}" for row in numbers
    ]

    def draw(axes: Sequence[Axes]) -> None:
        (panel,) = axes
        for place, row in enumerate(numbers):
            look = _LOOKS[bool(row["fitted"])]
            ends = np.array([row["lowest_deg"], row["highest_deg"]]) / row[f"{word}_deg"]
            panel.plot(ends, [place, place], color=look["color"], linewidth=2.2, solid_capstyle="butt")
            panel.plot(row["ratio"], place, "o", **look)
        for fitted in sorted({bool(row["fitted"]) for row in numbers}, reverse=True):
            label = "fitted" if fitted else "not fitted"
            panel.plot([], [], marker="o", linewidth=2.2, label=label, **_LOOKS[fitted])
        panel.axvline(1.0, color="black", linewidth=0.6, zorder=0.5)
        panel.margins(x=0.04)
        panel.set_xlabel(f"ours/{word}")

    return rows_figure("identify_numbers", [""], names, draw, caption, f"Simulated, fitted to {origin}")


def drawn_pairs(ratios: Sequence[Json]) -> list[tuple[int, int]]:
    """Places of the first two ratios of runs, by joint; none where fewer than three runs are compared."""
    of_joint: dict[object, list[int]] = {}
    for k, ratio in enumerate(ratios):
        if ratio["run"] != ratio["over_run"] and ratio["given"]:
            of_joint.setdefault(ratio["joint"], []).append(k)
    return [(places[0], places[1]) for places in of_joint.values() if len(places) > 1]


@style.journal_style()
def draw_edits(rows: Sequence[Json], ratios: Sequence[Json], plants: int) -> style.Drawing:
    """Draw every ranked edit over two ratios, a panel for each joint that has two; row 0 is no edit."""
    pairs = drawn_pairs(ratios)
    figure = style.open_figure(style.PAGE_MM, 78.0)
    panels = [*figure.subplots(1, len(pairs), squeeze=False)[0]]
    for panel, pair in zip(panels, pairs, strict=True):
        _draw_ratios(panel, rows, pair, [ratios[place] for place in pair])
    style.letter_panels(panels, [f"Joint {ratios[place]['joint']}" for place, _ in pairs])
    caption = (
        f"Every single edit that is stable on enough of {plants} plants, by two ratios of mean absolute "
        "errors (MAE). Dots are medians, the cross is without an edit, the star is the table. In the tinted "
        "region the runs rank as in the table. Numbers are the ranks of the likeliest edits."
    )
    return style.Drawing(
        "edits", figure, panels, caption, origin=f"Simulated, tendonrepro edits, {plants} plants"
    )


def _draw_ratios(panel: Axes, rows: Sequence[Json], pair: tuple[int, int], ratios: Sequence[Json]) -> None:
    table, (none, *edits) = [ratio["given"] for ratio in ratios], rows
    tinted = [(_EDGES[0], 1.0) if given < 1.0 else (1.0, _EDGES[1]) for given in table]
    panel.fill_between(tinted[0], *tinted[1], color="#F2E3E6", linewidth=0.0)
    ranked = sorted((row for row in edits if row["ranked"]), key=lambda row: row["rank"])
    shown = np.clip([[row["ratios"][place]["median"] for place in pair] for row in ranked], *_EDGES)
    dots: style.Look = {"markersize": 2.4, "alpha": 0.5, "markeredgewidth": 0.0, "clip_on": False}
    panel.plot(*shown.T, "o", color=style.SERIES[0].colour, **dots)
    for number, place in enumerate(shown[:NUMBERED], start=1):
        panel.annotate(str(number), place, textcoords="offset points", xytext=(2.5, 1.5), fontsize=6)
    if none["ranked"]:
        panel.plot(*(none["ratios"][place]["median"] for place in pair), "x", color="#000000", markersize=5.0)
    panel.plot(*table, "*", color=style.SERIES[1].colour, markersize=8.0)
    for axis, ratio in zip((panel.xaxis, panel.yaxis), ratios, strict=True):
        axis.set_label_text(f"{run_in_words(ratio['run'])} over {run_in_words(ratio['over_run'])}")
    panel.set(xscale="log", yscale="log", xlim=_EDGES, ylim=_EDGES)
    panel.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panel.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panel.minorticks_off()
