"""Tables of what the paper does not give: values, and ranges to draw from; for docs and page alike."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tendonrepro.configuration.ensemble import load_ensemble

BOX = ("Row", "Range or choices", "Nominal", "Unit", "Scale", "Confidence", "From")
VALUES = ("Key", "Value", "Unit", "Origin", "Why")
"""Heads of the tables."""


def box() -> list[tuple[str, ...]]:
    """Ranges that plants are drawn from."""
    rows: list[tuple[str, ...]] = []
    for name, row in load_ensemble(None).config.box:
        held = row.model_dump()
        choices = [item if isinstance(item, str) else f"{item:g}" for item in held.get("choices", ())]
        extent = ", ".join(choices) or f"{held['low']:g} to {held['high']:g}"
        nominal = held["nominal"] if isinstance(held["nominal"], str) else f"{held['nominal']:g}"
        unit, scale = held.get("unit", "–"), held.get("scale", "choice")
        rows.append((f"`{name}`", extent, nominal, unit, scale, held["confidence"], held["source"]))
    return rows


def quantities(tree: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Quantities of a configuration by their keys."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


def values(trees: Sequence[Any]) -> list[tuple[str, ...]]:
    """Quantities of some configurations, in the columns of `VALUES`; of each key the first."""
    held = {key: quantity for tree in reversed(trees) for key, quantity in quantities(tree)}
    order = dict.fromkeys(key for tree in trees for key, _ in quantities(tree))
    rows: list[tuple[str, ...]] = []
    for key in order:
        origin, _, why = held[key]["source"].partition(": ")
        rows.append((f"`{key}`", json.dumps(held[key]["value"]), held[key]["unit"], origin, why))
    return rows
