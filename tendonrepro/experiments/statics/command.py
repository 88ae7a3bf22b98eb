"""Tensions over the working half-plane as plain numbers and as files."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.config.request import Request
from tendonrepro.console import Talk
from tendonrepro.experiments.statics.report import statics_text
from tendonrepro.experiments.statics.survey import RESERVE, STRETCH, Survey, survey
from tendonrepro.files import to_json
from tendonrepro.results.folder import claimed, foretell_refusal
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.tables import write_table

SCHEMA_VERSION = 1

DATA = "summary.json"


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
    from tendonrepro.experiments.statics.figures import draw_statics

    loaded, folder = request.load("decouple"), request.folder("statics")
    if request.dry_run:
        foretell_refusal(folder, loaded.sha256, talk, force=request.force, command="statics")
        text = f"{loaded.origin} is valid (sha256 {loaded.sha256[:12]})\nwould write to {folder}"
        plan = {"dry_run": True, "config_sha256": loaded.sha256, "out": str(folder)}
        return {"schema_version": SCHEMA_VERSION, "command": "statics"} | plan | {"text": text}
    with claimed(folder, loaded.sha256, force=request.force, command="statics") as held:
        found = survey(loaded)
        data = statics_data(found)
        manifest = make_manifest(loaded, held.seconds) | {"command": "statics", "solver": None}
        held.clear()
        caption = f"Tensions at rest over the working half-plane, {found.postures} postures ({found.origin})."
        rows = list(statics_rows(data))
        held.files += write_table(rows, folder / "tables", "statics", caption)
        held.files += draw_statics(found, folder / "figures")
        held.write(DATA, to_json(data))
        path = held.finish(manifest, talk)
    return data | {"text": statics_text(data), "out": str(folder), "manifest": path}


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
