"""The arm in motion: a scene drawn once, shown at one sample after another, written as film or picture."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import patheffects
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import BoxStyle, Circle, FancyBboxPatch
from matplotlib.ticker import MaxNLocator
from PIL import Image

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.files import atomic_path, write_atomically
from tendonrepro.physics.tendon_path import path_points
from tendonrepro.results.figures.panels import thin
from tendonrepro.results.figures.style import (
    PAGE_MM,
    REFERENCE,
    imprint,
    journal_style,
    letter_panels,
    open_figure,
    settle,
    stroke_of,
)
from tendonrepro.results.scene import Plot, Scene

DPI = 110
"""Of films; a page is then 758 pixels wide."""

_HEIGHT_MM = 98.0
_COLOURS = 64
_LINK, _GHOST, _EDGE = "#D8D8D8", "#EFEFEF", "#777777"
_UNKNOWN, _PUSHES = "#BDBDBD", "#2E6FBB"
_OUTLINE = [patheffects.Stroke(linewidth=2.5, foreground="#444444"), patheffects.Normal()]


class Picture:
    """A scene drawn once; :meth:`show` moves what moves in it.

    Attributes
    ----------
    figure : Figure
    axes : dict of Axes
        Arm and plots by letter.
    colours : ScalarMappable
        Of tensions.
    tendons : list of Line2D
    moving : list of Artist
        Everything that moves, from below upwards.
    """

    def __init__(self, scene: Scene, origin: str) -> None:
        self.scene = scene
        self.figure = open_figure(PAGE_MM, _HEIGHT_MM)
        grid = self.figure.add_gridspec(3, 2, width_ratios=(1.35, 1.0), height_ratios=(1.0, 1.0, 0.05))
        arm, upper = self.figure.add_subplot(grid[:2, 0]), self.figure.add_subplot(grid[0, 1])
        lower = self.figure.add_subplot(grid[1, 1], sharex=upper)
        titles = [f"Run {scene.name}, to scale", *(plot.title for plot in scene.plots)]
        self.axes = letter_panels((arm, upper, lower), titles)
        self._clock = arm.set_title("", loc="right")
        self.colours = _tension_colours(scene.tension)
        self._pointers = self._draw_scale(self.figure.add_subplot(grid[2, 0]))
        self._draw_frame(arm)
        self._links, self._pulleys, self._winches = self._draw_arm(arm)
        self.tendons = [
            arm.plot([], [], linewidth=1.7, path_effects=_OUTLINE, solid_capstyle="round", zorder=4)[0]
            for _ in scene.paths
        ]
        self._cursors = [
            _draw_plot(axes, plot, scene.time) for axes, plot in zip((upper, lower), scene.plots, strict=True)
        ]
        upper.tick_params(labelbottom=False)
        lower.set_xlabel("Time (s)")
        first, last = scene.time[[0, -1]]
        lower.set_xlim(first, last if last > first else first + 1.0)
        _draw_legend(self.figure.add_subplot(grid[2, 1]), upper, lower)
        imprint(self.figure, origin)
        marks = [mark for cursor, dots in self._cursors for mark in (cursor, *(dot for dot, _ in dots))]
        moving = [self._links, *self._winches, *chain(*self._pulleys), *self.tendons]
        self.moving: list[Artist] = [*moving, *marks, *self._pointers, self._clock]
        self.show(0)
        settle(self.figure)

    def show(self, place: int) -> None:
        """Bring everything that moves to one sample."""
        scene = self.scene
        joints, tension = scene.joints[place], scene.tension[place]
        self._clock.set_text(f"t = {scene.time[place]:.2f} s")
        self._links.set_data(*joints.T)
        for joint, pulleys in enumerate(self._pulleys):
            for pulley in pulleys:
                pulley.set_center(tuple(joints[joint]))
        for line, path, force in zip(self.tendons, scene.paths, tension, strict=True):
            line.set_data(*path_points(path, place).T)
            line.set(color=self.colours.to_rgba(force) if np.isfinite(force) else _UNKNOWN)
        for tendon, spoke in enumerate(self._winches):
            # Winding on is turning clockwise.
            angle = np.pi / 2.0 - scene.winches[place, tendon]
            rim = scene.mechanism.winch_diameter[tendon] / 2.0 * np.array([np.cos(angle), np.sin(angle)])
            spoke.set_data(*np.stack([-rim, rim], axis=1) + scene.paths[tendon].centre[0, 0][:, np.newaxis])
        for pointer, force in zip(self._pointers, tension, strict=False):
            pointer.set_visible(bool(np.isfinite(force)))
            pointer.set_x(force)
        for cursor, dots in self._cursors:
            cursor.set_xdata([scene.time[place]] * 2)
            for dot, values in dots:
                dot.set_data([scene.time[place]], [values[place]])

    def _draw_frame(self, axes: Axes) -> None:
        """Fix what is seen, and draw what stands still: the motors' winches and a length to scale."""
        scene = self.scene
        winches = np.array([path.centre[0, 0] for path in scene.paths])
        sizes = scene.mechanism.winch_diameter / 2.0
        low, high = winches.min(axis=0) - sizes.max() - 0.02, winches.max(axis=0) + sizes.max() + 0.02
        width, height = high - low
        round_off = BoxStyle.Round(pad=0.0, rounding_size=0.02)
        box = FancyBboxPatch((low[0], low[1]), width, height, boxstyle=round_off, zorder=0.5)
        box.set(facecolor="#F4F4F4", edgecolor=_EDGE, linewidth=0.6)
        axes.add_patch(box)
        for number, (centre, radius) in enumerate(zip(winches, sizes, strict=True), start=1):
            axes.add_patch(
                Circle(tuple(centre), radius, facecolor="white", edgecolor=_EDGE, linewidth=0.6, zorder=1)
            )
            axes.text(centre[0], low[1] - 0.012, str(number), ha="center", va="top", fontsize=7)
        axes.text(high[0], low[1] - 0.055, "motor winches,\nplace assumed", ha="right", va="top", fontsize=6)
        axes.plot([0.0, winches[0, 0]], [0.0, high[1]], color=_LINK, linewidth=5.0, zorder=0.4)
        widest = scene.mechanism.pulley_diameter.max() / 2.0 + 0.02
        corners = np.vstack([scene.joints.reshape(-1, 2), low - [0.0, 0.12], high])
        left, bottom = corners.min(axis=0) - widest
        right, top = corners.max(axis=0) + np.array([0.01, widest])
        axes.set_aspect("equal", adjustable="box", anchor="C")
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.set_axis_off()
        bar = 0.1
        axes.plot(
            [left, left + bar], [bottom + 0.01] * 2, color="black", linewidth=1.0, solid_capstyle="butt"
        )
        axes.text(left + bar / 2.0, bottom + 0.02, f"{bar:g} m", ha="center", va="bottom", fontsize=7)

    def _draw_arm(self, axes: Axes) -> tuple[Line2D, list[list[Circle]], list[Line2D]]:
        """Links, pulleys by joint, and a mark on each winch."""
        scene = self.scene
        ghost, links = (
            axes.plot(*scene.joints[0].T, color=colour, linewidth=7.0, zorder=zorder)[0]
            for colour, zorder in ((_GHOST, 0.2), (_LINK, 2.0))
        )
        for line in (ghost, links):
            line.set(solid_joinstyle="round", solid_capstyle="round")
        x, y = scene.joints[0, -1]
        axes.text(x, y - 0.02, "start", ha="center", va="top", fontsize=6, color=_EDGE)
        pulleys = []
        for joint, sizes in enumerate(scene.mechanism.pulley_diameter):
            passed = {float(size) for size in sizes[scene.mechanism.side[joint] != 0.0]}
            pulleys.append([_disc((0.0, 0.0), size / 2.0, zorder=3) for size in sorted(passed, reverse=True)])
        if scene.payload > 0.0:
            pulleys.append([_disc((0.0, 0.0), 0.018, zorder=3)])
            pulleys[-1][0].set_facecolor("#444444")
        for disc in chain(*pulleys):
            axes.add_patch(disc)
        winches = [axes.plot([], [], color=_EDGE, linewidth=0.9, zorder=1.5)[0] for _ in scene.paths]
        return links, pulleys, winches

    def _draw_scale(self, axes: Axes) -> list[mpl.text.Text]:
        """Draw the scale of tensions, and a number above it for each tendon that has one."""
        if np.isnan(self.scene.tension).all():
            axes.set_axis_off()
            axes.set_title("Tensions not recorded", color="#666666")
            return []
        bar = self.figure.colorbar(self.colours, cax=axes, orientation="horizontal", drawedges=True)
        bar.outline.set_linewidth(0.5)
        bar.dividers.set(linewidth=0.3, color="white")
        grey = "; grey: not known" if np.isnan(self.scene.tension).any() else ""
        axes.set_xlabel(f"Tension of tendons 1 to {len(self.scene.paths)} (N){grey}")
        return [
            axes.text(
                0.0,
                1.15,
                f"{number}\n$\\blacktriangledown$",
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=7,
                linespacing=0.8,
            )
            for number in range(1, len(self.scene.paths) + 1)
        ]


