"""Maps of the tensions, and of the force that tendon 4 needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tendonrepro.experiments.statics.survey import MAP_ANGLES, RESERVE, STRETCH, Survey
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    journal_style,
    letter_panels,
    open_figure,
    paler,
)

COURSE_NAMES: Mapping[str, str] = {
    "negative": "Negative",
    "distal_only": "Last joint alone",
    "alternating": "Alternating",
}
"""Courses of tendon 4 as titles have them."""

_AXES = np.rad2deg(MAP_ANGLES), np.rad2deg(MAP_ANGLES)
_TENSIONS = (0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
_FORCES = (0.01, 1.0, 2.0, 3.0, 4.0, 5.0, 7.5, 10.0)
_BLUE, _PUSH, _FRICTION, _NEVER = "#004488", "#B5405A", "#CC8800", "#DDDDDD"
_SHADES = [*(paler(_BLUE, white) for white in np.linspace(0.92, 0.12, len(_TENSIONS) - 1)), _BLUE]


def figures(found: Survey) -> dict[str, Callable[[], Drawing]]:
    """Every picture of a survey, by name."""
    return {"margin": lambda: draw_margin(found), "force": lambda: draw_force(found)}


@journal_style()
def draw_margin(found: Survey) -> Drawing:
    """Smallest tension of any tendon over the half-plane: a column per course, a row per case."""
    data = found.data
    cases = {"motor": "motor", "payload": f"{data['payload_kg']:g} kg", "spring": "spring"}
    titles = [f"{COURSE_NAMES[course]}, {case}" for case in cases.values() for course in found.maps]
    figure, panels = _open(found, len(cases), titles)
    drawn: Any = None
    for panel, (case, maps) in zip(panels.values(), product(cases, found.maps.values()), strict=True):
        # Rounding below zero is no push.
        least = np.where(np.abs(maps.least[case]) < SLACK, 0.0, maps.least[case])
        drawn = panel.contourf(*_AXES, least, levels=_TENSIONS, colors=[_PUSH, *_SHADES], extend="both")
        for edge in maps.band if case == "motor" else ():
            if edge.min() < RESERVE < edge.max():
                panel.contour(*_AXES, edge, levels=[RESERVE], colors=_FRICTION, linewidths=0.9)
    line = Line2D(
        [], [], color=_FRICTION, linewidth=0.9, label=f"{RESERVE:g} N, with friction of the pulleys"
    )
    push = Patch(color=_PUSH, label="a tendon would have to push")
    caption = (
        f"Smallest tension of any tendon at rest, by course of tendon 4, which a motor pulls with "
        f"{data['tensioner_force_N']:g} N ({data['sources']['force']}); spring: as hard at the start, "
        f"there stretched by {1e3 * STRETCH:g} mm. Orange: between the lines friction of the guide pulleys, "
        f"{100 * data['pulley_loss']:g} % each, decides whether {RESERVE:g} N are left. {found.origin}."
    )
    _explain(figure, drawn, "Smallest tension of any tendon (N)", [line, push])
    return Drawing("statics_margin", figure, panels, caption, origin=posture_text(found))


@journal_style()
def draw_force(found: Survey) -> Drawing:
    """Least force of tendon 4 that leaves every tendon the reserve, a panel per course."""
    figure, panels = _open(found, 1, [COURSE_NAMES[course] for course in found.maps])
    drawn: Any = None
    for panel, maps in zip(panels.values(), found.maps.values(), strict=True):
        drawn = panel.contourf(*_AXES, maps.needed, levels=_FORCES, colors=_SHADES, extend="max")
        if maps.room.min() < 0.0:
            panel.contourf(*_AXES, maps.room, levels=[-np.inf, 0.0], colors=[_NEVER])
    never = Patch(color=_NEVER, label="no force does")
    caption = (
        f"Least force of tendon 4 that leaves {RESERVE:g} N in every tendon at rest, without payload or "
        f"friction; white: none is needed. {found.origin}."
    )
    _explain(figure, drawn, "Least force of tendon 4 (N)", [never])
    return Drawing("statics_force", figure, panels, caption, origin=posture_text(found))


def _open(found: Survey, rows: int, titles: Sequence[str]) -> tuple[Figure, dict[str, Axes]]:
    """Square panels over the angles of the last two links, a column per course of tendon 4."""
    figure = open_figure(PAGE_MM, 53.0 * rows + 13.0)
    panels = figure.subplots(rows, len(found.maps), squeeze=False, sharex=True, sharey=True)
    ticks = np.arange(0.0, 181.0, 45.0)
    for panel in panels.flat:
        panel.set(aspect="equal", xticks=ticks, yticks=ticks)
    before, last = found.data["joints"][-2:]
    for panel in panels[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")
    return figure, letter_panels(panels.flat, titles)


def _explain(figure: Figure, drawn: Any, label: str, handles: Sequence[Artist]) -> None:
    """Add the bar of colours and the legend."""
    figure.colorbar(drawn, ax=figure.axes, shrink=0.6, aspect=25, pad=0.01, format="{x:g}", label=label)
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))


def posture_text(found: Survey) -> str:
    """Where the maps hold the other links, for below the panels."""
    data = found.data
    fixed = zip(data["joints"][:-2], data["map"]["held_link_angles_deg"], strict=True)
    links = [f"link {joint} at {angle:g}°" for joint, angle in fixed]
    links += [f"joint {joint} held rigidly" for joint in data["held_joints"]]
    return "; ".join([*links, "link angles from hanging, at rest"])
