"""What stands on the page, part by part, as plain values for its template."""

from __future__ import annotations

import json
import math
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from tendonrepro.claims.judge import SHARE, Verdict
from tendonrepro.claims.report import details_text, reader_rows
from tendonrepro.config.fields.strict_yaml import load
from tendonrepro.config.load import load_config
from tendonrepro.config.published import published, quotient
from tendonrepro.report.answer import percent
from tendonrepro.report.figures import Figure, figure_of
from tendonrepro.report.sources import MISSING, RUN, Found
from tendonrepro.results.figures.catalogue import FIGURES, available, draw
from tendonrepro.results.paper_tables import made_tables, ranking_rows
from tendonrepro.results.records import TraceFile
from tendonrepro.results.tables import shown

COMMANDS = {
    "decouple": "tendonrepro decouple",
    "compare": "tendonrepro compare",
    "ensemble": "tendonrepro ensemble",
    "decides": "tendonrepro claims",
    "closest": "tendonrepro identify --fit all --readings default --out reports/identify_all",
    "statics": "tendonrepro statics",
    "measured": "tendonrepro fetch, then inspect --suggest and ingest",
}
"""What makes each part."""

GROUPS = {
    "Follows from the print": ("exact", "reproduced"),
    "Agrees on plausible plants": ("compatible", "direction_only"),
    "Does not hold": ("contradicted", "not_reproduced", "outside_model"),
    "Depends on what is not printed": ("depends_on_plant",),
    "Cannot be tested": ("not_testable",),
}
"""Verdicts by what a reader wants to know first."""

_NUMBERS = {
    "table1": "ratios of Table 1",
    "table2": "errors of Table 2",
    "table3": "errors of Table 3, with payload",
    "rmse_over_mae": "quotients RMSE/MAE of Tables 2 and 3",
    "share": "ratios of section 5.3",
    "increase": "changes by the payload, section 5.4",
    "hardware": "encoder resolution",
}


def standing(one: Verdict) -> str:
    """On how many plants a claim holds, or what is missing to tell."""
    if "missing" in one.evidence:
        return f"missing: {one.evidence['missing']}"
    return f"holds on {percent(one.ours)} of the plants judged" if one.unit == SHARE else ""


def overview(verdicts: Sequence[Verdict]) -> Iterator[dict[str, Any]]:
    """Yield the groups: claims, and how many numbers of which table; what is printed twice counts once."""
    for title, names in GROUPS.items():
        held = [one for one in verdicts if one.verdict in names and one.repeats is None]
        numbers = Counter(
            _NUMBERS.get(one.id.partition(".")[0], one.where) for one in held if is_number(one.id)
        )
        claims = [one for one in held if not is_number(one.id)]
        yield {"title": title, "names": names, "claims": claims, "numbers": numbers}


def is_number(identifier: str) -> bool:
    """Whether an id is of a printed number, not of a claim."""
    return "." in identifier


def run_numbers(verdicts: Sequence[Verdict]) -> dict[str, float]:
    """Numbers of the run on the page, by id."""
    held = {one.id: one.evidence.get("shipped_run") for one in verdicts}
    return {name: number for name, number in held.items() if number is not None}


def ledger(verdicts: Sequence[Verdict]) -> list[dict[str, Any]]:
    """Lines of the ledger: the verdict, its cells for a reader, and all its evidence as text."""
    rows = zip(verdicts, reader_rows(verdicts), strict=True)
    return [{"verdict": one, "cells": cells, "evidence": details_text(one)} for one, cells in rows]


@dataclass(frozen=True)
class Bar:
    """A printed number beside the run of this page and the central 90 % of the plants judged."""

    id: str
    printed: str
    ours: float | None
    low: float
    median: float
    high: float


@dataclass(frozen=True)
class Bars:
    """Numbers on one scale, from `low` to `high`, logarithmic where they span more than a decade."""

    rows: Sequence[Bar]
    scale: Any

    @classmethod
    def of(cls, verdicts: Sequence[Verdict], start: str) -> Bars:
        """Take those entries whose id starts so and that were judged over plants."""
        rows = [
            Bar(one.id, one.printed, one.evidence.get("shipped_run"), box["low"], box["median"], box["high"])
            for one in verdicts
            if one.id.startswith(start)
            and None not in (box := one.evidence.get("box") or {"low": None}).values()
        ]
        return cls(rows, Scale.over([value for row in rows for value in _extent(row)]))


def _extent(row: Bar) -> list[float]:
    printed = [float(part) for part in row.printed.split(" to ")]
    return [row.low, row.high, *printed, *([] if row.ours is None else [row.ours])]


