"""Pictures of the tensions: margin maps, the force that tendon 4 needs, and a spring for its motor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tendonrepro.arrays import Array
from tendonrepro.experiments.statics.survey import RESERVE, STRETCH, Survey
from tendonrepro.physics.statics import SLACK
from tendonrepro.results.figures.style import (
    COLUMN_MM,
    PAGE_MM,
    Drawing,
    journal_style,
    letter_panels,
    open_figure,
    paler,
    stroke_of,
)

COURSE_NAMES: Mapping[str, str] = {
    "negative": "negative",
    "distal_only": "last joint alone",
    "alternating": "alternating",
}
"""Courses of tendon 4 as titles have them."""

CASE_NAMES: Mapping[str, str] = {"motor": "motor", "payload": "{payload:g} kg", "spring": "spring"}

_LEVELS = np.array([0.0, 2.5, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0])
_BLUE = "#004488"
_PUSH = "#B5405A"
_NEVER = "#DDDDDD"


def figures(found: Survey) -> dict[str, Callable[[], Drawing]]:
    """Every picture of a survey, by name."""
    maps = posture_text(found)
    return {
        "margin": lambda: replace(draw_margin(found), origin=maps),
        "force": lambda: replace(draw_force(found), origin=maps),
        "spring": lambda: replace(draw_spring(found), origin="all link angles from 0 to 180°, at rest"),
    }


def posture_text(found: Survey) -> str:
    """Where the maps hold the other links, for below the panels."""
    fixed = zip(found.joints[:-2], np.rad2deg(found.fixed), strict=True)
    links = [f"link {joint} at {angle:g}°" for joint, angle in fixed]
    if found.held:
        links.append(f"joint {', '.join(map(str, found.held))} held rigidly")
    return "; ".join([*links, "link angles from hanging, at rest"])


def _shades(colour: str, count: int) -> list[str]:
    return [paler(colour, white) for white in np.linspace(0.92, 0.12, count)]


def _map_axes(panel: Axes) -> None:
    ticks = np.arange(0.0, 181.0, 45.0)
    panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    panel.set_aspect("equal")


def _label_map(panels: Any, found: Survey) -> None:
    before, last = found.joints[-2:]
    for panel in panels[-1]:
        panel.set_xlabel(f"Link {before} (deg)")
    for panel in panels[:, 0]:
        panel.set_ylabel(f"Link {last} (deg)")


@journal_style()
def draw_margin(found: Survey) -> Drawing:
    """Smallest tension of any tendon over the half-plane: a column per course, a row per case."""
    courses, cases = found.courses, tuple(CASE_NAMES)
    figure = open_figure(PAGE_MM, 172.0)
    panels = figure.subplots(len(cases), len(courses), squeeze=False, sharex=True, sharey=True)
    titles = [
        f"{COURSE_NAMES[course].capitalize()}, {CASE_NAMES[case].format(payload=found.payload)}"
        for case in cases
        for course in courses
    ]
    named = letter_panels(panels.flat, titles)
    degrees = np.rad2deg(found.angles)
    shades: Any = {"colors": [_PUSH, *_shades(_BLUE, len(_LEVELS) - 1), _BLUE], "extend": "both"}
    drawn: Any = None
    for row, case in enumerate(cases):
        for column, course in enumerate(courses.values()):
            panel, least = panels[row, column], course.least[case]
            # Rounding below zero is no push.
            shown = np.where(np.abs(least) < SLACK, 0.0, least)
            drawn = panel.contourf(degrees, degrees, shown, levels=_LEVELS, **shades)
            _line_at(panel, degrees, shown, 0.0, "black", 1.1)
            if case == "motor":
                _friction(panel, degrees, course.band)
            _map_axes(panel)
    _label_map(panels, found)
    bar = figure.colorbar(drawn, ax=panels, shrink=0.5, aspect=30, pad=0.01)
    bar.set_label("Smallest tension of any tendon (N)")
    handles: list[Artist] = [
        Line2D([], [], color="#CC8800", linewidth=0.9, label=f"{RESERVE:g} N, with friction of the pulleys")
    ]
    if min(least.min() for course in courses.values() for least in course.least.values()) < -SLACK:
        handles.append(Patch(color=_PUSH, label="a tendon would have to push"))
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    caption = (
        f"Smallest tension of tendons {_list(found.joints)} at rest, by course of tendon 4, which a motor "
        f"pulls with {found.force:g} N ({found.sources['force']}); spring: as hard in the start posture, "
        f"there stretched by {1e3 * STRETCH:g} mm. Orange: between the lines friction of the guide pulleys, "
        f"{100 * found.loss:g} % each ({found.sources['loss']}), decides whether {RESERVE:g} N are left. "
        f"{posture_text(found)}. {found.origin}."
    )
    return Drawing("statics_margin", figure, named, caption)


def _line_at(panel: Axes, degrees: Array, values: Array, level: float, colour: str, width: float) -> None:
    if values.min() < level < values.max():
        panel.contour(degrees, degrees, values, levels=[level], colors=[colour], linewidths=[width])


def _friction(panel: Axes, degrees: Array, band: Array) -> None:
    for edge in band:
        _line_at(panel, degrees, edge, RESERVE, "#CC8800", 0.9)


@journal_style()
def draw_force(found: Survey) -> Drawing:
    """Least force of tendon 4 that leaves every tendon the reserve, a panel per course."""
    figure = open_figure(PAGE_MM, 66.0)
    panels = figure.subplots(1, len(found.courses), squeeze=False, sharey=True)
    named = letter_panels(panels.flat, [COURSE_NAMES[name].capitalize() for name in found.courses])
    degrees, levels = np.rad2deg(found.angles), np.array([0.01, 1.0, 2.0, 3.0, 4.0, 5.0, 7.5, 10.0])
    shades: Any = {"colors": [*_shades(_BLUE, len(levels) - 1), _BLUE], "extend": "max"}
    drawn: Any = None
    for panel, course in zip(panels.flat, found.courses.values(), strict=True):
        drawn = panel.contourf(degrees, degrees, course.needed, levels=levels, **shades)
        if course.room.min() < 0.0:
            panel.contourf(degrees, degrees, course.room, levels=[-np.inf, 0.0], colors=[_NEVER])
        _map_axes(panel)
    _label_map(panels, found)
    bar = figure.colorbar(drawn, ax=panels, ticks=levels[1:], shrink=0.8, aspect=20, pad=0.01)
    bar.set_label("Least force of tendon 4 (N)")
    handles = [
        Patch(facecolor="white", edgecolor="#999999", linewidth=0.5, label="none is needed"),
        Patch(color=_NEVER, label="no force does"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    caption = (
        f"Least force of tendon 4 that leaves {RESERVE:g} N in every one of tendons {_list(found.joints)} "
        f"at rest, without payload or friction. {posture_text(found)}. {found.origin}."
    )
    return Drawing("statics_force", figure, named, caption)


@journal_style()
def draw_spring(found: Survey) -> Drawing:
    """How much a spring's pull varies over the half-plane, by how far it is stretched at its shortest."""
    figure = open_figure(COLUMN_MM, 62.0)
    panel = figure.subplots()
    stretch = np.geomspace(0.02, 1.0, 200)
    for number, (name, course) in enumerate(found.courses.items(), start=1):
        stroke = stroke_of(number)
        label = f"{COURSE_NAMES[name]}, {1e3 * course.travel:.0f} mm"
        style = {"color": stroke.colour, "linestyle": stroke.linestyle, "linewidth": stroke.width}
        panel.plot(1e3 * stretch, 1.0 + course.travel / stretch, label=label, **style)  # type: ignore[arg-type]
    panel.axhline(1.0, color="#777777", linewidth=0.6)
    panel.text(21.0, 1.03, "motor", ha="left", va="bottom", fontsize=7, color="#555555")
    panel.set(xscale="log", yscale="log", xlim=(20.0, 1000.0), ylim=(0.9, 16.0))
    panel.set_xticks([20, 50, 100, 200, 500, 1000], ["20", "50", "100", "200", "500", "1000"])
    panel.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    panel.minorticks_off()
    panel.set_xlabel("Least stretch of the spring (mm)")
    panel.set_ylabel("Largest pull over least")
    panel.legend(title="Course and change of length", title_fontsize=7, alignment="left")
    caption = (
        "Largest over least pull of a spring on tendon 4 over the half-plane, all link angles from 0 to "
        "180°: one plus the tendon's change of length over the spring's least stretch, whatever its rate. A "
        f"motor's is one by assumption. {found.origin}."
    )
    return Drawing("statics_spring", figure, [panel], caption)


def _list(joints: tuple[int, ...]) -> str:
    return ", ".join(map(str, joints))
