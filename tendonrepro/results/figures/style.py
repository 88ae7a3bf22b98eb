"""What all figures share: journal style, sizes, strokes that survive grey print, letters, and files.

A figure is drawn under `journal_style`, from `open_figure` to a `Drawing`; the same gives the same bytes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from textwrap import wrap
from typing import Any, Literal, TypeAlias

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from tendonrepro import __version__
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
    with journal_style(), _without_date():
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


@contextmanager
def _without_date() -> Iterator[None]:
    """Hide a date of the environment from matplotlib: figures hold none, and it might not be one."""
    date = os.environ.pop("SOURCE_DATE_EPOCH", None)
    try:
        yield
    finally:
        if date is not None:
            os.environ["SOURCE_DATE_EPOCH"] = date


def save_drawn(asked: tuple[Callable[[], Drawing], Path, Sequence[str]]) -> list[Path]:
    """Draw a figure and write it into a folder, in formats, as one piece of work."""
    draw, folder, formats = asked
    return save_drawing(draw(), folder, formats)
