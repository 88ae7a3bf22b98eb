"""From a drawn figure to its files; the same figure gives the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tendonrepro.files import atomic_path
from tendonrepro.results.figures.style import journal_style

_MM_PER_INCH = 25.4


class Drawn(Protocol):
    """A figure with the name of its files and the words kept in them."""

    @property
    def figure(self) -> Figure:
        """The figure."""

    @property
    def stem(self) -> str:
        """File name without suffix."""

    @property
    def caption(self) -> str:
        """Caption."""


def sheet(width_mm: float, height_mm: float) -> Figure:
    """Empty figure of a size."""
    size = (width_mm / _MM_PER_INCH, height_mm / _MM_PER_INCH)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, folder: Path, stem: str, title: str, caption: str) -> list[Path]:
    """Write a figure as PDF, SVG and PNG.

    Parameters
    ----------
    figure : Figure
    folder : Path
        Made when missing.
    stem : str
        File name without suffix.
    title, caption : str
        Kept in the files.

    Returns
    -------
    list of Path

    Raises
    ------
    TendonreproError
        When a file cannot be written.
    """
    metadata: dict[str, dict[str, Any]] = {
        "pdf": {"Title": title, "Subject": caption, "CreationDate": None},
        "svg": {"Title": title, "Description": caption, "Date": None},
        "png": {"Title": title, "Description": caption},
    }
    paths = [folder / f"{stem}.{suffix}" for suffix in metadata]
    with journal_style():
        for path, (suffix, entries) in zip(paths, metadata.items(), strict=True):
            with atomic_path(path) as temporary:
                figure.savefig(temporary, format=suffix, metadata=entries)
    return paths


def save_drawn(drawn: Drawn, folder: Path) -> list[Path]:
    """Write a figure that brings its name and caption, as :func:`save_figure` does."""
    return save_figure(drawn.figure, folder, drawn.stem, drawn.stem, drawn.caption)
