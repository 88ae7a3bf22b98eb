"""A verdict, and the ledger of all: which ensemble judged them, as ``claims.json`` has them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from operator import attrgetter

from tendonrepro.files import Json, read_json, shipped
from tendonrepro.monte_carlo.shares import Share
from tendonrepro.verdicts.rules import VERDICTS, Evidence

SCHEMA_VERSION = 1
SHARE = "share of the box"
"""Unit of a claim's share of the plants."""


@dataclass(frozen=True)
class ByChoice:
    """A verdict under another choice of what the paper leaves open, and our share or number under it.

    `opposite` is the share of plants on which the opposite of a claim holds.
    """

    reading: str
    verdict: str
    ours: float | None
    opposite: float | None = None


@dataclass(frozen=True)
class Verdict:
    """One line of the ledger; its fields are the keys of ``claims.json``.

    `ours` is a claim's share, or a number's median over the box. What `repeats` another entry is not counted.
    `shipped` is from the package's ensemble. `by_choice` has the verdict under each other choice of motion,
    starts, reference and friction of a run that was run. `false_contradicted` is the share of made-up papers,
    right and as published, that this rule contradicts.
    """

    id: str
    where: str
    kind: str
    printed: str
    ours: float | None
    unit: str | None
    rule: str
    verdict: str
    borderline: bool
    evidence: Evidence
    depends_on: tuple[str, ...]
    readings_that_change_it: tuple[str, ...]
    repeats: str | None = None
    shipped: bool = False
    by_choice: tuple[ByChoice, ...] = ()
    false_contradicted: Share | None = None

    @property
    def is_shown(self) -> bool:
        """Whether a page shows it: it counts, or it is a number over the plants that counts with a claim."""
        return self.repeats is None or self.kind == "ensemble"

    @property
    def unless(self) -> tuple[ByChoice, ...]:
        """Choices with another verdict, each with no more in it than that takes; `not_testable` is none."""
        changing = [
            choice for choice in self.by_choice if choice.verdict not in {self.verdict, "not_testable"}
        ]
        settings = {choice.reading: set(choice.reading.split("+")) for choice in changing}
        return tuple(
            choice
            for choice in changing
            if not any(fewer < settings[choice.reading] for fewer in settings.values())
        )


@dataclass(frozen=True)
class Ledger:
    """Verdicts by their ids, and which ensemble judged."""

    verdicts: Mapping[str, Verdict]
    ensemble: Json


def as_data(verdicts: Sequence[Verdict], ensemble: Json | None = None) -> dict[str, object]:
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
    rate = entry.get("false_contradicted")
    held = None if rate is None else Share(rate["share"], tuple(rate["interval"]), rate["plants"])
    return Verdict(**(known | lists | {"by_choice": choices, "false_contradicted": held}))


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


def origin_of(source: str, known: Json) -> Json:
    """Which ensemble judged, by what is known of it; ``local`` or ``shipped``."""
    keys = ("draws", "tendonrepro_version", "created", "rules_edition")
    return {"source": source} | {key: known.get(key) for key in keys}


def with_shipped(verdicts: Sequence[Verdict], ledger: Ledger) -> list[Verdict]:
    """Take from a ledger what waits for an ensemble, if its text and rule are the same."""
    keys = attrgetter("kind", "rule", "printed")

    def or_taken(verdict: Verdict) -> Verdict:
        stored = ledger.verdicts.get(verdict.id)
        waits = verdict.kind == "ensemble" and verdict.verdict == "not_testable"
        if stored is None or not waits or keys(verdict) != keys(stored):
            return verdict
        # The measurement is the one that is here, or none.
        evidence = {name: value for name, value in stored.evidence.items() if name != "measured"}
        here = {name: value for name, value in verdict.evidence.items() if name == "measured"}
        return replace(stored, evidence=evidence | here | {"ensemble": ledger.ensemble}, shipped=True)

    return [or_taken(verdict) for verdict in verdicts]
