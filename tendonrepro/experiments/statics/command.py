"""Tensions over the working half-plane as plain numbers and as files."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.experiments.statics.report import statics_text
from tendonrepro.experiments.statics.survey import RESERVE, STRETCH, Survey, survey
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.tables import Table

SCHEMA_VERSION = 1


def run_statics(request: Request, talk: Talk) -> dict[str, Any]:
    """Survey the tensions of a configuration and write numbers, table, figures and manifest.

    Parameters
    ----------
    request : Request
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints: :func:`statics_data`, ``text``, ``out`` and ``manifest``.

    Raises
    ------
    TendonreproError
        If fewer than two joints move or results cannot be written.
    """
    loaded = request.load("decouple")
    return run_study("statics", loaded, request, lambda: study_statics(loaded), talk)


def study_statics(loaded: LoadedConfig) -> Outcome:
    """Survey the tensions of a configuration."""
    from tendonrepro.experiments.statics.figures import figures

    found = survey(loaded)
    data = statics_data(found)
    caption = f"Tensions at rest over the working half-plane, {found.postures} postures ({found.origin})."
    table = Table("statics", caption, list(statics_rows(data)), suffixes=("csv", "md"), terminal=())
    return Outcome(data, [table, statics_text(data)], figures(found), {"solver": None})


def statics_data(found: Survey) -> dict[str, Any]:
    """Plain numbers with the keys of ``--json``; what has no limit is infinite, which JSON writes as null."""
    return {
        "schema_version": SCHEMA_VERSION,
        "command": "statics",
        "of_paper": found.of_paper,
        "joints": list(found.joints),
        "held_joints": list(found.held),
        "start_link_angles_deg": np.rad2deg(found.posture).tolist(),
        "map": {
            "across": f"link {found.joints[-2]}",
            "upright": f"link {found.joints[-1]}",
            "held_link_angles_deg": np.rad2deg(found.fixed).tolist(),
        },
        "postures": found.postures,
        "nearest_edge_deg": float(np.rad2deg(found.nearest_edge)),
        "tensioner_force_N": found.force,
        "pulley_loss": found.loss,
        "payload_kg": found.payload,
        "sources": dict(found.sources),
        "reserve_N": RESERVE,
        "spring_stretch_mm": 1e3 * STRETCH,
        "least_tension_of_weight_alone_N": found.gravity_alone.tolist(),
        "courses": {
            name: {
                "tension_per_newton": course.per_newton.tolist(),
                "change_of_length_mm": 1e3 * course.travel,
                "map_least_tension_N": {case: float(least.min()) for case, least in course.least.items()},
                "map_least_tension_with_friction_N": float(course.band[0].min()),
                "map_force_for_reserve_N": float(course.needed.max()),
                "map_share_where_a_force_leaves_reserve": float((course.room >= 0.0).mean()),
                "half_plane": dict(course.over_all),
            }
            for name, course in found.courses.items()
        },
    }


def statics_rows(data: dict[str, Any]) -> list[dict[str, Any]]:
    """One row per course and case for a table, over the whole half-plane."""
    rows = []
    for name, course in data["courses"].items():
        for case, over in course["half_plane"].items():
            least_pull, most_pull = over["pull_N"]
            least_force, most_force = over["force_window_N"]
            rows.append(
                {
                    "course": name,
                    "case": case,
                    "share_tense": over["share_tense"],
                    "least_tension_N": over["least_tension_N"],
                    "of_tendon": over["tendon"],
                    "at_link_angles_deg": over["link_angles_deg"],
                    "least_pull_N": least_pull,
                    "largest_pull_N": most_pull,
                    "least_force_N": least_force,
                    "largest_force_N": most_force,
                }
            )
    return rows
