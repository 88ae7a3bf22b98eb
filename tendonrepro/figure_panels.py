"""A figure being drawn: panels in a grid, curves in the panels, one legend above all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from string import ascii_lowercase

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tendonrepro.figure_style import Stroke, thin

Array = NDArray[np.float64]

_MM_PER_INCH = 25.4
# Free space above and below the curves, as a share of their range.
_MARGIN = 0.06
_RAW_ALPHA = 0.15


@dataclass(frozen=True)
class FigureArtists:
    """A finished figure and what is in it.

    Parameters
    ----------
    number : int
        The paper's number.
    figure : Figure
        Laid out for the journal style, which `tendonrepro.figures.save` puts in force again.
    axes : dict
        Panels by letter.
    lines : dict
        Curves by panel letter and name, such as ``("c", "Controller 1")``; the raw samples below a mean are
        ``("c", "Controller 1 raw")``.
    caption : str
        What is shown, which runs went wrong, and where it all comes from.
    """

    number: int
    figure: Figure
    axes: dict[str, Axes]
    lines: dict[tuple[str, str], Line2D]
    caption: str


@dataclass
class _Panel:
    """One panel: its axes, the values that set its y range, and those that may leave it."""

    axes: Axes
    framing: list[Array] = field(default_factory=list)
    loose: list[Array] = field(default_factory=list)
    raw: list[Array] = field(default_factory=list)
    ends: list[tuple[float, float, str]] = field(default_factory=list)


class Sheet:
    """A figure under construction.

    Parameters
    ----------
    width_mm, height_mm : float
        Printed size.
    labels : sequence of rows of (title, y label)
        The grid of panels, which share the time axis. Each title gets its letter; a single panel needs none.
    """

    def __init__(
        self, width_mm: float, height_mm: float, labels: Sequence[Sequence[tuple[str, str]]]
    ) -> None:
        size = (width_mm / _MM_PER_INCH, height_mm / _MM_PER_INCH)
        self._layout = ConstrainedLayoutEngine()
        self.figure = Figure(figsize=size, layout=self._layout)
        FigureCanvasAgg(self.figure)
        grid = self.figure.subplots(len(labels), len(labels[0]), sharex=True, squeeze=False)
        self._panels: dict[str, _Panel] = {}
        self._lines: dict[tuple[str, str], Line2D] = {}
        self._legend: dict[str, Line2D] = {}
        texts = [text for row in labels for text in row]
        for letter, axes, (title, y_label) in zip(ascii_lowercase, grid.flat, texts, strict=False):
            axes.set_title(f"({letter}) {title}" if len(texts) > 1 else "")
            axes.set_ylabel(y_label)
            self._panels[letter] = _Panel(axes)
        for axes in grid[-1]:
            axes.set_xlabel("Time (s)")

    @property
    def letters(self) -> list[str]:
        """Letters of the panels, row by row."""
        return list(self._panels)

    def curve(
        self,
        letter: str,
        name: str,
        time: Array,
        values: Array,
        stroke: Stroke,
        *,
        label: str | None = None,
        diverged: bool = False,
    ) -> None:
        """Draw a curve.

        Parameters
        ----------
        letter : str
            Panel.
        name : str
            Key of the line.
        time, values : Array
            Shape (T,), in the panel's units.
        stroke : Stroke
            Its look.
        label : str, optional
            Text in the legend, where equal texts are listed once; `name` unless given, nothing when empty.
        diverged : bool
            Mark the last sample, and leave the range of the y axis to the other curves.
        """
        panel = self._panels[letter]
        x, y = thin(time, values)
        (line,) = panel.axes.plot(
            x, y, color=stroke.colour, linestyle=stroke.linestyle, linewidth=stroke.width
        )
        self._lines[letter, name] = line
        text = name if label is None else label
        if text:
            line.set_label(text)
            self._legend.setdefault(text, line)
        (panel.loose if diverged else panel.framing).append(y)
        if diverged and len(y):
            panel.ends.append((float(x[-1]), float(y[-1]), stroke.colour))

    def raw(self, letter: str, name: str, time: Array, values: Array, stroke: Stroke) -> None:
        """Draw single samples, pale and below everything else.

        They do not set the range of the y axis; where they leave it, the panel says so. They are pixels even
        in the vector formats, since thousands of strokes as high as the panel would only make those large.

        Parameters
        ----------
        letter : str
            Panel.
        name : str
            Name of the curve whose samples they are.
        time, values : Array
            Shape (T,), in the panel's units.
        stroke : Stroke
            Look of that curve; its colour is used.
        """
        panel = self._panels[letter]
        x, y = thin(time, values)
        (line,) = panel.axes.plot(x, y, color=stroke.colour, linewidth=0.4, alpha=_RAW_ALPHA, zorder=1.0)
        line.set_rasterized(True)
        line.set_antialiased(False)
        line.set_solid_joinstyle("bevel")
        self._lines[letter, f"{name} raw"] = line
        panel.raw.append(y)

    def zero_line(self, letter: str) -> None:
        """Draw a hair line at zero."""
        self._panels[letter].axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.9)

    def note(self, letter: str, text: str) -> None:
        """Write a remark above a panel, at its right end."""
        self._panels[letter].axes.set_title(text, loc="right", fontsize="small")

    def not_recorded(self, letter: str) -> None:
        """Say in an empty panel that its variable was not recorded."""
        axes = self._panels[letter].axes
        axes.set_yticks([])
        axes.text(
            0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color="#666666"
        )

    def explain(self, label: str, stroke: Stroke) -> None:
        """Add a legend entry that stands for no single curve."""
        self._legend[label] = Line2D([], [], color=stroke.colour, linewidth=stroke.width)

    def finish(self, number: int, caption: str) -> FigureArtists:
        """Set ranges and legend, and lay the figure out once for all formats.

        Parameters
        ----------
        number : int
            The paper's number.
        caption : str
            Kept with the figure.

        Returns
        -------
        FigureArtists
            Ready to save.
        """
        self._frame_time()
        for letter, panel in self._panels.items():
            low, high = _frame_values(panel)
            if any(((values < low) | (values > high)).any() for values in panel.raw):
                self.note(letter, "raw clipped")
        if len(self._legend) > 1:
            self._draw_legend()
        self.figure.align_ylabels()
        self._layout.execute(self.figure)
        # The layout is settled; without its engine no format computes it again.
        self.figure.set_layout_engine(None)
        axes = {letter: panel.axes for letter, panel in self._panels.items()}
        return FigureArtists(number, self.figure, axes, self._lines, caption)

    def _frame_time(self) -> None:
        times = [np.asarray(line.get_xdata(), float) for line in self._lines.values()]
        spans = [(time[0], time[-1]) for time in times if len(time)]
        if not spans:
            return
        start, end = _widened(float(np.min(spans)), float(np.max(spans)))
        # A run of 18 s sampled at 1 ms ends at 17.999 s; rounding up gives the axis its last tick.
        unit = 10.0 ** (math.floor(math.log10(end - start)) - 2)
        self._panels["a"].axes.set_xlim(start, math.ceil(end / unit - 1e-6) * unit)

    def _draw_legend(self) -> None:
        """Use as few rows as the width allows; matplotlib itself does not wrap a legend."""
        handles, labels = list(self._legend.values()), list(self._legend)
        for rows in range(1, len(labels) + 1):
            columns = -(-len(labels) // rows)
            legend = self.figure.legend(handles, labels, loc="outside upper center", ncols=columns)
            if columns == 1 or legend.get_window_extent().width < 0.98 * self.figure.bbox.width:
                return
            legend.remove()


def _frame_values(panel: _Panel) -> tuple[float, float]:
    """Fit the y axis to the framing values, else to the loose ones, and mark where diverged runs end."""
    framing = [values for values in panel.framing or panel.loose if len(values)]
    if framing:
        low = min(float(values.min()) for values in framing)
        high = max(float(values.max()) for values in framing)
        low, high = _widened(low, high)
        margin = _MARGIN * (high - low)
        panel.axes.set_ylim(low - margin, high + margin)
    low, high = panel.axes.get_ylim()
    for time, value, colour in panel.ends:
        shown = min(max(value, low), high)
        panel.axes.plot(
            [time], [shown], "x", markersize=4.0, markeredgewidth=1.0, color=colour, clip_on=False
        )
    return low, high


def _widened(low: float, high: float) -> tuple[float, float]:
    """Give a constant curve some room; any other range stays as it is."""
    if high - low > 1e-9 * max(abs(low), abs(high)):
        return low, high
    half = 0.05 * abs(low) or 0.05
    return low - half, high + half
