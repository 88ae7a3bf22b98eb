"""Tables of what the paper does not print: values, ranges to draw from, readings; for docs and page alike."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from tendonrepro.config.ensemble import load_ensemble
from tendonrepro.config.models.control import Readings
from tendonrepro.config.models.readings import AXES, RUNS
from tendonrepro.report.answer import percent
from tendonrepro.report.rows import Table, above_chance, decided


def box(rankings: Mapping[str, Any] | None = None) -> Table:
    """Ranges that plants are drawn from; with rankings also what each row decides."""
    heads = ["Row", "Range or choices", "Nominal", "Unit", "Scale", "Confidence", "From"]
    rows = []
    for name, row in load_ensemble(None).config.box.items():
        held = row.model_dump()
        choices = [item if isinstance(item, str) else f"{item:g}" for item in held.get("choices", ())]
        extent = ", ".join(choices) or f"{held['low']:g} to {held['high']:g}"
        nominal = held["nominal"] if isinstance(held["nominal"], str) else f"{held['nominal']:g}"
        unit, scale = held.get("unit", "–"), held.get("scale", "choice")
        rows.append([f"`{name}`", extent, nominal, unit, scale, held["confidence"], held["source"]])
        if rankings is not None:
            rows[-1].append(_decides(name, rankings))
    return Table([*heads, *["Decides"] * (rankings is not None)], rows)


def _decides(row: str, rankings: Mapping[str, Any]) -> str:
    """What a row of the box decides, above chance."""
    shares = {of: above_chance(ranking).get(row) for of, ranking in rankings.items()}
    return ", ".join(f"{decided(of)} {percent(share)}" for of, share in shares.items() if share) or "–"


def readings() -> Table:
    """Places of the paper that can be read in more than one way."""

    def runs(affects: Mapping[str, tuple[str, ...]]) -> str:
        named = {value: "all" if held == RUNS else ", ".join(held) for value, held in affects.items()}
        each = [f"{value}: {held}" for value, held in named.items()]
        return named.popitem()[1] if len(set(named.values())) == 1 else "; ".join(each)

    rows = []
    for axis in AXES.values():
        key = f"`control.readings.{axis.name}`" if axis.name in Readings.model_fields else f"`{axis.name}`"
        rows.append(
            (key, axis.printed, ", ".join(axis.alternatives), runs(axis.affects), axis.place, axis.about)
        )
    return Table(["Reading", "Default", "Alternatives", "Changes the runs", "Place", "About"], rows)


def quantities(tree: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Quantities of a configuration by their keys."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


def values(trees: Sequence[Any]) -> list[tuple[str, str, str, str, str]]:
    """Key, value, unit, origin and reason of every quantity of some configurations; of each key the first."""
    held = {key: quantity for tree in reversed(trees) for key, quantity in quantities(tree)}
    order = dict.fromkeys(key for tree in trees for key, _ in quantities(tree))
    rows = []
    for key in order:
        origin, _, why = held[key]["source"].partition(": ")
        rows.append((f"`{key}`", json.dumps(held[key]["value"]), held[key]["unit"], origin, why))
    return rows
