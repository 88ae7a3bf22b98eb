"""What a survey of tensions shows: JSON, tables, terminal and map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tendonrepro.experiments.rig import start_angles
from tendonrepro.experiments.statics import RESERVE, STRETCH, Survey
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result


def statics_result(survey: Survey) -> Result:
    """All views of a survey."""
    from tendonrepro.experiments.figures_statics import draw_margin

    figures = {"margin": lambda: draw_margin(survey)} if survey.maps else {}
    return Result(statics_data(survey), _parts(survey), figures, {"solver": None})


def statics_data(survey: Survey) -> dict[str, object]:
    """Numbers by the keys of ``--json``."""
    config, joints = survey.loaded.config, survey.joints
    return {
        "schema_version": 1,
        "command": "statics",
        "of_paper": is_arm_of_paper(config.manipulator),
        "joints": joints,
        "held_joints": [k for k in range(1, config.manipulator.joints + 1) if k not in joints],
        "start_link_angles_deg": np.rad2deg(np.cumsum(config.posture.si)).tolist(),
        "tensioning_tendon": survey.tensioning_tendon,
        "map": {
            "across": f"link {joints[-2]}",
            "upright": f"link {joints[-1]}",
            "held_link_angles_deg": np.rad2deg(start_angles(config)[:-2]).tolist(),
        }
        if survey.maps
        else None,
        "postures": survey.half_plane.shape[1],
        "nearest_edge_deg": float(np.rad2deg(survey.half_plane.min())),
        "tensioner_force_N": survey.force[0],
        "pulley_loss": survey.loss[0],
        "payload_kg": survey.payload[0],
        "tensioner_diameter_mm": (1e3 * survey.diameter[0]).tolist(),
        "sources": {
            "force": survey.force[1],
            "loss": survey.loss[1],
            "payload": survey.payload[1],
            "diameter": survey.diameter[1],
        },
        "reserve_N": RESERVE,
        "spring_stretch_mm": 1e3 * STRETCH,
        "least_tension_of_weight_alone_N": survey.weight_alone.tolist(),
        "courses": {
            row["course"]: _without(row, "course")
            | {
                "half_plane": {
                    over["case"]: _without(over, "course", "case")
                    for over in survey.tensions
                    if over["course"] == row["course"]
                }
            }
            for row in survey.courses
        },
    }


def _without(row: Mapping[str, object], *names: str) -> dict[str, object]:
    """A row less the columns by which it is found."""
    return {name: value for name, value in row.items() if name not in names}


def _parts(survey: Survey) -> list[str | Table]:
    """A sentence, and a table of the half-plane and of the maps."""
    (force, force_source), (loss, loss_source) = survey.force, survey.loss
    alone = ", ".join(f"{tension:.2f}" for tension in survey.weight_alone)
    tendons = ", ".join(map(str, survey.joints))
    by_case = [name for row in survey.courses for name, value in row.items() if isinstance(value, dict)]
    courses = [_without(row, *by_case) for row in survey.courses]
    everywhere = (
        f"Tensions at rest over the working half-plane, {survey.half_plane.shape[1]} postures "
        f"({survey.origin}). Tendon {survey.tensioning_tendon} pulls with {force:g} N ({force_source})."
    )
    diameters, source = ", ".join(f"{1e3 * size:g}" for size in survey.diameter[0]), survey.diameter[1]
    on_maps = f"The courses of tendon {survey.tensioning_tendon} over pulleys of {diameters} mm ({source})."
    if survey.maps:
        on_maps += (
            f" On the maps: the force that leaves {RESERVE:g} N, and friction "
            f"of {100 * loss:g} % at each guide pulley ({loss_source})."
        )
    return [
        f"The weight alone leaves tendons {tendons} at least {alone} N at rest.",
        Table("statics", everywhere, survey.tensions, suffixes=("csv", "md")),
        Table("courses", on_maps, courses, suffixes=("csv", "md")),
    ]
