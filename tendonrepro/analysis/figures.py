"""Pictures of what was found about the loops: margins, root loci, and maps of stability."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

from tendonrepro import __version__
from tendonrepro.analysis.analysis import Explanation, Map, view_pairs
from tendonrepro.analysis.loads import draw_loads
from tendonrepro.arrays import Array
from tendonrepro.results.figures.style import (
    PAGE_MM,
    Drawing,
    Stroke,
    journal_style,
    open_figure,
    stroke_of,
)

SYMBOLS: Mapping[str, str] = {
    "M_bar": r"$\bar M$",
    "alpha": r"$\alpha$",
    "K_s": r"tendon stiffness $K_s$",
    "D_s": r"tendon damping $D_s$",
}
"""Parameters as axes name them."""

_SLOWEST_DRAWN = -20.0
_FASTEST_GROWTH = 10.0
_PALE = "#E4EAF1"


def figures(found: Explanation) -> dict[str, Callable[[], Drawing]]:
    """Every picture of an explanation, by name."""
    drawn = {
        "explain_margins": (draw_margins, "Open loops of every joint, the other loops closed"),
        "explain_locus": (draw_locus, "Modes of the loop while one parameter is multiplied"),
        "explain_map": (draw_map, "Borders of stability"),
    }
    pictures: dict[str, Callable[[], Drawing]] = {
        stem: partial(_drawing, stem, draw, caption, found) for stem, (draw, caption) in drawn.items()
    }
    laws = {view.law_name for pair in view_pairs(found.views) for view in pair[1:]}
    if laws and laws <= found.loads.error.keys():
        pairs = {name: (a.law_name, b.law_name) for name, a, b in view_pairs(found.views)}
        pictures["explain_loads"] = partial(draw_loads, found.loads, pairs, found.joints, found.origin)
    return pictures


@journal_style()
def _drawing(stem: str, draw: Callable[[Explanation], Figure], caption: str, found: Explanation) -> Drawing:
    figure = draw(found)
    text = f"{caption}; tendonrepro {__version__}, {found.origin}."
    return Drawing(stem, figure, figure.axes, text, origin=f"Computed from the linear model, {found.origin}")


def draw_margins(found: Explanation) -> Figure:
    """Gain and phase of every joint's open loop over the frequency, with the gain margins as circles."""
    figure, grid = _sheet(2, len(found.joints), 100.0, sharex=True, sharey="row")
    letters = iter(ascii_lowercase)
    for row, title in enumerate(("gain", "phase")):
        for axes, joint in zip(grid[row], found.joints, strict=True):
            axes.set_title(f"({next(letters)}) Joint {joint}, {title}")
    for k in range(len(found.joints)):
        gain, phase = grid[:, k]
        gain.axhline(1.0, color="#999999", linewidth=0.5)
        phase.axhline(-180.0, color="#999999", linewidth=0.5)
        for number, (run, (hertz, channels)) in enumerate(found.curves.items(), start=1):
            stroke, value = stroke_of(number), channels[k]
            _line(gain, hertz, np.abs(value), stroke, run)
            # Of -G, continuous from between -180 and 180 at the lowest frequency.
            _line(phase, hertz, np.rad2deg(np.unwrap(np.angle(-value))), stroke, run)
            place = found.rows[run][k]["gain_margin_hz"]
            if np.isfinite(place):
                height = np.exp(np.interp(np.log(place), np.log(hertz), np.log(np.abs(value))))
                circle = {"markersize": 3.2, "markerfacecolor": "white", "markeredgecolor": stroke.colour}
                gain.plot([place], [height], "o", **circle)
        phase.set_xlabel("Frequency (Hz)")
    grid[0, 0].set_yscale("log")
    grid[1, 0].set_xscale("log")
    grid[1, 0].set_yticks(np.arange(-360.0, 361.0, 90.0))
    highest = max(np.max(line.get_ydata()) for axes in grid[1] for line in axes.lines)
    grid[1, 0].set_ylim(-360.0, 0.0 if highest <= 0.0 else 180.0)
    low_gain = max(float(np.abs(channels[:, 0]).max()) for _, channels in found.curves.values())
    # A law with a pole on the unit circle has no finite gain there.
    grid[0, 0].set_ylim(max(grid[0, 0].get_ylim()[0], 1e-5), 3.0 * low_gain)
    grid[0, 0].set_ylabel("Loop gain")
    grid[1, 0].set_ylabel("Loop phase (deg)")
    _legend(figure, grid[0, 0], [_sample("o", "gain margin")])
    return figure


def draw_locus(found: Explanation) -> Figure:
    """Modes as curves, growth across, frequency upwards; circle: as configured, point: the largest factor."""
    figure, grid = _sheet(2, 2, 118.0, sharex=True, sharey=True)
    for letter, axes, (parameter, loci) in zip("abcd", grid.flat, found.loci.items(), strict=True):
        factors = found.locus_factors[parameter]
        here = int(np.abs(factors - 1.0).argmin())
        for number, (law, rates) in enumerate(loci.items(), start=1):
            _branches(axes, rates, here, stroke_of(number))
            _line(axes, np.array([]), np.array([]), stroke_of(number), law)
        axes.axvline(0.0, color="#999999", linewidth=0.5)
        axes.set_title(f"({letter}) {SYMBOLS[parameter]} × {factors[0]:.3g} to {factors[-1]:.3g}")
    _frame_locus(grid)
    _legend(figure, grid[0, 0], [_sample("o", "as configured"), _sample(".", "largest factor")])
    return figure


