"""The arm in its plane, in postures of a run: where joints and tendons are, and how they are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from tendonrepro.arrays import Array
from tendonrepro.physics.statics import sign_of_side, tensioner_side
from tendonrepro.physics.tendon_path import TendonPath, joint_positions, tendon_path
from tendonrepro.results.figures.style import Look
from tendonrepro.results.records import PlantRecord, Trace

_WINCHES = (0.07, 0.055), -0.13
"""x of the first motor winch and of each further one, and y of all, m; nothing is published of them."""


def postures(plant: PlantRecord, trace: Trace) -> tuple[Array, Array]:
    """Places of joints and tip, m, (T, N + 1, 2), and absolute angles of the links, rad, (T, N)."""
    length, start = (plant.values[key].value for key in ("length", "posture"))
    q = np.zeros((len(trace.time), len(length)))
    q[:, np.array(trace.joint) - 1] = trace["q_encoder"]
    angle = np.cumsum(start + q, axis=1)
    return joint_positions(length, angle), angle


def tendon_paths(plant: PlantRecord, joints: Array, angle: Array) -> list[TendonPath]:
    """Tendons, the tensioner last, from their motors' winches, below joint 1, to the joints they turn.

    `joints` and `angle` are as `postures` gives them.

    Raises
    ------
    ValueError
        If winches or pulleys overlap.
    """
    keys = ("winch_diameter", "pulley_diameter", "tensioner_diameter", "sign")
    winch, pulley, tensioner, sign = (plant.values[key].value for key in keys)
    n = len(winch)
    # The tensioner's winch is not published; that of the last motor stands for it.
    winch = np.append(winch, winch[-1])
    side = np.column_stack(
        [np.triu(sign_of_side(sign)), tensioner_side(plant.attributes["tensioner_side"], n)]
    )
    diameter = side * np.column_stack([pulley, tensioner])
    (first, step), height = _WINCHES
    paths = []
    for tendon in range(n + 1):
        last = min(tendon, n - 1)
        base = np.broadcast_to([first + step * tendon, height], (len(joints), 1, 2))
        centre = np.concatenate([base, joints[:, : last + 1]], axis=1)
        radius = np.append(winch[tendon], diameter[: last + 1, tendon]) / 2.0
        # It is fixed where the axis of its link leaves its circle.
        paths.append(tendon_path(centre, radius, -np.pi / 2.0 - angle[:, last]))
    return paths


def draw_links(axes: Axes, places: Array, colour: str = "#D8D8D8") -> Line2D:
    """Draw a chain of links through places (N + 1, 2), m, below its tendons."""
    look: Look = {"linewidth": 7.0, "solid_joinstyle": "round", "zorder": 2.0}
    return axes.plot(*places.T, color=colour, **look)[0]


def draw_discs(axes: Axes, paths: Iterable[TendonPath], place: int = 0) -> list[Circle]:
    """Draw the winches and pulleys that tendons lie on, in one of their postures."""
    look = {"facecolor": "none", "edgecolor": "#777777", "linewidth": 0.6, "zorder": 3.0}
    discs = [
        Circle(tuple(centre), abs(radius), **look)
        for path in paths
        for centre, radius in zip(path.centre[place], path.radius, strict=True)
    ]
    for disc in discs:
        axes.add_patch(disc)
    return discs


def number_winches(axes: Axes, paths: Sequence[TendonPath]) -> None:
    """Write the number of its tendon below each winch."""
    for number, path in enumerate(paths, start=1):
        x, y = path.centre[0, 0]
        axes.text(x, y - 0.03, str(number), ha="center", va="top", fontsize=7)


def frame(axes: Axes, joints: Array, paths: Sequence[TendonPath]) -> None:
    """Show all that joints (..., 2) and tendons reach, m, and a scale."""
    winches = np.array([path.centre[0, 0] for path in paths]).reshape(-1, 2)
    widest = max((float(np.abs(path.radius).max()) for path in paths), default=0.0) + 0.02
    below = winches - [0.0, 0.07]
    corners = np.vstack([joints.reshape(-1, 2), winches, below])
    (left, bottom), (right, top) = corners.min(axis=0) - widest, corners.max(axis=0) + widest
    axes.set_aspect("equal")
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.set_axis_off()
    axes.plot([left, left + 0.1], [bottom] * 2, color="black", linewidth=1.0)
    axes.text(left + 0.05, bottom + 0.01, "0.1 m", ha="center", va="bottom", fontsize=7)
