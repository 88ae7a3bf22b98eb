"""A figure of a journal's width: lettered panels, curves in them by panel and name, one legend above all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from tendonrepro.arrays import Array
from tendonrepro.results.figures import style
from tendonrepro.results.figures.style import Drawing, Look, Stroke

# No panel is wider than 75 mm, so a column is at most half as wide as the line drawn through it.
_ENVELOPE_COLUMNS = 600
# Free space above and below the curves, as a share of their range.
_MARGIN = 0.06
# Share of white in the insides of bands, in the order in which they are drawn, then from the first on again:
# with the colours of controllers they differ in lightness too. And in the edges, which lie above all insides.
_INSIDES, _EDGE = (0.6, 0.65, 0.65), 0.35
_SHARED = "#EDEDED"


class Band(NamedTuple):
    """The band between two edges (T,) around the curve of a stroke."""

    time: Array
    low: Array
    high: Array
    stroke: Stroke


class Sheet:
    """A figure under construction, width and height in mm printed.

    `labels` are (title, y label) of the grid's panels, whose time axes are `shared` by all, or by those of a
    column. Titled panels `beside`, at the left over all rows, are `pictures`, which have no time axis. A
    `note` on the bands stands in the legend. What the caption says of these runs alone is `told`. `places`
    are row and title, up to a comma. Curves of diverged runs are `diverged`.
    """

    def __init__(
        self,
        width_mm: float,
        height_mm: float,
        labels: Sequence[Sequence[tuple[str, str]]],
        beside: Sequence[str] = (),
        shared: Literal["all", "col"] = "all",
    ) -> None:
        self.figure = style.open_figure(width_mm, height_mm)
        self.lines: dict[tuple[str, str], Line2D] = {}
        self.bands: dict[tuple[str, str], Polygon] = {}
        self.diverged: set[tuple[str, str]] = set()
        self.note = self.told = ""
        self._insides: dict[str, str] = {}
        grid = self.figure.add_gridspec(len(labels), len(beside) + len(labels[0]))
        pictures = [self.figure.add_subplot(grid[:, column]) for column in range(len(beside))]
        inner = grid[:, len(beside) :].subgridspec(len(labels), len(labels[0]))
        panels = inner.subplots(squeeze=False, sharex=shared)
        texts = [text for row in labels for text in row]
        titles = [*beside, *(title for title, _ in texts)]
        lettered = style.letter_panels([*pictures, *panels.flat], titles)
        self.axes = dict([*lettered.items()][len(beside) :])
        self.pictures = {letter: axes for letter, axes in lettered.items() if letter not in self.axes}
        self.places = {}
        for letter, ((row, _), axes), (title, label) in zip(
            self.axes, np.ndenumerate(panels), texts, strict=True
        ):
            self.places[letter] = int(row), title.partition(",")[0]
            axes.set_ylabel(label)
            axes.margins(y=_MARGIN)
        for axes in panels[-1]:
            axes.set_xlabel("Time (s)")

    def curve(
        self,
        letter: str,
        name: str,
        time: Array,
        values: Array,
        stroke: Stroke,
        *,
        label: str = "",
        diverged: bool = False,
        as_steps: bool = False,
    ) -> None:
        """Draw a curve (T,) under the key `name`; where `as_steps`, samples are held.

        The legend lists equal labels once, an empty one not at all. A diverged run ends in a mark and does
        not set the range of the y axis.
        """
        (time, values), axes = thin(time, values), self.axes[letter]
        look: Look = stroke.line | {"drawstyle": "steps-post" if as_steps else "default"}
        look |= {"label": label} if label else {}
        if not diverged:
            (self.lines[letter, name],) = axes.plot(time, values, **look)
            return
        self.diverged.add((letter, name))
        # What is added as an artist has no say in the ranges.
        self.lines[letter, name] = Line2D(time, values, **look)
        axes.add_artist(self.lines[letter, name])
        axes.update_datalim(np.column_stack([time, time]), updatey=False)
        axes.autoscale_view(scaley=False)
        mark: Look = {"marker": "x", "markersize": 4.0, "markeredgewidth": 1.0, "clip_on": False}
        axes.add_artist(Line2D(time[-1:], values[-1:], color=stroke.colour, **mark))

    def draw_bands(self, letter: str, bands: Mapping[str, Band]) -> None:
        """Draw bands by the names of their curves, which lie above.

        Bands are opaque, the narrowest on top; what all cover is grey. In the legend a band lies behind the
        curve of its name.
        """
        axes = self.axes[letter]
        widest_first = sorted(bands, key=lambda name: -float(np.mean(bands[name].high - bands[name].low)))
        for name, (time, low, high, stroke) in bands.items():
            white = _INSIDES[len(self._insides) % len(_INSIDES)]
            colour = self._insides.setdefault(name, style.paler(stroke.colour, white))
            corners = np.column_stack([np.append(time, time[::-1]), np.append(high, low[::-1])])
            order = 0.7 * (1 + widest_first.index(name)) / (1 + len(bands))
            band = self.bands[letter, name] = Polygon(corners, facecolor=colour, linewidth=0.0, zorder=order)
            # As a patch each of its corners would be looked at in Python, for ranges that the edges have.
            axes.add_artist(band)
            edge = replace(stroke, colour=style.paler(stroke.colour, _EDGE), width=0.5)
            for values in (low, high):
                axes.plot(time, values, **edge.line, zorder=0.8)
        if len(bands) > 1:
            time = min((band.time for band in bands.values()), key=lambda time: float(time[-1]))
            low = np.max([np.interp(time, band.time, band.low) for band in bands.values()], axis=0)
            high = np.min([np.interp(time, band.time, band.high) for band in bands.values()], axis=0)
            look: Look = {"facecolor": _SHARED, "linewidth": 0.0, "zorder": 0.75}
            axes.fill_between(time, low, high, where=high > low, **look)

    def zero_line(self, letter: str) -> None:
        """Draw a hair line at zero, where the panel shows that."""
        axes = self.axes[letter]
        look: Look = {"color": "#999999", "linewidth": 0.4, "zorder": 0.9}
        axes.add_artist(Line2D([0.0, 1.0], [0.0, 0.0], transform=axes.get_yaxis_transform(), **look))

    @property
    def windows(self) -> list[tuple[float, float]]:
        """Spans of time that the panels show, s, each once."""
        return sorted({panel.get_xlim() for panel in self.axes.values()})

    def finish(self, name: str, caption: str, origin: str) -> Drawing:
        """Set ranges, legend and imprint, and lay the figure out for all formats."""
        for letter, axes in self.axes.items():
            courses = [line for (panel, _), line in self.lines.items() if panel == letter]
            if not courses:
                axes.set_yticks([])
                look: Look = {"ha": "center", "va": "center", "color": "#666666"}
                axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, **look)
            _settle_range(axes, courses)
        self._draw_legend()
        style.imprint(self.figure, origin)
        self.figure.align_ylabels(list(self.axes.values()))
        style.settle(self.figure)
        panels = self.pictures | self.axes
        return Drawing(name, self.figure, panels, caption, origin, self.lines, self.bands)

    def _draw_legend(self) -> None:
        """List every label once, in as few rows as the width allows; one alone needs no legend."""
        named: dict[str, Any] = {}
        for axes in (*self.axes.values(), *self.pictures.values()):
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                named.setdefault(label, handle)
        for (_, name), line in self.lines.items():
            if name in self._insides and named.get(str(line.get_label())) is line:
                behind = Patch(facecolor=self._insides[name], linewidth=0.0)
                named[str(line.get_label())] = behind, line
        if self.note:
            named[self.note] = Patch(facecolor=_SHARED, edgecolor="#777777", linewidth=0.5)
        handles: list[Artist] = [*named.values()]
        for rows in range(1, len(named) + 1) if len(named) > 1 else ():
            look: Look = {"loc": "outside upper center", "ncols": -(-len(named) // rows)}
            legend = self.figure.legend(handles, [*named], **look)
            if rows == len(named) or legend.get_window_extent().width < 0.98 * self.figure.bbox.width:
                return
            legend.remove()


def _settle_range(axes: Axes, courses: Sequence[Line2D]) -> None:
    """Fit the y axis to what has a say in it, else to all courses; keep the marks of diverged runs within."""
    if not np.isfinite(axes.dataLim.intervaly).all():
        for line in courses:
            axes.update_datalim(line.get_xydata())
        axes.autoscale_view()
    low, high = axes.get_ylim()
    for mark in (line for line in axes.lines if line.get_marker() == "x"):
        mark.set_ydata(np.clip(mark.get_ydata(), low, high))


def thin(time: Array, values: Array) -> tuple[Array, Array]:
    """Reduce a curve to what can be seen: the extremes of equal groups of samples, and both ends.

    Dashes would vanish in the noise between all of them.

    Non-finite samples are dropped.
    """
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    count = len(values)
    size = -(-count // _ENVELOPE_COLUMNS)
    if size <= 2:
        return time, values
    # The last group is filled with the last sample, which adds no extreme to it.
    groups = np.pad(values, (0, -count % size), mode="edge").reshape(-1, size)
    start = np.arange(len(groups)) * size
    picked = np.concatenate([[0], start + groups.argmin(axis=1), start + groups.argmax(axis=1), [count - 1]])
    keep = np.unique(np.minimum(picked, count - 1))
    return time[keep], values[keep]
