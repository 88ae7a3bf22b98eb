"""Orders of the three controllers by their errors, under several ways to understand the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tendonrepro.reporting.answer import percent

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


@dataclass(frozen=True)
class Orders:
    """Shares of the orders of three controllers under one reading; they add up to 1.

    Attributes
    ----------
    reading, label : str
        Name of the reading in the ensemble, and in words.
    plants : int
        Plants on which all three controllers are stable.
    shares : mapping
        ``published`` (1, 2, 3), ``first`` (another order with Controller 1 first), ``other`` and ``reverse``
        (3, 2, 1); an order has to hold in MAE and RMSE on both joints. None of them where no plant is left.
    ratio : float or None
        Median of Controller 1's MAE over Controller 2's on joint 2.
    """

    reading: str
    label: str
    plants: int
    shares: Mapping[str, float]
    ratio: float | None


def orders(summary: Mapping[str, Any], labels: Mapping[str, str]) -> list[Orders]:
    """Orders under those readings of a stored ensemble that have a label, in the order of the labels."""
    stored = {reading["name"]: reading for reading in summary["populations"]["box"]["readings"]}
    return [_orders(stored[name], label) for name, label in labels.items() if name in stored]


def _orders(reading: Mapping[str, Any], label: str) -> Orders:
    plants = reading["in_order"]["plants"]
    published, first, reverse = (reading[key]["share"] for key in ("in_order", "first_best", "in_reverse"))
    shares = {}
    if plants:
        between = {"first": first - published, "other": 1.0 - first - reverse}
        shares = {"published": published, **between, "reverse": reverse}
    return Orders(reading["name"], label, plants, shares, reading["c1_c2"]["joint_2"]["median"])


HEADS = ("interpretation", "plants", "published order", "Controller 1 first", "reverse order", "error 1 / 2")
"""Heads of `robustness`; the last is the median ratio of the MAE of Controllers 1 and 2 on joint 2."""


def robustness(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Rows of the table that says what the answer depends on, as text."""
    published, *others = orders(summary, AS_PUBLISHED | CHANGED)
    (last,) = (
        held for held in summary["populations"]["box"]["readings"] if held["name"] == published.reading
    )
    shares = [last["diverged_last"][key] for key in ("in_order", "first_best", "in_reverse")]
    counted = ("… diverged controllers ranked last", f"{shares[0]['plants']:,}")
    rows = [_cells(published), (*counted, *(percent(share["share"]) for share in shares), "–")]
    if "firm" in summary["populations"]:
        firm = {"populations": {"box": summary["populations"]["firm"]}}
        rows += [
            _cells(found) for found in orders(firm, {"printed": "… better known parameters alone varied"})
        ]
    return rows + [_cells(found) for found in others]


def _cells(found: Orders) -> tuple[str, ...]:
    shares = found.shares
    first = shares["published"] + shares["first"] if shares else None
    ratio = "–" if found.ratio is None else f"{found.ratio:.2f}"
    cells = (shares.get("published"), first, shares.get("reverse"))
    return (found.label, f"{found.plants:,}", *map(percent, cells), ratio)
