"""What `identify` found as tables, and the best plant as a configuration of `compare`."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.strict_yaml import dump
from tendonrepro.files import write_atomically
from tendonrepro.identification.misfit import METRICS, Printed, Simulated
from tendonrepro.identification.search import switched_by
from tendonrepro.monte_carlo.box import Box
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.results.tables import Table
from tendonrepro.studies.outcome import Outcome

CONFIG = "identified.yaml"
"""The best plant of all."""

PLANTS = "plants"
"""Folder with the best plant under each reading."""

AT_BOUND = 0.01
"""Share of a row's range within which the best plant counts as at its bound."""

_DRAWN = "assumed: draw from the box, "
_HELD = "not searched but of the arm at the start, "
_OF_JOINT = re.compile("(_joint)?_[23]$")
"""End of a row's name that a source leaves out."""
_CAPTIONS = {
    "numbers": "Printed numbers, the best plant's, and the range of the seeds' plants that come near.",
    "best_shape": "What of the best plant needs no scale: order of the controllers and RMSE over MAE.",
    "parameters": "Every row of the box on the best plant, and on the seeds' plants that come near.",
}
"""Of tables with rows of every reading, by key."""

_OF_READINGS = ("name", "misfit_log", "misfit_rounding", "seeds_agree", "near_count")
_OF_NUMBERS = ("run", "metric", "joint", "ours_deg", "printed_deg", "ratio", "lowest_deg", "highest_deg")
"""Columns for a terminal."""


