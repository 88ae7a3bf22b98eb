"""Orders of the three controllers by their errors, under several ways to understand the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tendonrepro.reporting.answer import by_name, percent

AS_PUBLISHED = {
    "printed": "As published",
    "encoder=ideal": "Ideal encoders",
    "hardware=drawn": "Encoder, delay and filter varied",
    "feedback=motor": "Motor encoders in the loop",
    "Delta_unit=deg": "Δ in degrees",
    "stored_torque=applied": "Estimator stores the applied torque",
    "stored_torque=applied+output_delay=1": "… which acts one sample late",
    "stored_torque=applied+torque_step=0.016": "Estimator stores a torque in steps",
    "Delta_unit=deg+stored_torque=applied+torque_step=0.016": "… with Δ in degrees",
    "torque_unit=volt": "Torque in volts",
}
CHANGED = {
    "weights=extrapolating": "Weights (1 + α, −α)",
    "weights=extrapolating+gain_unit=phi_in_degrees": "… with φ in degrees",
    "weights=extrapolating+Delta_unit=deg": "… with Δ in degrees",
    "weights=extrapolating+Delta_unit=deg+feedback=motor": "… with Δ in degrees and motor encoders",
}
"""Readings of the ensemble that the picture and the table of findings show, and what a reader calls them."""

HEADS = ("interpretation", "plants", "published order", "Controller 1 first", "reverse order", "error 1 / 2")
"""Heads of `robustness`; the last is the median ratio of the MAE of Controllers 1 and 2 on joint 2."""


def labelled(summary: Mapping[str, Any], labels: Mapping[str, str]) -> list[tuple[str, Mapping[str, Any]]]:
    """Labels and readings of a stored ensemble, where it has the reading."""
    stored = by_name(summary)
    return [(label, stored[name]) for name, label in labels.items() if name in stored]


def robustness(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table that says what the answer depends on, as text."""
    (label, printed), *others = labelled(summary, AS_PUBLISHED | CHANGED)
    rows = [(label, printed), ("… diverged controllers ranked last", printed["diverged_last"])]
    if "firm" in summary["populations"]:
        rows.append(("… better known parameters alone varied", by_name(summary, "firm")["printed"]))
    return [_cells(*row) for row in rows + others]


def _cells(label: str, reading: Mapping[str, Any]) -> tuple[str, ...]:
    shares = (percent(reading[key]["share"]) for key in ("in_order", "first_best", "in_reverse"))
    ratio = reading["c1_c2"]["joint_2"]["median"] if "c1_c2" in reading else None
    return label, f"{reading['in_order']['plants']:,}", *shares, "–" if ratio is None else f"{ratio:.2f}"
