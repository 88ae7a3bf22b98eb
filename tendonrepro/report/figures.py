"""The paper's figures as panels of plain numbers, taken from what `results.figures` draws."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.results.figures.panels import FigureArtists
from tendonrepro.results.figures.style import REFERENCE, SERIES, paler

WIDTH, HEIGHT = 520.0, 260.0
"""Of a panel, in its own units; letters of 13 are then readable on a phone."""
LEFT, RIGHT, TOP, BOTTOM = 54.0, 10.0, 10.0, 40.0
_DIGITS = 4
"""Digits kept of a value beyond those of its panel's range."""

_SIGNS = {
    r"\hat{H}": "Ĥ", r"\tau_m": "τₘ", r"\Delta ": "Δ", r"\,": " ", r"q_\mathrm{motor}": "q motor",
    "S^{-1}": "S⁻¹", "S_{21}": "S₂₁", "S_{11}": "S₁₁", "q_2": "q₂", "q_1": "q₁", "$": "",
}  # fmt: skip


@dataclass(frozen=True)
class Curve:
    """A curve (T,), its entry of the legend, and its look: 0 is a reference, else the number of a series."""

    name: str
    x: Array
    y: Array
    look: int
    pale: bool = False
    held: bool = False
    marked: bool = False


@dataclass(frozen=True)
class Band:
    """A band between `low` and `high` (T,), beside the curve of the same name."""

    name: str
    x: Array
    low: Array
    high: Array
    look: int


@dataclass(frozen=True)
class Panel:
    """One panel: texts, ranges, curves; `over_time` is false where x is another quantity."""

    letter: str
    title: str
    note: str
    x_label: str
    y_label: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    curves: Sequence[Curve]
    bands: Sequence[Band]
    over_time: bool

    def path(self, x: Array, y: Array, *, held: bool = False) -> str:
        """Outline of a curve for SVG; what leaves the panel far is cut off."""
        across, up = self._across(x), self._up(y)
        if held and len(across) > 1:
            across, up = np.repeat(across, 2)[1:], np.repeat(up, 2)[:-1]
        return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(across, up, strict=True))

    def outline(self, band: Band) -> str:
        """Outline of a band for SVG."""
        return self.path(np.append(band.x, band.x[::-1]), np.append(band.high, band.low[::-1])) + "Z"

    def _across(self, x: Array) -> Array:
        low, high = self.x_range
        return LEFT + (np.asarray(x) - low) / (high - low) * (WIDTH - LEFT - RIGHT)

    def _up(self, y: Array) -> Array:
        low, high = self.y_range
        share = np.clip((np.asarray(y) - low) / (high - low), -1.0, 2.0)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)

    @property
    def x_ticks(self) -> list[tuple[float, str]]:
        """Places and labels of the ticks."""
        return [(float(self._across(np.array(at))), text) for at, text in _ticks(*self.x_range, 7)]

    @property
    def y_ticks(self) -> list[tuple[float, str]]:
        """Places and labels of the ticks."""
        return [(float(self._up(np.array(at))), text) for at, text in _ticks(*self.y_range, 5)]

    @property
    def data(self) -> dict[str, Any]:
        """Values to read off, for the plotting script."""
        digits = max(_DIGITS - math.floor(math.log10(self.y_range[1] - self.y_range[0])), 0)

        def numbers(values: Array, kept: int) -> list[float | None]:
            return [round(float(v), kept) if math.isfinite(v) else None for v in values]

        curves = [
            {"name": c.name, "look": c.look, "pale": c.pale, "held": c.held, "x": numbers(c.x, 4)}
            | {"y": numbers(c.y, digits)}
            for c in self.curves
        ]
        bands = [
            {"name": b.name, "look": b.look, "x": numbers(b.x, 4)}
            | {"low": numbers(b.low, digits), "high": numbers(b.high, digits)}
            for b in self.bands
        ]
        labels = {"x_label": self.x_label, "y_label": self.y_label}
        return labels | {"x": self.x_range, "y": self.y_range, "curves": curves, "bands": bands}


@dataclass(frozen=True)
class Figure:
    """A figure of the paper: caption, panels, and the legend's names with look and whether pale."""

    number: int
    caption: str
    panels: Sequence[Panel]
    legend: Mapping[str, tuple[int, bool]]


