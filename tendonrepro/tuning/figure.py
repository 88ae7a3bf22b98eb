"""The picture of a tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

from matplotlib.axes import Axes

from tendonrepro.results.figures import style
from tendonrepro.tuning.search import TunedRow

KNOWN = {"none": "nothing known", "gravity": "weight known", "full": "model known"}
VELOCITY = {False: "velocity as measured", True: "velocity filtered"}
LEFT_OUT = {"dob", "alpha_published", "alpha_extrapolating"}  # their curves lie on those of special cases
MARKERS = "osD^vP"
FEW = 0.5  # share of plants below which a median is not drawn


@style.journal_style()
def draw_tuning(
    laws: Sequence[TunedRow], titles: Mapping[str, str], on: str = "the plants", gains: str = "published"
) -> style.Drawing:
    """Draw medians of error against torque roughness: a column for what is known, a row for the velocity.

    `on` says of which plants, for whoever made the picture, and `gains` whose the untuned ones are.
    """
    figure = style.open_figure(style.PAGE_MM, 134.0)
    grid = figure.subplots(len(VELOCITY), len(KNOWN), sharex=True, sharey=True)
    drawn = {law: title for law, title in titles.items() if law not in LEFT_OUT}
    conditions = list(product(VELOCITY, KNOWN))
    for panel, (filtered, knows) in zip(grid.flat, conditions, strict=True):
        condition = (knows, filtered)
        rows = [row for row in laws if (row["knows"], row["filtered"]) == condition]
        _draw(panel, [row for row in rows if row["share_stable"] >= FEW], drawn, gains)
    for panel, name in zip(grid[:, 0], VELOCITY.values(), strict=True):
        panel.set_ylabel(f"{name}\nmean absolute error (deg)")
    for panel in grid[-1]:
        panel.set_xlabel("torque roughness (N m)")
    style.letter_panels(grid.flat, [KNOWN[knows] for _, knows in conditions])
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    caption = (
        "Mean absolute error against torque roughness of every law at its best. Medians over the plants on "
        "which it has gains that are stable with half the tendon damping. Along a curve the cap on roughness "
        "changes. What is known is the arm's weight, its model, or nothing. "
        f"Stars have the {gains} gains, and along the grey line α changes. "
        "Each is over its own stable plants, so they do not rank each other."
    )
    return style.Drawing(
        "tune", figure, list(grid.flat), caption, origin=f"Simulated, tendonrepro tune, {on}"
    )


def _draw(panel: Axes, rows: Sequence[TunedRow], titles: Mapping[str, str], gains: str) -> None:
    def plot(own: Sequence[TunedRow], look: style.Look) -> None:
        panel.plot([row["roughness_Nm"] for row in own], [row["error_deg"] for row in own], **look)

    for number, (law, title) in enumerate(titles.items(), start=1):
        front = [row for row in rows if row["law"] == law and row["cap"] != "published"]
        look = style.stroke_of(number).line | {
            "marker": MARKERS[(number - 1) % len(MARKERS)],
            "markersize": 3.2,
        }
        plot(front, {"label": title, **look})
    published = [row for row in rows if row["cap"] == "published"]
    stars, curve = ([row for row in published if (row["alpha"] is None) == given] for given in (True, False))
    star = {"linestyle": "", "marker": "*", "color": "black", "markersize": 6}
    plot(stars, {**star, "label": f"{gains} gains"})
    plot(curve, {"color": "#BEBEBE", "linewidth": 2.2, "zorder": 1, "label": f"{gains} gains over α"})
    panel.set(xscale="log", yscale="log")
    panel.margins(0.06)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter("{x:g}")