def _disc(centre: Sequence[float], radius: float, zorder: float) -> Circle:
    x, y = centre
    return Circle((x, y), radius, facecolor="white", edgecolor=_EDGE, linewidth=0.6, zorder=zorder)


def _tension_colours(tension: Array) -> ScalarMappable:
    """Pale to dark by steps from zero up; another hue where a tendon would have to push."""
    known = tension[np.isfinite(tension)]
    top = max(float(known.max(initial=0.0)), 1.0)
    levels = MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, top)
    shades = mpl.colormaps["YlOrRd"](np.linspace(0.18, 1.0, len(levels) - 1))
    pushes = bool(known.min(initial=0.0) < 0.0)
    norm = BoundaryNorm(levels, len(shades) + pushes, extend="min" if pushes else "neither")
    if pushes:
        shades = np.vstack([mpl.colors.to_rgba(_PUSHES), shades])
    return ScalarMappable(norm, ListedColormap(shades))


def _draw_plot(axes: Axes, plot: Plot, time: Array) -> tuple[Line2D, list[tuple[Line2D, Array]]]:
    """Draw a plot's curves, and what moves along them."""
    axes.set_ylabel(plot.y_label)
    axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.9)
    dots = []
    for curve in plot.curves:
        stroke = stroke_of(curve.number)
        drawn = ((curve.reference, REFERENCE, plot.reference), (curve.values, stroke, curve.label))
        for values, look, label in drawn:
            if values is not None:
                (line,) = axes.plot(*thin(time, values), color=look.colour, linewidth=look.width, label=label)
                line.set_linestyle(look.linestyle)
        dot = axes.plot([], [], "o", color=stroke.colour, markersize=3.0, zorder=5)[0]
        dots.append((dot, curve.values))
    return axes.axvline(time[0], color="#444444", linewidth=0.7, zorder=4), dots


