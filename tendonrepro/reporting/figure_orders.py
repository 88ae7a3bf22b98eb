"""The picture of the answer: how the three controllers rank under each way to understand the paper."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import Any

from matplotlib.axes import Axes

from tendonrepro.reporting.orders import AS_PUBLISHED, CHANGED, Orders, orders
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure

# Told apart in grey print by lightness: dark, light, lightest, middle.
_LOOKS = {
    "published": ("published order: 1, 2, 3", "#004488", "white"),
    "first": ("Controller 1 first", "#9CC3EA", "black"),
    "other": ("another order", "#EDEDED", "black"),
    "reverse": ("reverse order: 3, 2, 1", "#8A8A8A", "black"),
}
_LABELLED = 0.08
"""Shares from here on have their number in the bar."""


@journal_style()
def draw_orders(summary: Mapping[str, Any]) -> Drawing:
    """Draw the shares of the orders of a stored ensemble, a row for each reading that has a label.

    Parameters
    ----------
    summary : mapping
        Stored ensemble, as in ``docs/results/ensemble.json``.
    """
    groups = [found for labels in (AS_PUBLISHED, CHANGED) if (found := orders(summary, labels))]
    size = sum(map(len, groups))
    figure = open_figure(PAGE_MM, 22.0 + 5.6 * (size + len(groups)))
    panel = figure.subplots()
    place = 0.0
    for title, group in zip(("Equations as published", "Equations changed"), groups, strict=False):
        panel.text(0.0, place, title, fontsize=7.5, fontweight="bold", va="center")
        for row, one in enumerate(group, start=1):
            _draw_row(panel, place + row, one)
        place += len(group) + 1.15
    panel.set_ylim(place - 0.5, -0.6)
    panel.set_xlim(0.0, 1.0)
    panel.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "25", "50", "75", "100 %"])
    panel.set_yticks([])
    panel.spines["left"].set_visible(False)
    panel.set_xlabel("share of the plants on which all three controllers are stable")
    plants = summary["populations"]["box"]["plants"]
    panel.text(1.02, 0.0, f"stable plants\nof {plants:,}", fontsize=7, va="center")
    handles = [panel.barh(0.0, 0.0, color=colour, label=label) for label, colour, _ in _LOOKS.values()]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, handlelength=1.4)
    caption = (
        "Order of the three controllers by their tracking errors, from the smallest, under several ways to "
        "understand the paper. An order counts where it holds in MAE and RMSE on both joints."
    )
    return Drawing("orders", figure, [panel], caption)


def _draw_row(panel: Axes, place: float, found: Orders) -> None:
    panel.text(-0.01, place, found.label, ha="right", va="center", fontsize=8)
    panel.text(1.02, place, f"{found.plants:,}", va="center", fontsize=8)
    left = 0.0
    for name, share in found.shares.items():
        _, colour, ink = _LOOKS[name]
        panel.barh(place, share, 0.74, left=left, color=colour, edgecolor="white", linewidth=0.5)
        if share >= _LABELLED:
            middle = left + share / 2.0
            panel.text(
                middle, place, f"{100.0 * share:.0f} %", ha="center", va="center", color=ink, fontsize=7
            )
        left += share


def orders_svg(summary: Mapping[str, Any]) -> bytes:
    """The same picture as SVG."""
    drawn = draw_orders(summary)
    content = BytesIO()
    with journal_style():
        drawn.figure.savefig(content, format="svg", metadata={"Title": drawn.stem, "Date": None})
    return content.getvalue()
