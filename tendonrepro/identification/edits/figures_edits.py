"""The picture of single edits: where they move the ratios of a table, and how likely they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.configuration.shown import run_in_words
from tendonrepro.files import Json
from tendonrepro.results.figures.style import (
    PAGE_MM,
    SERIES,
    Drawing,
    journal_style,
    letter_panels,
    open_figure,
)

NAMED, NUMBERED = 12, 5
"""Edits that have a bar, and those that have their number beside their dots, the likeliest first."""
_ROW_MM, _MAP_MM, _FRAME_MM, _LETTERS = 5.0, 72.0, 24.0, 44
_EDGES = 0.6, 1.6
_TICKS = 0.6, 0.8, 1.0, 1.2, 1.6
_EDIT, _NONE, _TABLE = SERIES[0].colour, "#000000", SERIES[1].colour

EditRows: TypeAlias = Sequence[Json]


@journal_style()
def draw_edits(rows: EditRows, ratios: EditRows, factor: float, plants: int) -> Drawing:
    """Draw every ranked edit over two ratios by joint, and the likeliest with their names; row 0 is none."""
    ranked = sorted((row for row in rows[1:] if row["ranked"]), key=lambda row: row["rank"])
    pairs = _pairs(ratios)
    heights = [_MAP_MM] * bool(pairs) + [_FRAME_MM + _ROW_MM * NAMED]
    figure = open_figure(PAGE_MM, sum(heights))
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)
    maps = [*parts[0, 0].subplots(1, len(pairs), squeeze=False)[0]] if pairs else []
    for panel, pair in zip(maps, pairs, strict=True):
        _draw_map(panel, rows[0], ranked, pair, ratios)
    bars = parts[-1, 0].subplots()
    _draw_likeliest(bars, ranked[:NAMED], factor)
    panels = [*maps, bars]
    joints = [f"Joint {ratios[pair[0]]['joint']}" for pair in pairs]
    letter_panels(panels, [*joints, "The likeliest edits"])
    caption = (
        f"Every single edit that is stable on enough of {plants} plants, by two ratios of mean absolute "
        "errors (MAE). Dots are medians, the cross is without an edit, the star is the table. In the tinted "
        "region the runs rank as in the table. Numbers are those of the bars. A bar is an edit's likelihood "
        "over that of no edit, and at its right the share of its stable plants with the order of the table. "
        f"An edit is named from a factor of {factor:,.0f} on, the dashed line."
    )
    return Drawing("edits", figure, panels, caption, origin=f"Simulated, tendonrepro edits, {plants} plants")


def _pairs(ratios: Sequence[Mapping[str, object]]) -> list[tuple[int, int]]:
    """Places of the first two ratios of runs, by joint; none where fewer than three runs are compared."""
    of_joint: dict[object, list[int]] = {}
    for k, ratio in enumerate(ratios):
        if ratio["run"] != ratio["over_run"] and ratio["given"]:
            of_joint.setdefault(ratio["joint"], []).append(k)
    return [(places[0], places[1]) for places in of_joint.values() if len(places) > 1]


def _draw_map(panel: Axes, none: Json, ranked: EditRows, pair: tuple[int, int], ratios: EditRows) -> None:
    first, second = (ratios[place] for place in pair)
    tinted = [(_EDGES[0], 1.0) if ratio["given"] < 1.0 else (1.0, _EDGES[1]) for ratio in (first, second)]
    panel.fill_between(tinted[0], *tinted[1], color="#F2E3E6", linewidth=0.0)
    shown = np.array([[row["ratios"][place]["median"] for place in pair] for row in ranked])
    inside = np.clip(shown.reshape(-1, 2), *_EDGES)
    panel.plot(*inside.T, "o", color=_EDIT, markersize=2.4, alpha=0.5, markeredgewidth=0.0, clip_on=False)
    for number, place in enumerate(inside[:NUMBERED], start=1):
        panel.annotate(str(number), place, textcoords="offset points", xytext=(2.5, 1.5), fontsize=6)
    if none["ranked"]:
        panel.plot(*(none["ratios"][place]["median"] for place in pair), "x", color=_NONE, markersize=5.0)
    panel.plot(first["given"], second["given"], "*", color=_TABLE, markersize=8.0)
    for axis, ratio in ((panel.xaxis, first), (panel.yaxis, second)):
        axis.set_label_text(f"{run_in_words(ratio['run'])} over {run_in_words(ratio['over_run'])}")
    panel.set(xscale="log", yscale="log", xlim=_EDGES, ylim=_EDGES)
    panel.set_xticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panel.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    panel.minorticks_off()


def _draw_likeliest(panel: Axes, ranked: EditRows, factor: float) -> None:
    y = range(len(ranked))
    sizes = [row["log10_likelihood_ratio"] for row in ranked]
    panel.barh(y, sizes, color=_EDIT, height=0.6)
    most = max([*sizes, np.log10(factor)])
    for place, row in enumerate(ranked):
        if row["order_share"] is not None:
            panel.text(1.04 * most, place, f"{100.0 * row['order_share']:.0f} %", va="center", fontsize=6)
    panel.axvline(np.log10(factor), **SERIES[1].line)
    names = [f"{number} {fill(row['edit'], _LETTERS)}" for number, row in enumerate(ranked, start=1)]
    panel.set_yticks(y, names, fontsize=6)
    panel.set_title("share with the order of the table", loc="right", fontsize="small")
    panel.set_ylim(len(ranked) - 0.4, -0.6)
    panel.set_xlim(min([0.0, *sizes]), 1.15 * most)
    panel.set_xlabel("log10 of the likelihood over that of no edit")