def _draw_legend(axes: Axes, *plots: Axes) -> None:
    """Name the curves of some axes; equal names once."""
    axes.set_axis_off()
    named = {
        label: line for plot in plots for line, label in zip(*plot.get_legend_handles_labels(), strict=True)
    }
    labels = sorted(named)
    legend = axes.legend([named[label] for label in labels], labels, loc="upper center", ncols=2)
    legend.set_in_layout(False)


@journal_style()
def save_frames(scene: Scene, origin: str, frames: dict[Path, int]) -> None:
    """Write one sample or several as SVG, each to its path; the same scene gives the same bytes.

    Raises
    ------
    TendonreproError
        If a file cannot be written.
    """
    picture = Picture(scene, origin)
    for path, place in frames.items():
        picture.show(place)
        image = BytesIO()
        title = f"{scene.name} at {scene.time[place]:.2f} s"
        picture.figure.savefig(image, format="svg", metadata={"Title": title, "Date": None})
        write_atomically(path, image.getvalue())


@journal_style()
def save_film(
    scene: Scene, origin: str, path: Path, places: Sequence[int], rate: int, advance: Callable[[int], None]
) -> None:
    """Write samples as a film, GIF or MP4 by the suffix; the same scene gives the same bytes.

    Parameters
    ----------
    scene : Scene
    origin : str
        One line that says where it comes from.
    path : Path
    places : sequence of int
        Samples to show.
    rate : int
        Pictures per second of the film.
    advance : callable
        Told of each picture that is made.

    Raises
    ------
    UsageError
        For an MP4 without ffmpeg.
    TendonreproError
        If the file cannot be written.
    """
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        message = "an MP4 needs the program ffmpeg, which is not on the path"
        raise UsageError(message, where="--out", hint="install ffmpeg, or name a file that ends with .gif")
    picture = Picture(scene, origin)
    with atomic_path(path) as temporary:
        if path.suffix == ".mp4":
            _write_mp4(picture, temporary, places, rate, advance)
        else:
            _write_gif(picture, temporary, places, rate, advance)


