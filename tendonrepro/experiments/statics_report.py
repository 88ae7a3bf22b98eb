"""What a survey of tensions shows: JSON, tables, terminal and map."""

from __future__ import annotations

import numpy as np

from tendonrepro.experiments.rig import start_angles
from tendonrepro.experiments.statics import RESERVE, STRETCH, Course, Extremes, Survey
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result


def statics_result(survey: Survey) -> Result:
    """All views of a survey."""
    from tendonrepro.experiments.figures_statics import draw_margin

    figures = {"margin": lambda: draw_margin(survey)} if survey.has_maps else {}
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
        if survey.has_maps
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
            name: _course_data(course)
            | {"half_plane": {case: _extremes_data(over) for case, over in course.half_plane.items()}}
            for name, course in survey.courses.items()
        },
    }


def _course_data(course: Course) -> dict[str, object]:
    of_course = {
        "tension_per_newton": course.per_newton.tolist(),
        "change_of_length_mm": 1e3 * course.travel,
    }
    if (maps := course.maps) is None:
        return of_course
    return of_course | {
        "map_least_tension_N": {case: float(least.min()) for case, least in maps.least.items()},
        "map_least_tension_with_friction_N": float(maps.band[0].min()),
        "map_force_for_reserve_N": float(maps.needed.max()),
        "map_share_where_a_force_leaves_reserve": float((maps.room >= 0.0).mean()),
    }


def _extremes_data(over: Extremes) -> dict[str, object]:
    return {
        "least_tension_N": over.least,
        "tendon": over.tendon,
        "link_angles_deg": np.rad2deg(over.phi).round(6).tolist(),
        "share_tense": over.share,
        "pull_N": over.pull.tolist(),
        "force_window_N": over.window.tolist(),
    }


def _parts(survey: Survey) -> list[str | Table]:
    """A sentence, and a table of the half-plane and of the maps."""
    (force, force_source), (loss, loss_source) = survey.force, survey.loss
    alone = ", ".join(f"{tension:.2f}" for tension in survey.weight_alone)
    tendons = ", ".join(map(str, survey.joints))
    tensions = [
        {"course": name, "case": case} | _extremes_data(over)
        for name, course in survey.courses.items()
        for case, over in course.half_plane.items()
    ]
    courses = [
        {"course": name}
        | {key: value for key, value in _course_data(course).items() if not isinstance(value, dict)}
        for name, course in survey.courses.items()
    ]
    everywhere = (
        f"Tensions at rest over the working half-plane, {survey.half_plane.shape[1]} postures "
        f"({survey.origin}). Tendon {survey.tensioning_tendon} pulls with {force:g} N ({force_source})."
    )
    diameters, source = ", ".join(f"{1e3 * size:g}" for size in survey.diameter[0]), survey.diameter[1]
    on_maps = f"The courses of tendon {survey.tensioning_tendon} over pulleys of {diameters} mm ({source})."
    if survey.has_maps:
        on_maps += (
            f" On the maps: the force that leaves {RESERVE:g} N, and friction "
            f"of {100 * loss:g} % at each guide pulley ({loss_source})."
        )
    return [
        f"The weight alone leaves tendons {tendons} at least {alone} N at rest.",
        Table("statics", everywhere, tensions, suffixes=("csv", "md")),
        Table("courses", on_maps, courses, suffixes=("csv", "md")),
    ]
