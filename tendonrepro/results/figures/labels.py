"""Names of points in a panel, put where they cover nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from tendonrepro.arrays import Array
from tendonrepro.results.figures.style import Look

_DIRECTIONS = np.deg2rad(np.arange(0.0, 360.0, 15.0))
_DISTANCES = (4.0, 7.0, 11.0, 16.0, 22.0, 30.0)
"""How far a name may stand from its point, pt."""
_LED = 8.0
"""From this distance on a line leads to the point, pt."""
_AIR = 1.5
"""Free space around a name, pt."""

_MARK = 2.5
"""How far a mark reaches from its place, pt."""
_OVER_TEXT, _OVER_MARK, _OVER_LINE, _FARTHER = 1e4, 100.0, 5.0, 1.0
"""What it costs to cover another text, a mark, or a piece of a line, and to stand 1 pt farther away."""


def name_points(
    axes: Axes, names: Sequence[tuple[str, tuple[float, float], str]], marks: Array, lines: Array
) -> list[Annotation]:
    """Write names, each with its point and colour, one after the other where they cover least.

    `marks` and `lines` are places (K, 2) of what names should not cover, in data coordinates; a line is given
    by many of its places. Texts of the panel are never covered if there is any room. The layout of the figure
    has to be settled before.
    """
    pixel = axes.figure.dpi / 72.0
    taken = [text.get_window_extent() for text in axes.texts]
    at = axes.transData.transform
    marked, passed = at(marks), at(lines)
    written = []
    for text, point, colour in names:
        look: Look = {
            "ha": "center",
            "va": "center",
            "fontsize": 6.5,
            "color": colour,
            "zorder": 5.0,
        }
        label = axes.annotate(text, point, (0.0, 0.0), textcoords="offset points", **look)
        label.set_in_layout(False)
        extent = label.get_window_extent()
        size = np.array([extent.width, extent.height])
        start = at(point)
        others = marked[np.hypot(*(marked - start).T) > pixel]
        candidates = []
        for away in _DISTANCES:
            for centre in _around(start, away * pixel, size):
                box = _box(centre, size + 2.0 * _AIR * pixel)
                near = _box(centre, size + 2.0 * (_AIR + _MARK) * pixel)
                cost = _OVER_TEXT * box.count_overlaps(taken) + _OVER_LINE * _inside(passed, box)
                cost += _OVER_MARK * _inside(others, near)
                outside = Bbox.union([box, axes.bbox]).bounds != axes.bbox.bounds
                candidates.append((np.inf if outside else cost + _FARTHER * away, away, centre))
        _, away, centre = min(candidates, key=lambda candidate: candidate[0])
        label.set_position(tuple((centre - start) / pixel))
        if away >= _LED:
            passed = np.vstack([passed, _lead(axes, start, centre, size)])
        taken.append(_box(centre, size))
        written.append(label)
    return written


def _around(start: Array, away: float, size: Array) -> list[Array]:
    """Centres of a text all around a point, whose nearest edge is `away` from it, in pixels."""
    steps = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
    return [start + away * step + 0.5 * size * np.clip(2.0 * step, -1.0, 1.0) for step in steps]


def _box(centre: Array, size: Array) -> Bbox:
    return Bbox([centre - 0.5 * size, centre + 0.5 * size])


def _inside(places: Array, box: Bbox) -> int:
    """How many of the places lie in a box."""
    return int(((places > box.min) & (places < box.max)).all(axis=1).sum())


def _lead(axes: Axes, start: Array, centre: Array, size: Array) -> Array:
    """Draw a hair line from a point to the nearest place of its name; return places along it, pixels."""
    end = np.clip(start, centre - 0.5 * size, centre + 0.5 * size)
    ends = axes.transData.inverted().transform([start, end])
    axes.plot(*ends.T, color="#777777", linewidth=0.4, zorder=3.5)
    return start + np.linspace(0.0, 1.0, 20)[:, np.newaxis] * (end - start)
