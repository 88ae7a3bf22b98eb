"""What all figures share: journal style, sizes, strokes that survive grey print, panels over time, files.

A figure is drawn under `journal_style`, from `open_figure` to a `Drawing`; the same gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from textwrap import wrap
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends import backend_pdf  # noqa: F401 (else every process that draws would load it)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from tendonrepro import __version__
from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND, THIRD
from tendonrepro.files import write_atomically
from tendonrepro.results.figures import DRAWN

Look: TypeAlias = dict[str, Any]
"""How matplotlib shall draw: keyword arguments of its functions."""

COLUMN_MM = 85.0
"""Width of one journal column."""

PAGE_MM = 175.0
"""Width of two journal columns."""

NOTEBOOK_DPI = 120
"""Fine enough for a screen; a printed figure has more."""

_EDGE = 0.005
"""Free space beside what is printed below the panels, as a share of the width."""

# No panel is wider than 75 mm, so a column is at most half as wide as the line drawn through it.
_ENVELOPE_COLUMNS = 600
# Free space above and below the curves, as a share of their range.
_MARGIN = 0.06
# Share of white in the insides of bands, in the order in which they are drawn, then from the first on again:
# with the colours of controllers they differ in lightness too. And in the edges, which lie above all insides.
_INSIDES, _EDGES = (0.6, 0.65, 0.65), 0.35
_SHARED = "#EDEDED"


@dataclass(frozen=True)
class Stroke:
    """Look of a curve: colour in hexadecimal RGB, dash and gap in line widths, width in pt."""

    colour: str
    dashes: tuple[float, ...] = ()
    width: float = 0.9

    @property
    def linestyle(self) -> Literal["-"] | tuple[float, tuple[float, ...]]:
        """The dashes in matplotlib's words."""
        return (0.0, self.dashes) if self.dashes else "-"

    @property
    def line(self) -> Look:
        """All of it as settings of a matplotlib line."""
        return {"color": self.colour, "linestyle": self.linestyle, "linewidth": self.width}


SERIES = (
    Stroke("#004488"),
    Stroke("#B5405A", (4.0, 1.6)),
    Stroke("#CC8800", (1.3, 1.1), 1.1),
    Stroke("#000000", (6.0, 1.5, 1.3, 1.5)),
    Stroke("#777777", (9.0, 2.5)),
    Stroke("#228833", (3.0, 1.2, 1.0, 1.2, 1.0, 1.2)),
)
"""Strokes of joints and motors by number; of controllers `strokes_of` knows which.

The first three colours are told apart by any kind of colour vision, and by lightness in grey print.
"""


def stroke_of(number: int) -> Stroke:
    """Stroke of a joint or motor by its number from 1; strokes repeat."""
    return SERIES[(number - 1) % len(SERIES)]


def strokes_of(runs: Iterable[str]) -> dict[str, Stroke]:
    """Strokes of the paper's runs, in every figure the same, and of further `runs`, the rest in turn.

    A ratio of two runs has the stroke of the first.
    """
    strokes = dict(zip((FIRST, SECOND, THIRD), SERIES, strict=False))
    # With a payload Controller 1 keeps its hue, paler.
    strokes[LOADED] = Stroke("#5DA5DA", (4.0, 1.6))
    further = [name for name in runs if name not in strokes]
    return strokes | {name: SERIES[3 + place % (len(SERIES) - 3)] for place, name in enumerate(further)}


REFERENCE = Stroke("#BEBEBE", (), 2.6)
"""Wide and pale, below the curve that is meant to cover it."""


def paler(colour: str, white: float) -> str:
    """Mix a colour with a share of white; opaque, so that nothing below shines through."""
    red, green, blue = (share + white * (1.0 - share) for share in to_rgb(colour))
    return to_hex((red, green, blue))


journal_style = partial(style.context, Path(__file__).with_name("tendonrepro.mplstyle"), after_reset=True)
"""Puts the project's style in force, whatever the user's own matplotlib settings are."""


class ShownFigure(Figure):
    """A figure that a notebook shows as the value of a cell, without ``%matplotlib inline``."""

    def _repr_png_(self) -> bytes:
        image = BytesIO()
        with journal_style():
            self.savefig(image, format="png", dpi=NOTEBOOK_DPI)
        return image.getvalue()


