"""What statics and a sweep show: JSON, tables, terminal and figures."""

from __future__ import annotations

import numpy as np

from tendonrepro.experiments.statics import STRETCH, Survey
from tendonrepro.experiments.sweep import Sweep, text_of
from tendonrepro.results.tables import Table, rounded
from tendonrepro.simulation.resolution import COMPILED_STEPPER
from tendonrepro.studies.result import Result


def statics_result(survey: Survey) -> Result:
    """All views of a survey."""
    from tendonrepro.experiments.figures import draw_statics

    config, postures = survey.loaded.config, survey.half_plane.shape[1]
    data = {
        "schema_version": 2,
        "command": "statics",
        "joints": list(config.joints),
        "start_link_angles_deg": np.rad2deg(np.cumsum(config.posture.si)).tolist(),
        "postures": postures,
        "nearest_edge_deg": float(np.rad2deg(survey.half_plane.min())),
        "spring_stretch_mm": 1e3 * STRETCH,
        "inputs": survey.inputs,
        "least_tension_of_weight_alone_N": survey.weight_alone.tolist(),
        "courses": survey.courses,
        "tensions": survey.tensions,
    }
    alone = ", ".join(f"{tension:.2f}" for tension in survey.weight_alone)
    tendons = ", ".join(map(str, config.joints))
    suffixes = ("csv", "md")
    tensioner = config.manipulator.joints + 1
    everywhere = (
        f"Tensions at rest over the working half-plane, {postures} postures "
        f"({survey.loaded.origin}, sha256 {survey.loaded.sha256[:12]})."
    )
    inputs = [f"{row['input']} {rounded(row['value'])} ({row['source']})" for row in survey.inputs]
    parts: list[Table | str] = [
        f"The weight alone leaves tendons {tendons} at least {alone} N at rest.",
        Table("statics", everywhere, survey.tensions, suffixes=suffixes),
        Table("courses", f"The courses of tendon {tensioner}.", survey.courses, suffixes=suffixes),
        f"Of tendon {tensioner}, pulleys and payload: {'; '.join(inputs)}.",
    ]
    figures = {"margin": lambda: draw_statics(survey)} if survey.maps else {}
    return Result(data, parts, figures, {"solver": None})


def sweep_result(sweep: Sweep) -> Result:
    """All views of a sweep."""
    from tendonrepro.experiments.figures import draw_sweep

    grid, base = sweep.grid, sweep.grid.base
    data = {
        "schema_version": 2,
        "experiment": "sweep",
        "config": base.origin,
        "config_sha256": base.sha256,
        "joints": list(grid.joints),
        "runs": grid.runs,
        "keys": [{"key": axis.key, "unit": axis.unit, "values": axis.values} for axis in grid.axes],
        "points": sweep.points,
        "rows": sweep.rows,
    }
    swept = f"{base.origin} over {' and '.join(axis.key for axis in grid.axes)}, sweep {base.sha256[:12]}"
    parts = [
        Table("points", f"{swept}: MAE of each run, deg, and ratios of MAE.", sweep.points),
        Table("sweep", f"{swept}. A diverged run has its numbers up to its end.", sweep.rows, terminal=()),
    ]
    over = [f"{axis.key}={','.join(map(text_of, axis.values))}" for axis in grid.axes]
    manifest = {"solver": {"name": COMPILED_STEPPER}, "over": over, "points": len(grid.points)}
    diverged = any(row["status"] == "diverged" for row in sweep.rows)
    return Result(data, parts, {"sweep": lambda: draw_sweep(sweep)}, manifest, diverged=diverged)