def _write_gif(
    picture: Picture, path: Path, places: Sequence[int], rate: int, advance: Callable[[int], None]
) -> None:
    """One palette for all pictures, so that the file holds of each what moved alone."""
    canvas: Any = FigureCanvasAgg(picture.figure)
    picture.figure.set_dpi(DPI)
    # What stands still is drawn once.
    for artist in picture.moving:
        artist.set_animated(True)
    canvas.draw()
    still = canvas.copy_from_bbox(picture.figure.bbox)

    def image_at(place: int) -> Image.Image:
        picture.show(place)
        canvas.restore_region(still)
        for artist in picture.moving:
            picture.figure.draw_artist(artist)
        # Sixteen levels: with more, similar colours of the palette stand in for each other.
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3] // 16 * 17)

    palette = _palette([image_at(place) for place in places[:: max(1, len(places) // 8)]])

    def images() -> Iterator[Image.Image]:
        for place in places:
            yield image_at(place).quantize(palette=palette, dither=Image.Dither.NONE)
            advance(1)

    made = images()
    next(made).save(path, format="GIF", save_all=True, append_images=made, duration=1000 // rate, loop=0)


def _palette(images: Sequence[Image.Image]) -> Image.Image:
    """The commonest colours of some pictures, as they are: an averaged palette has no white."""
    weights = 16 ** np.arange(3)[::-1]
    counts = sum(
        np.bincount((np.asarray(image) // 17 @ weights).ravel(), minlength=16**3) for image in images
    )
    commonest = np.argsort(-np.asarray(counts), kind="stable")[:_COLOURS]
    palette = Image.new("P", (1, 1))
    palette.putpalette((commonest[:, np.newaxis] // weights % 16 * 17).ravel().tolist())
    return palette


def _write_mp4(
    picture: Picture, path: Path, places: Sequence[int], rate: int, advance: Callable[[int], None]
) -> None:
    exact = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-crf", "18"]
    writer = FFMpegWriter(rate, codec="h264", extra_args=exact)
    try:
        with writer.saving(picture.figure, str(path), 2 * DPI):
            for place in places:
                picture.show(place)
                writer.grab_frame()
                advance(1)
    except subprocess.CalledProcessError as error:
        message = f"ffmpeg ended with exit code {error.returncode}"
        raise TendonreproError(message, hint="name a file that ends with .gif") from error
