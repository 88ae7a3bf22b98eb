"""The picture of a tuning: error against torque roughness, a panel for each class of knowledge."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

from matplotlib.lines import Line2D

from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    journal_style,
    letter_panels,
    open_figure,
    stroke_of,
)

KNOWN = {"none": "nothing known", "gravity": "weight known", "full": "model known"}
LEFT_OUT = {"dob", "alpha_published", "alpha_extrapolating", "controller_1", "controller_2", "controller_3"}
"""Laws without a curve: they lie on those of their special cases, or have published gains."""
FEW = 0.5
"""Share of plants below which a median is not drawn."""


@journal_style()
def draw_tuning(laws: Sequence[Mapping[str, Any]], titles: Mapping[str, str]) -> Drawing:
    """Draw medians over plants: every law's front, the published gains, and Controller 2's over alpha."""
    figure = open_figure(PAGE_MM, 88.0)
    panels = figure.subplots(1, len(KNOWN), squeeze=False, sharex=True, sharey=True)[0]
    strokes = {law: stroke_of(k) for k, law in enumerate((x for x in titles if x not in LEFT_OUT), start=1)}
    for panel, knows in zip(panels, KNOWN, strict=True):
        for (law, stroke), filtered in product(strokes.items(), (False, True)):
            front = _points(laws, law=law, knows=knows, filtered=filtered)
            face = "white" if filtered else stroke.colour
            style = {"color": stroke.colour, "linestyle": stroke.linestyle, "linewidth": 0.7}
            panel.plot(*front, marker="s" if filtered else "o", markersize=2.6, markerfacecolor=face, **style)
        panel.plot(
            *_points(laws, law="controller_2", knows=knows, curve=True), color="#BEBEBE", linewidth=2.2
        )
        for name in ("controller_1", "controller_2", "controller_3"):
            panel.plot(
                *_points(laws, law=name, knows=knows, filtered=False), "*", color="black", markersize=5
            )
        panel.set(xscale="log", yscale="log", xlabel="torque roughness (N m)")
    panels[0].set_ylabel("mean absolute error (deg)")
    letter_panels(panels, KNOWN.values())
    marks = [
        Line2D([], [], color=stroke.colour, linestyle=stroke.linestyle, label=titles[law])
        for law, stroke in strokes.items()
    ]
    marks += [
        Line2D([], [], color="black", marker="o", linestyle="", markersize=2.6, label="velocity as measured"),
        Line2D(
            [],
            [],
            color="black",
            marker="s",
            linestyle="",
            markersize=2.6,
            fillstyle="none",
            label="filtered",
        ),
        Line2D([], [], color="black", marker="*", linestyle="", markersize=5, label="published gains"),
        Line2D([], [], color="#BEBEBE", linewidth=2.2, label="the same over α"),
    ]
    figure.legend(handles=marks, loc="outside upper center", ncols=5)
    caption = (
        "Every law at its best: mean absolute error against torque roughness, medians over the plants on "
        "which it has gains that are stable with half the tendon damping. Along a curve the cap on roughness "
        "changes."
    )
    return Drawing("tune", figure, list(panels), caption)


def _points(laws: Sequence[Mapping[str, Any]], *, curve: bool = False, **key: Any) -> list[list[float]]:
    """Roughness and error of the rows with these values, those over alpha where a curve is asked for."""

    def wanted() -> Iterator[tuple[float, float]]:
        for row in laws:
            is_own = all(row[name] == value for name, value in key.items())
            if is_own and (row["alpha"] is not None) == curve and row["share_stable"] >= FEW:
                yield row["roughness_Nm"], row["error_deg"]

    return [list(values) for values in zip(*wanted(), strict=True)] or [[], []]
