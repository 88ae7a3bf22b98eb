"""The ledger: all verdicts, and which ensemble judged them, as ``claims.json`` has them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from operator import attrgetter
from typing import TypedDict, cast

from tendonrepro.files import Json, read_json, shipped
from tendonrepro.verdicts.rules import VERDICTS
from tendonrepro.verdicts.verdict import ByChoice, Verdict

SCHEMA_VERSION = 1


class Origin(TypedDict):
    """Which ensemble judged the claims."""

    source: str
    draws: int
    tendonrepro_version: str
    created: str
    rules_edition: int


@dataclass(frozen=True)
class Ledger:
    """Verdicts by their ids, and which ensemble judged."""

    verdicts: Mapping[str, Verdict]
    ensemble: Origin


def as_data(verdicts: Sequence[Verdict], ensemble: Origin | None = None) -> dict[str, object]:
    """Data of ``claims --json``; `ensemble` tells which one judged."""
    return {
        "schema_version": SCHEMA_VERSION,
        "claims": [asdict(verdict) for verdict in verdicts],
        "summary": summary(verdicts),
        "ensemble": ensemble,
    }


def read_ledger(content: Json) -> Ledger:
    """Ledger from what ``claims.json`` holds, of an earlier version too."""
    verdicts = map(_read_verdict, content["claims"])
    return Ledger({verdict.id: verdict for verdict in verdicts}, content["ensemble"])


def _read_verdict(entry: Json) -> Verdict:
    known = {field.name: entry[field.name] for field in fields(Verdict) if field.name in entry}
    lists = {name: tuple(known[name]) for name in ("depends_on", "readings_that_change_it")}
    choices = tuple(ByChoice(**choice) for choice in entry.get("by_choice", ()))
    return Verdict(**(known | lists | {"by_choice": choices}))


def summary(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count verdicts, without what repeats another."""
    counts = Counter(verdict.verdict for verdict in verdicts if verdict.repeats is None)
    return {name: counts[name] for name in VERDICTS}


def changed(before: Mapping[str, str], now: Iterable[Verdict]) -> dict[str, tuple[str, str | None]]:
    """Id -> verdicts before and now that differ, of those that were judged before; None: not judged now."""
    after = {verdict.id: verdict.verdict for verdict in now}
    return {name: (old, after.get(name)) for name, old in before.items() if old != after.get(name)}


def shipped_ledger() -> Ledger:
    """Read the ``claims.json`` of the package."""
    stored = read_ledger(read_json(shipped("docs/results") / "claims.json"))
    return replace(stored, ensemble=origin_of("shipped", stored.ensemble))


def origin_of(source: str, known: Mapping[str, object]) -> Origin:
    """Which ensemble judged, by what is known of it; ``local`` or ``shipped``."""
    keys = ("draws", "tendonrepro_version", "created", "rules_edition")
    return cast("Origin", {"source": source} | {key: known.get(key) for key in keys})


def with_shipped(verdicts: Sequence[Verdict], ledger: Ledger) -> list[Verdict]:
    """Take from a ledger what waits for an ensemble, if its text and rule are the same."""

    def or_taken(verdict: Verdict) -> Verdict:
        stored = ledger.verdicts.get(verdict.id)
        waits = verdict.kind == "ensemble" and verdict.verdict == "not_testable"
        keys = attrgetter("kind", "rule", "printed")
        if stored is None or not waits or keys(verdict) != keys(stored):
            return verdict
        return _taken(verdict, stored, ledger.ensemble)

    return [or_taken(verdict) for verdict in verdicts]


def _taken(waiting: Verdict, stored: Verdict, origin: Origin) -> Verdict:
    # The run of the shipped plant and the measurement are those that are here, or none.
    here = {name: waiting.evidence.get(name) for name in ("shipped_run", "measured")}
    evidence = {**stored.evidence, **here, "ensemble": origin}
    return replace(
        waiting,
        ours=stored.ours if here["shipped_run"] is None else waiting.ours,
        verdict=stored.verdict,
        borderline=stored.borderline,
        evidence={name: value for name, value in evidence.items() if value is not None},
        readings_that_change_it=stored.readings_that_change_it,
        by_choice=stored.by_choice,
        shipped=True,
    )
