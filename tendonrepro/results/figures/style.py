"""Journal style: sizes, strokes that survive grey print, and the thinning of long curves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib import style

from tendonrepro.arrays import Array

COLUMN_MM = 85.0
"""Width of one journal column."""

PAGE_MM = 175.0
"""Width of two journal columns."""

# No panel is wider than 75 mm, so a column is at most half as wide as the line drawn through it.
_ENVELOPE_COLUMNS = 600
# A step of a band is at most 0.4 mm wide, so that lone pulses stand apart from dense ones.
_BAND_STEPS = 180


@dataclass(frozen=True)
class Stroke:
    """How a curve looks.

    Parameters
    ----------
    colour : str
        Hexadecimal RGB.
    dashes : tuple of float
        Lengths of dash and gap in line widths; empty for a solid line.
    width : float
        Line width, pt.
    """

    colour: str
    dashes: tuple[float, ...] = ()
    width: float = 0.9

    @property
    def linestyle(self) -> Literal["-"] | tuple[float, tuple[float, ...]]:
        """The same in matplotlib's words."""
        return (0.0, self.dashes) if self.dashes else "-"


SERIES = (
    Stroke("#004488"),
    Stroke("#B5405A", (4.0, 1.6)),
    Stroke("#CC8800", (1.3, 1.1), 1.1),
    Stroke("#000000", (6.0, 1.5, 1.3, 1.5)),
    Stroke("#777777", (9.0, 2.5)),
    Stroke("#228833", (3.0, 1.2, 1.0, 1.2, 1.0, 1.2)),
)
"""Strokes of controllers, joints and motors in the order of their numbers, then of further laws.

The first three colours are told apart by any kind of colour vision, and by lightness in grey print.
"""


def stroke_of(number: int) -> Stroke:
    """Stroke of the joint, motor or law with a number, counted from 1; they repeat when there are many."""
    return SERIES[(number - 1) % len(SERIES)]


REFERENCE = Stroke("#BEBEBE", (), 2.6)
"""Wide and pale, drawn below the curve that is meant to cover it."""


@contextmanager
def journal_style() -> Iterator[None]:
    """Put the project's style in force, whatever the user's own matplotlib settings are."""
    with style.context(Path(__file__).with_name("tendonrepro.mplstyle"), after_reset=True):
        yield


def thin(time: Array, values: Array) -> tuple[Array, Array]:
    """Reduce a curve to what can be seen, keeping every spike.

    Samples are taken in as many equal groups as a panel has columns; of each group the smallest and the
    largest stay, at their own times, and of the whole curve both ends. Non-finite samples are dropped first.
    """
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    count = len(values)
    size = -(-count // _ENVELOPE_COLUMNS)
    if size <= 2:
        return time, values
    groups = _groups(values, size)
    start = np.arange(len(groups)) * size
    picked = np.concatenate([[0], start + groups.argmin(axis=1), start + groups.argmax(axis=1), [count - 1]])
    keep = np.unique(np.minimum(picked, count - 1))
    return time[keep], values[keep]


def envelope(time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Smallest and largest sample of each of at most 180 equal groups; non-finite samples are dropped first.

    Times are the middles of the groups, except for both ends of the curve.
    """
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    size = max(-(-len(values) // _BAND_STEPS), 1)
    groups = _groups(values, size)
    middles = time[np.minimum(np.arange(len(groups)) * size + size // 2, len(values) - 1)]
    if len(middles):
        middles[[0, -1]] = time[[0, -1]]
    return middles, groups.min(axis=1), groups.max(axis=1)


def _groups(values: Array, size: int) -> Array:
    """Cut a curve into equal groups, filling the last with its last sample, which adds no extreme to it."""
    if not len(values):
        return values.reshape(0, size)
    return np.pad(values, (0, -len(values) % size), mode="edge").reshape(-1, size)
