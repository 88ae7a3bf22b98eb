"""A figure being drawn: panels in a grid, curves in the panels, one legend above all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

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


class Canvas:
    """A figure under construction, width and height in mm printed.

    `labels` are (title, y label) of the grid's panels, which share the time axis. The last rows may have x
    axes of their own, shared within a column, labelled `apart`. `places` are row and title, up to a comma.
    Titled panels `beside`, at the left over all rows, are `pictures`, which have no time axis.
    """

    def __init__(
        self,
        width_mm: float,
        height_mm: float,
        labels: Sequence[Sequence[tuple[str, str]]],
        apart: Sequence[str] = (),
        beside: Sequence[str] = (),
    ) -> None:
        self.figure = style.open_figure(width_mm, height_mm)
        self.places: dict[str, tuple[int, str]] = {}
        self.pictures: dict[str, Axes] = {}
        self.lines: dict[tuple[str, str], Line2D] = {}
        self._bands: dict[tuple[str, str], Polygon] = {}
        self._insides: dict[str, str] = {}
        self._edges: dict[str, list[tuple[Array, Array, Array]]] = {}
        self._legend: dict[str, tuple[str, Artist]] = {}
        texts = [text for row in labels for text in row]
        sheet = self.figure.add_gridspec(len(labels), len(beside) + len(labels[0]))
        pictures = [self.figure.add_subplot(sheet[:, column]) for column in range(len(beside))]
        grid = sheet[:, len(beside) :].subgridspec(len(labels), len(labels[0])).subplots(squeeze=False)
        titles = [*beside, *(title for title, _ in texts)]
        lettered = style.letter_panels([*pictures, *grid.flat], titles)
        self.pictures = dict(list(lettered.items())[: len(beside)])
        self.axes = {letter: axes for letter, axes in lettered.items() if letter not in self.pictures}
        self._framing: dict[str, list[Array]] = {letter: [] for letter in self.axes}
        self._diverged: dict[str, list[Line2D]] = {letter: [] for letter in self.axes}
        sharing = len(labels) - len(apart)
        x_labels = ["Time (s)" if row == sharing - 1 else "" for row in range(sharing)] + [*apart]
        for (letter, axes), ((row, column), _), (title, y_label) in zip(
            self.axes.items(), np.ndenumerate(grid), texts, strict=True
        ):
            first = grid[0, 0] if row < sharing else grid[sharing, column]
            if axes is not first:
                axes.sharex(first)
            axes.set(xlabel=x_labels[row], ylabel=y_label)
            axes.tick_params(labelbottom=bool(x_labels[row]))
            self.places[letter] = row, title.partition(",")[0]

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
        x, y = thin(time, values)
        (line,) = self.axes[letter].plot(
            x, y, **stroke.line, drawstyle="steps-post" if as_steps else "default"
        )
        self.lines[letter, name] = line
        if label:
            line.set_label(label)
            self._legend.setdefault(label, (name, line))
        if not diverged:
            self._framing[letter].append(y)
        elif len(y):
            self._diverged[letter].append(line)

    def band(self, letter: str, name: str, time: Array, edges: tuple[Array, Array], stroke: Stroke) -> None:
        """Draw the band between two edges (T,), below all curves.

        Bands are opaque, the narrowest on top; what all cover is grey, and edges lie above. In the legend a
        band lies behind the curve of its name.
        """
        low, high = edges
        white = _INSIDES[len(self._insides) % len(_INSIDES)]
        colour = self._insides.setdefault(name, style.paler(stroke.colour, white))
        band = Polygon(np.column_stack([np.append(time, time[::-1]), np.append(high, low[::-1])]))
        band.set(facecolor=colour, linewidth=0.0)
        # As a patch each of its vertices would be looked at in Python, for limits that the edges give, too.
        self.axes[letter].add_artist(band)
        look = replace(stroke, colour=style.paler(stroke.colour, _EDGE), width=0.5).line
        for edge in edges:
            self.axes[letter].plot(time, edge, **look, zorder=0.8)
        self._bands[letter, name] = band
        self._edges.setdefault(letter, []).append((time, low, high))
        self._framing[letter].extend(edges)

    def _order_bands(self, letter: str, edges: list[tuple[Array, Array, Array]]) -> None:
        """Lay the narrow bands of a panel on the wide ones, and in grey what all of several cover."""
        bands = [band for (panel, _), band in self._bands.items() if panel == letter]
        widths = [float(np.mean(high - low)) for _, low, high in edges]
        for place, at in enumerate(np.argsort(widths)[::-1], start=1):
            bands[at].set_zorder(0.7 * place / (1 + len(bands)))
        if len(bands) > 1:
            time = min((time for time, _, _ in edges), key=lambda time: float(time[-1]))
            low = np.max([np.interp(time, own, values) for own, values, _ in edges], axis=0)
            high = np.min([np.interp(time, own, values) for own, _, values in edges], axis=0)
            look: Look = {"facecolor": _SHARED, "linewidth": 0.0, "zorder": 0.75}
            self.axes[letter].fill_between(time, low, high, where=high > low, **look)

    def draw_path(self, letter: str, places: Array, label: str) -> None:
        """Draw a dashed line through places (K, 2) of a picture; the legend names it."""
        look: Look = {"color": "black", "linestyle": (0.0, (2.0, 1.5)), "linewidth": 1.3}
        (line,) = self.pictures[letter].plot(*places.T, zorder=5.0, **look)
        self._legend[label] = "", line

    def say_below(self, letter: str, text: str) -> None:
        """Write a remark below a picture."""
        axes = self.pictures[letter]
        axes.text(0.5, 0.0, text, transform=axes.transAxes, ha="center", va="top", fontsize="small")

    def leave_room(self, letter: str, values: Array) -> None:
        """Let a panel show these values, whether or not a curve goes there."""
        self._framing[letter].append(values)

    def mark_time(self, letter: str, time: float, label: str) -> None:
        """Mark a time, s, with a line that the legend explains."""
        mark = self.axes[letter].axvline(time, color="#6E6E6E", linewidth=0.9, zorder=0.85, label=label)
        self._legend.setdefault(label, ("", mark))

    @property
    def windows(self) -> list[tuple[float, float]]:
        """Spans of time that the panels show, s, each once."""
        return sorted({panel.get_xlim() for panel in self.axes.values()})

    def zero_line(self, letter: str) -> None:
        """Draw a hair line at zero."""
        self.axes[letter].axhline(0.0, color="#999999", linewidth=0.4, zorder=0.9)

    def note(self, letter: str, text: str) -> None:
        """Write a remark at the right above a panel."""
        self.axes[letter].set_title(text, loc="right", fontsize="small", linespacing=1.35)

    def explain_bands(self, label: str) -> None:
        """Add a legend entry for the bands of all curves."""
        self._legend[label] = "", Patch(facecolor=_SHARED, edgecolor="#777777", linewidth=0.5)

    def finish(self, name: str, caption: str, origin: str) -> Drawing:
        """Set ranges, legend and imprint, and lay the figure out for all formats."""
        drawn = {letter for letter, _ in self.lines}
        for letter, edges in self._edges.items():
            self._order_bands(letter, edges)
        for letter, axes in self.axes.items():
            if letter not in drawn:
                axes.set_yticks([])
                at = axes.transAxes
                axes.text(0.5, 0.5, "not recorded", transform=at, ha="center", va="center", color="#666666")
            _frame_values(axes, self._framing[letter], self._diverged[letter])
        if len(self._legend) > 1:
            self._draw_legend()
        style.imprint(self.figure, origin)
        self.figure.align_ylabels(list(self.axes.values()))
        style.settle(self.figure)
        panels = self.pictures | self.axes
        return Drawing(name, self.figure, panels, caption, origin, self.lines, self._bands)

    def _draw_legend(self) -> None:
        """Use as few rows as the width allows."""
        handles: list[Any] = []
        for name, artist in self._legend.values():
            inside = self._insides.get(name)
            handles.append((Patch(facecolor=inside, linewidth=0.0), artist) if inside else artist)
        labels = list(self._legend)
        for rows in range(1, len(labels) + 1):
            columns = -(-len(labels) // rows)
            legend = self.figure.legend(handles, labels, loc="outside upper center", ncols=columns)
            if columns == 1 or legend.get_window_extent().width < 0.98 * self.figure.bbox.width:
                return
            legend.remove()


def _frame_values(axes: Axes, framing: list[Array], diverged: list[Line2D]) -> None:
    """Fit the y axis to values, else to the diverged runs, and mark the ends of these."""
    courses = [np.array(line.get_data()) for line in diverged]
    shown = np.concatenate([np.zeros(0), *(framing or [values for _, values in courses])])
    if shown.size:
        low, high = float(shown.min()), float(shown.max())
        # A constant curve needs some room, too.
        margin = _MARGIN * (high - low) or 0.05 * abs(low) or 0.05
        axes.set_ylim(low - margin, high + margin)
    for line, (time, values) in zip(diverged, courses, strict=True):
        end = np.clip(values[-1], *axes.get_ylim())
        (mark,) = axes.plot(time[-1], end, "x", color=line.get_color(), clip_on=False)
        mark.set(markersize=4.0, markeredgewidth=1.0)


def thin(time: Array, values: Array) -> tuple[Array, Array]:
    """Reduce a curve to what can be seen: the extremes of equal groups of samples, and both ends.

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
