"""Figures of an ensemble: ratios and shares under each reading."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, NullLocator

from tendonrepro.monte_carlo.shares import RATIO_NAMES, RATIOS
from tendonrepro.results.figures.style import (
    PAGE_MM,
    SERIES,
    Drawing,
    journal_style,
    open_figure,
    save_drawing,
)

_ROW_MM = 4.2
_FRAME_MM = 26.0

_SHARES = {
    "share_c1_lt_c2_lt_c3": "C1 < C2 < C3",
    "share_c3_lt_c2_lt_c1": "C3 < C2 < C1",
    "share_c1_best": "C1 best",
}
_SETS = {"all_ok": "all three laws ok", "diverged_last": "diverged ranked last"}


def draw_ensemble_figures(summary: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw and save ratios and shares of every population, each as pdf, svg and png."""
    paths = []
    for name, held in summary["populations"].items():
        for draw in (draw_ratios, draw_shares):
            origin = f"Simulated, {held['plants']} plants of the population {name}"
            paths += save_drawing(draw(name, held), folder, origin)
    return paths


def draw_ratios(population: str, summary: Mapping[str, Any]) -> Drawing:
    """Ratios of MAE under each reading, against the printed ratio and that of slowly changing errors."""
    panels = [(key, joint) for key in RATIOS for joint in summary["joints"]]
    titles = [f"{RATIO_NAMES[key]}, joint {joint}" for key, joint in panels]

    def draw(axes: Sequence[Axes]) -> None:
        for panel, (key, joint) in zip(axes, panels, strict=True):
            _draw_ratio(panel, summary["readings"], key, f"joint_{joint}")
            panel.set_xlabel("ratio of MAE")
        marks = {line.get_label(): line for panel in axes for line in panel.lines}
        held = [line for label, line in marks.items() if not str(label).startswith("_")]
        axes[0].figure.legend(handles=held, loc="outside upper center", ncols=5)

    caption = (
        f"Ratio of the mean absolute errors on plants of the population {population} on which all three laws "
        "are ok, under each reading: median, central 50 % (thick) and 90 % (thin). Dashed: as printed. "
        "Cross: what errors that change slowly would give."
    )
    return rows_figure(f"ratios_{population}", titles, _names(summary), draw, caption)


def _names(summary: Mapping[str, Any]) -> list[str]:
    return [reading["name"] for reading in summary["readings"]]


def _draw_ratio(panel: Axes, readings: Sequence[Mapping[str, Any]], key: str, joint: str) -> None:
    stroke, printed = SERIES[0], float("nan")
    for row, reading in enumerate(readings):
        ratio = reading[key]["all_ok"]["mae"][joint]
        printed = ratio["printed"]
        if ratio["plants"] == 0:
            continue
        q05, q25, median, q75, q95 = (ratio[name]["value"] for name in ("q05", "q25", "median", "q75", "q95"))
        panel.plot([q05, q95], [row, row], color=stroke.colour, linewidth=0.7, label="central 90 %")
        panel.plot([q25, q75], [row, row], color=stroke.colour, linewidth=2.6, label="central 50 %")
        panel.plot(
            median, row, "o", color="white", markeredgecolor=stroke.colour, markersize=3.2, label="median"
        )
        if key == "ratio_c1_c2":
            theory = reading["theory"][joint]
            panel.plot(
                theory, row, "x", color="black", markersize=3.5, markeredgewidth=0.8, label="slow errors"
            )
    if np.isfinite(printed):
        panel.axvline(
            printed, color=SERIES[1].colour, linestyle=SERIES[1].linestyle, zorder=0.5, label="printed"
        )
    panel.margins(x=0.05)
    panel.axvline(1.0, color="#999999", linewidth=0.4, zorder=0.4)
    if any(reading[key]["all_ok"]["mae"][joint]["plants"] for reading in readings):
        panel.set_xscale("log")
        # Ratios are near 1, where ticks of a logarithmic axis are rare.
        panel.xaxis.set_major_locator(MaxNLocator(3))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_locator(NullLocator())


def draw_shares(population: str, summary: Mapping[str, Any]) -> Drawing:
    """Shares of the box on which the printed ranking holds, under each reading, with intervals."""

    def draw(axes: Sequence[Axes]) -> None:
        for panel, key in zip(axes, _SHARES, strict=True):
            for place, plants in enumerate(_SETS):
                shares = [reading[key][plants]["mae"]["both"] for reading in summary["readings"]]
                _draw_intervals(panel, shares, place)
            panel.set_xlim(-1.0, 101.0)
            panel.set_xlabel("share of the box (%)")
        axes[0].figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)

    caption = (
        f"Share of the population {population} on which the ranking holds in MAE on both joints, under each "
        "reading, with 95 % intervals from the scramblings: over plants on which all three laws are ok, and "
        "over those on which not all three diverge, a diverged law ranked last."
    )
    return rows_figure(f"shares_{population}", list(_SHARES.values()), _names(summary), draw, caption)


def _draw_intervals(panel: Axes, shares: Sequence[Mapping[str, Any]], place: int) -> None:
    known = [(row, share) for row, share in enumerate(shares) if share["share"] is not None]
    rows = np.array([row for row, _ in known])
    # A share without an interval stands there without a bar.
    values, low, high = 100.0 * np.array(
        [
            [share["share"] if share[key] is None else share[key] for _, share in known]
            for key in ("share", "low", "high")
        ]
    )
    panel.errorbar(
        values,
        rows + (0.18 if place else -0.18),
        xerr=np.array([values - low, high - values]),
        fmt="os"[place],
        markersize=3.0,
        linewidth=0.9,
        color=SERIES[place].colour,
        markerfacecolor="white" if place else SERIES[place].colour,
        label=list(_SETS.values())[place],
    )


def rows_figure(
    stem: str,
    titles: Sequence[str],
    rows: Sequence[str],
    draw: Callable[[Sequence[Axes]], None],
    caption: str,
) -> Drawing:
    """Draw panels with these titles side by side over rows with these names, the first on top."""
    with journal_style():
        figure = open_figure(PAGE_MM, _FRAME_MM + _ROW_MM * len(rows))
        axes = figure.subplots(1, len(titles), sharey=True, squeeze=False)[0]
        for panel, title in zip(axes, titles, strict=True):
            panel.set_title(title)
            panel.tick_params(axis="y", length=0.0)
            panel.grid(axis="y", color="#EEEEEE", linewidth=0.4)
            panel.set_axisbelow(True)
        draw(axes)
        axes[0].set_ylim(len(rows) - 0.4, -0.6)
        axes[0].set_yticks(range(len(rows)), rows, fontsize=6)
        return Drawing(stem, figure, tuple(axes), caption)
