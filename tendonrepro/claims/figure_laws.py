"""What tells the controllers apart beyond their mean error: spectra, distributions, a reversal from near."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tendonrepro.arrays import Array
from tendonrepro.physics.metrics import periodogram
from tendonrepro.results.figures.style import PAGE_MM, SERIES, journal_style, open_figure
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS

Curve = Callable[[Trace, int], tuple[Array, Array]]

NEAR = 0.6
"""Time shown around a reversal, s to both sides."""
BANDS = 120
"""Points of a spectrum, evenly spaced on a logarithmic axis."""


def draw_laws(file: TraceFile) -> Figure:
    """Torque and estimation error over frequency, the error's distribution, and the error at a reversal.

    Parameters
    ----------
    file : TraceFile
        Of a comparison with at least one of Controllers 1 to 3.

    Returns
    -------
    Figure
        A row for each of the four, a column for each joint.
    """
    runs = {name: file.runs[name] for name in CONTROLLERS if name in file.runs}
    joints = next(iter(runs.values())).joint
    with journal_style():
        figure = open_figure(PAGE_MM, 185.0)
        grid = figure.subplots(4, len(joints), squeeze=False)
        for i, joint in enumerate(joints):
            _draw(grid[0, i], runs, i, _spectrum_of("tau_m"))
            _label(grid[0, i], "frequency (Hz)", "torque (N m)", "log")
            grid[0, i].set_title(f"Joint {joint}")
            _draw(grid[1, i], runs, i, _spectrum_of("epsilon"))
            _label(grid[1, i], "frequency (Hz)", "ε (rad s⁻²)", "log")
            _draw(grid[2, i], runs, i, _distribution)
            _label(grid[2, i], "|error| (deg)", "share of samples below", "linear")
            _draw(grid[3, i], runs, i, _reversal)
            _label(grid[3, i], "time from the reversal (s)", "error (deg)", "linear")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def _draw(axes: Axes, runs: Mapping[str, Trace], joint: int, curve: Curve) -> None:
    for (name, trace), series in zip(runs.items(), SERIES, strict=False):
        label = name.replace("_", " ").capitalize()
        axes.plot(*curve(trace, joint), color=series.colour, linestyle=series.linestyle, label=label)


def _label(axes: Axes, x: str, y: str, scale: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_xscale(scale)
    axes.set_yscale(scale)


def _spectrum_of(variable: str) -> Curve:
    """Root mean square in bands of equal ratio, the constant part left out."""

    def curve(trace: Trace, joint: int) -> tuple[Array, Array]:
        signal = trace[variable][:, [joint]]
        # An unfinished last sample of ε has no successor to be compared with.
        frequency, power = periodogram(
            signal[np.isfinite(signal[:, 0])], float(trace.time[1] - trace.time[0])
        )
        edges = np.geomspace(frequency[1], frequency[-1], BANDS + 1)
        sums = np.histogram(frequency[1:], edges, weights=power[1:, 0])[0]
        held = sums > 0.0
        return np.sqrt(edges[:-1] * edges[1:])[held], np.sqrt(sums[held])

    return curve


def _distribution(trace: Trace, joint: int) -> tuple[Array, Array]:
    size = np.sort(np.abs(np.rad2deg(trace["e"][:, joint])))
    return size, np.arange(1, size.size + 1) / size.size


def _reversal(trace: Trace, joint: int) -> tuple[Array, Array]:
    """Error around the last reversal of the first period: the arm begins to move down."""
    down = np.flatnonzero((trace["dq_d"][1:, joint] < 0.0) & (trace["dq_d"][:-1, joint] >= 0.0))
    at = trace.time[down[0]] if down.size else trace.time[0]
    near = np.abs(trace.time - at) <= NEAR
    return trace.time[near] - at, np.rad2deg(trace["e"][near, joint])
