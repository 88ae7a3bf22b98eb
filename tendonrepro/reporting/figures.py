"""The picture of the answer, from a stored ensemble: how the controllers rank under each reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.configuration.shown import GROUPS, STARTS_APART
from tendonrepro.reporting.readings import Row, Shown
from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    Look,
    journal_style,
    open_figure,
)

# Told apart in grey print by lightness: dark, light, lightest, middle.
_LOOKS = {
    "published order: 1, 2, 3": ("#004488", "white"),
    "Controller 1 first, another order": ("#9CC3EA", "black"),
    "neither first nor last": ("#EDEDED", "black"),
    "Controller 1 last": ("#8A8A8A", "black"),
}
_LABELLED = 0.08
"""Shares from here on have their number in the bar."""


@journal_style()
def draw_orders(shown: Shown) -> Drawing:
    """Draw the shares of the orders, a row for each labelled reading."""
    rows: list[tuple[str, str]] = []
    for title, names in GROUPS.items():
        if labelled := [(label, name) for name, label in names.items() if name in shown.box]:
            rows += [(title, ""), *labelled]
    labels = [label for label, _ in rows]
    readings = [shown.box.get(name) for _, name in rows]
    figure = open_figure(PAGE_MM, 26.0 + 5.6 * len(rows))
    panel = figure.subplots()
    counts = [f"{reading['plants']:,.0f}" if reading else "" for reading in readings]
    counts[0] = f"stable plants\nof {shown.plants['box']:,}"
    panel.set(xlim=(0.0, 1.0), xticks=np.linspace(0.0, 1.0, 5), ylim=(len(rows) - 0.5, -0.6))
    panel.set_xlabel("share of the plants on which all three controllers are stable")
    panel.xaxis.set_major_formatter(lambda share, _: f"{100.0 * share:.0f} %")
    for axis, side, texts in ((panel, "left", labels), (panel.secondary_yaxis("right"), "right", counts)):
        axis.set_yticks(range(len(rows)), texts)
        axis.tick_params("y", length=0.0)
        axis.spines[side].set_visible(False)
    for tick in panel.get_yticklabels():
        tick.set_fontweight("bold" if tick.get_text() in GROUPS else "normal")
    shares = np.array([order_shares(reading) if reading else [0.0] * 4 for reading in readings]).T
    left = np.zeros(len(rows))
    for (label, (colour, ink)), share in zip(_LOOKS.items(), shares, strict=True):
        bars = panel.barh(range(len(rows)), share, 0.7, left=left, label=label, fc=colour, ec="white", lw=0.5)
        texts = [f"{100.0 * part:.0f} %" if part >= _LABELLED else "" for part in share]
        panel.bar_label(bars, texts, label_type="center", color=ink, fontsize=7)
        left += share
    _mark_without_start(panel, [name for _, name in rows], readings)
    # Bars first, in their order; matplotlib would begin with the marks.
    entries = sorted(
        zip(*panel.get_legend_handles_labels(), strict=True), key=lambda entry: entry[1] not in _LOOKS
    )
    figure.legend(
        *zip(*entries, strict=True), loc="outside upper center", ncols=3, handlelength=1.4, columnspacing=1.2
    )
    caption = (
        "How the three controllers rank by their tracking errors on the plants on which all three are "
        "stable, the smallest error first. Each row is one way to understand the paper, or one change to it. "
        "A place counts where it holds in mean absolute error (MAE) and root mean square error (RMSE) on "
        "both joints. Where runs start apart, diamonds are where dark grey begins without the first two "
        "seconds."
    )
    return Drawing("orders", figure, [panel], caption, origin=of_plants(shown))


def _mark_without_start(panel: Axes, names: Sequence[str], readings: Sequence[Row | None]) -> None:
    """Mark where the last bar of runs that start apart would begin without the first two seconds."""
    edges = [
        (1.0 - reading["late"], row)
        for row, (name, reading) in enumerate(zip(names, readings, strict=True))
        if reading and STARTS_APART in name.split("+") and reading["plants"]
    ]
    if edges:
        look: Look = {"markersize": 4.5, "mfc": "white", "mec": "black", "mew": 0.8}
        panel.plot(*zip(*edges, strict=True), "D", label="where “last” begins without the first 2 s", **look)


def order_shares(reading: Row) -> list[float]:
    """Shares of the four kinds of order; their sum is 1, or 0 without stable plants."""
    if not reading["plants"]:
        return [0.0] * len(_LOOKS)
    published, first, last = (reading[column] for column in ("order", "first", "last"))
    return [published, first - published, 1.0 - first - last, last]


def of_plants(shown: Shown) -> str:
    """What a picture says of its plants."""
    return f"Simulated, {shown.plants['box']:,} plants of the parameter ranges"
