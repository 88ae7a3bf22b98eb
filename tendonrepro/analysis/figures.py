"""Pictures of what was found about the loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.analysis.explain import Explanation, view_pairs
from tendonrepro.arrays import Array
from tendonrepro.configuration.shown import run_in_words
from tendonrepro.results.figures.style import (
    COLUMN_MM,
    PAGE_MM,
    Drawing,
    Look,
    Stroke,
    journal_style,
    letter_panels,
    open_figure,
    strokes_of,
)

_PALE = "#E4EAF1"


def figures(explanation: Explanation) -> dict[str, Callable[[], Drawing]]:
    """Every picture of an explanation, by name."""
    drawn = {
        "explain_margins": (draw_margins, "Open loops of every joint, the other loops closed"),
        "explain_map": (draw_map, "Borders of stability"),
    }
    laws = {view.law_name for pair in view_pairs(explanation.views) for view in pair[1:]}
    if laws and laws <= explanation.loads.error.keys():
        caption = (
            "Error that a load on a joint leaves, by the load's frequency: one controller's over the next "
            "one's; below the line the first has the smaller error"
        )
        drawn["explain_loads"] = draw_loads, caption
    return {
        stem: partial(_drawing, stem, draw, caption, explanation) for stem, (draw, caption) in drawn.items()
    }


@journal_style()
def _drawing(
    stem: str, draw: Callable[[Explanation], Figure], caption: str, explanation: Explanation
) -> Drawing:
    figure = draw(explanation)
    text = f"{caption}; tendonrepro {__version__}, {explanation.origin}."
    return Drawing(
        stem, figure, figure.axes, text, origin=f"Computed from the linear model, {explanation.origin}"
    )


def draw_margins(explanation: Explanation) -> Figure:
    """Gain and phase of every joint's open loop, gain margins as circles."""
    figure, grid = _sheet(2, len(explanation.joints), 100.0, sharex=True, sharey="row")
    titles = [f"Joint {joint}, {what}" for what in ("gain", "phase") for joint in explanation.joints]
    letter_panels(grid.ravel(), titles)
    for k in range(len(explanation.joints)):
        gain, phase = grid[:, k]
        gain.axhline(1.0, color="#999999", linewidth=0.5)
        phase.axhline(-180.0, color="#999999", linewidth=0.5)
        strokes = strokes_of(explanation.curves)
        for run, (hertz, channels) in explanation.curves.items():
            stroke, value = strokes[run], channels[k]
            _line(gain, hertz, np.abs(value), stroke, run)
            _line(phase, hertz, _loop_phase(value), stroke, run)
            place = explanation.margins[run].joints[k].gain_margin_hz
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
    low_gain = max(float(np.abs(channels[:, 0]).max()) for _, channels in explanation.curves.values())
    # A law with a pole on the unit circle has no finite gain there.
    grid[0, 0].set_ylim(max(grid[0, 0].get_ylim()[0], 1e-5), 3.0 * low_gain)
    grid[0, 0].set_ylabel("Loop gain")
    grid[1, 0].set_ylabel("Loop phase (deg)")
    _legend(figure, grid[0, 0], [_sample("o", "gain margin")])
    return figure


def _loop_phase(value: Array) -> Array:
    """Phase of -G, deg, continuous; above -270 and up to 90 at the lowest frequency.

    A slow load is countered with -90 to -180 deg and a little more, which must not wrap to 170.
    """
    phase = np.rad2deg(np.unwrap(np.angle(-value)))
    return np.asarray(phase - 360.0 * np.ceil((phase[0] - 90.0) / 360.0))


