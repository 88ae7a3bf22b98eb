"""The figure of a sweep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator

from tendonrepro.arrays import Array
from tendonrepro.experiments.sweep import Sweep, text_of
from tendonrepro.results.figures import style
from tendonrepro.results.figures.style import Look

GONE = ("diverged", "unresolved")
"""Statuses of runs whose errors cannot be compared."""

_BESIDE = 2
"""So many labels of keys have room beside each other."""

_TEXTS = 12
"""And so many of values, slanted."""

_SPREAD = 7.5
"""From this ratio of the largest to the smallest value on, an axis is logarithmic."""


@style.journal_style()
def draw_sweep(sweep: Sweep) -> style.Drawing:
    """MAE of every run above, ratios of the controllers below, a column per joint."""
    grid, joints = sweep.grid, sweep.grid.joints
    rows = ("MAE (deg)", "Ratio of MAE")[: 1 + bool(sweep.ratios)]
    figure = style.open_figure(style.PAGE_MM, 48.0 * len(rows) + 16.0)
    panels = figure.subplots(len(rows), len(joints), sharex="col", squeeze=False)
    for k in range(len(joints)):
        order, x = _set_values(panels[-1, k], sweep, k)
        _draw_errors(panels[0, k], sweep, order, x, k)
        for panel in panels[1:, k]:
            _draw_ratios(panel, sweep, order, x, k)
    if not _is_numeric(sweep):
        for line in (line for panel in panels.flat for line in panel.lines if line.get_marker() != "None"):
            line.set_linestyle("none")
    for panel, label in zip(panels[:, 0], rows, strict=True):
        panel.set_ylabel(label)
    named = style.letter_panels(panels.flat, [f"Joint {joint}" for _ in rows for joint in joints])
    handles = [line for panel in panels[:, 0] for line in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper center", ncols=5)
    digest = grid.base.sha256
    caption = (
        f"Mean absolute tracking error over the whole run under values of "
        f"{' and '.join(axis.key for axis in grid.axes)}. "
        f"Open markers: ringing. Crosses: did not last. Ratios where both runs lasted. "
        f"Diverged: {', '.join(sweep.named('diverged')) or 'none'}. "
        f"Configuration {grid.base.origin}, sweep {digest[:12]}."
    )
    origin = f"Open: ringing; cross: did not last. Simulated, configuration {digest[:8]}"
    return style.Drawing("sweep", figure, named, caption, origin=origin)


def _is_numeric(sweep: Sweep) -> bool:
    """Whether points lie on one axis of numbers; no line joins words or pairs."""
    return len(sweep.grid.axes) == 1 and sweep.grid.axes[0].numbers is not None


def _set_values(panel: Axes, sweep: Sweep, k: int) -> tuple[Sequence[int], Array]:
    """Places of the points along the axis, numbers in order or words side by side; and where they stand."""
    axes, points = sweep.grid.axes, sweep.grid.points
    labels = (axis.key + ("" if axis.unit in (None, "1") else f" ({axis.unit})") for axis in axes)
    joints = len(sweep.grid.joints)
    # Many joints leave no room for the keys below each panel.
    if joints <= _BESIDE or k == (joints - 1) // 2:
        panel.set_xlabel(", ".join(labels))
    panel.margins(x=0.06)
    if len(axes) == 1 and axes[0].numbers is not None:
        numbers = np.array([row[k] for row in axes[0].numbers])
        _set_scale(panel, "x", numbers)
        order = np.argsort(numbers)
        return order.tolist(), numbers[order]
    texts = [
        ", ".join(text_of(axis.values[place]) for axis, place in zip(axes, point.places, strict=True))
        for point in points
    ]
    x = np.arange(len(points), dtype=np.float64)
    if len(points) * joints <= _TEXTS:
        panel.set_xticks(x, texts, rotation=25.0, ha="right")
    else:
        panel.set_xticks(x, texts, rotation=90.0)
    return range(len(points)), x


def _draw_errors(panel: Axes, sweep: Sweep, order: Sequence[int], x: Array, k: int) -> None:
    """Lines of the runs: open markers where they ring, crosses where they did not last."""
    status = sweep.status[order]
    gone = np.isin(status, GONE)
    errors = np.where(gone, np.nan, sweep.sizes["mae_deg"][order, :, k])
    strokes = style.strokes_of(sweep.grid.runs)
    for i, run in enumerate(sweep.grid.runs):
        stroke, y, ringing = strokes[run], errors[:, i], status[:, i] == "ringing"
        look: Look = {"color": stroke.colour, "marker": "osD^v"[i % 5], "markersize": 3.3}
        label = run.replace("_", " ").capitalize()
        panel.plot(x, y, linestyle=stroke.linestyle, linewidth=stroke.width, label=label, **look)
        panel.plot(x[ringing], y[ringing], linestyle="none", markerfacecolor="white", **look)
        height = np.full(gone[:, i].sum(), 0.97 - 0.07 * i)
        across = panel.get_xaxis_transform()
        panel.plot(x[gone[:, i]], height, "x", color=stroke.colour, transform=across)
    _set_scale(panel, "y", errors)


def _draw_ratios(panel: Axes, sweep: Sweep, order: Sequence[int], x: Array, k: int) -> None:
    """Lines of the ratios, paler under a slow load."""
    strokes = style.strokes_of(())
    for i, (pair, ratio) in enumerate(sweep.ratios.items()):
        stroke, label = strokes[f"controller_{pair[1]}"], pair.upper().replace("_", "/")
        simulated, predicted = ratio.simulated[order, k], ratio.predicted[order, k]
        panel.plot(x, simulated, marker="PX"[i], markersize=4.0, label=label, **stroke.line)
        pale: Look = {"color": style.paler(stroke.colour, 0.5), "marker": "_", "zorder": 1.5}
        panel.plot(x, predicted, ":", label=f"{label}, slow load", **pale)
    panel.axhline(1.0, color="#999999", linewidth=0.4, zorder=0.5)


def _set_scale(panel: Axes, which: str, values: Array) -> None:
    seen = values[np.isfinite(values)]
    if not seen.size or seen.min() <= 0.0 or seen.max() <= _SPREAD * seen.min():
        return
    panel.set(**{f"{which}scale": "log"})
    axis = panel.xaxis if which == "x" else panel.yaxis
    axis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), major_formatter="{x:g}")
    axis.minorticks_off()
