"""Range of an error over plausible plants, from the stored ensemble: beside the paper's experiment alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache

from tendonrepro.configuration.models.readings import AXES
from tendonrepro.files import shipped
from tendonrepro.results.paper import of_paper
from tendonrepro.results.records import Trace, TraceFile

Range = tuple[float, float]
"""Ends of the central 90 %."""


def plausible_beside(file: TraceFile, trace: Trace, identifier: str) -> list[Range | None]:
    """Range of ``<identifier>.joint_<number>`` of each joint of a run, deg; None where none stands beside it.

    The plants are those of the shipped box that are stable under all three controllers, with the equations as
    printed (docs/verdicts.md); nothing stands beside a run under another reading.
    """
    readings = trace.attributes["readings"]
    as_printed = all(readings.get(axis.name, axis.printed) == axis.printed for axis in AXES.values())
    ranges: Mapping[str, Range] = _ranges() if as_printed and of_paper(file, trace) else {}
    return [ranges.get(f"{identifier}.joint_{joint}") for joint in trace.joint]


@cache
def _ranges() -> dict[str, Range]:
    """Ends by the identifiers of the ledger of claims; a number that is printed twice has one range."""
    stored = shipped("docs") / "results" / "claims.json"
    claims = json.loads(stored.read_text(encoding="utf-8"))["claims"]
    boxes = {claim["id"]: claim["evidence"].get("box", {}) for claim in claims}
    found = {name: (box["low"], box["high"]) for name, box in boxes.items() if "low" in box}
    for claim in claims:
        for source in claim["evidence"].get("from", ()) if claim["id"].startswith("table") else ():
            if source in found:
                found[claim["id"]] = found[source]
    return found
