"""The picture of a tuning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from tendonrepro.configuration.models.control import FIRST, SECOND, THIRD
from tendonrepro.files import Json
from tendonrepro.results.figures import style
from tendonrepro.tuning.bench import KNOWN, PUBLISHED

PANELS = {PUBLISHED: "nothing known, velocity as measured", KNOWN: "model known, velocity filtered"}
LEFT_OUT = {"dob", "alpha_published", "alpha_extrapolating"}  # their curves lie on those of special cases
MARKERS = "osD^vP"
AS_RUN = {"alpha_free": FIRST, "ntsm": SECOND, "tsm": THIRD}
"""Laws that are a controller of the paper, tuned; they have its strokes."""
FEW = 0.5  # share of plants below which a median is not drawn


@style.journal_style()
def draw_tuning(
    laws: Sequence[Json], titles: Mapping[str, str], on: str = "the plants", gains: str = "published"
) -> style.Drawing:
    """Draw medians of error against torque roughness, a panel for each condition.

    `on` says of which plants, for whoever made the picture, and `gains` whose the untuned ones are.
    """
    figure = style.open_figure(style.PAGE_MM, 88.0)
    panels = figure.subplots(1, len(PANELS), sharex=True, sharey=True)
    drawn = {law: title for law, title in titles.items() if law not in LEFT_OUT}
    for panel, condition in zip(panels, PANELS, strict=True):
        rows = [row for row in laws if row["condition"] == condition and not row["alone"]]
        _draw(panel, [row for row in rows if row["share_stable"] >= FEW], drawn, gains)
        panel.set_xlabel("torque roughness (N m)")
    panels[0].set_ylabel("mean absolute error (deg)")
    style.letter_panels(panels, [*PANELS.values()])
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    caption = (
        "Mean absolute error against torque roughness of every law at its best. Medians over the plants on "
        "which it has gains that are stable with half the tendon damping. Along a curve the cap on roughness "
        f"changes. Stars have the {gains} gains, and along the grey line α changes. "
        "Each is over its own stable plants, so they do not rank each other."
    )
    return style.Drawing("tune", figure, list(panels), caption, origin=f"Simulated, tendonrepro tune, {on}")


def _draw(panel: Axes, rows: Sequence[Json], titles: Mapping[str, str], gains: str) -> None:
    def plot(own: Sequence[Json], look: style.Look) -> None:
        panel.plot([row["roughness_Nm"] for row in own], [row["error_deg"] for row in own], **look)

    best = [row for row in rows if row["alpha"] is None and row["cap"] != "published"]
    strokes = style.strokes_of(AS_RUN.get(law, law) for law in titles)
    for number, (law, title) in enumerate(titles.items()):
        mark = {"marker": MARKERS[number % len(MARKERS)], "markersize": 3.2}
        front = [row for row in best if row["law"] == law]
        plot(front, {"label": title, **strokes[AS_RUN.get(law, law)].line, **mark})
    published = [row for row in rows if row["cap"] == "published"]
    stars, curve = ([row for row in published if (row["alpha"] is None) == given] for given in (True, False))
    star = {"linestyle": "", "marker": "*", "color": "black", "markersize": 6}
    plot(stars, {**star, "label": f"{gains} gains"})
    plot(curve, {"color": "#BEBEBE", "linewidth": 2.2, "zorder": 1, "label": f"{gains} gains over α"})
    panel.set(xscale="log", yscale="log")
    panel.margins(0.06)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter("{x:g}")
