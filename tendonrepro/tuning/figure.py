"""The picture of a tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from matplotlib.axes import Axes

from tendonrepro.results.figures import style

KNOWN = {"none": "nothing known", "gravity": "weight known", "full": "model known"}
LEFT_OUT = {"dob", "alpha_published", "alpha_extrapolating"}  # their curves lie on those of special cases
FEW = 0.5  # share of plants below which a median is not drawn


@style.journal_style()
def draw_tuning(laws: Sequence[Mapping[str, Any]], titles: Mapping[str, str]) -> style.Drawing:
    """Draw medians of error against torque roughness, a panel for each class of knowledge."""
    figure = style.open_figure(style.PAGE_MM, 88.0)
    panels = figure.subplots(1, len(KNOWN), squeeze=False, sharex=True, sharey=True)[0]
    drawn = {law: title for law, title in titles.items() if law not in LEFT_OUT}
    for panel, knows in zip(panels, KNOWN, strict=True):
        _draw(panel, [row for row in laws if row["knows"] == knows and row["share_stable"] >= FEW], drawn)
    panels[0].set_ylabel("mean absolute error (deg)")
    style.letter_panels(panels, KNOWN.values())
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=5)
    caption = (
        "Every law at its best: mean absolute error against torque roughness, medians over the plants on "
        "which it has gains that are stable with half the tendon damping. Along a curve the cap on roughness "
        "changes."
    )
    return style.Drawing("tune", figure, list(panels), caption)


def _draw(panel: Axes, rows: Sequence[Mapping[str, Any]], titles: Mapping[str, str]) -> None:
    def plot(own: Sequence[Mapping[str, Any]], **look: Any) -> None:
        panel.plot([row["roughness_Nm"] for row in own], [row["error_deg"] for row in own], **look)

    for (number, law), filtered in product(enumerate(titles, start=1), (False, True)):
        front = [row for row in rows if (row["law"], row["filtered"]) == (law, filtered)]
        mark = (
            {"marker": "s", "markerfacecolor": "white"} if filtered else {"marker": "o", "label": titles[law]}
        )
        plot(front, **style.stroke_of(number).line | mark | {"linewidth": 0.7, "markersize": 2.6})
    panel.plot([], [], "s", color="black", markersize=2.6, fillstyle="none", label="velocity filtered")
    published = [row for row in rows if row["cap"] == "published" and not row["filtered"]]
    stars, curve = ([row for row in published if (row["alpha"] is None) == given] for given in (True, False))
    plot(stars, linestyle="", marker="*", color="black", markersize=5, label="published gains")
    plot(curve, color="#BEBEBE", linewidth=2.2, zorder=1, label="the same over α")
    panel.set(xscale="log", yscale="log", xlabel="torque roughness (N m)")
