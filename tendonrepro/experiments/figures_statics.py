"""The map of tensions over the angles of the last two links."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.contour import QuadContourSet
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tendonrepro.experiments.rig import start_angles
from tendonrepro.experiments.statics import RESERVE, STRETCH, Survey
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures import style

COURSE_NAMES = {"negative": "Negative", "distal_only": "Last joint alone", "alternating": "Alternating"}
"""Courses of tendon 4 as titles have them."""

_LEVELS = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
_BLUE, _PUSH, _FRICTION = "#004488", "#B5405A", "#CC8800"
_SHADES = [*(style.paler(_BLUE, white) for white in np.linspace(0.92, 0.12, len(_LEVELS) - 1)), _BLUE]


@style.journal_style()
def draw_margin(survey: Survey) -> style.Drawing:
    """Smallest tension of any tendon: a column per course, a row per case."""
    courses, ticks = survey.maps, np.arange(0.0, 181.0, 45.0)
    cases = {"motor": "motor", "payload": f"{survey.payload[0]:g} kg", "spring": "spring"}
    figure = style.open_figure(style.PAGE_MM, 172.0)
    grid = figure.subplots(len(cases), len(courses), sharex=True, sharey=True)
    titles = [f"{COURSE_NAMES[course]}, {case}" for case in cases.values() for course in courses]
    panels = style.letter_panels(grid.flat, titles)
    drawn: QuadContourSet | None = None
    for panel, (case, maps) in zip(panels.values(), product(cases, courses.values()), strict=True):
        # Rounding below zero is no push.
        least = np.where(np.abs(maps.least[case]) < SLACK, 0.0, maps.least[case])
        degrees, colours = np.linspace(0.0, 180.0, len(least)), [_PUSH, *_SHADES]
        drawn = panel.contourf(degrees, degrees, least, levels=_LEVELS, colors=colours, extend="both")
        for edge in maps.band if case == "motor" else ():
            if edge.min() < RESERVE < edge.max():
                panel.contour(degrees, degrees, edge, levels=[RESERVE], colors=_FRICTION, linewidths=0.9)
        panel.set(aspect="equal", xticks=ticks, yticks=ticks)
    before, last = survey.joints[-2:]
    for panel in grid[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in grid[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")
    label = "Smallest tension of any tendon (N)"
    assert drawn is not None
    figure.colorbar(drawn, ax=grid, shrink=0.6, aspect=25, pad=0.01, format="{x:g}", label=label)
    line = Line2D([], [], color=_FRICTION, linewidth=0.9, label=f"{RESERVE:g} N, with pulley friction")
    push = Patch(color=_PUSH, label="a tendon would have to push")
    figure.legend(handles=[line, push], loc="outside upper center", ncols=2)
    force, source = survey.force
    caption = (
        f"Smallest tension of any tendon at rest, by course of tendon {survey.tensioning_tendon}, which a "
        f"motor pulls with {force:g} N ({source}); spring: as hard at the start, there stretched by "
        f"{1e3 * STRETCH:g} mm. Orange: between the lines friction of the guide pulleys, "
        f"{100 * survey.loss[0]:g} % each, decides on {RESERVE:g} N. {survey.origin}."
    )
    angles = np.rad2deg(start_angles(survey.loaded.config)[:-2])
    before_them = ", ".join(f"{angle:g}°" for angle in angles) or "held rigidly"
    posture = f"links before: {before_them}; link angles from hanging, at rest"
    return style.Drawing("statics_margin", figure, panels, caption, origin=posture)
