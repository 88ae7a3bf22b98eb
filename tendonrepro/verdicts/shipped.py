"""Verdicts of the large ensemble that come with the package, for whoever has run none."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tendonrepro.files import shipped
from tendonrepro.results.store import read_manifest
from tendonrepro.verdicts.judge import Verdict
from tendonrepro.verdicts.rules import EDITION

SHIPPED = "docs/results/claims.json"
"""The stored ledger, from which docs/findings.md is made too."""


@dataclass(frozen=True)
class ShippedLedger:
    """Stored entries by id, as in ``claims --json``, and what is known of their ensemble."""

    entries: Mapping[str, Mapping[str, Any]]
    ensemble: Mapping[str, Any]


def shipped_ledger() -> ShippedLedger:
    """Read the ledger that comes with the package."""
    folder, _, name = SHIPPED.rpartition("/")
    stored = json.loads((shipped(folder) / name).read_text(encoding="utf-8"))
    entries = {entry["id"]: entry for entry in stored["claims"]}
    return ShippedLedger(entries, _origin("shipped", stored["ensemble"]))


def local_origin(folder: Path, draws: int) -> dict[str, Any]:
    """What is known of an ensemble in a results folder, as `ShippedLedger.ensemble`."""
    return _origin("local", read_manifest(folder) | {"draws": draws, "rules_edition": EDITION})


def _origin(source: str, known: Mapping[str, Any]) -> dict[str, Any]:
    origin = ("draws", "tendonrepro_version", "created", "rules_edition")
    return {"source": source} | {key: known.get(key) for key in origin}


def with_shipped(verdicts: Sequence[Verdict], ledger: ShippedLedger) -> list[Verdict]:
    """Put the shipped verdict wherever one waits for an ensemble.

    A stored verdict counts only if it is of the number or claim of today, by the rule of the same name.
    """
    return [
        _taken(one, ledger) if one.kind == "ensemble" and one.verdict == "not_testable" else one
        for one in verdicts
    ]


def _taken(waiting: Verdict, ledger: ShippedLedger) -> Verdict:
    entry = ledger.entries.get(waiting.id, {})
    if any(entry.get(key) != getattr(waiting, key) for key in ("kind", "rule", "printed")):
        return waiting
    # The run of the shipped plant and the measurement are those that are here, or none.
    here = {name: waiting.evidence.get(name) for name in ("shipped_run", "measured")}
    evidence = {**entry["evidence"], **here, "ensemble": ledger.ensemble}
    return replace(
        waiting,
        ours=entry["ours"] if here["shipped_run"] is None else waiting.ours,
        verdict=entry["verdict"],
        borderline=entry["borderline"],
        evidence={name: value for name, value in evidence.items() if value is not None},
        readings_that_change_it=tuple(entry["readings_that_change_it"]),
        shipped=True,
    )
