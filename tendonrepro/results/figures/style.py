"""The canvas of every figure: journal style, sizes, strokes that survive grey print, letters, and files.

A figure is drawn under `journal_style`, from `open_figure` to a `Drawing`, and written by `save_drawing`. The
same figure gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Literal

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from tendonrepro.files import write_atomically

COLUMN_MM = 85.0
"""Width of one journal column."""

PAGE_MM = 175.0
"""Width of two journal columns."""

_MM_PER_INCH = 25.4


@dataclass(frozen=True)
class Stroke:
    """How a curve looks: colour in hexadecimal RGB, dash and gap in line widths, width in pt."""

    colour: str
    dashes: tuple[float, ...] = ()
    width: float = 0.9

    @property
    def linestyle(self) -> Literal["-"] | tuple[float, tuple[float, ...]]:
        """The dashes in matplotlib's words."""
        return (0.0, self.dashes) if self.dashes else "-"

    @property
    def line(self) -> dict[str, Any]:
        """All of it as matplotlib's settings of a line."""
        return {"color": self.colour, "linestyle": self.linestyle, "linewidth": self.width}


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


def paler(colour: str, white: float) -> str:
    """Mix a colour with a share of white; opaque, so that what lies below does not change it."""
    red, green, blue = (share + white * (1.0 - share) for share in to_rgb(colour))
    return to_hex((red, green, blue))


@contextmanager
def journal_style() -> Iterator[None]:
    """Put the project's style in force, whatever the user's own matplotlib settings are."""
    with style.context(Path(__file__).with_name("tendonrepro.mplstyle"), after_reset=True):
        yield


def open_figure(width_mm: float, height_mm: float) -> Figure:
    """Empty figure of a printed size, mm; its layout keeps texts apart."""
    size = (width_mm / _MM_PER_INCH, height_mm / _MM_PER_INCH)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def imprint(figure: Figure, text: str) -> None:
    """Say below all panels where a figure comes from; a caption gets lost when a picture is passed on."""
    figure.supxlabel(text, x=0.995, ha="right", fontsize="x-small", color="#555555")


def settle(figure: Figure) -> None:
    """Lay a figure out once, under the journal style; without its engine no format computes it again."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


def letter_panels(panels: Iterable[Axes], titles: Iterable[str]) -> dict[str, Axes]:
    """Entitle panels with "(a) ...", "(b) ...", unless there is one alone, and return them by letter.

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
    """A finished figure.

    Attributes
    ----------
    stem : str
        Name of its files, and their title.
    figure : Figure
    axes : mapping or sequence of Axes
        Its panels.
    caption : str
        Kept in the files.
    origin : str
        Printed below the panels.
    """

    stem: str
    figure: Figure
    axes: Any
    caption: str
    origin: str = field(default="", kw_only=True)


def title_of(name: str) -> str:
    """The paper's title of a figure, or the name of one that is not the paper's."""
    number = name.removeprefix("fig")
    return f"Figure {int(number)}" if number.isdecimal() else name


def save_drawing(drawn: Drawing, folder: Path, origin: str = "") -> list[Path]:
    """Write a figure as PDF, SVG and PNG, title and caption in the files, an origin below the panels.

    Raises
    ------
    TendonreproError
        When a file cannot be written.
    """
    title, caption = title_of(drawn.stem), drawn.caption
    metadata: dict[str, dict[str, Any]] = {
        "pdf": {"Title": title, "Subject": caption, "CreationDate": None},
        "svg": {"Title": title, "Description": caption, "Date": None},
        "png": {"Title": title, "Description": caption},
    }
    paths = [folder / f"{drawn.stem}.{suffix}" for suffix in metadata]
    with journal_style():
        if origin or drawn.origin:
            imprint(drawn.figure, origin or drawn.origin)
        settle(drawn.figure)
        for path, (suffix, entries) in zip(paths, metadata.items(), strict=True):
            # Made in memory: the writer of PDF does not survive a full disk.
            image = BytesIO()
            drawn.figure.savefig(image, format=suffix, metadata=entries)
            write_atomically(path, image.getvalue())
    return paths
