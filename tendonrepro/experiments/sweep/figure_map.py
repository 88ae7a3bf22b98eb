"""Maps of a sweep over two keys, and what all its figures share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tendonrepro.arrays import Array
from tendonrepro.results.figures.style import PAGE_MM, journal_style
from tendonrepro.results.summary import CONTROLLERS

PAIRS = {"c1_c2": "C1/C2", "c2_c3": "C2/C3"}
"""Ratios by their keys."""

GONE = ("diverged", "unresolved")
"""Statuses of runs whose errors cannot be compared."""

_MM_PER_INCH = 25.4
_CELL_MM = 7.5
_FRAME_MM = 20.0
# Shades of ratios end at a factor that is at least and at most:
_REACH = (1.1, 2.0)
_PALE = "#E4E4E4"
_RATIO_COLOURS = LinearSegmentedColormap.from_list("ratio", ["#4477AA", "#F6F6F6", "#CC6677"])
_SIZE_COLOURS = LinearSegmentedColormap.from_list("size", ["#F6F6F6", "#6699CC"])
_SUPERSCRIPTS = {"m2": "m²", "s-1": "s⁻¹", "s-2": "s⁻²", "rad-1": "rad⁻¹", "m-1": "m⁻¹"}


@dataclass(frozen=True)
class SweepFigure:
    """A finished figure.

    Attributes
    ----------
    stem : str
        Name of its files.
    figure : Figure
    axes : dict
        Panels by what they show and the joint, such as ``("mae", 2)``, ``("c1_c2", 3)``.
    caption : str
    """

    stem: str
    figure: Figure
    axes: dict[tuple[str, int], Axes]
    caption: str


def draw_maps(data: Mapping[str, Any]) -> list[SweepFigure]:
    """Maps over two keys: MAE of every run, and ratios of the controllers where they ran.

    Parameters
    ----------
    data : mapping
        Of a sweep over two keys.
    """
    with journal_style():
        pairs = [pair for pair in PAIRS if pair in data["points"][0]["ratio"]]
        maps = [_draw_map_grid("sweep", data, data["runs"], ratios=False)]
        if pairs:
            maps.append(_draw_map_grid("sweep_ratio", data, pairs, ratios=True))
        return maps


def _draw_map_grid(stem: str, data: Mapping[str, Any], names: Sequence[str], *, ratios: bool) -> SweepFigure:
    """A row of panels per run or pair, a column per joint."""
    upright, across = data["keys"]
    joints, shape = data["joints"], (len(upright["texts"]), len(across["texts"]))
    height = len(names) * (shape[0] * _CELL_MM + 9.0) + _FRAME_MM
    figure, grid = grid_of(len(names), len(joints), height)
    axes = {}
    for k, joint in enumerate(joints):
        maps = [_matrix(data, name, k, shape, ratios=ratios) for name in names]
        shades = _shades([values for values, _ in maps], ratios=ratios)
        for row, (name, (values, marks)) in enumerate(zip(names, maps, strict=True)):
            panel = axes[name, joint] = grid[row][k]
            letter = ascii_lowercase[(row * len(joints) + k) % len(ascii_lowercase)]
            what = f"MAE of {PAIRS[name]}" if ratios else f"{title_of(name)}, MAE (deg)"
            panel.set_title(f"({letter}) {what}, joint {joint}")
            panel.imshow(shades[row], aspect="auto", interpolation="nearest")
            _write_cells(panel, values, marks, ratios=ratios)
            panel.set_yticks(range(shape[0]), upright["texts"] if k == 0 else [""] * shape[0])
            panel.set_xticks(range(shape[1]), across["texts"] if row == len(names) - 1 else [""] * shape[1])
    figure.supxlabel(name_of(across), fontsize=8)
    figure.supylabel(name_of(upright), fontsize=8)
    return SweepFigure(stem, figure, axes, caption_of(data, names if ratios else ()))


def _matrix(
    data: Mapping[str, Any], name: str, k: int, shape: tuple[int, int], *, ratios: bool
) -> tuple[Array, dict[tuple[int, int], str]]:
    """Values of a map, and remarks on cells whose runs were not all ok."""
    values, marks = np.full(shape, np.nan), {}
    for point in data["points"]:
        i, j = point["places"]
        runs = [CONTROLLERS[int(digit) - 1] for digit in name if digit.isdigit()] if ratios else [name]
        ended = {run: point["runs"][run]["status"] for run in runs}
        bad = [
            f"{_short(run)} {status}" if ratios else status for run, status in ended.items() if status in GONE
        ]
        if bad:
            marks[i, j] = "\n".join(bad)
            continue
        values[i, j] = point["ratio"][name][k] if ratios else point["runs"][name]["mae_deg"][k]
        if "ringing" in ended.values():
            marks[i, j] = "~"
    return values, marks


def _shades(maps: Sequence[Array], *, ratios: bool) -> list[Array]:
    """Colours of the cells of a joint's maps, on one scale."""
    every = np.concatenate([values[np.isfinite(values)] for values in maps])
    if ratios:
        low, high = np.log(_REACH)
        reach = float(np.clip(np.abs(np.log(every)).max(initial=0.0), low, high))
        return [_RATIO_COLOURS(0.5 + 0.5 * np.log(values) / reach) for values in maps]
    top = float(every.max(initial=0.0)) or 1.0
    return [_SIZE_COLOURS(values / top) for values in maps]


def _write_cells(panel: Axes, values: Array, marks: Mapping[tuple[int, int], str], *, ratios: bool) -> None:
    for (i, j), value in np.ndenumerate(values):
        mark = marks.get((i, j), "")
        gone = not np.isfinite(value)
        cell = Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, edgecolor="white", linewidth=0.8)
        cell.set_facecolor(_PALE if gone else "none")
        panel.add_patch(cell)
        number = f"{value:.2f}" if ratios else f"{value:#.3g}"
        text, size = (mark or "-", 5.5) if gone else (f"{number}{mark}", 7)
        panel.text(j, i, text, ha="center", va="center", fontsize=size)
    panel.tick_params(length=0.0)
    panel.spines[:].set_visible(False)


def grid_of(rows: int, columns: int, height_mm: float) -> tuple[Figure, Any]:
    """Figure of the page's width and its panels, row by row."""
    size = (PAGE_MM / _MM_PER_INCH, height_mm / _MM_PER_INCH)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def caption_of(data: Mapping[str, Any], pairs: Sequence[str]) -> str:
    """What a figure shows, and which runs did not last."""
    keys = " and ".join(axis["key"] for axis in data["keys"])
    parts = [f"Mean absolute tracking error over the whole run under values of {keys}."]
    if pairs:
        parts.append(
            "Ratios where both runs lasted; slow load: what the laws alone give for a slowly changing load."
        )
    if data["diverged"]:
        parts.append(f"Diverged: {', '.join(data['diverged'])}.")
    if len(data["keys"]) > 1 and "ringing" in data["status"].values():
        parts.append("A tilde marks a run that rings.")
    return " ".join([*parts, f"Configuration {data['config']}, sweep {data['config_sha256'][:12]}."])


def title_of(run: str) -> str:
    """Name of a run in a figure."""
    return run.replace("_", " ").capitalize()


def _short(run: str) -> str:
    return run.replace("controller_", "C")


def name_of(axis: Mapping[str, Any]) -> str:
    """Key and unit as the label of an axis."""
    if axis["unit"] in (None, "1"):
        return str(axis["key"])
    unit = " ".join(_SUPERSCRIPTS.get(part, part) for part in axis["unit"].split())
    return f"{axis['key']} ({unit})"
