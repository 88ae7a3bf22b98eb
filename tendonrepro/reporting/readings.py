"""What pages show of an ensemble: a row for each interpretation, a column for each number.

A user's own comes from ``summary.json``, that of the package from ``docs/results/readings.csv``.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from tendonrepro.files import Json, read_json
from tendonrepro.monte_carlo.report import COLUMNS, rows_of

Row: TypeAlias = dict[str, float]
"""Numbers of one interpretation, by the columns of `COLUMNS`; NaN where there are no plants."""


class Shown(NamedTuple):
    """An ensemble as pages show it.

    `plants` is how many were drawn of each population; `readings` are rows by population and name.
    """

    plants: dict[str, int]
    readings: dict[str, dict[str, Row]]

    @property
    def box(self) -> dict[str, Row]:
        """Rows of the population by which claims are judged."""
        return self.readings["box"]


HEAD = ("tendonrepro_version", "config_sha256", "draws", "scramblings", "cost")
"""Keys of ``summary.json`` that ``docs/results/ensemble.json`` holds beside the drawn plants."""


def head_of(summary: Json) -> Json:
    """What ``docs/results/ensemble.json`` holds: what made the ensemble, and how many plants were drawn."""
    plants = {name: held["plants"] for name, held in summary["populations"].items()}
    return {**{key: value for key, value in summary.items() if key in HEAD}, "plants": plants}


def shown(summary: Json) -> Shown:
    """What pages show of an ensemble; a KeyError for one of an older version that lacks some of it."""
    return _shown(head_of(summary), rows_of(summary))


def read_shown(folder: Path) -> Shown:
    """The ensemble that the package stores."""
    with (folder / "readings.csv").open(encoding="utf-8", newline="") as file:
        return _shown(read_json(folder / "ensemble.json"), csv.DictReader(file))


def _shown(head: Json, table: Iterable[Mapping[str, Any]]) -> Shown:
    rows: dict[str, dict[str, Row]] = {name: {} for name in head["plants"]}
    for row in table:
        numbers = {
            column: math.nan if row[column] in ("", None) else float(row[column]) for column in COLUMNS
        }
        rows[row["population"]][row["reading"]] = numbers
    return Shown(head["plants"], rows)
