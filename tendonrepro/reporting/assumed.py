"""Tables of what the paper does not give: values, ranges to draw from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tendonrepro.configuration.ensemble import load_ensemble

BOX = ("Row", "Range or choices", "Nominal", "Unit", "Scale", "Confidence", "From")
VALUES = ("Key", "Value", "Unit", "Origin", "Why")
"""Heads of the tables."""


def box() -> Iterator[tuple[str, ...]]:
    """Yield the ranges that plants are drawn from, as `BOX`."""
    for name, row in load_ensemble(None).config.box:
        held = {"unit": "–", "scale": "choice"} | row.model_dump()
        extent = ", ".join(map(_short, held.get("choices", ()))) or f"{held['low']:g} to {held['high']:g}"
        texts = [held[key] for key in ("unit", "scale", "confidence", "source")]
        yield f"`{name}`", extent, _short(held["nominal"]), *texts


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def quantities(tree: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Quantities of a configuration by their keys."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


def values(trees: Sequence[Any]) -> list[tuple[str, ...]]:
    """Quantities of some configurations, as `VALUES`; of each key the first."""
    held: dict[str, Mapping[str, Any]] = {}
    for key, quantity in (pair for tree in trees for pair in quantities(tree)):
        held.setdefault(key, quantity)
    rows: list[tuple[str, ...]] = []
    for key, quantity in held.items():
        origin, _, why = quantity["source"].partition(": ")
        rows.append((f"`{key}`", json.dumps(quantity["value"]), quantity["unit"], origin, why))
    return rows
