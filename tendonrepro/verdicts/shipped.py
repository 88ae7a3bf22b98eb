"""Verdicts of the large ensemble that come with the package, for whoever has run none."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

from tendonrepro.errors import DataMissingError
from tendonrepro.files import digest_of, shipped
from tendonrepro.results.store import MANIFEST, read_manifest
from tendonrepro.verdicts.judge import Verdict
from tendonrepro.verdicts.rules import EDITION

SHIPPED = "docs/results/claims.json"
"""The stored ledger, from which docs/findings.md is made too."""

_ORIGIN = ("draws", "tendonrepro_version", "created", "rules_edition")


@dataclass(frozen=True)
class ShippedLedger:
    """Stored entries by id, as in ``claims --json``, and what is known of their ensemble."""

    entries: Mapping[str, Mapping[str, Any]]
    ensemble: Mapping[str, Any]


def shipped_ledger() -> ShippedLedger:
    """Read the ledger that comes with the package.

    Raises
    ------
    DataMissingError
        If it is missing or damaged.
    """
    folder, _, name = SHIPPED.rpartition("/")
    path = shipped(folder) / name
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored.pop("sha256", None) != digest_of(stored):
            raise ValueError
        entries = {entry["id"]: entry for entry in stored["claims"]}
        known = stored.get("ensemble") or {}
        ensemble = {"source": "shipped"} | {key: known.get(key) for key in _ORIGIN}
    except (OSError, ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        message = "the verdicts that come with the package are missing or damaged"
        raise DataMissingError(message, where=str(path), hint="install tendonrepro again") from error
    return ShippedLedger(entries, ensemble)


def local_origin(folder: Path, identity: str, draws: int) -> dict[str, Any]:
    """What is known of an ensemble in a results folder, as `ShippedLedger.ensemble`."""
    manifest = read_manifest(folder) if (folder / MANIFEST).exists() else {}
    # While an ensemble is extended the manifest of the earlier one stands there.
    ours = manifest.get("config", {}).get("sha256") == identity
    known = (manifest if ours else {}) | {"draws": draws, "rules_edition": EDITION}
    return {"source": "local"} | {key: known.get(key) for key in _ORIGIN}


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
    needed = {one.name for one in fields(Verdict) if one.default is MISSING}
    same = all(entry.get(key) == getattr(waiting, key) for key in ("kind", "rule", "printed"))
    if not same or not needed <= entry.keys():
        return waiting
    stored = Verdict(**{name: entry[name] for name in needed})
    # The run of the shipped plant and the measurement are those that are here, or none.
    own = ("shipped_run", "measured")
    evidence = {name: value for name, value in stored.evidence.items() if name not in own}
    here = {name: waiting.evidence[name] for name in own if name in waiting.evidence}
    return replace(
        stored,
        ours=waiting.ours if "shipped_run" in here else stored.ours,
        evidence=evidence | here | {"ensemble": ledger.ensemble},
        depends_on=tuple(stored.depends_on),
        readings_that_change_it=tuple(stored.readings_that_change_it),
        repeats=waiting.repeats,
        shipped=True,
    )
