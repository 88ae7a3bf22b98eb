"""The figure of an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tendonrepro.analysis.margins import ChannelMargins, angle_grid, channel, response
from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import run_in_words
from tendonrepro.experiments.loops import View
from tendonrepro.physics.linear_loop import Complex, open_loop
from tendonrepro.results.figures import style


@style.journal_style()
def draw_margins(
    joints: Sequence[int],
    views: Mapping[str, View],
    margins: Mapping[str, Sequence[ChannelMargins]],
    posture: Array,
    origin: str,
) -> style.Drawing:
    """Gain and phase of every joint's open loop at a posture, rad, with `margins` by run as circles."""
    figure = style.open_figure(style.PAGE_MM, 100.0)
    grid = figure.subplots(2, len(joints), squeeze=False, sharex=True, sharey="row")
    style.letter_panels(
        grid.flat, [f"Joint {joint}, {what}" for what in ("gain", "phase") for joint in joints]
    )
    strokes, low_gains = style.strokes_of(views), []
    for run, view in views.items():
        hertz, channels = curves(view, posture)
        low_gains.append(np.abs(channels[:, 0]).max())
        for (gain, phase), value, of_joint in zip(grid.T, channels, margins[run], strict=True):
            gain.plot(hertz, np.abs(value), label=run_in_words(run), **strokes[run].line)
            phase.plot(hertz, _loop_phase(value), **strokes[run].line)
            height = np.exp(np.interp(np.log(of_joint.gain_margin_hz), np.log(hertz), np.log(np.abs(value))))
            circle = {"markersize": 3.2, "markerfacecolor": "white", "markeredgecolor": strokes[run].colour}
            gain.plot([of_joint.gain_margin_hz], [height], "o", **circle)
    for gain, phase in grid.T:
        gain.axhline(1.0, color="#999999", linewidth=0.5)
        phase.axhline(-180.0, color="#999999", linewidth=0.5)
        phase.set_xlabel("Frequency (Hz)")
    grid[0, 0].set(xscale="log", yscale="log", ylabel="Loop gain")
    # A law with a pole on the unit circle has no finite gain there.
    grid[0, 0].set_ylim(max(grid[0, 0].get_ylim()[0], 1e-5), 3.0 * max(low_gains))
    grid[1, 0].set(yticks=np.arange(-360.0, 181.0, 90.0), ylim=(-360.0, 180.0), ylabel="Loop phase (deg)")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    caption = (
        "Open loops of every joint, the other loops closed, at the middle of the motion; circles are gain "
        f"margins, the worst of three postures. {origin}."
    )
    told = f"Circles: gain margins. Computed from the linear model, {origin}"
    return style.Drawing("explain_margins", figure, figure.axes, caption, origin=told)


def curves(view: View, q: Array) -> tuple[Array, Complex]:
    """Hz (F,), and the response (n, F) of every joint's channel at a posture, rad."""
    A, B, C = cut = open_loop(q, view.plant, view.law, view.delay)
    angles = angle_grid(A + B @ C)
    hertz = angles / (2.0 * np.pi * view.law.L)
    shown = hertz >= 0.02
    channels = [response(channel(cut, joint), angles[shown])[:, 0, 0] for joint in range(q.size)]
    return hertz[shown], np.stack(channels)


def _loop_phase(value: Array) -> Array:
    """Phase of -G, deg, continuous; above -270 and up to 90 at the lowest frequency.

    A slow load is countered with -90 to -180 deg and a little more, which must not wrap to 170.
    """
    phase = np.rad2deg(np.unwrap(np.angle(-value)))
    return np.asarray(phase - 360.0 * np.ceil((phase[0] - 90.0) / 360.0))