def draw_map(explanation: Explanation) -> Figure:
    """Borders of stability of every run; where all are stable is pale."""
    figure, grid = _sheet(1, 1, 82.0, width_mm=COLUMN_MM)
    axes, factors, borders = grid[0, 0], explanation.borders.factors, explanation.borders.distance
    least = np.min(list(borders.values()), axis=0)
    if least.max() > 0.0:
        axes.contourf(factors, factors, least, levels=[0.0, 1e9], colors=[_PALE])
    strokes = strokes_of(borders)
    for run, distance in borders.items():
        stroke = strokes[run]
        if distance.min() < 0.0 < distance.max():
            style: Look = {"colors": [stroke.colour], "linestyles": [stroke.linestyle]}
            axes.contour(factors, factors, distance, levels=[0.0], linewidths=1.1, **style)
        # A contour is no legend entry of its own.
        _line(axes, np.array([]), np.array([]), stroke, run)
    axes.plot([1.0], [1.0], "k*", markersize=5.0, markeredgewidth=0.0, zorder=4.0)
    axes.set(xscale="log", yscale="log", xlim=factors[[0, -1]], ylim=factors[[0, -1]])
    for axis, name in ((axes.xaxis, "stiffness $K_s$"), (axes.yaxis, "damping $D_s$")):
        ticks = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
        axis.set_label_text(f"Factor on tendon {name}")
    stable = Patch(color=_PALE, label="all stable")
    _legend(figure, axes, [_sample("*", "as configured", "black"), stable], columns=2)
    return figure


def draw_loads(explanation: Explanation) -> Figure:
    """Error per load of one law over that of the next, by frequency."""
    responses = explanation.loads
    figure, grid = _sheet(1, len(explanation.joints), 70.0, sharey=True)
    for k, axes in enumerate(grid[0]):
        axes.axvspan(responses.hertz[0], responses.motion_hz, color=_PALE, linewidth=0.0, label="the motion")
        axes.axhline(1.0, color="#999999", linewidth=0.6)
        axes.axvline(
            responses.mode_hz, color="#777777", linewidth=0.7, linestyle="--", label="the arm on its tendons"
        )
        strokes = strokes_of(responses.error)
        for _, a, b in view_pairs(explanation.views):
            ratio = responses.error[a.law_name][k] / responses.error[b.law_name][k]
            _line(axes, responses.hertz, ratio, strokes[a.law_name], f"{a.law_name} over {b.law_name}")
        # Below six panels there is no room for more words.
        axes.set(xscale="log", xlim=responses.hertz[[0, -1]], xlabel="Frequency (Hz)")
    grid[0, 0].set_ylabel("Error of one over the other")
    letter_panels(grid[0], [f"Joint {joint}" for joint in explanation.joints])
    _legend(figure, grid[0, 0], columns=4)
    return figure


def _sheet(
    rows: int,
    cols: int,
    height_mm: float,
    width_mm: float = PAGE_MM,
    *,
    sharex: bool = False,
    sharey: bool | Literal["row"] = False,
) -> tuple[Figure, NDArray[np.object_]]:
    figure = open_figure(width_mm, height_mm)
    return figure, figure.subplots(rows, cols, squeeze=False, sharex=sharex, sharey=sharey)


def _line(axes: Axes, x: Array, y: Array, stroke: Stroke, label: str) -> None:
    axes.plot(x, y, color=stroke.colour, linestyle=stroke.linestyle, linewidth=stroke.width, label=label)


def _sample(marker: str, label: str, colour: str = "#555555") -> Line2D:
    face = "white" if marker == "o" else colour
    edge = 0.0 if marker in "*." else 0.7
    style: Look = {"markerfacecolor": face, "markeredgewidth": edge, "markersize": 5.0}
    return Line2D([], [], linestyle="none", marker=marker, color=colour, label=label, **style)


def _legend(figure: Figure, axes: Axes, extra: Sequence[Artist] = (), columns: int = 6) -> None:
    handles, names = axes.get_legend_handles_labels()
    texts = [*map(run_in_words, names), *(str(artist.get_label()) for artist in extra)]
    figure.legend([*handles, *extra], texts, loc="outside upper center", ncols=columns)
