"""The picture of the verdicts: which unknowns decide."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tendonrepro.console import count_of
from tendonrepro.results.figures.style import PAGE_MM, Drawing, journal_style, open_figure
from tendonrepro.verdicts.sensitivity import Influences

SHOWN = 12
"""Unknowns in the picture."""

_WORDS = {"table2": "Table 2", "table3": "Table 3", "mae": "MAE", "rmse": "RMSE"}
"""Parts of an outcome's name as a reader knows them."""


def draw_influences(rankings: Mapping[str, Influences], plants: int) -> Drawing:
    """Draw the strongest unknowns' shares of each outcome's variance, over a number of plants."""
    shares = {name: {row["name"]: row["index"] for row in parts["rows"]} for name, parts in rankings.items()}
    unknowns = sorted(
        next(iter(shares.values())), key=lambda name: -sum(parts[name] for parts in shares.values())
    )[:SHOWN]
    cells = np.array([[100.0 * parts[name] for parts in shares.values()] for name in unknowns])
    with journal_style():
        figure = open_figure(PAGE_MM, 48.0 + 5.0 * len(unknowns))
        axes = figure.subplots()
        axes.imshow(cells, cmap="Blues", vmin=0.0, vmax=60.0, aspect="auto")
        for (row, column), value in np.ndenumerate(cells):
            if value >= 1.0:
                ink = "white" if value > 35.0 else "black"
                axes.text(column, row, f"{value:.0f}", ha="center", va="center", fontsize=6, color=ink)
        axes.set_yticks(np.arange(len(unknowns)), unknowns)
        names = [
            ", ".join(_WORDS.get(part, part.replace("_", " ")) for part in name.split(".")) for name in shares
        ]
        axes.set_xticks(np.arange(len(shares)), names, rotation=60.0, ha="right", rotation_mode="anchor")
        axes.set_title("What decides each claim and number: share of the variance, %")
    caption = "Share of the variance of an outcome that an unknown explains alone."
    return Drawing("decides", figure, [axes], caption, f"Simulated, {count_of(plants, 'plant')} of the box")
