"""The arm in its plane: its postures and tendons in numbers, how they are drawn, and the film of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image

from tendonrepro.arrays import Array
from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import Json, atomic_path, refuse_existing
from tendonrepro.physics import statics
from tendonrepro.results.figures import style
from tendonrepro.results.paper import origin_of
from tendonrepro.results.records import PlantRecord, Trace, TraceFile
from tendonrepro.results.summary import tensions
from tendonrepro.results.traces import read_traces

RATE = 10
"""Pictures per second of a film."""

MOST_PICTURES = 1000
"""Of a film; all are held in memory."""

_DPI = 110


def animate(
    source: Path,
    talk: Talk,
    *,
    run: str | None = None,
    speed: float = 1.0,
    out: Path | None = None,
    force: bool = False,
) -> Json:
    """Draw the arm of a stored run as a film, and return what ``--json`` prints.

    Parameters
    ----------
    source : Path
        Trace file, or a results folder.
    run : str, optional
        Else the first one.
    speed : float
        Seconds of the run in one second of the film.
    out : Path, optional
        Ends in .gif; else beside the traces by the run's name.

    Raises
    ------
    UsageError
        For options that do not fit the run, and a file that is there.
    DataMissingError
        If the traces cannot be read or do not say where the tendons go.
    """
    file = read_traces(source)
    name = run or next(iter(file.runs))
    target = out or (source if source.is_dir() else source.parent) / f"{name}.gif"
    if target.suffix != ".gif":
        raise UsageError(f"a film ends in .gif, found {target.name!r}", where="--out")
    refuse_existing(target, force=force, inputs=[source])
    scene = scene_of(file, run)
    places = _places(scene.trace.time, speed)
    film = []
    with style.journal_style(), talk.bar(f"{name}: pictures", len(places)) as advance:
        figure, show = draw_scene(scene, origin_of(file))
        figure.set_dpi(_DPI)
        canvas: Any = figure.canvas
        for place in places:
            show(place)
            canvas.draw()
            film.append(Image.fromarray(np.array(canvas.buffer_rgba())).convert("RGB"))
            advance(1)
    look = {"save_all": True, "append_images": film[1:], "duration": 1000 // RATE, "loop": 0}
    with atomic_path(target) as temporary:
        film[0].save(temporary, "GIF", comment=origin_of(file).encode(errors="backslashreplace"), **look)
    return {"schema_version": 1, "files": [str(target)], "run": name, "pictures": len(places)}


def _places(time: Array, speed: float) -> list[int]:
    """Samples nearest to the times of the pictures."""
    count = (time[-1] - time[0]) / speed * RATE if 0.0 < speed < np.inf else np.inf
    if not count <= MOST_PICTURES:
        message = f"must be above zero and leave at most {MOST_PICTURES} pictures, found {speed:g}"
        raise UsageError(message, where="--speed")
    times = time[0] + np.arange(int(count) + 1) * speed / RATE
    return [int(np.abs(time - moment).argmin()) for moment in times]


@dataclass(frozen=True, eq=False)
class Scene:
    """One run of an arm of N joints, at its T samples with all angles known.

    `joints` are places of joints and tip, m, (T, N + 1, 2). `paths` are of the N + 1 tendons, the tensioner
    last; `tension` is theirs, N, (T, N + 1), NaN where unknown.
    """

    trace: Trace
    joints: Array
    paths: Sequence[statics.TendonPath]
    tension: Array


def scene_of(file: TraceFile, name: str | None = None) -> Scene:
    """What a film shows of a run, by default the first.

    Raises
    ------
    UsageError
        If there is no such run.
    DataMissingError
        If the file does not say where the tendons go.
    """
    name = name or next(iter(file.runs))
    if name not in file.runs:
        message = f"there is no run {name!r} in this file"
        raise UsageError(message, where="--run", hint=f"runs: {', '.join(file.runs)}")
    if "tensioner_side" not in file.plant.attributes:
        message = "this file does not say where the tendons go, so no arm can be drawn"
        raise DataMissingError(message, hint="animate a simulated run")
    known = np.isfinite(file.runs[name]["q_encoder"]).all(axis=1)
    variables = {key: values[known] for key, values in file.runs[name].variables.items()}
    trace = replace(file.runs[name], time=file.runs[name].time[known], variables=variables)
    joints, angle = postures(file.plant, trace)
    paths = tendon_paths(file.plant, joints, angle)
    # Tensions of the tendons of held joints are not known.
    tension = np.full((len(trace.time), angle.shape[1] + 1), np.nan)
    tension[:, np.array(trace.joint) - 1] = tensions(file, trace)
    tension[:, -1] = file.plant.values["tensioner_force"].value
    return Scene(trace, joints, paths, tension)


def draw_scene(scene: Scene, origin: str) -> tuple[Figure, Callable[[int], None]]:
    """Draw a scene, and return what brings it to one of its samples."""
    figure = style.open_figure(style.PAGE_MM, 90.0)
    panels = figure.subplot_mosaic([["arm", "q_encoder"], ["arm", "e"]], width_ratios=(1.35, 1.0))
    arm, time = panels["arm"], scene.trace.time
    top = max(float(np.nanmax(scene.tension, initial=0.0)), 1.0)
    # The palest yellows of the map cannot be seen on paper.
    shades = ListedColormap(mpl.colormaps["YlOrRd"](np.linspace(0.2, 1.0, 256)))
    colours = ScalarMappable(Normalize(0.0, top), shades.with_extremes(under="#2E6FBB", bad="#BDBDBD"))
    label = "Tension (N); grey: not known, blue: would push"
    figure.colorbar(colours, ax=arm, orientation="horizontal", label=label, shrink=0.8, pad=0.02)
    links, discs = draw_arm(arm, scene.joints, scene.paths)
    x, y = np.mean([path.centre[0, 0] for path in scene.paths], axis=0)
    arm.text(x, y - 0.065, "motor winches, place assumed", ha="center", va="top", fontsize=6)
    tendons = [arm.plot([], [], linewidth=1.7, zorder=4.0)[0] for _ in scene.paths]
    labels = {"q_encoder": "Joint angle (deg)", "e": "Tracking error (deg)"}
    cursors = [_draw_curves(panels[name], scene, name, label) for name, label in labels.items()]
    panels["q_encoder"].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    panels["e"].set_xlabel("Time (s)")
    style.imprint(figure, origin)

    def show(place: int) -> None:
        arm.set_title(f"Run {scene.trace.name}, t = {time[place]:.2f} s")
        links.set_data(*scene.joints[place].T)
        centres = [centre for path in scene.paths for centre in path.centre[place]]
        for disc, centre in zip(discs, centres, strict=True):
            disc.set_center(tuple(centre))
        for line, path, force in zip(tendons, scene.paths, scene.tension[place], strict=True):
            line.set_data(*statics.path_points(path, place).T)
            line.set(color=colours.to_rgba(force))
        for cursor in cursors:
            cursor.set_xdata([time[place]] * 2)

    show(0)
    style.settle(figure)
    return figure, show


def _draw_curves(axes: Axes, scene: Scene, name: str, label: str) -> Line2D:
    """Angles or errors of all joints, and a line that moves along them."""
    trace = scene.trace
    axes.set_ylabel(label)
    for place, joint in enumerate(trace.joint):
        x, y = style.thin(trace.time, np.rad2deg(trace[name][:, place]))
        axes.plot(x, y, **style.stroke_of(joint).line, label=f"Joint {joint}")
    axes.set_xlim(trace.time[0], max(trace.time[-1], trace.time[0] + 1e-3))
    return axes.axvline(trace.time[0], color="#444444", linewidth=0.7)


_WINCHES = (0.07, 0.055), -0.13
"""x of the first motor winch and of each further one, and y of all, m; nothing is published of them."""


def postures(plant: PlantRecord, trace: Trace) -> tuple[Array, Array]:
    """Places of joints and tip, m, (T, N + 1, 2), and absolute angles of the links, rad, (T, N)."""
    length, start = (plant.values[key].value for key in ("length", "posture"))
    q = np.zeros((len(trace.time), len(length)))
    q[:, np.array(trace.joint) - 1] = trace["q_encoder"]
    angle = np.cumsum(start + q, axis=1)
    return statics.joint_positions(length, angle), angle


def tendon_paths(plant: PlantRecord, joints: Array, angle: Array) -> list[statics.TendonPath]:
    """Tendons, the tensioner last, from their motors' winches, below joint 1, to the joints they turn.

    `joints` and `angle` are as `postures` gives them.

    Raises
    ------
    ValueError
        If winches or pulleys overlap.
    """
    keys = ("winch_diameter", "pulley_diameter", "tensioner_diameter", "sign")
    winch, pulley, tensioner, sign = (plant.values[key].value for key in keys)
    n = len(winch)
    # The tensioner's winch is not published; that of the last motor stands for it.
    winch = np.append(winch, winch[-1])
    side = np.column_stack(
        [np.triu(statics.sign_of_side(sign)), statics.tensioner_side(plant.attributes["tensioner_side"], n)]
    )
    diameter = side * np.column_stack([pulley, tensioner])
    (first, step), height = _WINCHES
    paths = []
    for tendon in range(n + 1):
        last = min(tendon, n - 1)
        base = np.broadcast_to([first + step * tendon, height], (len(joints), 1, 2))
        centre = np.concatenate([base, joints[:, : last + 1]], axis=1)
        radius = np.append(winch[tendon], diameter[: last + 1, tendon]) / 2.0
        # It is fixed where the axis of its link leaves its circle.
        paths.append(statics.tendon_path(centre, radius, -np.pi / 2.0 - angle[:, last]))
    return paths


def draw_links(axes: Axes, places: Array, colour: str = "#D8D8D8") -> Line2D:
    """Draw a chain of links through places (N + 1, 2), m, below its tendons."""
    look: style.Look = {"linewidth": 7.0, "solid_joinstyle": "round", "zorder": 2.0}
    return axes.plot(*places.T, color=colour, **look)[0]


def draw_arm(
    axes: Axes, joints: Array, paths: Sequence[statics.TendonPath], place: int = 0
) -> tuple[Line2D, list[Circle]]:
    """Draw an arm in one of its postures, and return its links, and winches and pulleys.

    Winches are numbered. The panel shows all that joints (T, N + 1, 2), m, reach, and a scale.
    """
    look = {"facecolor": "none", "edgecolor": "#777777", "linewidth": 0.6, "zorder": 3.0}
    discs = [
        Circle(tuple(centre), abs(radius), **look)
        for path in paths
        for centre, radius in zip(path.centre[place], path.radius, strict=True)
    ]
    for disc in discs:
        axes.add_patch(disc)
    winches = np.array([path.centre[0, 0] for path in paths]).reshape(-1, 2)
    for number, (x, y) in enumerate(winches, start=1):
        axes.text(x, y - 0.03, str(number), ha="center", va="top", fontsize=7)
    widest = max((float(np.abs(path.radius).max()) for path in paths), default=0.0) + 0.02
    corners = np.vstack([joints.reshape(-1, 2), winches, winches - [0.0, 0.07]])
    (left, bottom), (right, top) = corners.min(axis=0) - widest, corners.max(axis=0) + widest
    axes.set_aspect("equal")
    axes.set(xlim=(left, right), ylim=(bottom, top))
    axes.set_axis_off()
    axes.plot([left, left + 0.1], [bottom] * 2, color="black", linewidth=1.0)
    axes.text(left + 0.05, bottom + 0.01, "0.1 m", ha="center", va="bottom", fontsize=7)
    return draw_links(axes, joints[place]), discs
