"""What findings.md and the report say of a stored ensemble: words with slots, and a table."""

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

AS_PUBLISHED = {
    "printed": "As published",
    "encoder=ideal": "Ideal encoders",
    "hardware=drawn": "Encoder, delay and filter varied",
    "feedback=motor": "Motor encoders in the loop",
    "Delta_unit=deg": "Δ in degrees",
    "stored_torque=applied": "Estimator stores the applied torque",
    "stored_torque=applied+output_delay=1": "… which acts one sample late",
    "stored_torque=applied+torque_step=0.016": "Estimator stores a torque in steps",
    STEPS: "… with Δ in degrees",
    "torque_unit=volt": "Torque in volts",
}
CHANGED = {
    "weights=extrapolating": "Weights (1 + α, −α)",
    "weights=extrapolating+gain_unit=phi_in_degrees": "… with φ in degrees",
    BOTH: "… with Δ in degrees",
    "weights=extrapolating+Delta_unit=deg+feedback=motor": "… with Δ in degrees and motor encoders",
}
"""Readings of the ensemble that the picture and the table of findings show, and what a reader calls them."""

HEADS = ("interpretation", "plants", "published order", "Controller 1 first", "reverse order", "error 1 / 2")
"""Heads of `robustness`; the last is the median ratio of the MAE of Controllers 1 and 2 on joint 2."""


def by_name(summary: Mapping[str, Any], population: str = "box") -> dict[str, Mapping[str, Any]]:
    """Readings of an ensemble by their names."""
    return {reading["name"]: reading for reading in summary["populations"][population]["readings"]}


def numbers(summary: Mapping[str, Any], ledger: Mapping[str, Any]) -> dict[str, str]:
    """Numbers of the answer as text, by slot."""
    readings, printed = by_name(summary), by_name(summary)["printed"]
    claims = {entry["id"]: entry for entry in ledger["claims"]}
    ahead = claims["share.controller_1_of_2.mae.joint_2"]["evidence"]["direction"]["share"]
    slots = {
        "first_fine": percent(readings[FINE_STEPS]["first_best"]["share"]),
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
    """Text of a template, ``answer`` or ``why``, with numbers in its slots."""
    return (TEMPLATES / f"{name}.md").read_text(encoding="utf-8").format_map(values).strip()


def labelled(summary: Mapping[str, Any], labels: Mapping[str, str]) -> list[tuple[str, Mapping[str, Any]]]:
    """Labels and readings, where the ensemble has the reading."""
    stored = by_name(summary)
    return [(label, stored[name]) for name, label in labels.items() if name in stored]


def robustness(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table that says what the answer depends on."""
    (label, printed), *others = labelled(summary, AS_PUBLISHED | CHANGED)
    rows = [(label, printed), ("… diverged controllers ranked last", printed["diverged_last"])]
    if "firm" in summary["populations"]:
        rows.append(("… better known parameters alone varied", by_name(summary, "firm")["printed"]))
    return [_cells(*row) for row in rows + others]


def _cells(label: str, reading: Mapping[str, Any]) -> tuple[str, ...]:
    shares = (percent(reading[key]["share"]) for key in ("in_order", "first_best", "in_reverse"))
    ratio = reading["c1_c2"]["joint_2"]["median"] if "c1_c2" in reading else None
    return label, f"{reading['in_order']['plants']:,}", *shares, "–" if ratio is None else f"{ratio:.2f}"


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
