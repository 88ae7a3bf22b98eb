"""Tensions over the working half-plane as plain numbers and as files."""

from __future__ import annotations

from typing import Any

from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.configuration.request import Request
from tendonrepro.console import Talk
from tendonrepro.experiments.statics.survey import Survey, survey
from tendonrepro.results.study import Outcome, run_study
from tendonrepro.results.tables import Table


def run_statics(request: Request, talk: Talk) -> dict[str, Any]:
    """Survey the tensions of a configuration and write numbers, tables, figures and manifest.

    Parameters
    ----------
    request : Request
    talk : Talk

    Returns
    -------
    dict
        What ``--json`` prints, ``text``, ``out`` and ``manifest``.

    Raises
    ------
    TendonreproError
        If fewer than two joints move or results cannot be written.
    """
    loaded = request.load("decouple")
    return run_study("statics", loaded, request, lambda: study_statics(loaded), talk)


def study_statics(loaded: LoadedConfig) -> Outcome:
    """Survey the tensions of a configuration."""
    from tendonrepro.experiments.statics.figures import draw_margin

    found = survey(loaded)
    figures = {"margin": lambda: draw_margin(found)}
    return Outcome(found.data, [_weight(found.data), *_tables(found)], figures, {"solver": None})


def _weight(data: dict[str, Any]) -> str:
    """What tendon 4 is needed for."""
    numbers = ", ".join(f"{tension:.2f}" for tension in data["least_tension_of_weight_alone_N"])
    tendons = ", ".join(map(str, data["joints"]))
    held = "".join(f"; joint {joint} held rigidly" for joint in data["held_joints"])
    return f"The weight alone leaves tendons {tendons} at least {numbers} N at rest{held}."


def _tables(found: Survey) -> list[Table]:
    """Tensions over the whole half-plane by course and case, and what a course does on the maps."""
    data = found.data
    tensions, courses = [], []
    for name, course in data["courses"].items():
        half_plane = course["half_plane"].items()
        tensions += [{"course": name, "case": case} | over for case, over in half_plane]
        courses.append({"course": name} | {key: x for key, x in course.items() if not isinstance(x, dict)})
    everywhere = (
        f"Tensions at rest over the working half-plane, {data['postures']} postures ({found.origin}). "
        f"Tendon 4 pulls with {data['tensioner_force_N']:g} N ({data['sources']['force']})."
    )
    on_maps = (
        f"The courses of tendon 4. On the maps: the force that leaves {data['reserve_N']:g} N, and friction "
        f"of {100 * data['pulley_loss']:g} % at each guide pulley ({data['sources']['loss']})."
    )
    return [
        Table("statics", everywhere, tensions, suffixes=("csv", "md")),
        Table("courses", on_maps, courses, suffixes=("csv", "md")),
    ]