def _branches(axes: Axes, rates: Any, here: int, stroke: Stroke) -> None:
    growth, hertz = rates.real, np.abs(rates.imag) / (2.0 * np.pi)
    axes.plot(growth, hertz, color=stroke.colour, linestyle=stroke.linestyle, linewidth=stroke.width)
    circle: dict[str, Any] = {"markersize": 4.0, "markerfacecolor": "none", "markeredgecolor": stroke.colour}
    axes.plot(growth[here], hertz[here], "o", markeredgewidth=0.6, **circle)
    axes.plot(growth[-1], hertz[-1], ".", markersize=3.5, color=stroke.colour)


def _frame_locus(grid: Any) -> None:
    first = grid[0, 0]
    first.set_xlim(_SLOWEST_DRAWN, _FASTEST_GROWTH)
    first.set_yscale("symlog", linthresh=1.0, linscale=0.6)
    first.yaxis.set_major_locator(FixedLocator([0.0, 0.5, 1.0, 10.0, 100.0, 500.0]))
    first.yaxis.set_major_formatter(FuncFormatter(_plain))
    first.yaxis.set_minor_formatter(NullFormatter())
    first.set_ylim(-0.12, 900.0)
    for axes in grid[-1]:
        axes.set_xlabel(r"Growth (s$^{-1}$)")
    for axes in grid[:, 0]:
        axes.set_ylabel("Frequency (Hz)")


def _plain(value: float, _place: int) -> str:
    return f"{value:g}"


def draw_map(found: Explanation) -> Figure:
    """Borders of stability of every run over tendons and over gains; where all are stable is pale."""
    figure, grid = _sheet(1, len(found.maps), 82.0)
    for letter, axes, drawn in zip("ab", grid.flat, found.maps, strict=True):
        _borders(axes, drawn)
        axes.set_xscale("log")
        axes.set_yscale("linear" if drawn.y == "alpha" else "log")
        for axis, parameter in ((axes.xaxis, drawn.x), (axes.yaxis, drawn.y)):
            if parameter != "alpha":
                axis.set_major_locator(FixedLocator([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0]))
                axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(FuncFormatter(_plain))
        axes.plot([1.0], [1.0], "k*", markersize=5.0, markeredgewidth=0.0, zorder=4.0)
        axes.set_xlabel(f"Factor on {SYMBOLS[drawn.x]}")
        axes.set_ylabel(f"Factor on {SYMBOLS[drawn.y]}")
        axes.set_title(f"({letter}) " + ("Tendons" if drawn.x == "K_s" else "Gains"))
    _legend(
        figure, grid[0, 0], [_sample("*", "as configured", "black"), Patch(color=_PALE, label="all stable")]
    )
    return figure


def _borders(axes: Axes, drawn: Map) -> None:
    x, y = drawn.x_factors, drawn.y_factors
    least = np.min(list(drawn.distance.values()), axis=0)
    if least.max() > 0.0:
        axes.contourf(x, y, least, levels=[0.0, 1e9], colors=[_PALE])
    for number, (run, distance) in enumerate(drawn.distance.items(), start=1):
        stroke = stroke_of(number)
        if distance.min() < 0.0 < distance.max():
            style: dict[str, Any] = {"colors": [stroke.colour], "linestyles": [stroke.linestyle]}
            axes.contour(x, y, distance, levels=[0.0], linewidths=1.1, **style)
        # A contour is no legend entry of its own.
        _line(axes, np.array([]), np.array([]), stroke, run)
    axes.set_xlim(x[0], x[-1])
    axes.set_ylim(y[0], y[-1])


def _sheet(rows: int, cols: int, height_mm: float, **shared: Any) -> tuple[Figure, Any]:
    figure = open_figure(PAGE_MM, height_mm)
    return figure, figure.subplots(rows, cols, squeeze=False, **shared)


def _line(axes: Axes, x: Array, y: Array, stroke: Stroke, label: str) -> None:
    axes.plot(x, y, color=stroke.colour, linestyle=stroke.linestyle, linewidth=stroke.width, label=label)


def _sample(marker: str, label: str, colour: str = "#555555") -> Line2D:
    face = "white" if marker == "o" else colour
    edge = 0.0 if marker in "*." else 0.7
    style: dict[str, Any] = {"markerfacecolor": face, "markeredgewidth": edge, "markersize": 5.0}
    return Line2D([], [], linestyle="none", marker=marker, color=colour, label=label, **style)


def _legend(figure: Figure, axes: Axes, extra: Sequence[Artist]) -> None:
    handles, names = axes.get_legend_handles_labels()
    texts = [name.replace("_", " ").replace("controller", "Controller") for name in names]
    texts += [str(artist.get_label()) for artist in extra]
    columns = -(-len(texts) // (1 if len(texts) <= 6 else 2))
    figure.legend([*handles, *extra], texts, loc="outside upper center", ncols=columns)