def figure_of(drawn: FigureArtists) -> Figure:
    """Take a drawn figure apart."""
    names = _names(drawn)
    panels = [_panel(drawn, letter, axes, names) for letter, axes in drawn.axes.items()]
    below = next(panel.x_label for panel in reversed(panels) if panel.x_label)
    caption = drawn.caption.removeprefix(f"Figure {drawn.number}. ")
    legend = {curve.name: (curve.look, curve.pale) for panel in panels for curve in panel.curves}
    # Panels that share an axis have its label once.
    panels = [panel if panel.x_label else _labelled(panel, below, panels) for panel in panels]
    return Figure(drawn.number, caption, panels, legend)


def _labelled(panel: Panel, below: str, panels: Sequence[Panel]) -> Panel:
    shared = [other.x_label for other in panels if other.x_range == panel.x_range and other.x_label]
    return replace(panel, x_label=shared[0] if shared else below)


def _names(drawn: FigureArtists) -> dict[str, str]:
    """Entry of the legend by the name of a curve."""
    found: dict[str, str] = {}
    for (_, name), line in drawn.lines.items():
        label = str(line.get_label())
        if name not in found and not label.startswith("_"):
            found[name] = plain(label)
    return found


def _panel(drawn: FigureArtists, letter: str, axes: Any, names: Mapping[str, str]) -> Panel:
    curves = []
    for (place, name), line in drawn.lines.items():
        if place == letter:
            look, pale = _look(str(line.get_color()))
            pale = pale or (look > 0 and line.get_linewidth() >= REFERENCE.width)
            x, y = (np.asarray(values, float) for values in line.get_data())
            held = str(line.get_drawstyle()).startswith("steps")
            marked = str(line.get_marker()) == "o"
            curves.append(Curve(names.get(name, name), x, y, look, pale, held, marked))
    looks = {curve.name: curve.look for curve in curves}
    bands = [
        Band(shown, *_edges(np.asarray(band.get_xy())), look=looks.get(shown, 0))
        for (place, name), band in drawn.bands.items()
        if place == letter and (shown := names.get(name, name))
    ]
    (x_low, x_high), (y_low, y_high) = axes.get_xlim(), axes.get_ylim()
    return Panel(
        letter,
        re.sub(r"^\([a-z]+\) ", "", plain(axes.get_title(loc="left"))),
        plain(axes.get_title(loc="right")),
        plain(axes.get_xlabel()),
        plain(axes.get_ylabel()),
        (float(x_low), float(x_high)),
        (float(y_low), float(y_high)),
        curves,
        bands,
        over_time=axes.get_aspect() == "auto",
    )


def _edges(corners: Array) -> tuple[Array, Array, Array]:
    """Times, lower and upper edge (T,) of a band's outline: there along the upper, back along the lower."""
    half = len(corners) // 2
    return corners[:half, 0], corners[half : 2 * half, 1][::-1], corners[:half, 1]


def _look(colour: str) -> tuple[int, bool]:
    """Number of the series a colour is of, and whether it is a paler one; 0 where it is of none."""
    for number, stroke in enumerate(SERIES, start=1):
        if colour.lower() == stroke.colour.lower():
            return number, False
        if colour.lower() in {paler(stroke.colour, white).lower() for white in (0.55, 0.62)}:
            return number, True
    return 0, False


def plain(text: str) -> str:
    r"""Text without the marks of mathematical typesetting.

    Examples
    --------
    >>> plain(r"Estimate $\hat{H}$ (N m)")
    'Estimate Ĥ (N m)'
    """
    for sign, letters in _SIGNS.items():
        text = text.replace(sign, letters)
    return text


def _ticks(low: float, high: float, most: int) -> Iterator[tuple[float, str]]:
    """Round numbers in a range, at most so many, and how they are written."""
    raw = (high - low) / most
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * unit for factor in (1.0, 2.0, 5.0, 10.0) if factor * unit >= raw)
    digits = max(-math.floor(math.log10(step) + 1e-9), 0)
    for count in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1):
        yield count * step, f"{count * step:z.{digits}f}".replace("-", "−")
