"""What pages show of an ensemble, and what the report says, findings.md and tables.md too.

An ensemble is shown as a row for each interpretation, a column for each number. A user's own comes from
``summary.json``, that of the package from ``docs/results/readings.csv``.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import jinja2

from tendonrepro.configuration.ensemble import load_ensemble
from tendonrepro.configuration.models.readings import EVERY_RUN, SHOWN
from tendonrepro.configuration.strict_yaml import Node
from tendonrepro.files import Json, read_json
from tendonrepro.monte_carlo.report import COLUMNS, rows_of
from tendonrepro.verdicts.words import percent, two_digits

Row: TypeAlias = dict[str, float]
"""Numbers of one interpretation, by the columns of `COLUMNS`; NaN where there are no plants."""


class Shown(NamedTuple):
    """An ensemble of the paper's ranges as pages show it: how many plants were drawn, and rows by reading."""

    plants: int
    box: dict[str, Row]


HEAD = ("tendonrepro_version", "config_sha256", "draws", "scramblings", "cost")
"""Keys of ``summary.json`` that ``docs/results/ensemble.json`` holds beside the drawn plants."""


def head_of(summary: Json) -> Json:
    """What ``docs/results/ensemble.json`` holds: what made the ensemble, and how many plants were drawn."""
    plants = {name: held["plants"] for name, held in summary["populations"].items()}
    return {**{key: value for key, value in summary.items() if key in HEAD}, "plants": plants}


def shown(summary: Json) -> Shown:
    """What pages show of an ensemble; a KeyError for one of another population, or that lacks some of it."""
    return _shown(head_of(summary), rows_of(summary))


def read_shown(folder: Path) -> Shown:
    """The ensemble that the package stores."""
    with (folder / "readings.csv").open(encoding="utf-8", newline="") as file:
        return _shown(read_json(folder / "ensemble.json"), csv.DictReader(file))


def _shown(head: Json, table: Iterable[Mapping[str, Any]]) -> Shown:
    rows = {
        row["reading"]: {
            column: math.nan if row[column] in ("", None) else float(row[column]) for column in COLUMNS
        }
        for row in table
        if row["population"] == "box"
    }
    return Shown(head["plants"]["box"], rows)


TEMPLATES = Path(__file__).with_name("templates")
WORDS = ("headline", "drawn", "answer", "why", "robustness", "assumed")
"""Templates of what is said of an ensemble."""

BOX_HEADS = ("Row", "Range or choices", "Nominal", "Unit", "Scale", "Confidence", "From")
VALUE_HEADS = ("Key", "Value", "Unit", "Origin", "Why")
"""Heads of `box_rows` and `value_rows`."""


def environment(*folders: Path, html: bool = False) -> jinja2.Environment:
    """Read templates of folders, and those of the report, with filters for shares, ratios and counts."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, TEMPLATES]),
        undefined=jinja2.StrictUndefined,
        autoescape=html,
        trim_blocks=True,
    )
    made.filters |= {"thousands": "{:,.0f}".format, "percent": percent, "ratio": two_digits}
    return made


def rendered(
    name: str,
    shown: Shown,
    *folders: Path,
    filters: Mapping[str, Callable[..., object]] | None = None,
    **known: object,
) -> str:
    """Text of a template over the rows of an ensemble, one of `WORDS` or of other folders."""
    templates = environment(*folders)
    templates.filters |= filters or {}
    known |= {"r": shown.box, "drawn": shown.plants}
    known |= {"labels": SHOWN, "conditions": f"Every run {EVERY_RUN}."}
    return templates.get_template(f"{name}.md").render(**known).strip()


def shown_in_words(summary: Json) -> Shown | None:
    """What pages show of a user's own ensemble, if it is of the paper and has all that `WORDS` speak of."""
    if not summary["of_paper"]:
        return None
    try:
        own = shown(summary)
        for name in WORDS:
            rendered(name, own)
    except (KeyError, jinja2.UndefinedError):
        # Its population has another name, it lacks interpretations, or it is of an older version.
        return None
    return own


def box_rows() -> Iterator[tuple[str, ...]]:
    """Yield the ranges that plants are drawn from, from the shipped ensemble, as `BOX_HEADS`."""
    for name, row in load_ensemble(None).config.box:
        entry = {"unit": "–", "scale": "choice"} | row.model_dump()
        extent = ", ".join(map(_short, entry.get("choices", ()))) or f"{entry['low']:g} to {entry['high']:g}"
        texts = [entry[key] for key in ("unit", "scale", "confidence", "source")]
        yield f"`{name}`", extent, _short(entry["nominal"]), *texts


def _short(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def quantities(tree: Node, path: tuple[str, ...] = ()) -> Iterator[tuple[str, dict[str, Node]]]:
    """Quantities of a configuration by their keys."""
    if isinstance(tree, dict) and {"value", "unit", "source"} <= tree.keys():
        yield ".".join(path), tree
    elif isinstance(tree, dict):
        for key, value in tree.items():
            yield from quantities(value, (*path, str(key)))


def value_rows(trees: Sequence[Node]) -> list[tuple[str, ...]]:
    """Quantities of some configurations, as `VALUE_HEADS`; of each key the first."""
    first: dict[str, dict[str, Node]] = {}
    for key, quantity in (pair for tree in trees for pair in quantities(tree)):
        first.setdefault(key, quantity)
    rows: list[tuple[str, ...]] = []
    for key, quantity in first.items():
        origin, _, why = str(quantity["source"]).partition(": ")
        rows.append((f"`{key}`", json.dumps(quantity["value"]), str(quantity["unit"]), origin, why))
    return rows
