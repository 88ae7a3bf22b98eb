"""Figures of an identification: misfit by reading, every number, and what is known of each row of the box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from tendonrepro.monte_carlo.figures import rows_figure
from tendonrepro.results.figures.style import SERIES, Drawing, save_drawing

_RUNS = {
    "controller_1": "Controller 1",
    "controller_2": "Controller 2",
    "controller_3": "Controller 3",
    "controller_1_payload": "Controller 1, payload",
}
_BOUNDS = {"low": "lower bound", "high": "upper bound"}


def draw_identify_figures(data: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw and save all figures as pdf, svg and png; the last two are of the reading that fits best."""
    best = min(data["readings"], key=lambda held: held["misfit_log"])
    drawn = [draw_readings(data), draw_numbers(best), draw_parameters(best)]
    return [path for held in drawn for path in save_drawing(held, folder, "Simulated, plants of the box")]


def draw_readings(data: Mapping[str, Any]) -> Drawing:
    """Best misfit under each reading, of each seed and of all."""
    readings = data["readings"]

    def draw(axes: Sequence[Axes]) -> None:
        (panel,) = axes
        for row, held in enumerate(readings):
            seeds = held["misfit_by_seed"]
            panel.plot(seeds, [row] * len(seeds), "|", color=SERIES[0].colour, markersize=6.0)
        best = [held["misfit_log"] for held in readings]
        panel.plot(best, range(len(best)), "o", color=SERIES[0].colour, markersize=4.0)
        panel.axvline(data["near_tolerance"], color="#999999", linewidth=0.6, zorder=0.5)
        panel.set_xscale("log")
        # At least two decades, so that equal misfits do not look different.
        panel.set_xlim(min(0.5 * min(best), 0.002), max(2.0 * max(best), 0.2))
        panel.set_xlabel("misfit: root mean square of log(ours/printed)")

    caption = (
        f"Best misfit to the numbers of {', '.join(_fitted(data))} under each reading (dot) and that of each "
        f"seed (strokes). Left of the line, {data['near_tolerance']:g}, a plant counts as fitting."
    )
    return rows_figure("identify_readings", [""], [held["name"] for held in readings], draw, caption)


def _fitted(data: Mapping[str, Any]) -> list[str]:
    return ["Controller 2"] if data["fit"] == "controller_2" else list(_RUNS.values())


def draw_numbers(held: Mapping[str, Any]) -> Drawing:
    """Every number over the printed one, of the best plant and of the near-optimal plants of one reading."""
    numbers = held["numbers"]
    names = [f"{_RUNS[row['run']]}, {row['metric'].upper()} {row['joint']}" for row in numbers]

    def draw(axes: Sequence[Axes]) -> None:
        (panel,) = axes
        for place, row in enumerate(numbers):
            stroke = SERIES[0] if row["verdict"] == "fitted" else SERIES[1]
            ends = np.array([row["near_low_deg"], row["near_high_deg"]]) / row["printed_deg"]
            panel.plot(ends, [place, place], color=stroke.colour, linewidth=2.2, solid_capstyle="butt")
            panel.plot(row["ratio"], place, "o", color="white", markeredgecolor=stroke.colour, markersize=3.6)
        panel.plot([], [], color=SERIES[0].colour, linewidth=2.2, label="fitted")
        if any(row["verdict"] != "fitted" for row in numbers):
            panel.plot([], [], color=SERIES[1].colour, linewidth=2.2, label="not fitted")
        panel.axvline(1.0, color="black", linewidth=0.6, zorder=0.5)
        panel.margins(x=0.04)
        panel.set_xlabel("ours/printed")
        panel.figure.legend(*panel.get_legend_handles_labels(), loc="outside upper center", ncols=2)

    caption = (
        f"Errors over the printed ones under the reading {held['name']}: best plant (circle) and the central "
        f"90 % of {held['near_count']} plants that miss what was fitted by at most {held['near_limit']:.3g}."
    )
    return rows_figure("identify_numbers", [""], names, draw, caption)


def draw_parameters(held: Mapping[str, Any]) -> Drawing:
    """Where the near-optimal plants lie between the bounds of each row of the box, under one reading."""
    rows = [row for row in held["parameters"] if row["searched"] and not row["choice"]]
    rows = sorted(rows, key=lambda row: np.nan_to_num(row["width"], nan=1.0))

    def draw(axes: Sequence[Axes]) -> None:
        (panel,) = axes
        for place, row in enumerate(rows):
            low, median, high = row["near_unit"]
            panel.plot(
                [low, high], [place, place], color=SERIES[0].colour, linewidth=2.2, solid_capstyle="butt"
            )
            panel.plot(median, place, "|", color="white", markersize=4.0, markeredgewidth=1.0)
            mark = "D" if row["at_bound"] else "o"
            panel.plot(row["best_unit"], place, mark, color=SERIES[1].colour, markersize=3.0, clip_on=False)
            if row["at_bound"]:
                text = _BOUNDS[row["at_bound"]]
                panel.annotate(text, (1.02, place), annotation_clip=False, fontsize=5.5, va="center")
        panel.set_xlim(0.0, 1.0)
        panel.set_xticks([0.0, 0.5, 1.0], ["lower bound", "middle", "upper bound"])

    caption = (
        f"Central 90 % of {held['near_count']} near-optimal plants between the bounds of each row, on "
        f"its own scale, under the reading {held['name']}; dot: the best plant, diamond: at a bound. A "
        "bar of nine tenths of the width means that the fit says nothing. Choices are in the table."
    )
    return rows_figure("identify_parameters", [""], [row["name"] for row in rows], draw, caption)