@dataclass(frozen=True)
class Scale:
    """A scale with some room at its ends."""

    low: float
    high: float
    logarithmic: bool

    @classmethod
    def over(cls, values: Sequence[float]) -> Scale:
        """Fit a scale to values; logarithmic where they are positive and span more than a decade."""
        low, high = min(values, default=0.0), max(values, default=1.0)
        if low > 0.0 and high > 10.0 * low:
            return cls(low / 1.1, high * 1.1, True)
        room = 0.04 * (high - low or 1.0)
        return cls(low - room, high + room, False)

    def place(self, value: float | str) -> float:
        """Place of a value, or of the middle of a printed range, in per cent of the width."""
        parts = [float(part) for part in str(value).split(" to ")]
        value = sum(parts) / len(parts)
        if self.logarithmic:
            share = math.log(value / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return round(100.0 * min(max(share, 0.0), 1.0), 2)


def agreement(summary: Mapping[str, Any]) -> list[tuple[str, list[tuple[Bar, bool] | None]]]:
    """Ratios C1/C2 and C2/C3 of the MAE on joints 2 and 3 by reading, and whether the printed is inside.

    A ratio that no plant gives is None.
    """
    rows = []
    for reading in summary["populations"]["box"]["readings"]:
        pairs = product(((1, 2), (2, 3)), (2, 3))
        rows.append((reading["name"], [_agreement(reading, *pair, joint) for pair, joint in pairs]))
    return rows


def _agreement(reading: Mapping[str, Any], first: int, second: int, joint: int) -> tuple[Bar, bool] | None:
    found, paper = reading[f"c{first}_c{second}"][f"joint_{joint}"], published()
    sizes = [paper.interval(f"table2.controller_{k}.mae.joint_{joint}") for k in (first, second)]
    low, high = map(float, quotient(*sizes))
    if found["median"] is None:
        return None
    bar = Bar(reading["name"], f"{low} to {high}", None, found["q05"], found["median"], found["q95"])
    return bar, found["q05"] <= high and low <= found["q95"]


RATIO = Scale(0.5, 2.0, True)
"""Scale of `agreement`, the same for all ratios."""


def tables(found: Found) -> dict[str, dict[str, Any]]:
    """Tables 1 to 3 and their companions, of the runs there are."""
    return {
        table.name: {"stem": table.name, "about": table.caption}
        | dict(zip(("heads", "rows", "numeric"), shown(table.rows, table.columns), strict=True))
        for file in (found.decouple, found.compare)
        if file
        for table in made_tables(file)
    }


def plates(found: Found) -> Iterator[dict[str, Any]]:
    """Yield Figures 6 and 9 to 16: as simulated, as measured; each None where there is none."""
    for number, spec in FIGURES.items():
        file = found.decouple if spec.experiment == "decouple" else found.compare
        simulated = figure_of(draw(number, file)) if file and number in available(file) else None
        about = {"number": number, "about": spec.caption, "experiment": spec.experiment}
        yield about | {"simulated": simulated, "measured": _measured(found, number)}


def _measured(found: Found, number: int) -> Figure | None:
    """A figure of the measurement, with the model on the measured motion where `validate` has run it."""
    from tendonrepro.validation.figures import available_overlays, draw_overlay

    if found.measured is None or number not in available_overlays(found.measured):
        return None
    models = found.simulated.runs if found.simulated else {}
    return figure_of(draw_overlay(number, found.measured, models))


def order(file: TraceFile | None) -> list[tuple[str, str, str]]:
    """Errors, orders of the controllers, best first, and what the print says; see `ranking_rows`."""
    names = ("errors", "order", "as_published")
    rows = ranking_rows(file) if file else ()
    return [tuple(str(row[name] or "") for name in names) for row in rows]  # type: ignore[misc]


def configurations(found: Found) -> list[Any]:
    """Configurations of the runs there are, the shipped ones of those that are missing."""
    files = {"compare": found.compare, "decouple": found.decouple}
    return [
        load(file.config_yaml, name).tree if file else load_config(None, name).tree  # type: ignore[arg-type]
        for name, file in files.items()
    ]


def made(file: TraceFile) -> dict[str, Any]:
    """Configuration, changes and versions that made the traces of a file; what it does not tell is a dash."""
    try:
        manifest = dict(json.loads(file.manifest_json))
    except (ValueError, TypeError):
        manifest = {}
    config, environment = manifest.get("config") or {}, manifest.get("environment") or {}
    git = environment.get("git") or {}
    commit = f"{git['commit'][:12]}{' with changes' * bool(git.get('dirty'))}" if git.get("commit") else "–"
    versions = {"tendonrepro": file.tendonrepro_version, "commit": commit}
    versions |= {"Python": environment.get("python") or "–", "platform": environment.get("platform") or "–"}
    versions |= {name: str(version or "–") for name, version in (environment.get("versions") or {}).items()}
    return {
        "experiment": file.experiment,
        "config": Path(str(config.get("origin", "–"))).name,
        "sha256": file.config_sha256,
        "overrides": [str(change) for change in manifest.get("overrides") or ()],
        "created": file.created,
        "versions": versions,
    }


def _option(change: str) -> list[str]:
    """Words of a command line for what a manifest lists among the changes."""
    key, _, value = change.partition("=")
    return [f"--{key}", value] if key in {"solver", "law"} else ["--set", change]


def again(found: Found) -> list[str]:
    """Commands that make this very page again, from nothing."""
    lines = []
    for name, file in (("decouple", found.decouple), ("compare", found.compare)):
        if file:
            held = made(file)
            config = [] if held["config"] in {"–", name, f"{name}.yaml"} else ["--config", held["config"]]
            changes = [word for change in held["overrides"] for word in _option(change)]
            lines.append(shlex.join(["tendonrepro", name, *config, *changes]))
    if lines == ["tendonrepro decouple", "tendonrepro compare"]:
        lines = ["tendonrepro reproduce"]
    if found.origins["ensemble"] == RUN:
        lines.append(f"tendonrepro ensemble --draws {found.judged_by.get('draws')}")
        lines += ["tendonrepro claims"] if found.decides else []
    lines += [COMMANDS[name] for name in ("closest", "statics") if found.origins[name] == RUN]
    if found.origins["measured"] != MISSING:
        lines.append(f"# the measurement: {COMMANDS['measured']}")
    lines += ["tendonrepro validate data/measured.h5"] if found.simulated else []
    return [*lines, "tendonrepro report"]