def best_of(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """The reading that fits best."""
    found: Mapping[str, Any] = min(data["readings"], key=lambda held: held["misfit_log"])
    return found


def outcome(data: Mapping[str, Any]) -> Outcome:
    """Everything that is written and shown."""
    from tendonrepro.identification.figures import draw_numbers

    readings, best = data["readings"], best_of(data)
    scalars = [{k: v for k, v in held.items() if not isinstance(v, list)} for held in readings]
    caption = "Best plant under each reading; misfit as root mean square of log(ours/printed)."
    title = f"Best plant, reading {best['name']}."
    parts: list[Table | str] = [
        "\n".join(data["conclusions"]),
        Table("identify_readings", caption, scalars, terminal=_OF_READINGS),
        Table("identify_best", title, best["numbers"], terminal=_OF_NUMBERS),
        *(_gathered(readings, key) for key in _CAPTIONS),
        f"tendonrepro compare --config {data['config']} shows the best plant's traces.",
    ]
    return Outcome(data, parts, {"identify_numbers": partial(draw_numbers, best)})


def _gathered(readings: list[dict[str, Any]], key: str) -> Table:
    rows = [{"reading": reading["name"], **row} for reading in readings for row in reading[key]]
    return Table(f"identify_{key.removeprefix('best_')}", _CAPTIONS[key], rows, terminal=())


def conclusions(data: Mapping[str, Any]) -> list[str]:
    """Whether a plant fits under the first reading."""
    first = data["readings"][0]
    target = "Controller 2's four numbers" if data["fit"] == "controller_2" else "all sixteen numbers"
    answer = "A plant within the box gives" if first["fits"] else "No plausible plant found for"
    size = (
        f"{first['misfit_log']:.3g} in log ratio, {first['misfit_rounding']:.3g} half units of the last digit"
    )
    return [f"{answer} {target} under {first['name']}: best misfit {size}."]


def write_config(path: Path, config: CompareConfig, data: Mapping[str, Any], held: Mapping[str, Any]) -> None:
    """Write the best plant under a reading as a configuration, and read it back as a check."""
    numbers = "Tables 2 and 3" if data["fit"] == "all" else "Controller 2 of Table 2"
    source = f"identified: {numbers}, misfit {held['misfit_log']:.2g}, "
    searched = "|".join(f"{row}|{_OF_JOINT.sub('', row)}" for row in held["rows_searched"])

    def told(drawn: re.Match[str]) -> str:
        """Where a number comes from: a row that was searched, or one that kept what the arm has."""
        is_searched = re.search(rf"\b({searched})\b", drawn[1])
        return source + ("" if is_searched else _HELD) + drawn[1]

    text = re.sub(f'{_DRAWN}([^"]*)', told, config.model_dump_json(exclude_none=True))
    tree = json.loads(text, parse_float=_whole)
    tree["title"] = f"{config.title}, plant fitted to {numbers}"
    path.parent.mkdir(exist_ok=True)
    write_atomically(path, _head(numbers, data, held) + dump(tree))
    load_config(path, "compare")


def _whole(text: str) -> float:
    """An integer where it is whole: the schema wants counts to be."""
    return int(float(text)) if float(text).is_integer() else float(text)


def _head(numbers: str, data: Mapping[str, Any], held: Mapping[str, Any]) -> str:
    bounds = [f"{row['name']} ({row['at_bound']})" for row in held["parameters"] if row["at_bound"]]
    return f"""\
# Fitted to {numbers} of the paper under the reading {held["name"]},
# by {_command(data, held)}.
# Misfit {held["misfit_log"]:.3g}, root mean square of log(ours/printed), by the compiled stepper.
# It proves nothing: what was fitted to the print cannot be evidence for it.
# Searched, the other rows of the box kept what the arm has: {", ".join(held["rows_searched"])}.
# At a bound of the box: {", ".join(bounds) or "none of them"}.

"""


def _command(data: Mapping[str, Any], held: Mapping[str, Any]) -> str:
    """What makes the search again, on lines of a heading."""
    asked = [f"--fit {data['fit']}", f"--window {data['window']}", f"--readings {held['name']}"]
    names = ("generations", "population", "seeds", "unknowns")
    effort = [f"--{name} {data[name]}" for name in names]
    rows = [f"--rows {','.join(data['rows'])}"] if data["rows"] else []
    changes = [f"--set {shlex.quote(change)}" for change in data["overrides"]]
    lines = [" ".join(part) for part in (asked, effort, rows, *[[change] for change in changes]) if part]
    return "\n# ".join(["tendonrepro identify " + lines[0], *lines[1:]])


def number_rows(plants: Simulated, printed: Printed, fitted: tuple[str, ...]) -> list[dict[str, Any]]:
    """Every printed number, the first plant's, and the range of those whose run is ok."""
    rows = []
    for (r, m, i), goal in np.ndenumerate(printed.values):
        ours = float(plants.sizes[0, r, m, i])
        sizes = plants.sizes[plants.ok[:, r], r, m, i]
        low, high = (sizes.min(), sizes.max()) if sizes.size else (np.nan, np.nan)
        rows.append(
            {
                "run": RUNS[r],
                "metric": METRICS[m],
                "joint": printed.joints[i],
                "fitted": RUNS[r] in fitted,
                "printed_deg": float(goal),
                "ours_deg": ours,
                "ratio": ours / float(goal),
                "lowest_deg": float(low),
                "highest_deg": float(high),
            }
        )
    return rows


def shape_rows(best: Simulated, printed: Printed) -> list[dict[str, Any]]:
    """Order of the controllers and RMSE over MAE, ours and printed."""
    rows = []
    for i, joint in enumerate(printed.joints):
        row: dict[str, Any] = {"joint": joint}
        for name, sizes in {"ours": best.sizes[0, ..., i], "printed": printed.values[..., i]}.items():
            for m, metric in enumerate(METRICS):
                order = np.argsort(sizes[: len(CONTROLLERS), m], kind="stable")
                row[f"{name}_order_{metric}"] = " < ".join(str(k + 1) for k in order)
            for r, run in enumerate(RUNS):
                row[f"{name}_rmse_over_mae_{run}"] = float(sizes[r, 1] / sizes[r, 0])
        rows.append(row)
    return rows


def parameter_rows(box: Box, units: Array) -> list[dict[str, Any]]:
    """Every row of the box at points (N, P), the best first.

    What the best plant has switched off is at no bound.
    """
    values, best = box.values(units), units[0]
    off = [p for p, choices in enumerate(box.choices) if choices.size and values[0, p] == 0.0]
    idle = set().union(*(switched_by(box.names[p]) for p in off))
    rows = []
    for p, name in enumerate(box.names):
        is_choice, words = box.choices[p].size > 0, box.words[p]
        found = [words[int(value)] if words else float(value) for value in values[:, p]]
        can_lean = box.free[p] and not is_choice and name not in idle
        rows.append(
            {
                "name": name,
                "unit": box.units[p],
                "low": float(box.low[p]),
                "high": float(box.high[p]),
                "searched": bool(box.free[p]),
                "choice": is_choice,
                "best": found[0],
                "at_bound": _bound(best[p]) if can_lean else None,
                "plants": found,
            }
        )
    return rows


def _bound(unit: float) -> str | None:
    return "low" if unit < AT_BOUND else "high" if unit > 1.0 - AT_BOUND else None
