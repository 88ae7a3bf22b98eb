"""What pages show of an ensemble: a row for each interpretation, a column for each number.

A user's own comes from ``summary.json``, that of the package from ``docs/results/readings.csv``.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from tendonrepro.files import Json, read_json
from tendonrepro.results.summary import CONTROLLERS

Row: TypeAlias = dict[str, float]
"""Numbers of one interpretation, by the columns of `COLUMNS`; NaN where there are no plants."""

_BOTH = "all_ok.mae_and_rmse.both"
_RANKINGS = {
    "order": "share_c1_lt_c2_lt_c3",
    "first": "share_c1_best",
    "last": "share_c1_worst",
    "reverse": "share_c3_lt_c2_lt_c1",
    "tie": "share_c2_ties_c3",
}
_RATIOS = {
    **{f"{name}_joint_{joint}": f"ratio_{name}.all_ok.mae.joint_{joint}"
       for name in ("c1_c2", "c2_c3") for joint in (2, 3)},
    "joint_3_over_2": "joint_3_over_2.controller_1.mae",
    "growth": "rmse_over_mae_growth.joint_2",
}  # fmt: skip
COLUMNS = {
    "plants": f"share_c1_best.{_BOTH}.plants",
    **{column: f"{key}.{_BOTH}.share" for column, key in _RANKINGS.items()},
    "behind": "share_c2_lt_c1.all_ok.mae.joint_2.share",
    "late": f"without_start.share_c1_worst.{_BOTH}.share",
    "smooth": "share_c1_smoother.share",
    "rises": "share_rmse_over_mae_rises.both.share",
    "plants_diverged_last": "share_c1_best.diverged_last.mae_and_rmse.both.plants",
    **{f"{column}_diverged_last": f"{_RANKINGS[column]}.diverged_last.mae_and_rmse.both.share"
       for column in ("order", "first", "last")},
    **{f"{column}_{quantile}": f"{key}.{quantile}.value"
       for column, key in _RATIOS.items() for quantile in ("q05", "median", "q95")},
    **{f"stable_{run}": f"status.{run}.ok.share" for run in CONTROLLERS},
}  # fmt: skip
"""Columns, and where each number stands among those of a reading in ``summary.json``.

Shares are of the plants on which all three controllers are stable. A place counts where it holds in MAE and
RMSE on both joints: `order` is the published one, `first` and `last` are Controller 1's, `late` is `last`
without the first two seconds. `behind` is Controller 1 behind 2 in the MAE of joint 2, `smooth` its torque
the smoothest, and `rises` RMSE over MAE from Controller 1 to 3.
"""


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


def rows_of(summary: Json) -> Iterator[dict[str, object]]:
    """Yield the rows of ``readings.csv``; a KeyError for a summary of an older version."""
    for population, held in summary["populations"].items():
        for reading in held["readings"]:
            numbers = {column: _at(reading, path) for column, path in COLUMNS.items()}
            yield {"population": population, "reading": reading["name"], **numbers}


def _at(reading: Any, path: str) -> float | None:
    """The number at a dotted path."""
    number: float | None = reduce(getitem, path.split("."), reading)
    return number


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
