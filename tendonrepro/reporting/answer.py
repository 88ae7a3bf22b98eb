"""The words that findings.md and the report share: written by a person, with slots for stored numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

BOTH = "weights=extrapolating+Delta_unit=deg"
"""Reading under which the published order comes out."""
STEPS = "Delta_unit=deg+stored_torque=applied+torque_step=0.016"
FINE_STEPS = "Delta_unit=deg+stored_torque=applied+torque_step=0.0032"
"""Readings with Eq. (15) as printed under which it comes out on some plants."""
TEMPLATES = Path(__file__).with_name("templates")


def by_name(summary: Mapping[str, Any], population: str = "box") -> dict[str, Mapping[str, Any]]:
    """Readings of an ensemble by their names."""
    return {reading["name"]: reading for reading in summary["populations"][population]["readings"]}


def numbers(summary: Mapping[str, Any], ledger: Mapping[str, Any]) -> dict[str, str]:
    """Numbers of the answer as text, by slot; from a stored ensemble and the verdicts on it."""
    readings, printed = by_name(summary), by_name(summary)["printed"]
    claims = {entry["id"]: entry for entry in ledger["claims"]}
    ahead = claims["share.controller_1_of_2.mae.joint_2"]["evidence"]["direction"]["share"]
    slots = {
        "first_fine": percent(readings[FINE_STEPS]["first_best"]["share"]),
        "worst": percent(printed["first_worst"]["share"]),
        "tie": percent(printed["last_two_tie"]["share"]),
        "behind": percent(1.0 - ahead),
        "plants": f"{summary['populations']['box']['plants']:,}",
        "stable": f"{printed['in_order']['plants']:,}",
        "ratio": f"{printed['c1_c2']['joint_2']['median']:.2f}",
        "ratio_surfaces": f"{printed['c2_c3']['joint_2']['median']:.2f}",
        "ratio_degrees": f"{readings['Delta_unit=deg']['c2_c3']['joint_2']['median']:.2f}",
    }
    for row, name in {"printed": "printed", "both": BOTH, "steps": STEPS}.items():
        for column, key in {"order": "in_order", "first": "first_best", "smooth": "smoother"}.items():
            slots[f"{column}_{row}"] = percent(readings[name][key]["share"])
    return slots


def filled(name: str, values: Mapping[str, str]) -> str:
    """Text of a template of words, ``answer`` or ``why``, with numbers in its slots."""
    return (TEMPLATES / f"{name}.md").read_text(encoding="utf-8").format_map(values).strip()


def percent(share: float | None) -> str:
    """Share in per cent, two digits of a small one; only all of it is 100 %.

    Examples
    --------
    >>> percent(0.8917), percent(0.0085), percent(0.0), percent(None), percent(0.9997), percent(0.999999)
    ('89 %', '0.85 %', '0 %', '–', '99.97 %', 'over 99.99 %')
    """
    if share is None:
        return "–"
    value = 100.0 * share
    if 99.5 <= value < 100.0:
        texts = (f"{value:.{digits}g} %" for digits in (3, 4))
        return next((text for text in texts if text != "100 %"), "over 99.99 %")
    return f"{value:.0f} %" if value >= 10.0 or value == 0.0 else f"{value:.2g} %"
