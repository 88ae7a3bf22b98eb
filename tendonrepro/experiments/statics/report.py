"""Tensions over the working half-plane as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tendonrepro.console import columns


def statics_text(data: Mapping[str, Any]) -> str:
    """What keeps every tendon tense on each course of tendon 4; every number is computed."""
    return "\n\n".join([_weight(data), _courses(data), _force(data), _spring(data)])


def _weight(data: Mapping[str, Any]) -> str:
    numbers = ", ".join(f"{tension:.2f}" for tension in data["least_tension_of_weight_alone_N"])
    tendons = ", ".join(map(str, data["joints"]))
    held = "".join(f"; joint {joint} held rigidly" for joint in data["held_joints"])
    return (
        f"Tension at rest over {data['postures']} postures of the half-plane, every link at least "
        f"{data['nearest_edge_deg']:g} deg from its edges{held}\n"
        f"The weight alone leaves tendons {tendons} at least {numbers} N; where all hang or stand, nothing."
    )


def _courses(data: Mapping[str, Any]) -> str:
    rows = [["course of tendon 4", "by", "tense", "least", "tendon", "at link angles"]]
    for name, course in data["courses"].items():
        for case, over in course["half_plane"].items():
            angles = ", ".join(f"{angle:g}" for angle in over["link_angles_deg"])
            by = f"motor, {data['payload_kg']:g} kg" if case == "payload" else case
            share, least = f"{100.0 * over['share_tense']:.4g} %", f"{over['least_tension_N']:.2f} N"
            rows.append([name, by, share, least, str(over["tendon"]), f"{angles} deg"])
    head = f"Smallest tension, tendon 4 with {data['tensioner_force_N']:g} N ({data['sources']['force']})"
    return f"{head}\n{columns(rows)}"


def _force(data: Mapping[str, Any]) -> str:
    rows = [
        ["course of tendon 4", "adds per newton", "force for the reserve", "no force does", "with friction"]
    ]
    for name, course in data["courses"].items():
        added = " | ".join(f"{share:.3f}" for share in course["tension_per_newton"])
        never = 1.0 - course["map_share_where_a_force_leaves_reserve"]
        rows.append(
            [
                name,
                added,
                f"{course['map_force_for_reserve_N']:.1f} N",
                f"{100.0 * never:.3g} %",
                f"{course['map_least_tension_with_friction_N']:.2f} N",
            ]
        )
    held = ", ".join(f"{angle:g}" for angle in data["map"]["held_link_angles_deg"])
    head = (
        f"On the maps (links before at {held or '-'} deg, edges included), without payload: least "
        f"force of tendon 4\nthat leaves {data['reserve_N']:g} N where one does; smallest tension where each "
        f"guide pulley may hold {100 * data['pulley_loss']:g} %"
    )
    return f"{head}\n{columns(rows)}"


def _spring(data: Mapping[str, Any]) -> str:
    rows = [["course of tendon 4", "its length changes by", "pull of the spring"]]
    for name, course in data["courses"].items():
        low, high = course["half_plane"]["spring"]["pull_N"]
        ratio = f", {high / low:.1f} times" if low > 0.0 else ""
        rows.append([name, f"{course['change_of_length_mm']:.0f} mm", f"{low:.1f} to {high:.1f} N{ratio}"])
    head = (
        f"A spring that pulls {data['tensioner_force_N']:g} N in the start posture, stretched there by "
        f"{data['spring_stretch_mm']:g} mm"
    )
    return f"{head}\n{columns(rows)}"