def open_figure(width_mm: float, height_mm: float) -> Figure:
    """Empty figure of a printed size, mm; its layout keeps texts apart."""
    figure = ShownFigure(figsize=(width_mm / 25.4, height_mm / 25.4), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def imprint(figure: Figure, text: str) -> None:
    """Say below all panels where a figure comes from; captions get lost when pictures are passed on.

    A text that is wider than the figure is broken into lines.
    """
    label = figure.supxlabel(text, x=1.0 - _EDGE, ha="right", fontsize="x-small", color="#555555")
    for width in range(len(text), 0, -1):
        lines = wrap(text, width, break_on_hyphens=False)
        label.set_text("\n".join(lines))
        if label.get_window_extent().width <= (1.0 - 2.0 * _EDGE) * figure.bbox.width:
            break


def settle(figure: Figure) -> None:
    """Lay a figure out once, under the journal style; without its engine no format does it again."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def mark_cut(
    panel: Axes, ends: tuple[float, float], y: float, limits: tuple[float, float], colour: str
) -> None:
    """Mark with arrows where a bar at a height y goes on beyond the limits of its panel."""
    (low, high), (left, right) = ends, limits
    for edge, arrow in [(left, "<")] * bool(low < left) + [(right, ">")] * bool(high > right):
        panel.plot([edge], [y], arrow, color=colour, markersize=4.0, clip_on=False, zorder=3.0)


def letter_panels(panels: Iterable[Axes], titles: Iterable[str]) -> dict[str, Axes]:
    """Entitle panels with "(a) ...", unless there is one alone, and return them by letter.

    After (z) comes (aa), then (bb).
    """
    named = list(zip(panels, titles, strict=True))
    letters = [ascii_lowercase[place % 26] * (place // 26 + 1) for place in range(len(named))]
    if len(named) > 1:
        for letter, (axes, title) in zip(letters, named, strict=True):
            axes.set_title(f"({letter}) {title}")
    return dict(zip(letters, (axes for axes, _ in named), strict=True))


@dataclass(frozen=True)
class Drawing:
    """A finished figure, and its panels.

    `stem` is the name of its files. The `caption` says what it shows; it lies beside the figure as text.
    The `origin` is printed below the panels. `lines` and `bands` of a figure drawn from traces are by panel
    and name: ``("c", "Controller 1")``.
    """

    stem: str
    figure: Figure
    axes: Sequence[Axes] | Mapping[str, Axes]
    caption: str
    origin: str = ""
    lines: Mapping[tuple[str, str], Line2D] = field(default_factory=dict)
    bands: Mapping[tuple[str, str], Polygon] = field(default_factory=dict)


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
        self.figure = open_figure(width_mm, height_mm)
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
        lettered = letter_panels([*pictures, *panels.flat], titles)
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
            colour = self._insides.setdefault(name, paler(stroke.colour, white))
            corners = np.column_stack([np.append(time, time[::-1]), np.append(high, low[::-1])])
            order = 0.7 * (1 + widest_first.index(name)) / (1 + len(bands))
            band = self.bands[letter, name] = Polygon(corners, facecolor=colour, linewidth=0.0, zorder=order)
            # As a patch each of its corners would be looked at in Python, for ranges that the edges have.
            axes.add_artist(band)
            edge = replace(stroke, colour=paler(stroke.colour, _EDGES), width=0.5)
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
        imprint(self.figure, origin)
        self.figure.align_ylabels(list(self.axes.values()))
        settle(self.figure)
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


def title_of(name: str) -> str:
    """Title of a figure, its name where it is not the paper's."""
    number = name.removeprefix("fig")
    return f"Figure {int(number)}" if number.isdecimal() else name


def save_drawing(drawn: Drawing, folder: Path, formats: Sequence[str] = DRAWN) -> list[Path]:
    """Write a figure in every format, and its caption as text.

    A TendonreproError tells where a file cannot be written.
    """
    # Neither a date nor a version, so that the same gives the same bytes.
    metadata: dict[str, dict[str, None]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}
    paths = [folder / f"{drawn.stem}.{suffix}" for suffix in formats]
    with journal_style():
        if drawn.origin and not drawn.figure.get_supxlabel():
            imprint(drawn.figure, drawn.origin)
        settle(drawn.figure)
        for path, suffix in zip(paths, formats, strict=True):
            # Made in memory: the writer of PDF does not survive a full disk.
            image = BytesIO()
            # The usual level, 6, takes twice the time for a tenth of the size.
            options: Look = {"pil_kwargs": {"compress_level": 3}} if suffix == "png" else {}
            drawn.figure.savefig(image, format=suffix, metadata=metadata.get(suffix), **options)
            write_atomically(path, image.getvalue())
    told, origin = folder / f"{drawn.stem}.txt", f"{drawn.origin}; " if drawn.origin else ""
    write_atomically(told, f"{drawn.caption}\n\n{origin}drawn by tendonrepro {__version__}.\n")
    return [*paths, told]


def save_drawn(asked: tuple[Callable[[], Drawing], Path, Sequence[str]]) -> list[Path]:
    """Draw a figure and write it into a folder, in formats, as one piece of work."""
    draw, folder, formats = asked
    return save_drawing(draw(), folder, formats)
