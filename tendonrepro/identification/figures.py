"""Figure of an identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.configuration.shown import run_in_words
from tendonrepro.files import Json
from tendonrepro.monte_carlo.figures import rows_figure
from tendonrepro.results.figures.style import SERIES, Drawing, Look

_LOOKS: dict[bool, Look] = {
    True: {"color": SERIES[0].colour, "markersize": 3.6},
    False: {"color": "#888888", "markersize": 3.6, "markerfacecolor": "white"},
}
"""Of numbers that were fitted, and of others; in the colour of no controller."""


def draw_numbers(numbers: Sequence[Json], word: str, caption: str, origin: str) -> Drawing:
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
