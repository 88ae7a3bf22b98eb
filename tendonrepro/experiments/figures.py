"""The figures of statics and of a sweep."""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.patches import Patch

from tendonrepro.experiments.rig import start_angles
from tendonrepro.experiments.statics import COURSES, STRETCH, Survey
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures import style

COURSE_NAMES = {"negative": "Negative", "distal_only": "Last joint alone", "alternating": "Alternating"}
"""Courses of tendon 4 as titles have them."""

_LEVELS = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
_BLUE, _PUSH = "#004488", "#B5405A"
_SHADES = [*(style.paler(_BLUE, white) for white in np.linspace(0.92, 0.12, len(_LEVELS) - 1)), _BLUE]


@style.journal_style()
def draw_statics(survey: Survey) -> style.Drawing:
    """Smallest tension of any tendon: a column per course, a row per case."""
    config, values = survey.loaded.config, {row["input"]: row["value"] for row in survey.inputs}
    cases = {"motor": "motor", "payload": f"{values['payload_kg']:g} kg", "spring": "spring"}
    figure = style.open_figure(style.PAGE_MM, 172.0)
    grid = figure.subplots(len(cases), len(COURSES), sharex=True, sharey=True)
    titles = [f"{COURSE_NAMES[course]}, {case}" for case in cases.values() for course in COURSES]
    panels = style.letter_panels(grid.flat, titles)
    ticks, colours = np.arange(0.0, 181.0, 45.0), [_PUSH, *_SHADES]
    for panel, (case, course) in zip(panels.values(), product(cases, COURSES), strict=True):
        tension = survey.maps[course, case]
        # Rounding below zero is no push.
        least = np.where(np.abs(tension) < SLACK, 0.0, tension)
        degrees = np.linspace(0.0, 180.0, len(least))
        drawn = panel.contourf(degrees, degrees, least, levels=_LEVELS, colors=colours, extend="both")
        panel.set(aspect="equal", xticks=ticks, yticks=ticks)
    before, last = config.joints[-2:]
    for panel in grid[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in grid[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")
    label = "Smallest tension of any tendon (N)"
    figure.colorbar(drawn, ax=grid, shrink=0.6, aspect=25, pad=0.01, format="{x:g}", label=label)
    figure.legend(
        handles=[Patch(color=_PUSH, label="a tendon would have to push")], loc="outside upper center"
    )
    caption = (
        f"Smallest tension of any tendon at rest, by course of tendon {config.manipulator.joints + 1}, which "
        f"a motor pulls with {values['force_N']:g} N; spring: as hard at the start, there stretched by "
        f"{1e3 * STRETCH:g} mm. {survey.loaded.origin} (sha256 {survey.loaded.sha256[:12]})."
    )
    angles = ", ".join(f"{angle:g}°" for angle in np.rad2deg(start_angles(config)[:-2]))
    posture = f"links before: {angles or 'held rigidly'}; link angles from hanging, at rest"
    return style.Drawing("statics_margin", figure, panels, caption, origin=posture)
